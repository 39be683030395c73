"""Kinds of feature beyond the mean: what cannot work. Their values are held by hardware, which keeps running sums."""

import numpy as np

from eskin.golden.core import FEATURE_KINDS
from eskin.golden.model.preprocess import companded
from tests.support.front_end_cases import CASES
from tests.support.table import each_row, refused

FREE = CASES["one block"].replace(
    rest_frames=8, sample_bits=9, integral_knee=3, integral_frac=5, hop=12, window=24, steps=4
)


@each_row(
    "changes, match",
    [
        ({"feature_kinds": ()}, "feature_kinds: .* name one or more"),
        (
            {"feature_kinds": ("median",)},
            "feature_kinds: .* give one of mean, activity, integral, highest, lowest",
        ),
        ({"feature_kinds": ("mean", "mean")}, "feature_kinds: .* each kind once"),
        (
            {"feature_kinds": ("activity", "mean")},
            "feature_kinds: .* in the order mean, activity, integral, highest, lowest",
        ),
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
            "feature_shift: has 1 values for 1 distinct window lengths of 5 kinds",
        ),
        (
            {"feature_kinds": FEATURE_KINDS, "feature_shift": (3,) * 5, "aligned_means": True},
            "aligned_means: needs one mean",
        ),
        (
            {"feature_kinds": FEATURE_KINDS, "taxels": 103, "clock_hz": 50e6},
            "feature_kinds: 5 kinds of 103 taxels make 515 inputs, above the limit of 512",
        ),
        ({"feature_shift": (99,), "sample_bits": 16, "checksum": True}, "feature_shift: must lie in -9..22"),
        ({"feature_kinds": FEATURE_KINDS, "clock_hz": 15e3}, "3 taxels with 5 kinds .* at least 30000"),
    ],
)
def test_what_cannot_work_is_refused_with_what_does(changes, match):
    with refused(match):
        FREE.replace(**changes)


@each_row("knee, fraction", [(0, 5), (3, 5), (3, 1), (5, 7), (8, 8), (9, 9)])
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
