"""Each doubt on a result made for it, and none on a sound one."""

import numpy as np

from eskin.choose import doubts
from eskin.golden.data import Recordings
from eskin.training.evaluate import HeldBack
from eskin.training.record import Baseline, Doubt, FoldShares, Nested, NetworkRow, Split
from tests.eskin.choose.test_candidate import CONFIG
from tests.support.result_case import but, evaluation, some
from tests.support.table import each_row

NAMES = ("smooth", "rough", "edge")


SPLIT = some(Split, groups=["person"], integer_accuracy=0.9)
NESTED = some(
    Nested, integer_accuracy=0.85, per_fold=2 * [some(FoldShares, recordings=141)], range=[0.8, 0.908]
)
UNSEEN = but(SPLIT, nested=NESTED, range=[0.7, 1.0])
BASELINE = some(Baseline, groups=["person"], standard_error=0.02, hardware=True, whole=False)
BASELINE.name = "linear classifier on the same features"
VECTORS = but(BASELINE, name="RBF-SVM on the same features", hardware=False)
WHOLE = but(VECTORS, name="linear classifier on whole recordings", whole=True)
LINEAR = some(NetworkRow, cell="linear", hidden=0, accuracy=0.9)
SMALL, LARGE = (some(NetworkRow, cell="gru", hidden=hidden, accuracy=0.91) for hidden in (8, 12))
BEST_IS_LARGEST = [LINEAR, SMALL, but(LARGE, accuracy=0.92)]
NONE_BETTER = "no other candidate is better"


def below(candidates, *scored, split=SPLIT) -> list[Doubt]:
    """What is said of these baselines and their accuracies."""
    rows = [but(baseline, accuracy=accuracy) for baseline, accuracy in scored]
    return doubts.below_baselines(split, rows, candidates)


def by_choice(accuracy) -> list[Doubt]:
    return doubts.by_choice(SPLIT, but(NESTED, integer_accuracy=accuracy))


def lost(on_smooth, on_rough, fold=15) -> list[Doubt]:
    per_fold = [some(FoldShares, recordings=count) for count in (fold, 30 - fold)]
    split = but(SPLIT, confusion=[on_smooth, on_rough, [1, 0, 9, 0]], per_fold=per_fold)
    return doubts.lost_classes(split, NAMES)


def below_range(right, count, split=UNSEEN) -> list[Doubt]:
    return doubts.below_range(evaluation(count, integer=right / count), split)


@each_row(
    "found, code, parts",
    [
        (below(None), "", []),
        (below(None, (BASELINE, 0.915), (but(BASELINE, groups=["speed"]), 0.99)), "", []),
        (below(None, (BASELINE, 0.925), (BASELINE, 0.91)), "below_baselines",
         ["with person left out, the ", "92.5 %", "90.0 %", "2.5 points", "`cell` auto"]),
        (below(BEST_IS_LARGEST, (BASELINE, 0.93)), "below_baselines", ["try `cell` gru `hidden` 16"]),
        (below([LINEAR, SMALL, but(LARGE, accuracy=0.85)], (BASELINE, 0.93)), "below_baselines", [NONE_BETTER]),
        (below([LINEAR], (BASELINE, 0.93)), "below_baselines", [NONE_BETTER]),
        (below(None, (VECTORS, 0.939)), "", []),  # within two standard errors
        (below(BEST_IS_LARGEST, (VECTORS, 0.95)), "below_baselines",
         ["eskin has no hardware for it; try `cell` gru `hidden` 16"]),
        (below([LINEAR], (WHOLE, 0.95)), "below_baselines", ["no kinds of feature for all of its statistics; ", NONE_BETTER]),
        # what chose nothing beside what was chosen without the fold
        (below([LINEAR], (BASELINE, 0.905), (WHOLE, 0.9), split=UNSEEN), "below_baselines",
         [WHOLE.name, "the network 85.0 %, 5.0 points less"]),
        (below([LINEAR], (BASELINE, 0.905), split=UNSEEN), "", []),
        (below([LINEAR], (WHOLE, 0.9)), "", []),
        (by_choice(0.87), "", []),
        (by_choice(0.85), "by_choice", ["90.0 % correctly on the folds that chose it", "85.0 %: quote the second figure for a new person"]),
        (doubts.level_tells(13, 0.9, None, []), "level_tells", ["name these in an array of the archive and give it with `group`"]),
        (below_range(769, 1000), "below_range", ["76.9 %", "promises 80.0 % to 90.8 %"]),
        (below_range(774, 1000), "", []),  # within two standard errors
        (below_range(199, 200, but(SPLIT, nested=None, range=[1.0, 1.0])), "", []),
        (below_range(0, 1), "", []),
        (doubts.seen_in_training(HeldBack(**vars(evaluation(356)), seen_in_training=1), "images"), "seen_in_training",
         ["1 of the 356 images held back (0.3 %) are also in the training data"]),
        (doubts.missed_onsets(98, 100), "", []),
        (doubts.missed_onsets(97, 100), "missed_onsets", ["in 3 of 100", "a smaller onset_threshold in `config`"]),
        (lost([9, 1, 0, 0], [0, 9, 1, 0]), "", []),
        (lost([9, 1, 0, 0], [0, 0, 0, 0]), "", []),  # no recording of it
        (lost([9, 1, 0, 0], [6, 3, 1, 0]), "lost_classes", ["rough is recognised no more often", "classified as smooth): record more of it"]),
        (lost([9, 1, 0, 0], [6, 3, 1, 0], fold=29), "lost_classes",
         ["a fold left out 29 of 30 recordings and was trained on the rest: record more with other values of person"]),
        (lost([0, 1, 0, 9], [6, 3, 1, 0]), "lost_classes", ["smooth, rough are recognised", "smooth is mostly classified as nothing"]),
    ],
)  # fmt: skip
def test_a_doubt_and_none_on_what_is_sound(found, code, parts):
    assert [doubt.code for doubt in found] == [code] * bool(code)
    assert all(part in doubt.text for doubt in found for part in parts)
    assert not code.startswith("below_b") or found[0].groups == ["person"]


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
    assert [doubt.code for doubt in found] == ["still_climbing"] * doubted
    assert all("record longer touches" in doubt.text for doubt in found)
    assert all("the linear classifier that judges front ends" in doubt.text for doubt in found)
    # what scans less often may begin later
    seldom = CONFIG.replace(steps=1, scan_every=2), rows[1][1]
    assert doubts.still_climbing([rows[0], seldom]) == []
    # windows that divide the touch have seen all of it, and say nothing of longer ones
    divided = rows[0][0].replace(window_mode="whole"), rows[0][1]
    assert doubts.still_climbing([divided, *rows[1:]]) == []
    assert len(doubts.still_climbing([*rows, (divided[0], rows[2][1])])) == doubted


def sessions(shift: float, groups: dict | None = None, each: int = 30) -> Recordings:
    """Three classes that hardly differ, recorded in sessions of six in a row; every session has a pattern of
    its own, ``shift`` high."""
    rng, labels = np.random.default_rng(4), np.repeat(np.arange(3), each)
    patterns = rng.normal(0, shift, (len(labels), 20, 4))[np.arange(len(labels)) // 6]
    samples = np.rint(patterns + rng.normal(0, 10, patterns.shape) + labels[:, None, None])
    return Recordings.of(samples, labels, sample_rate_hz=100, class_names=NAMES, groups=groups)


def test_neighbours_that_look_alike():
    (doubt,) = doubts.look_alike(sessions(30.0), [], 5)
    assert "neighbouring recordings look alike" in doubt.text and "an array in the archive" in doubt.text
    groups = {"session": np.arange(90) % 5}
    assert doubts.look_alike(sessions(30.0, groups), ["session"], 5) == []  # a group was left out
    # what `run` would refuse is not advised
    refused = {"source_file": np.arange(90), "sensor": np.zeros(90), "one_class": np.arange(90) // 15}
    assert "an array in the archive" in doubts.look_alike(sessions(30.0, refused), [], 5)[0].text
    assert "`group` session" in doubts.look_alike(sessions(30.0, refused | groups), [], 5)[0].text
    # the recordings of a class do not depend on their place
    assert doubts.look_alike(sessions(0.0), [], 5) == []
    assert doubts.look_alike(sessions(30.0, each=3), [], 5) == []  # too few to tell
