"""What defences save and cost: the failures are what they say, the margin is chosen on training data, the
table is counted by hand."""

import dataclasses

import numpy as np
import pytest

from eskin.study import defences
from eskin.study.stability.core import Experiment, Scene
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
        played = failure.run.cases(scene)["taxel 2"]
        assert (played.config.sensor.masked_taxels == (2,)) == (name == "stuck, masked")
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
    labels = np.array([0, 1, 0, 1, 0, 0, 0, 0])
    decided = np.array([0, 1, 1, -1, 0, 0, 0, 0])

    def record(margins, learnt, coverage):
        outcome = [(np.arange(4, 8), np.arange(4), decided, np.array(margins + learnt))]
        found = defences.margin_record(labels, outcome, coverage)
        return [found[key] for key in ("threshold", "coverage", "accuracy")]

    # a margin of the threshold itself is confident
    assert record([9, 3, 6, 0], [4, 6, 8, 9], 0.75) == [6, 0.5, 0.5]
    assert record([9, 3, 5, 0], [0, 0, 0, 5], 1.0) == [0, 0.75, pytest.approx(2 / 3)]
    assert record([0, 0, 0, 0], [9, 9, 9, 9], 1.0) == [9, 0.0, 0.0]


def test_the_comparison_counts_what_unseen_recordings_get(monkeypatch):
    data = stability_case.recordings()
    recipe = dataclasses.replace(recipes.RECIPES["onset"], updates=60)
    monkeypatch.setattr(defences, "FOLDS", 2)

    def compared():
        return defences.judge_defences((data, ["trial"], 1), ("one", CONFIG, recipe))

    record = compared()
    (reference,) = crossval.cross_validate(data, CONFIG, [["trial"]], [0], folds=2, recipe=recipe)
    assert record["accuracy"] == pytest.approx(reference["integer_accuracy"])
    assert all(0 <= record[name]["worst"] <= record[name]["mean"] <= 1 for name in defences.FAILURES)
    deaf = Experiment(lambda stream, at: stream * (3 not in at.taxels), 0, (), "", over="taxels")
    monkeypatch.setitem(defences.FAILURES, "dead", dataclasses.replace(defences.FAILURES["dead"], run=deaf))
    again = compared()
    assert (again["dead"]["worst"], again["dead"]["worst_taxel"]) == (0.0, "taxel 3")
    assert again["stuck"] == record["stuck"]
