"""tests/support/table.py: every row is played, in a folder of its own, and a failure names its row."""

import inspect

import pytest

from tests.support.table import each_row


def test_every_row_is_played_and_a_failure_names_it(tmp_path):
    played = []

    @each_row("first, second", [(1, 2), (3, 4), (5, 6)])
    @each_row("third", [0, (7,)])
    def play(tmp_path, first, second, third):
        assert not list(tmp_path.iterdir())
        played.append((first, second, third))
        assert first != 5

    assert list(inspect.signature(play).parameters) == ["tmp_path"]
    with pytest.raises(AssertionError) as failed:
        play(tmp_path=tmp_path)
    assert played == [(1, 2, 0), (1, 2, (7,)), (3, 4, 0), (3, 4, (7,)), (5, 6, 0)]
    assert failed.value.__notes__ == ["row 0: {'third': 0}", "row 2: {'first': 5, 'second': 6}"]
