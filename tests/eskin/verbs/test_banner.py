"""Runs that look done and are not: each is made on purpose, and its banner says what was seen and what
helps."""

import dataclasses

import numpy as np

from eskin.choose.choice import train_chosen
from eskin.golden.data import Recordings
from eskin.pages.report import write_report
from eskin.training import recipe as recipes
from tests.support.parts import of_parts
from tests.support.prices import priced
from tests.support.result_case import edit, make_result
from tests.support.table import each_row
from tests.support.touch_scenes import SMALL, scene

SAYS = [
    ("the linear classifier on the same features decides", "points less"),
    ("of 60 recordings show no touch, and count as wrong", "eskin inspect"),
    ("pulse", "found no more often than by guessing", "or join the classes"),
]


def doubtful(made: Recordings) -> Recordings:
    """Of every sixth recording only the quiet frames before the touch are there; two of a class look like another
    one's."""
    parts = [made.recording(index)[: 28 if index % 6 == 0 else None] for index in range(len(made))]
    labels = np.where(made.labels == 2, 1, made.labels)
    labels[np.flatnonzero(made.labels == 1)[[3, 9]]] = 2
    return of_parts(made, parts, labels=labels)


@each_row(("change", "updates"), [(doubtful, 4), (lambda made: made, 150)])
def test_a_doubtful_run_shows_its_banner_and_a_sound_one_none(change, updates, tmp_path, monkeypatch):
    """By the doubts of a real training."""
    few = {name: dataclasses.replace(recipe, updates=updates) for name, recipe in recipes.RECIPES.items()}
    monkeypatch.setattr(recipes, "RECIPES", few)
    recordings = change(scene(64, seed=7).subset(range(2, 62)))  # every one is touched
    options = dict(cell="gru", group=["person"], folds=3, seeds=1)
    warnings = train_chosen(recordings, SMALL, priced(), out=tmp_path / "m", **options)["warnings"]
    result = make_result(tmp_path / "result")
    edit(result / "run.json", warnings=warnings)
    page = write_report(result).read_text()
    doubted = change is doubtful
    assert ('class="verdict warn"' in page, 'class="verdict good"' in page) == (doubted, not doubted), (
        warnings
    )
    for parts in SAYS:
        said = [sentence for sentence in warnings if all(part in sentence for part in parts)]
        assert len(said) == doubted and all(part in page for part in parts) == doubted, (parts, warnings)
