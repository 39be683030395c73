"""Each doubt on a result made for it, and none on a sound one."""

import numpy as np

from eskin.choose import doubts
from eskin.golden.data import Recordings
from eskin.training.evaluate import HeldBack
from tests.eskin.choose.test_candidate import CONFIG
from tests.support.result_case import evaluation
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
    whole: bool = False,
) -> dict:
    return {
        "groups": list(groups),
        "name": name,
        "accuracy": accuracy,
        "standard_error": 0.02,
        "hardware": hardware,
        "whole": whole,
    }


VECTORS, WHOLE = "RBF-SVM on the same features", "linear classifier on whole recordings"
LINEAR = {"cell": "linear", "hidden": 0, "accuracy": 0.9}
SMALL, LARGE = ({"cell": "gru", "hidden": hidden, "accuracy": 0.91} for hidden in (8, 12))
BEST_IS_LARGEST = [LINEAR, SMALL, LARGE | {"accuracy": 0.92}]
NONE_BETTER = "no other candidate is better"


@each_row(
    "rows, candidates, parts",
    [
        ([], None, None),
        ([baseline(0.915), baseline(0.99, groups=("speed",))], None, None),
        ([baseline(0.925), baseline(0.91)], None, ["92.5 %", "90.0 %", "2.5 points", "`cell` auto"]),
        ([baseline(0.93)], BEST_IS_LARGEST, ["try `cell` gru `hidden` 16"]),
        ([baseline(0.93)], [LINEAR, SMALL, LARGE | {"accuracy": 0.85}], [NONE_BETTER]),
        ([baseline(0.93)], [LINEAR], [NONE_BETTER]),
        ([baseline(0.939, VECTORS, False)], None, None),  # within two standard errors
        (
            [baseline(0.95, VECTORS, False)],
            BEST_IS_LARGEST,
            ["eskin has no hardware for it; try `cell` gru `hidden` 16"],
        ),
        ([baseline(0.95, WHOLE, False, whole=True)], [LINEAR], [NONE_BETTER]),
    ],
)
def test_a_network_below_its_best_baseline(rows, candidates, parts):
    found = doubts.below_baselines(split(), rows, candidates)
    assert [one["code"] for one in found] == ["below_baselines"] * (parts is not None)
    for one in found:
        assert one["groups"] == ["person"] and one["text"].startswith("with person left out, the ")
        assert all(part in one["text"] for part in parts)


def test_what_chose_nothing_is_compared_with_what_was_chosen_without_the_fold():
    chosen = split() | {"nested": {"integer_accuracy": 0.85}}
    whole = baseline(0.9, WHOLE, False, whole=True)
    (one,) = doubts.below_baselines(chosen, [baseline(0.905), whole], [LINEAR])
    assert WHOLE in one["text"] and "the network 85.0 %, 5.0 points less" in one["text"]
    assert doubts.below_baselines(chosen, [baseline(0.905)], [LINEAR]) == []
    assert doubts.below_baselines(split(), [whole], [LINEAR]) == []


def test_a_choice_that_is_too_optimistic():
    nested = {"integer_accuracy": 0.87, "per_fold": 2 * [{"recordings": 141}]}
    assert doubts.by_choice(split() | {"nested": nested}) == []
    (one,) = doubts.by_choice(split() | {"nested": nested | {"integer_accuracy": 0.85}})
    assert one["code"] == "by_choice" and "90.0 % correctly on the folds that chose it" in one["text"]
    assert "85.0 %: quote the second figure for a new person" in one["text"] and doubts.sentences([one]) == [
        one["text"]
    ]


def test_recordings_held_back_below_the_range():
    of = split() | {"range": [0.7, 1.0], "nested": {"range": [0.8, 0.908]}}
    assert doubts.below_range(evaluation(1, integer=0.8), of) == []
    (one,) = doubts.below_range(evaluation(1, integer=0.799), of)
    assert "79.9 %" in one["text"] and "promises 80.0 % to 90.8 %" in one["text"]
    (seen,) = doubts.seen_in_training(HeldBack(**vars(evaluation(356)), seen_in_training=1), "images")
    assert "1 of the 356 images held back (0.3 %) are also in the training data" in seen["text"]


@each_row(
    "on_smooth, on_rough, said",
    [
        ((9, 1, 0, 0), (0, 9, 1, 0), []),
        ((9, 1, 0, 0), (0, 0, 0, 0), []),  # no recording of it
        ((9, 1, 0, 0), (6, 3, 1, 0), ["rough is recognised no more often", "classified as smooth"]),
        (
            (0, 1, 0, 9),
            (6, 3, 1, 0),
            ["smooth, rough are recognised", "smooth is mostly classified as nothing"],
        ),
    ],
)
def test_a_lost_class(on_smooth, on_rough, said):
    found = doubts.lost_classes(split(confusion=(on_smooth, on_rough, (1, 0, 9, 0))), NAMES)
    assert len(found) == bool(said) and all(words in one["text"] for one in found for words in said)


@each_row(
    "steps, right, brief, doubted",
    [
        (6, 80, 60, True),
        (6, 80, 77, False),  # two standard errors at least
        (6, 96, 60, False),  # enough is right
        (2, 80, 60, False),  # the best is short
    ],
)
def test_accuracy_that_climbs_to_the_end_is_doubted(steps, right, brief, doubted):
    rows = [(CONFIG.replace(steps=k), np.arange(100) < n) for k, n in ((steps, right), (2, brief), (6, 50))]
    found = doubts.still_climbing(rows)
    assert [one["code"] for one in found] == ["still_climbing"] * doubted
    assert all("record longer touches" in one["text"] for one in found)
    assert all("the linear classifier that judges front ends" in one["text"] for one in found)
    # what scans less often may begin later
    seldom = CONFIG.replace(steps=1, scan_every=2), rows[1][1]
    assert doubts.still_climbing([rows[0], seldom]) == []


def sessions(shift: float, groups: dict | None = None, each: int = 30) -> Recordings:
    """Three classes that hardly differ, recorded in sessions of six in a row; every session has a pattern of
    its own, ``shift`` high."""
    rng, labels = np.random.default_rng(4), np.repeat(np.arange(3), each)
    patterns = rng.normal(0, shift, (len(labels), 20, 4))[np.arange(len(labels)) // 6]
    samples = np.rint(patterns + rng.normal(0, 10, patterns.shape) + labels[:, None, None])
    return Recordings.of(samples, labels, sample_rate_hz=100, class_names=NAMES, groups=groups)


def test_neighbours_that_look_alike():
    (one,) = doubts.look_alike(sessions(30.0), [], 5)
    assert "neighbouring recordings look alike" in one["text"] and "an array in the archive" in one["text"]
    groups = {"session": np.arange(90) % 5}
    assert doubts.look_alike(sessions(30.0, groups), ["session"], 5) == []  # a group was left out
    # what `run` would refuse is not advised
    refused = {"source_file": np.arange(90), "sensor": np.zeros(90), "one_class": np.arange(90) // 15}
    assert "an array in the archive" in doubts.look_alike(sessions(30.0, refused), [], 5)[0]["text"]
    assert "`group` session" in doubts.look_alike(sessions(30.0, refused | groups), [], 5)[0]["text"]
    # the recordings of a class do not depend on their place
    assert doubts.look_alike(sessions(0.0), [], 5) == []
    assert doubts.look_alike(sessions(30.0, each=3), [], 5) == []  # too few to tell
