"""Runs that look done and are not: each is made on purpose, and its banner says what was seen and what
helps."""

from __future__ import annotations

import dataclasses

import numpy as np

from eskin.golden.data.recordings import Recordings
from eskin.golden.training import recipe as recipes
from eskin.golden.training.choose_network import train_chosen
from eskin.pages.report import write_report
from tests.support.prices import priced
from tests.support.result_case import edit, make_result
from tests.support.table import each_row
from tests.support.touch_scenes import SMALL, scene

GROUPS = ["person"]
SAYS = {
    "worse than a baseline": ("the linear classifier on the same features decides", "points less"),
    "lost onsets": ("of 60 recordings show no touch, and count as wrong", "eskin inspect"),
    "lost class": (
        "pulse is found no more often than by guessing (pulse is mostly taken for",
        "record more of it, or join the classes",
    ),
}


def sound() -> Recordings:
    """Every recording is touched."""
    whole = scene(64, seed=7)
    return whole.subset(range(2, 62))


def lost_onsets() -> Recordings:
    """Of every sixth recording only the quiet frames before the touch are there."""
    made = sound()
    parts = [made.recording(index)[: 28 if index % 6 == 0 else None] for index in range(len(made))]
    return dataclasses.replace(made, samples=np.concatenate(parts), offsets=np.cumsum([0, *map(len, parts)]))


def lost_class() -> Recordings:
    """Two recordings of a class that look like another one's."""
    made = sound()
    labels = np.where(made.labels == 2, 1, made.labels)
    labels[np.flatnonzero(made.labels == 1)[[3, 9]]] = 2
    return dataclasses.replace(made, labels=labels)


def trained(kind: str, monkeypatch, folder) -> list[str]:
    """The doubts of a real training on recordings made for them."""
    updates = 4 if kind == "worse than a baseline" else 150
    few = {name: dataclasses.replace(recipe, updates=updates) for name, recipe in recipes.RECIPES.items()}
    monkeypatch.setattr(recipes, "RECIPES", few)
    recordings = {"lost onsets": lost_onsets, "lost class": lost_class}.get(kind, sound)()
    return train_chosen(recordings, SMALL, priced(), out=folder, cell="gru", group=GROUPS, folds=3, seeds=1)[
        "warnings"
    ]


@each_row("kind", [*SAYS, "sound"])
def test_a_doubtful_run_shows_its_banner_and_a_sound_one_none(kind, tmp_path, monkeypatch):
    warnings = trained(kind, monkeypatch, tmp_path / "model")
    result = make_result(tmp_path / "result")
    edit(result / "run.json", warnings=warnings)
    page = write_report(result).read_text()
    assert ('class="verdict warn"' in page, 'class="verdict good"' in page) == (
        kind != "sound",
        kind == "sound",
    ), warnings
    found = [sentence for sentence in warnings if all(part in sentence for part in SAYS.get(kind, ("",)))]
    assert len(found) == (kind != "sound"), warnings
    assert all(part in page for part in SAYS.get(kind, ()))
