"""eskin/study/baselines/simple.py and beside it: each method learns a task it can learn, is counted right, and sees
nothing of a part that was left out."""

import dataclasses

import numpy as np
import pytest

from eskin.choose import yardsticks
from eskin.golden.core import PRESETS
from eskin.study.baselines import simple, tiles
from eskin.study.baselines.judge import Judging, judge
from eskin.study.baselines.rows import judge_baseline
from eskin.study.baselines.scene import Scene
from eskin.study.baselines.simple import SIMPLE, cnn_channels, cnn_network, cnn_size
from eskin.study.baselines.tensor import TENSOR
from eskin.study.baselines.tiles import TILED
from eskin.study.baselines.transfer import TRANSFER
from eskin.training import recipe as recipes
from tests.support.touch_scenes import SMALL, scene


@pytest.fixture(scope="module")
def touches():
    return Scene.of(scene(60, seed=3), SMALL)


LEAST = {"logistic": 0.6, "tensor": 0.6, "tiles": 0.6, "transfer": 0.4}
"""Of a method or a family; 0.8 of others. Rise and fall have nearly one mean and deviation; chance is a third."""


@pytest.mark.parametrize("method", [*SIMPLE, *TENSOR, *TILED, *TRANSFER], ids=lambda method: method.name)
def test_each_learns_the_scene(method, touches, monkeypatch):
    quick = {key: dataclasses.replace(recipe, updates=150) for key, recipe in recipes.RECIPES.items()}
    monkeypatch.setattr(recipes, "RECIPES", quick)
    monkeypatch.setattr(simple, "TREES", 30)
    monkeypatch.setattr(tiles, "UPDATES", 80)
    judging = Judging(method, ("person",), (1,), 2 if method.one_seed else 5)
    runs = judge(touches, judging)["runs"]
    assert [run["fold"] for run in runs] == [*range(judging.folds)]
    assert sum(run["recordings"] for run in runs) == 60
    least = LEAST.get(method.name, LEAST.get(method.family, 0.8))
    assert least < np.mean([run["accuracy"] for run in runs]) <= 59 / 60  # one recording is never touched
    assert all(run["train_s"] > 0 and run["decision_us"] and min(run["decision_us"]) > 0 for run in runs)
    again = runs if method.one_seed else judge(touches, judging)["runs"]
    assert [run["accuracy"] for run in again] == [run["accuracy"] for run in runs]


def test_labels_of_the_test_part_are_not_seen(monkeypatch):
    """What can only be learnt by heart, which these penalties allow, is not known of a part that was left
    out."""
    by_heart = {"C": 1e4, "gamma": 1.0}
    monkeypatch.setattr(
        yardsticks, "fitted", lambda model, x, labels, **choice: model.set_params(**by_heart).fit(x, labels)
    )
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


def test_trees_are_counted(touches):
    """Of stumps everything is known: one fork and two leaves each."""
    part = np.arange(40)
    monkey = pytest.MonkeyPatch()
    with monkey.context() as patched:
        patched.setattr(simple, "DEPTH", 1)
        patched.setattr(simple, "STAGES", 4)
        fitted = simple.fit_boosting(touches, part, 0)
        assert (fitted.parameters, fitted.multiplies, fitted.comparisons) == (4 * 3 * (2 + 2), 0, 4 * 3)
        patched.setattr(simple, "TREES", 5)
        forest = simple.fit_forest(touches, part, 0)
    # a tree has a leaf more than forks; a leaf has the shares of three classes
    forks = (forest.parameters - 5 * 3) / (2 + 3)
    assert forks == int(forks) and 5 * 2 <= forks <= 5 * 39 and 5 < forest.comparisons < forks


def test_random_kernels_are_counted(touches):
    count, inputs, steps, length = simple.RANDOM_KERNELS, 4, 6, simple.RANDOM_LENGTH
    fitted = simple.fit_kernels(touches, np.arange(40), 0)
    assert fitted.multiplies == count * inputs * steps * length + 3 * 2 * count
    assert fitted.parameters == count * (inputs * length + 1) + 3 * (2 * count + 1)


@pytest.mark.parametrize("name", ["pvdf", "fabric", "thesis"])
def test_the_cnn_is_of_similar_size(name):
    config = PRESETS[name]
    parameters, multiplies = cnn_size(config, cnn_channels(config))
    assert 0.75 * config.parameter_count < parameters <= config.parameter_count
    assert sum(p.numel() for p in cnn_network(config).parameters()) == parameters
    assert multiplies > parameters  # its kernels are used at every step
