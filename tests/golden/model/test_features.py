"""Kinds of feature beyond the mean: golden values against plain loops over frames, configuration refusals,
training and quantising."""

import math
from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest

from eskin.golden.core import FEATURE_KINDS, AcceleratorConfig, InputError
from eskin.golden.data import Recordings
from eskin.golden.model import find_touches
from eskin.golden.model.preprocess import TouchFinder, companded
from eskin.training.made_up import random_recordings
from tests.support.table import each_row

SUBSETS = [subset for size in (1, 2, 3) for subset in combinations(FEATURE_KINDS, size)]
BASE = dict(
    taxels=4,
    sample_bits=9,
    hidden=4,
    sample_rate_hz=1000.0,
    rest="tracked",
    rest_frames=8,
    onset="baseline",
    onset_check_frames=4,
    onset_mean_frames=8,
    onset_threshold=30,
    class_names=("a", "b"),
    integral_knee=3,
    integral_frac=5,
)
FREE = AcceleratorConfig.of(
    **BASE, window_mode="free", pretrigger_frames=0, hop=12, window=24, steps=4, rearm_frames=9
)
CONFIGS = {
    "free": FREE,
    "touch": AcceleratorConfig.of(
        **BASE,
        window_mode="touch",
        pretrigger_frames=4,
        touch_frames=54,
        hop=12,
        window=24,
        steps=5,
        rearm_frames=13,
    ),
    "at once": FREE.replace(onset="immediate", rest="none", rest_frames=0, sample_signed=True),
}


def streams(config: AcceleratorConfig, count: int, seed: int) -> Recordings:
    return random_recordings(config, np.random.default_rng(seed).integers(40, 260, count), seed)


def one_window(
    config: AcceleratorConfig, deviations: np.ndarray, start: int, first: int, last: int, taxel: int
) -> dict[str, int]:
    """Mean, activity and integral of the window of frames ``first``..``last`` from ``start`` (1-based), by
    loops."""
    column = [int(value) for value in deviations[:, taxel]]
    frames = column[start - 1 + first - 1 : start - 1 + last]
    size, total = config.features.activity_block, 0
    for begin in range(0, len(frames), size):
        here = sum(frames[begin : begin + size])
        at = start - 1 + first - 1 + begin  # frames of the recording before the block
        origin = 0 if config.windows.window_mode == "free" else start - 1
        before = here if at == origin else sum(column[at - size : at])
        total += abs(here) if config.features.activity_rule == "sum" else abs(here - before)
    grown = sum(column[start - 1 : start - 1 + last])
    knee = 1 << config.features.integral_knee
    biased = abs(grown) + knee
    power = math.floor(math.log2(biased)) if biased < 1 << 40 else None
    # straight between powers of two
    exact = Fraction(power - config.features.integral_knee) + Fraction(biased, 1 << power) - 1
    logarithm = math.floor(exact * (1 << config.features.integral_frac))
    return {"mean": sum(frames), "activity": total, "integral": logarithm if grown >= 0 else -logarithm}


@each_row("name", CONFIGS)
@each_row("rule", ["sum", "change"])
@each_row("block", [1, 3, 6])
def test_windows_give_what_loops_over_their_frames_give(name, rule, block):
    config = CONFIGS[name].replace(activity_rule=rule, activity_block=block, feature_kinds=FEATURE_KINDS)
    recordings = streams(config, 6, seed=block)
    touches = find_touches(config, recordings)
    alone = {
        subset: find_touches(config.replace(feature_kinds=subset), recordings).sums for subset in SUBSETS
    }
    assert len(touches) > 3 and touches.sums.shape[1:] == (config.windows.steps, 12)
    seen = 0
    for number, (index, start, completed) in enumerate(
        zip(touches.recording, touches.start_frame, touches.completed, strict=True)
    ):
        stream = recordings.recording(int(index))
        deviations = TouchFinder(config).push(stream[:, None].astype(np.int32))[0][:, 0]
        for k, (first, last) in enumerate(config.window_spans):
            for taxel in range(config.sensor.taxels):
                expected = {kind: 0 for kind in FEATURE_KINDS}
                if k < completed:
                    expected = one_window(config, deviations, int(start), first, last, taxel)
                    seen += 1
                for subset, sums in alone.items():
                    columns = sums[number, k, taxel * len(subset) : (taxel + 1) * len(subset)]
                    assert columns.tolist() == [expected[kind] for kind in subset], (subset, k, taxel)
    assert seen > 50
    bound = 1 << config.sum_bits - 1
    assert np.abs(touches.sums).max() < bound


@each_row(
    ("changes", "match"),
    [
        ({"feature_kinds": ()}, "feature_kinds: .* name one or more"),
        ({"feature_kinds": ("median",)}, "feature_kinds: .* give one of mean, activity, integral"),
        ({"feature_kinds": ("mean", "mean")}, "feature_kinds: .* each kind once"),
        ({"feature_kinds": ("activity", "mean")}, "feature_kinds: .* in the order mean, activity, integral"),
        (
            {"feature_kinds": ("mean", "activity"), "activity_block": 5},
            "activity_block: is 5 with hops of 12 .* use 1, 2, 3, 4, 6, 12",
        ),
        ({"feature_kinds": ("mean", "activity"), "activity_block": 0}, "activity_block"),
        (
            {"feature_kinds": ("mean", "activity"), "activity_rule": "median"},
            "activity_rule: .* one of sum, change",
        ),
        (
            {"feature_kinds": ("integral",), "integral_knee": 30},
            "integral_knee: is 30 for integrals of 16 bits; give at most 14",
        ),
        ({"feature_scale": "row"}, "feature_scale: .* one of array, taxel"),
        (
            {"feature_kinds": FEATURE_KINDS, "feature_shift": (3,)},
            "feature_shift: has 1 values for 1 distinct window lengths of 3 kinds",
        ),
        (
            {"feature_kinds": FEATURE_KINDS, "feature_shift": (3, 3, 3), "aligned_means": True},
            "aligned_means: needs one mean",
        ),
        (
            {"feature_kinds": FEATURE_KINDS, "taxels": 171, "clock_hz": 50e6},
            "feature_kinds: 3 kinds of 171 taxels make 513 inputs, above the limit of 512",
        ),
        ({"feature_shift": (99,)}, "feature_shift: must lie in -10..15"),
        ({"feature_kinds": FEATURE_KINDS, "clock_hz": 20e3}, "4 taxels with 3 kinds .* at least 24000"),
    ],
)
def test_what_cannot_work_is_refused_with_what_does(changes, match):
    with pytest.raises(InputError, match=match):
        FREE.replace(**changes)


@pytest.mark.parametrize(("knee", "fraction"), [(0, 5), (3, 5), (3, 1), (5, 7), (8, 8), (9, 9)])
def test_companding_is_odd_and_monotone_and_can_be_undone(knee, fraction):
    sums = np.arange(-1024, 1025)
    found = companded(sums, knee, fraction)
    np.testing.assert_array_equal(found, -found[::-1])
    assert (np.diff(found) >= 0).all() and found[1024] == 0
    # back: 2**whole * (1 + fraction) - 1 knees, below the sum by less than a step of the fraction
    whole, part = np.divmod(np.abs(found), 1 << fraction)
    back = (2.0**whole * (1 + part / 2.0**fraction) - 1) * 2**knee
    lost = np.abs(sums) - back
    assert (lost >= 0).all() and (lost < (np.abs(sums) + 2**knee) / 2**fraction + 1e-9).all()
    # never further from the true logarithm than a straight line between powers of two is, and a step of the
    # fraction
    true = np.log2(1 + np.abs(sums) / 2**knee)
    assert (np.abs(np.abs(found) / 2**fraction - true) < 0.0861 + 2.0**-fraction).all()
