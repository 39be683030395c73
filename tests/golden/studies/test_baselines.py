"""golden/studies/baselines.py: each learns a task it can learn, is counted right, and counts untouched recordings as wrong."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from eskin.golden.core.config import PRESETS
from eskin.golden.studies import baselines
from eskin.golden.studies.baselines import BASELINES, cnn_channels, judge_baseline
from eskin.golden.training import train
from tests.support.touch_scenes import SMALL, scene


@pytest.mark.parametrize("name", BASELINES)
def test_each_learns_the_scene(name, monkeypatch):
    recipes = {key: dataclasses.replace(recipe, updates=150) for key, recipe in train.RECIPES.items()}
    monkeypatch.setattr(train, "RECIPES", recipes)
    recordings = scene(60, seed=3)
    result = judge_baseline(name, recordings, SMALL, [["person"]], (0, 1), 5)
    (split,) = result["splits"]
    assert split["groups"] == ["person"] and len(split["by_seed"]) == 2 and len(split["per_fold"]) == 5
    least = 0.6 if name == "logistic" else 0.85  # rise and fall have nearly one mean and deviation; chance is a third
    assert least < split["accuracy"] <= 59 / 60  # one recording is never touched
    assert split["accuracy"] == pytest.approx(np.mean(split["by_seed"]))
    again = judge_baseline(name, recordings, SMALL, [["person"]], (0, 1), 5)
    assert again == result


def test_labels_of_the_test_part_are_not_seen(monkeypatch):
    """What can only be learnt by heart, which these penalties allow, is not known of a part that was left out."""
    by_heart = {"C": 1e4, "gamma": 1.0}
    monkeypatch.setattr(baselines, "_chosen", lambda model, grid, x, y, seed: model.set_params(**by_heart).fit(x, y))
    recordings = scene(60, seed=3)
    shuffled = dataclasses.replace(recordings, labels=np.random.default_rng(5).permutation(recordings.labels))
    (split,) = judge_baseline("svm", shuffled, SMALL, [["person"]], (0,), 5)["splits"]
    assert split["accuracy"] < 0.5


def test_sizes_are_counted():
    recordings = scene(40, seed=4)
    logistic = judge_baseline("logistic", recordings, SMALL, [["person"]], (0,), 5)
    assert (logistic["parameters"], logistic["multiplies_decision"]) == (3 * 8 + 3, 3 * 8 + 6 * 4 + 4)
    vectors = judge_baseline("svm", recordings, SMALL, [["person"]], (0,), 5)
    count = (vectors["parameters"] - 3) / (24 + 2)
    assert 3 <= count <= 32 and vectors["multiplies_decision"] == pytest.approx(count * 27, rel=1e-3)


@pytest.mark.parametrize("name", ["pvdf", "fabric", "thesis"])
def test_the_cnn_is_of_similar_size(name):
    config = PRESETS[name]
    parameters, multiplies = baselines._cnn_size(config, cnn_channels(config))
    assert 0.75 * config.parameter_count < parameters <= config.parameter_count
    network = _network(config)
    assert sum(p.numel() for p in network) == parameters
    assert multiplies > parameters  # its kernels are used at every step


def _network(config):
    seen = []

    def note(network, *_):
        seen.extend(network.parameters())

    original = baselines._train_cnn
    baselines._train_cnn = note
    try:
        features = np.zeros((4, config.windows.steps, config.sensor.taxels))
        baselines._cnn(features, np.zeros(4, dtype=np.int64), np.arange(4), np.arange(4), config, 0)
    finally:
        baselines._train_cnn = original
    return seen
