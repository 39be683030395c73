"""What defences save and cost: the failures are what they say, the margin is chosen on training data, the
table is counted by hand."""

import dataclasses

import numpy as np
import pytest

from eskin.study import defences
from eskin.study.stability.core import Scene
from eskin.training import crossval
from eskin.training import recipe as recipes
from tests.support import stability_case
from tests.support.stability_case import CONFIG


def test_the_threshold_keeps_the_coverage_and_no_larger_one_does():
    rng = np.random.default_rng(3)
    for _ in range(50):
        margins = rng.integers(0, 20, rng.integers(1, 60))
        threshold = defences.choose_margin(margins, 0.9)
        assert np.mean(margins >= threshold) >= 0.9 > np.mean(margins > threshold)


def test_failures_are_what_they_say():
    data = stability_case.recordings(4)
    scene, top = Scene(config=CONFIG, recordings=data), CONFIG.sample_format.max_code
    for name, failure in defences.FAILURES.items():
        played = failure.cases(scene)["taxel 2"]
        assert (played.scene.config.sensor.masked_taxels == (2,)) == (name == "stuck, masked")
        for i in range(4):
            before, after = scene.clean.recording(i), played.recordings.recording(i)
            assert np.array_equal(np.delete(before, 2, axis=1), np.delete(after, 2, axis=1))
            since = int(scene.onsets[i]) - 1 + round(0.25 * CONFIG.last_frame)
            if name == "dead":
                assert len(set(after[:, 2].tolist())) == 1
                assert abs(int(after[0, 2]) - before[:20, 2].mean()) < 3
            else:
                assert np.array_equal(after[:since, 2], before[:since, 2]) and np.all(after[since:, 2] == top)


def test_the_margin_record_is_counted_over_the_confident():
    labels = np.array([0, 1, 0, 1])
    decided = np.array([0, 1, 1, -1])

    def record(margins, learnt, coverage):
        outcome = [(np.arange(4), decided, np.array(margins), np.array(learnt))]
        found = defences.margin_record(["trial"], labels, outcome, coverage)
        return [found[key] for key in ("threshold", "coverage", "accuracy", "without")]

    # a margin of the threshold itself is confident
    assert record([9, 3, 6, 0], [4, 6, 8, 9], 0.75) == [6, 0.5, 0.5, 0.5]
    assert record([9, 3, 5, 0], [0, 0, 0, 5], 1.0) == [0, 0.75, pytest.approx(2 / 3), 0.5]


def test_the_comparison_counts_what_unseen_recordings_get():
    data = stability_case.recordings()
    recipe = dataclasses.replace(recipes.RECIPES["onset"], updates=60)
    variant = defences.Variant("one", CONFIG, recipe)
    front_ends: dict = {}
    names = ("dead", "stuck", "stuck, masked")

    def compared(front_ends):
        return defences.judge_defences(data, variant, [["trial"]], [0], folds=2, front_ends=front_ends)

    record = compared(front_ends)
    (reference,) = crossval.cross_validate(data, CONFIG, [["trial"]], [0], folds=2, recipe=recipe)
    assert record["clean"][0]["accuracy"] == pytest.approx(reference["integer_accuracy"])
    ((key, front_end),) = front_ends.items()
    taxels = range(CONFIG.sensor.taxels)
    assert set(front_end) == {"clean"} | {f"{name}, taxel {taxel}" for name in names for taxel in taxels}
    assert all(0 <= record[name]["worst"] <= record[name]["mean"] <= 1 for name in names)
    config, rows, touches = front_end["dead, taxel 3"]
    again = compared({key: front_end | {"dead, taxel 3": (config, np.full_like(rows, -1), touches)}})
    assert (again["dead"]["worst"], again["dead"]["worst_taxel"]) == (0.0, 3)
    assert again["stuck"] == record["stuck"]
