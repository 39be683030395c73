"""The rule: what is level, what is cheap, and what a board has to say."""

import numpy as np
import pytest

from eskin.choose.candidate import Candidate, ScoredCandidate, choose
from eskin.choose.cost import Cost
from eskin.training.formats import with_network
from eskin.training.level import TIE, is_level, least_error, paired_shortfall
from eskin.training.recipe import RECIPES
from tests.support.prices import priced
from tests.support.small_designs import TRACKED
from tests.support.table import each_row, refused

CONFIG = TRACKED.replace(
    name="derived",
    taxels=12,
    sample_rate_hz=200.0,
    sample_bits=8,
    hop=16,
    window=32,
    steps=6,
    rest="none",
    rest_frames=0,
    onset="immediate",
    class_names=("object0", "object1", "object2"),
)


def judged(cell: str, hidden: int | None, right: int, of: int = 100, won: int = 0) -> ScoredCandidate:
    """``right`` of the first in all; ``won`` of these that one which is right on the first 90 is not."""
    correct = np.zeros(of)
    correct[:right] = 1.0
    correct = np.roll(correct, 90 - right + won) if won else correct
    config = with_network(CONFIG, cell=cell, hidden=hidden)
    return ScoredCandidate(Candidate(CONFIG, config, RECIPES["contact"]), correct)


@each_row(
    "right, won, level",
    [
        (89, 0, True),  # one lost, none won: exactly one standard error
        (88, 0, False),  # two lost: 0.02 behind, 0.014
        (87, 3, True),  # 6 lost and 3 won: 3 of sqrt(9)
        (87, 0, False),  # 1.7 standard errors; unpaired, 3.0 points would do
        (86, 3, False),
    ],
)
def test_the_cheapest_within_a_standard_error_of_the_paired_difference(right, won, level):
    large, small = judged("gru", 12, 90), judged("gru", 4, right, won=won)
    shortfall, error = paired_shortfall(large.correct, small.correct)
    difference = large.correct - small.correct
    assert shortfall == pytest.approx((90 - right) / 100)
    assert error == pytest.approx(np.sqrt(difference.var(ddof=1) / 100))
    assert is_level(large.correct, small.correct) == level == (shortfall <= TIE * error * 1.000001)
    assert choose([small, large], priced()) is (small if level else large)
    assert choose([large, small], priced()) is (small if level else large)


def test_what_is_least_is_what_is_preferred_and_the_board_has_the_say():
    linear, small, large = judged("linear", None, 90), judged("gru", 4, 90), judged("gru", 8, 90)
    rows = {
        linear.config: Cost(energy_touch_j=3.0, cells=30, latency_s=2.0, touch_s=1.0, average_w=0.0),
        small.config: Cost(energy_touch_j=1.0, cells=30, latency_s=3.0, touch_s=1.0, average_w=0.0),
        large.config: Cost(energy_touch_j=2.0, cells=20, latency_s=3.0, touch_s=0.5, average_w=0.0),
    }
    for prefer, expected in {"energy": small, "cells": large, "latency": linear}.items():
        prices = priced(cost_of=rows.__getitem__, prefer=prefer)
        assert choose([linear, small, large], prices) is expected, prefer
    only = {"cost_of": rows.__getitem__, "fits": lambda config: config == linear.config}
    assert choose([linear, small, large], priced(**only)) is linear
    nothing = {"cost_of": rows.__getitem__, "fits": lambda config: False}
    assert choose([linear, small, large], priced(**nothing)) is small


def test_a_named_board_has_to_hold_the_best_too():
    best, smaller = judged("gru", 12, 99), judged("gru", 4, 80)
    named = priced(named=True, fits=lambda config: config.network.hidden == 4)
    assert choose([best, smaller], named) is smaller
    with refused("`fits` icebreaker: is too small for all 2 candidates"):
        choose([best, smaller], priced(named=True, fits=lambda config: False))


def test_no_error_in_the_recordings_is_not_a_standard_error_of_nothing():
    """Laplace: n of n right is estimated as (n + 1) / (n + 2)."""
    share = 101 / 102
    assert least_error(100) == pytest.approx(np.sqrt(share * (1 - share) / 100))
    perfect, near = judged("gru", 12, 1000, 1000), judged("linear", None, 9995, 10000)
    assert perfect.standard_error == least_error(1000) == pytest.approx(0.00099800, rel=1e-3)
    assert perfect.settled and not near.settled
