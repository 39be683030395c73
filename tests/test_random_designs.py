"""Random designs, golden against RTL at every stage: a few, and those that once failed; ``make designs``
draws 300."""

import json
from pathlib import Path

import pytest
from hypothesis import event, given

from eskin.rtl.frontend import moving_sums
from tests.support.strategies import LONG, Design, designs, differences, examples, taught_designs, touched
from tests.support.stream_bench import simulate
from tests.support.table import each_row
from tests.support.taught_device import taught_at_random

FAILED = json.loads((Path(__file__).parent / "failing_designs.json").read_text())
"""What was wrong -> the design."""
SHOWN = (
    *("cell", "lane_type", "onset", "window_mode", "decision", "feature_kinds", "converter", "clock_gate"),
    *("readout", "taught", "spare_classes"),
)


@pytest.mark.timeout(0 if LONG else 600)
@pytest.mark.parametrize("part", range(6 if LONG else 1))
@examples(1, 50)
@given(design=designs())
def test_a_drawn_design_is_exact(tmp_path_factory, part, design):
    for field in SHOWN:
        event(f"{field} {design.config.value(field)}")
    assert not differences(design, tmp_path_factory.mktemp("design"))


@pytest.mark.slow
@pytest.mark.timeout(0 if LONG else 600)
@pytest.mark.parametrize("part", range(3 if LONG else 1))
@examples(1, 30)
@given(design=taught_designs())
def test_a_drawn_design_is_taught_as_the_stream_is(tmp_path_factory, part, design):
    """Touches, TEACH, FORGET and reloads in any order: decisions, flags and what is read out of the memory. A simulator is
    built for each; tests/cosim/test_teaching.py does the same to a design that is not drawn."""
    folder = tmp_path_factory.mktemp("design")
    both = taught_at_random(design.model, touched(design, (3, 3, 1, 2, 3, 2)), folder, design.seed)
    event(f"taught {both.taught > 0}, refused {both.refused > 0}, decided {both.decisions > 0}")


LONG_ONES = (
    "one saturated taxel of two converters in series",
    "a table entry looked up by nobody yet, with the checksum",
)


@pytest.mark.parametrize(
    "title", [pytest.param(title, marks=pytest.mark.slow if title in LONG_ONES else ()) for title in FAILED]
)
def test_a_design_that_once_failed(tmp_path, title):
    assert not differences(Design.of(FAILED[title]), tmp_path)


@each_row("bits", [1, 3])
def test_exceeds_for_every_value_and_bound(bits):
    """Bounds beyond the value's range too: they were cut to its width."""
    from amaranth.hdl import Module, Signal, signed, unsigned

    for shape in (signed(bits), unsigned(bits)):
        bounds = range(-(1 << bits + 2), 1 << bits + 2)
        value, results = Signal(shape), {bound: Signal() for bound in bounds}
        m = Module()
        m.d.comb += [result.eq(moving_sums.exceeds(value, bound)) for bound, result in results.items()]

        async def bench(ctx, shape=shape, value=value, results=results):
            low = -(1 << bits - 1) if shape.signed else 0
            for number in range(low, low + (1 << bits)):
                ctx.set(value, number)
                for bound, result in results.items():
                    assert ctx.get(result) == (number > bound), (shape, number, bound)

        simulate(m, bench)
