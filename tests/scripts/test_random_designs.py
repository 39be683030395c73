"""Random configurations, golden against RTL at every stage: a few by hypothesis, and those that once failed (make designs runs 300)."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from eskin.golden.core.errors import InputError
from eskin.rtl.frontend import moving_sums
from scripts.design_job import Recorded, draw, fails, judged, model_of, play, random_row, shrink

FAILED = json.loads((Path(__file__).parent / "failing_designs.json").read_text())
"""What was wrong -> the row of choices."""


@pytest.mark.timeout(600)
@settings(max_examples=4, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_a_drawn_design_is_exact(tmp_path_factory, data):
    try:
        design = draw(lambda options: data.draw(st.sampled_from(options)))
        model_of(design)
    except InputError:
        assume(False)
    result = play(design, tmp_path_factory.mktemp("design"))
    assert result["bit_exact"], (design, result["mismatch_list"])


@pytest.mark.timeout(300)
@pytest.mark.parametrize("what", FAILED)
def test_a_design_that_once_failed(what):
    record = judged(FAILED[what])
    assert record["exact"], record["detail"]


@pytest.mark.timeout(300)
def test_a_broken_design_is_seen(monkeypatch):
    """The threshold's upper bits ignored, as they once were."""
    right = moving_sums.exceeds

    def cut(value, bound):
        half = 1 << len(value) - 1
        return right(value, (bound + half) % (2 * half) - half if bound >= half else bound)

    monkeypatch.setattr(moving_sums, "exceeds", cut)
    assert fails(FAILED["a threshold above the clip"])


def test_rows_make_the_same_design_again_and_shrink_to_what_fails():
    row = random_row(3, 5)
    assert random_row(3, 5) == row and draw(Recorded(row)) == draw(Recorded(row)) and random_row(4, 5) != row
    assert shrink([3, 5, 9, 1], lambda row: row[1] >= 2 and row[2] > 0) == [0, 2, 1, 0]


@pytest.mark.parametrize("bits", [1, 3])
def test_exceeds_for_every_value_and_bound(bits):
    """Bounds beyond the value's range too: they were cut to its width."""
    from amaranth.hdl import Module, Signal, signed, unsigned
    from amaranth.sim import Simulator

    for shape in (signed(bits), unsigned(bits)):
        bounds = range(-(1 << bits + 2), 1 << bits + 2)
        value, results = Signal(shape), {bound: Signal() for bound in bounds}
        m = Module()
        m.d.comb += [result.eq(moving_sums.exceeds(value, bound)) for bound, result in results.items()]
        simulator = Simulator(m)

        async def bench(ctx, shape=shape, value=value, results=results):
            low = -(1 << bits - 1) if shape.signed else 0
            for number in range(low, low + (1 << bits)):
                ctx.set(value, number)
                for bound, result in results.items():
                    assert ctx.get(result) == (number > bound), (shape, number, bound)

        simulator.add_testbench(bench)
        simulator.run()
