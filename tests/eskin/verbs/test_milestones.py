"""Progress as lines of text."""

import io

from rich.console import Console

from eskin.verbs import milestones


def test_what_is_waited_for_is_told_with_the_count_that_there_is(monkeypatch):
    monkeypatch.setattr(milestones, "MILESTONE_S", 0.0)
    text = io.StringIO()
    with milestones.shown(Console(file=text), "stage") as notify:
        for count in ((0, 0), (51, 0), (0, 12)):
            notify("work", *count)
    assert {"stage, work", "stage, work: 51 so far", "stage, work: 0 of 12"} <= {
        *text.getvalue().splitlines()
    }
