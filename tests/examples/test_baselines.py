"""examples/thesis/baselines.py: each method learns a task it can learn, is counted right, and sees nothing of a part
that was left out."""

import ast
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from eskin.golden.core import content_key
from eskin.training.splits import split_folds
from examples.thesis import baselines
from examples.thesis.baselines import FLOAT_BYTES, Fitted, Method, Scene, method_row
from tests.support.result_case import ROW_KEYS
from tests.support.touch_scenes import SMALL, scene
from tests.test_imports import beyond, imports_of, modules


class Nearest(Method):
    """Decides as the nearest touch of the part."""

    def fit(self, scene, parts, seed):
        def decide(rows, part):
            x = scene.windows(part).reshape(len(scene.labels), -1)
            near = np.linalg.norm(x[rows][:, None] - x[part], axis=2).argmin(axis=1)
            return scene.labels[part][near]

        return [Fitted(partial(decide, part=part), len(part), len(part)) for part in parts]


def test_a_method_learns_the_scene_and_sees_no_label_of_the_test_part():
    """What can only be learnt by heart is not known of a part that was left out."""
    recordings, nearest = scene(60, seed=3), Nearest("nearest", "nearest touch")
    row = method_row(Scene.of(recordings, SMALL), (nearest, ("person",), (1,), 2))
    assert 42 / 60 < row["accuracy"] <= 59 / 60  # one recording is never touched
    assert row["train_s"] > 0 and row["decision_us"] > 0 and set(row) >= ROW_KEYS
    shuffled = replace(recordings, labels=np.random.default_rng(5).permutation(recordings.labels))
    assert method_row(Scene.of(shuffled, SMALL), (nearest, ("person",), (0,), 5))["accuracy"] < 0.5


@dataclass(frozen=True)
class Reader(Method):
    file: Path


def test_a_method_of_another_file_or_code_is_another(tmp_path, monkeypatch):
    reader, keys = Reader("a", "b", tmp_path / "file"), []
    for text in "aab":
        reader.file.write_text(text)
        keys.append(content_key(reader))
    monkeypatch.setattr(baselines, "code_version", str)
    assert keys[0] == keys[1] and len({*keys, content_key(reader)}) == 3


def test_a_row_weighs_recordings_and_spreads_over_folds_and_seeds():
    class Same:
        """Decides the first class, always."""

        name, label, hardware, one_seed = "same", "the first class", True, False

        def fit(self, scene, parts, seed):
            return [Fitted(lambda rows: np.zeros(len(rows)), len(part), 6 + seed) for part in parts]

    shared = Scene.of(recordings := scene(52, seed=3), SMALL)
    row = method_row(shared, (Same(), ("person",), (0, 2), 3))
    right = (recordings.labels == 0) & (shared.where >= 0)
    assert row["accuracy"] == pytest.approx(right.mean())
    shares = [right[test].mean() for test in split_folds(recordings, ["person"], 3, None)]
    assert row["spread"] == pytest.approx(np.std(shares))
    assert row["standard_error"] == pytest.approx(np.sqrt(right.mean() * (1 - right.mean()) / 52))
    assert (row["seeds"], row["split"], row["multiplies"], row["hardware"]) == (2, "person", 7, True)
    assert row["bytes"] == FLOAT_BYTES * row["parameters"]


def test_the_code_of_a_key_is_all_that_makes_the_row():
    own, *code = baselines.CODE.args
    known, tree = {*modules()}, ast.parse(Path(own, "baselines.py").read_text())
    outside = [beyond(worker, tuple(code)) for worker in imports_of(tree, known) & known]
    assert outside and not any(outside)
