"""rtl/frontend/compander.py and eskin.golden.model.preprocess.compand: every sum of narrow windows, and what
the formula promises."""

import numpy as np
import pytest

from eskin.golden.core import PRESETS
from eskin.golden.model.preprocess import compand
from eskin.rtl.frontend.compander import Compander
from tests.support.stream_bench import play, values


def companding(knee, fraction, **changes):
    """Sums of 11 bits: 4 taxels, 16 frames, deviations within +-60."""
    sizes = {
        "taxels": 4,
        "hop": 8,
        "window": 16,
        "steps": 4,
        "clip": 60,
        "compand": "log",
        "compand_knee": knee,
        "compand_frac": fraction,
    }
    return PRESETS["pvdf"].replace(**{**sizes, **changes})


KNEES = [(0, 5), (3, 5), (3, 1), (5, 7), (8, 8), (9, 9)]


@pytest.mark.parametrize(("knee", "fraction"), KNEES)
def test_every_sum_is_companded_as_the_golden_model_does(knee, fraction):
    config = companding(knee, fraction)
    assert config.sum_bits == 11
    sums, stall = np.arange(-1024, 1024), 0.2 * (knee % 2)
    beats = [
        {"complement": ~int(d), "taxel": k % 4, "length": 0, "final": k % 3 == 0} for k, d in enumerate(sums)
    ]
    out, _ = play(Compander(config), beats, (stall, stall), seed=fraction)
    expected = compand(config, sums)
    assert values(out) == [beat | {"complement": ~int(c)} for beat, c in zip(beats, expected, strict=True)]


@pytest.mark.parametrize(("knee", "fraction"), KNEES)
def test_companding_is_odd_and_monotone_and_can_be_undone(knee, fraction):
    config = companding(knee, fraction)
    sums = np.arange(-1024, 1025)
    found = compand(config, sums)
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
