"""eskin/study/baselines.py: each method learns a task it can learn, is counted right, and sees nothing of a part
that was left out; figures of the runs; what is refused."""

import dataclasses

import numpy as np
import pytest

from eskin.study.baselines import METHODS, BaselineJob, Held, Scene, judge, row_of
from eskin.training import recipe as recipes
from tests.support.result_case import ROW_KEYS
from tests.support.touch_scenes import SMALL, scene


@pytest.mark.parametrize("name", METHODS)
def test_each_learns_the_scene(name, monkeypatch):
    quick = {key: dataclasses.replace(recipe, updates=150) for key, recipe in recipes.RECIPES.items()}
    monkeypatch.setattr(recipes, "RECIPES", quick)
    shared = Held((scene(60, seed=3), SMALL))
    runs = judge(shared, BaselineJob(METHODS[name], ("person",), (1,), 2))["runs"]
    assert [run["fold"] for run in runs] == [0, 1] and sum(run["recordings"] for run in runs) == 60
    right = sum(run["accuracy"] * run["recordings"] for run in runs)
    assert 42 < right <= 59  # one recording is never touched
    assert all(run["train_s"] > 0 and run["decision_us"] and min(run["decision_us"]) > 0 for run in runs)
    inputs = SMALL.windows.steps * SMALL.inputs
    counts = {
        "logistic": (3 * inputs, 0),
        "neighbours": (len(Scene.of(*shared).labels) // 2 * inputs, 0),
        "gru": (SMALL.windows.steps * 12 * (SMALL.inputs + 12), 0),
        "forest": (0, 200),
    }
    multiplies, comparisons = counts.get(name, (inputs, 0))
    assert runs[0]["comparisons"] >= comparisons and runs[0]["bytes"] == 4 * runs[0]["parameters"]
    if name in ("logistic", "forest"):
        assert runs[0]["multiplies"] == multiplies
    assert 0.7 * multiplies <= runs[0]["multiplies"]


def test_labels_of_the_test_part_are_not_seen():
    """What can only be learnt by heart is not known of a part that was left out."""
    recordings = scene(60, seed=3)
    shuffled = dataclasses.replace(recordings, labels=np.random.default_rng(5).permutation(recordings.labels))
    outcome = judge(Held((shuffled, SMALL)), BaselineJob(METHODS["neighbours"], ("person",), (0,), 5))
    assert row_of(METHODS["neighbours"], ["person"], outcome["runs"])["accuracy"] < 0.5


def run(fold, accuracy, recordings=10, seed=0, **more):
    common = dict(fold=fold, seed=seed, recordings=recordings, accuracy=accuracy, decision_us=[1.0, 3.0])
    return common | dict(parameters=8, multiplies=6, bytes=32, comparisons=0, train_s=2.0) | more


def test_a_row_weighs_recordings_and_spreads_over_runs():
    runs = [
        run(0, 0.5, 30),
        run(1, 1.0, decision_us=[2.0, 100.0]),
        run(0, 0.7, 30, seed=1),
        run(1, 0.8, seed=1, parameters=12),
    ]
    outcome = row_of(METHODS["svm"], ["person"], runs)
    assert outcome["accuracy"] == pytest.approx((15 + 10 + 21 + 8) / 80)
    assert outcome["spread"] == pytest.approx(np.std([0.5, 1.0, 0.7, 0.8]))
    assert (outcome["best"], outcome["seeds"], outcome["split"]) == (1.0, 2, "person")
    # 40 recordings, twice
    error = np.sqrt(outcome["accuracy"] * (1 - outcome["accuracy"]) / 40)
    assert outcome["standard_error"] == pytest.approx(error)
    assert (outcome["parameters"], outcome["decision_us"], outcome["hardware"]) == (9, 2.5, False)
    assert outcome["decision_us_99"] > 90 and set(outcome) >= ROW_KEYS
    assert row_of(METHODS["gru"], [], runs)["hardware"]
