"""The evaluation of all learners: one table by hand, what a learner sees, and figures of it."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from eskin.golden.data import Recordings
from eskin.training.judge import Decided, Decisions, folds_of, judge

LABELS = np.array([0, 1, 0, 1, 1, 0])
RECORDINGS = Recordings.of(
    np.zeros((6, 4, 1)), LABELS, sample_rate_hz=100, groups={"day": [0, 0, 1, 1, 2, 2]}
)
DAYS = [np.array([0, 1]), np.array([2, 3]), np.array([4, 5])]


@dataclass
class Majority:
    """Decides the more frequent class of its part, by its seed in float; notes what it is given."""

    parts: list = field(default_factory=list)

    def fit(self, parts, seeds, progress=None):
        self.parts += [part.tolist() for part in parts]
        classes = [int(LABELS[part].mean() > 0.5) for part in parts]
        return [decider(seed % 2, known) for known, seed in zip(classes, seeds, strict=True)]


def decider(real, integer, steps=1):
    def decide(rows):
        decided = np.full(len(rows), real), np.full(len(rows), integer)
        locals_ = [np.repeat(each[:, None], steps, axis=1) for each in decided]
        return Decided(*decided, np.full(len(rows), steps - 1), *locals_)

    return SimpleNamespace(decide=decide)


def test_a_table_by_hand():
    """Without day 0, the others are 0 1 1 0: the class is 0; without day 1 and day 2, 0 1 1 0 and 0 1 0 1: 0."""
    decisions = judge(Majority(), folds_of(DAYS, [0, 1], np.arange(6)), LABELS)
    table = decisions.table
    assert table["recording"].tolist() == 2 * [0, 1, 2, 3, 4, 5]
    assert table["integer"].tolist() == 12 * [0] and table["float"].tolist() == [0] * 6 + [1] * 6
    assert decisions.correct.tolist() == (LABELS == 0).tolist()
    record = decisions.record(RECORDINGS, ["day"], [0.5])
    assert record.integer_accuracy == record.float_accuracy == record.agreement == 0.5
    assert record.confusion == [[6, 0, 0], [6, 0, 0]] and record.decision_time_s == 0.5
    assert record.integer_by_seed == [0.5, 0.5] and record.integer_spread == 0
    first = record.per_fold[0]
    assert (first.held_out, first.recordings) == ("day 0", 2)
    assert first.by_seed["agreement"] == [1.0, 0.0]


def test_a_learner_sees_the_part_and_is_judged_on_the_rest():
    """Folds with the same part and seed share a decider; seeds have one each."""
    learner, folds = Majority(), folds_of(DAYS, [3, 4], np.arange(6))
    decisions = judge(learner, [*folds, *folds_of(DAYS[:1], [3], np.arange(6), split=1)], LABELS)
    assert learner.parts == 2 * [[2, 3, 4, 5], [0, 1, 4, 5], [0, 1, 2, 3]]
    assert decisions.fitted[0][1] is decisions.fitted[-1][1] is not decisions.fitted[3][1]
    own = decisions.of_split(1)
    assert own.table["recording"].tolist() == [0, 1] and len(own.fitted) == 1
    assert decisions.seeds == [3, 4] and decisions.of_split(0).joined(own).seeds == [3, 4]


def test_a_recording_without_a_decision_is_wrong_and_deciders_may_have_other_steps():
    folds = folds_of(DAYS, [0], np.arange(6))
    deciders = [decider(-1, -1), decider(0, 0, 3), decider(1, 1, 2)]
    decisions = Decisions.of([*zip(folds, deciders, strict=True)], LABELS)
    assert decisions.local.shape == (2, 6, 3) and decisions.correct.tolist() == [0, 0, 1, 0, 1, 0]
    record = decisions.record(RECORDINGS, ["day"], [0.1, 0.2, 0.3])
    assert [step.integer_accuracy for step in record.per_step] == pytest.approx([2 / 6, 2 / 6, 1 / 6])
    assert record.confusion == [[1, 1, 1], [1, 1, 1]]
