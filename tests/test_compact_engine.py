"""The compact engine (one serial lane) bit for bit against golden cells, its cycles, its proven widths, the images of its memories."""

from __future__ import annotations

import pytest

from golden.formats import QFormat
from golden.model import random_integer_model
from tests.test_engine import check_exact_and_cycles, expected, run, small, windows

CELLS = [("gru", "before"), ("gru", "after"), ("lstm", "before")]


def serial(cell: str, reset: str, **changes):
    """`small` on one serial lane."""
    return small(cell, reset, 1, lane_type="serial", **changes)


@pytest.mark.parametrize("decision", ["vote", "last"])
@pytest.mark.parametrize(("cell", "reset"), CELLS)
def test_bit_exact_and_cycles_of_the_program(cell, reset, decision):
    check_exact_and_cycles(serial(cell, reset, decision=decision), touches=2)
