"""Each doubt on a result made for it, and none on a sound one."""

import numpy as np

from eskin.choose import doubts
from eskin.golden.data import Recordings
from tests.support.table import each_row

NAMES = ("smooth", "rough", "edge")


def split(
    accuracy: float = 0.9, confusion=((9, 1, 0, 0), (0, 9, 1, 0), (1, 0, 9, 0)), groups=("person",)
) -> dict:
    return {
        "groups": list(groups),
        "integer_accuracy": accuracy,
        "confusion": [list(row) for row in confusion],
    }


def baseline(
    accuracy: float,
    name: str = "linear classifier on the same features",
    hardware: bool = True,
    groups=("person",),
) -> dict:
    return {
        "groups": list(groups),
        "name": name,
        "accuracy": accuracy,
        "standard_error": 0.02,
        "hardware": hardware,
    }


def test_a_network_below_its_best_baseline():
    assert doubts.below_baselines(split(), [], chosen=False) == []
    assert (
        doubts.below_baselines(split(), [baseline(0.915), baseline(0.99, groups=("speed",))], chosen=False)
        == []
    )
    (sentence,) = doubts.below_baselines(split(), [baseline(0.925), baseline(0.91)], chosen=False)
    assert "92.5 %" in sentence
    assert "90.0 %" in sentence
    assert "2.5 points" in sentence
    assert "--cell auto" in sentence
    (sentence,) = doubts.below_baselines(split(), [baseline(0.93)], chosen=True, hidden=8)
    assert "--cell gru --hidden 12" in sentence and "--cell auto" not in sentence
    (sentence,) = doubts.below_baselines(split(), [baseline(0.93)], chosen=True, cell="linear", hidden=12)
    assert "--cell gru --hidden 4" in sentence
    (sentence,) = doubts.below_baselines(
        split(), [baseline(0.93, "RBF-SVM on the same features", False)], chosen=True
    )
    assert "no hardware for it" in sentence
    (sentence,) = doubts.below_baselines(
        split(), [baseline(0.93, "linear classifier on whole recordings", False)], chosen=True
    )
    assert "eskin inspect" in sentence


def test_a_choice_that_flatters_and_labels_that_may_be_luck():
    def nested(accuracy: float, as_good: float = 0.0, shuffled: bool = True) -> dict:
        luck = {"count": 20, "mean": 0.5, "largest": 0.7, "right": accuracy, "as_good": as_good}
        return {"integer_accuracy": accuracy, "standard_error": 0.02, "shuffled": luck if shuffled else None}

    assert doubts.by_choice(split() | {"nested": nested(0.87, 1 / 21)}) == []
    assert doubts.by_choice(split() | {"nested": nested(0.87, shuffled=False)}) == []
    (sentence,) = doubts.by_choice(split() | {"nested": nested(0.85)})
    assert (
        "decides 90.0 % rightly on the folds it was chosen on, and one chosen without them, by a cheaper "
        "choice, 85.0 %" in sentence
    )
    (sentence,) = doubts.by_choice(split() | {"nested": nested(0.9, 2 / 21)})
    assert "shuffled labels are decided rightly up to 70.0 % (50.0 % on average)" in sentence


def test_missed_onsets():
    assert doubts.missed_onsets(98, 100) == []
    assert "3 of 100 recordings" in doubts.missed_onsets(97, 100)[0]


def test_a_lost_class():
    assert doubts.lost_classes(split(), NAMES) == []
    (sentence,) = doubts.lost_classes(split(confusion=((9, 1, 0, 0), (6, 3, 1, 0), (1, 0, 9, 0))), NAMES)
    assert "rough is found no more often" in sentence and "taken for smooth" in sentence
    (sentence,) = doubts.lost_classes(split(confusion=((0, 1, 0, 9), (6, 3, 1, 0), (1, 0, 9, 0))), NAMES)
    assert "smooth, rough are found" in sentence and "smooth is mostly taken for nothing" in sentence
    # no recording of it
    assert doubts.lost_classes(split(confusion=((9, 1, 0, 0), (0, 0, 0, 0), (1, 0, 9, 0))), NAMES) == []


def sessions(shift: float, groups: dict | None = None, each: int = 30, seed: int = 4) -> Recordings:
    """Three classes that hardly differ, recorded in sessions of six in a row; every session has a pattern of
    its own, ``shift`` high."""
    rng = np.random.default_rng(seed)
    labels = np.repeat(np.arange(3), each)
    patterns = rng.normal(0, shift, (len(labels), 20, 4))[np.arange(len(labels)) // 6]
    samples = np.rint(patterns + rng.normal(0, 10, (len(labels), 20, 4)) + labels[:, None, None]).astype(
        np.int32
    )
    return Recordings(
        samples.reshape(-1, 4),
        20 * np.arange(len(labels) + 1),
        labels,
        NAMES,
        100.0,
        groups or {},
        source="sessions",
    )


def test_neighbours_that_look_alike():
    (sentence,) = doubts.look_alike(sessions(30.0), [], 5)
    assert "neighbouring recordings look alike" in sentence and "an array in the archive" in sentence
    groups = {"session": np.arange(90) // 6}
    assert "--group session" in doubts.look_alike(sessions(30.0, groups), [], 5)[0]
    assert doubts.look_alike(sessions(30.0, groups), ["session"], 5) == []  # a group was left out
    # the recordings of a class do not depend on their place
    assert doubts.look_alike(sessions(0.0), [], 5) == []
    assert doubts.look_alike(sessions(30.0, each=3), [], 5) == []  # too few to tell


@each_row("seed", range(5))
def test_recordings_in_any_order_are_not_doubted(seed):
    rng = np.random.default_rng(seed)
    labels = rng.permutation(np.repeat(np.arange(3), 20))
    samples = rng.normal(0, 30, (60, 20, 4)) + 10 * labels[:, None, None]
    made = Recordings(
        np.rint(samples).astype(np.int32).reshape(-1, 4),
        20 * np.arange(61),
        labels,
        NAMES,
        100.0,
        {},
        source="made",
    )
    assert doubts.look_alike(made, [], 5) == []
