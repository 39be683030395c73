"""eskin/study/baselines/rows.py, judge.py, registry.py: figures of the runs, who is near the best, the thesis's
orders, what is refused."""

import numpy as np
import pytest

from eskin.golden.core import PRESETS, AcceleratorConfig, InputError
from eskin.golden.model import random_integer_model
from eskin.study.baselines.judge import Judging, bytes_of, judge, timed
from eskin.study.baselines.method import Fitted, Method
from eskin.study.baselines.recurrent import NetworkMethod, thesis_network
from eskin.study.baselines.registry import METHODS, choose_methods
from eskin.study.baselines.rows import nearest, orders, row_of
from eskin.study.baselines.scene import Scene, array_shape
from eskin.training import recipe as recipes
from tests.support.result_case import ROW_KEYS
from tests.support.touch_scenes import SMALL, scene


def run(fold, accuracy, recordings=10, seed=0, **more):
    size = {
        "parameters": 8,
        "multiplies": 6,
        "bytes": 32,
        "comparisons": 0,
        "train_s": 2.0,
        "decision_us": [1.0, 3.0],
    }
    return {"fold": fold, "seed": seed, "recordings": recordings, "accuracy": accuracy} | size | more


def row(name, accuracy, multiplies=10, hardware=False, **more):
    return {
        "method": name,
        "split": "person",
        "accuracy": accuracy,
        "multiplies": multiplies,
        "hardware": hardware,
    } | more


def test_a_row_weighs_recordings_and_spreads_over_runs():
    runs = [
        run(0, 0.5, 30),
        run(1, 1.0, 10, decision_us=[2.0, 100.0]),
        run(0, 0.7, 30, seed=1),
        run(1, 0.8, 10, seed=1, parameters=12),
    ]
    outcome = row_of(METHODS["svm"], ["person"], runs)
    assert outcome["accuracy"] == pytest.approx((15 + 10 + 21 + 8) / 80)
    assert outcome["spread"] == pytest.approx(np.std([0.5, 1.0, 0.7, 0.8]))
    assert outcome["best"] == 1.0
    assert outcome["seeds"] == 2
    # 40 recordings, twice
    assert outcome["standard_error"] == pytest.approx(
        np.sqrt(outcome["accuracy"] * (1 - outcome["accuracy"]) / 40)
    )
    assert (outcome["parameters"], outcome["decision_us"], outcome["hardware"], outcome["split"]) == (
        9,
        2.5,
        False,
        "person",
    )
    assert outcome["decision_us_99"] > 90
    assert set(outcome) >= ROW_KEYS
    network = row_of(METHODS["gru12"], [], [run(0, 0.5, float_accuracy=0.6), run(1, 0.7, float_accuracy=0.6)])
    assert network["hardware"]
    assert network["float_accuracy"] == pytest.approx(0.6)
    assert network["float_spread"] == 0.0
    assert network["split"] == "recordings"


def test_the_smallest_within_a_point_is_named_or_the_gap():
    rows = [
        row("svm", 0.95),
        row("big", 0.946, 900, True),
        row("small", 0.9401, 30, True),
        row("tiny", 0.93, 3, True),
    ]
    assert nearest(rows) == {
        "split": "person", "best": "svm", "best_accuracy": 0.95, "network": "small", "accuracy": 0.9401, "multiplies": 30,
        "gap": pytest.approx(0.0099), "within": True,
    }  # fmt: skip
    far = nearest([row("svm", 0.99), *rows[1:]])
    assert (far["network"], far["within"]) == ("big", False) and far["gap"] == pytest.approx(0.044)
    assert nearest(rows[:1])["network"] is None


def order_rows(first, second):
    def of(name, folds):
        runs = [
            {"fold": k, "seed": 0, "recordings": 5, "accuracy": 0.0, "float_accuracy": a}
            for k, a in enumerate(folds)
        ]
        return row(
            name,
            0.0,
            hardware=True,
            float_accuracy=float(np.mean(folds)),
            float_spread=0.1,
            spread=0.2,
            runs=runs,
        )

    return [of("gru12-n20", first), of("gru12-n256", second)]


@pytest.mark.parametrize(
    ("first", "second", "holds"),
    [
        ((0.9, 0.8, 0.7), (0.7, 0.6, 0.5), True),
        ((0.7, 0.6, 0.5), (0.9, 0.8, 0.7), False),
        ((0.9, 0.5, 0.7), (0.6, 0.8, 0.6), None),
    ],
)
def test_an_order_holds_by_more_than_its_error_or_not(first, second, holds):
    (outcome,) = orders(order_rows(first, second))
    assert outcome["order"] == "GRU20 above GRU256" and outcome["holds"] is holds
    assert outcome["difference"] == pytest.approx(np.mean(first) - np.mean(second))
    assert outcome["above"]["spread"] == 0.1


def test_networks_of_the_thesis_have_its_sizes():
    """Table 3.1: 1083, 843 and 1113 parameters; 1119 with torch's second bias row (reset after)."""
    thesis = PRESETS["thesis"]
    sizes = {
        name: METHODS[name].network(thesis)[0].parameter_count
        for name in ("gru12-n20", "gru10-n20", "lstm10-n20", "lstm10-n256")
    }
    assert sizes == {"gru12-n20": 1083, "gru10-n20": 843, "lstm10-n20": 1113, "lstm10-n256": 1113}
    assert METHODS["gru12-n20"].network(thesis)[0].replace(reset="after").parameter_count == 1119
    windows = METHODS["gru12-n20"].network(thesis)[0].windows
    assert (windows.hop, windows.window, windows.steps) == (307, 615, 20)


@pytest.mark.parametrize("steps", [20, 50, 100, 200, 256])
def test_windows_of_the_thesis_cover_the_same_touch(steps):
    config = thesis_network(PRESETS["pvdf"], "lstm", 10, steps)
    span = PRESETS["pvdf"].last_frame
    assert config.windows.steps == steps and span - (steps + 1) < config.last_frame <= span
    assert config.features.feature_kinds == ("mean",) and config.network.decision == "last"


def test_too_many_windows_are_refused_in_a_sentence():
    touches = Scene.of(scene(20), SMALL)  # a touch of 70 frames
    outcome = judge(touches, Judging(METHODS["gru12-n100"], ("person",), (0,), 5))
    assert outcome == {
        "refused": "100 windows: a touch has 70 frames; take fewer windows or a front end of longer touches"
    }


def test_a_network_is_judged_in_integers_and_float(monkeypatch):
    quick = recipes.Recipe(name="quick", learning_rate=0.03, updates=60)
    monkeypatch.setattr(recipes, "RECIPES", recipes.RECIPES | {"onset": quick})
    touches = Scene.of(scene(60, seed=3), SMALL)
    runs = judge(touches, Judging(NetworkMethod("g", "g", "ours", "gru", 6), ("person",), (0, 1), 5))["runs"]
    assert [(run["seed"], run["fold"]) for run in runs] == [(s, f) for s in (0, 1) for f in range(5)]
    assert 0.6 < np.mean([run["accuracy"] for run in runs]) <= 59 / 60
    assert all(
        run["parameters"] == 3 * 6 * 11 + 3 * 7 and run["multiplies"] == 6 * SMALL.multiplies for run in runs
    )
    assert all(run["bytes"] > run["parameters"] for run in runs)  # weights of a byte, biases of two
    assert any(run["accuracy"] != run["float_accuracy"] or run["decision_us"] for run in runs)


def test_bytes_are_those_of_the_formats():
    model = random_integer_model(SMALL, 0)
    weights, biases = 3 * 6 * (4 + 6) + 3 * 6, 3 * 6 + 3
    assert bytes_of(model) == weights + 2 * biases  # SQ(3,5) weights, SQ(5,11) biases


def test_a_part_of_one_class_decides_that_class():
    def never(touches, part, seed):
        raise AssertionError("there is nothing to fit")

    recordings = scene(40, seed=1)
    recordings.groups["kind"] = (recordings.labels > 0).astype(int)
    lone = Method("lone", "lone", "simple", lambda touches, part, seed: never(touches, part, seed))
    touches = Scene.of(recordings, SMALL)
    fit = Method(
        "zero",
        "zero",
        "simple",
        lambda touches, part, seed: Fitted(lambda rows: np.zeros(len(rows), int), 1, 1),
    )
    only_zero = [run for run in judge(touches, Judging(fit, ("kind",), (0,), 5))["runs"] if run["fold"] == 0]
    assert only_zero[0]["accuracy"] > 0.9  # the touched ones of class 0
    with pytest.raises(AssertionError):
        judge(touches, Judging(lone, ("person",), (0,), 5))


def test_decisions_are_timed_one_by_one():
    seen = []
    assert len(timed(seen.append, np.arange(100))) == 40 and seen == list(range(41))
    assert timed(seen.append, np.arange(0)) == []


# ---------------------------------------------------------------------- what is asked for
def test_families_and_methods_are_chosen():
    assert choose_methods(["simple", "svm", "gru4"], False)[:2] == ["logistic", "svm"]
    assert choose_methods(["thesis"], False) == ["gru12-n20", "gru10-n20", "lstm10-n20"]
    assert len(choose_methods(["thesis"], True)) == 15 and choose_methods(["gru12-n256"], False) == [
        "gru12-n256"
    ]
    assert set(choose_methods(None, True)) == set(METHODS) > set(choose_methods(None, False))
    for bad, words in ((["forst"], "forst"), ([], "names none")):
        with pytest.raises(InputError, match=words):
            choose_methods(bad, False)


@pytest.mark.parametrize(
    ("asked", "words"), [("4x5", "20 taxels"), ("4", "no shape"), ("0x16", "no shape"), ("axb", "no shape")]
)
def test_a_shape_that_does_not_fit_is_refused(asked, words):
    with pytest.raises(InputError, match=words):
        array_shape(PRESETS["thesis"], asked)


def test_shapes():
    assert array_shape(PRESETS["thesis"], None) == (4, 4) and array_shape(PRESETS["thesis"], "2x8") == (2, 8)
    assert array_shape(PRESETS["pvdf"], None) == (2, 4)
    assert array_shape(AcceleratorConfig.of(taxels=19), None) == (1, 19)


# ---------------------------------------------------------------------- frames
def test_frames_are_the_course_of_the_touch():
    recordings = scene(40, seed=1)
    touches = Scene.of(recordings, SMALL)
    span = SMALL.last_frame
    whole = touches.frames(span)
    assert whole.shape == (len(touches.labels), span, 4)
    sums = whole[:, :20].sum(axis=1)
    assert np.array_equal(sums, touches.touches.sums[:, 0])  # the first window, of 20 frames
    halves = touches.frames(span // 2)
    assert np.allclose(halves, (whole[:, ::2] + whole[:, 1::2]) / 2, atol=1e-4)
    long = touches.frames(2 * span - 1)
    assert np.allclose(long[:, ::2], whole, atol=1e-4)
    assert not whole[0, touches.recordings.lengths[1] :].any()  # recording 1 ends inside its touch
    tensors = touches.tensors(span)
    assert tensors.shape == (len(touches.labels), 2, 2, span) and np.array_equal(
        tensors[3, 1, 0], whole[3, :, 2]
    )
