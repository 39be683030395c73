"""The longest of what is measured, against a list of events; saturation."""

from __future__ import annotations

import random

import pytest
from amaranth.sim import Simulator

from eskin.rtl.host.cycle_counter import CycleCounter
from eskin.rtl.program.memory_map import Measure
from tests.support.table import each_row


def play(measure: Measure, events, *, after: int = 4) -> int:
    """What LONGEST is after ``events``, a dict of input levels a cycle."""
    dut, result = CycleCounter(), []

    async def bench(ctx):
        ctx.set(dut.measure, int(measure))
        for event in [*events, *[{}] * after]:
            for name in (
                "clear",
                "anew",
                "forget",
                "offered",
                "first",
                "taken",
                "last",
                "slot_done",
                "step_done",
                "windows_open",
            ):
                ctx.set(getattr(dut, name), event.get(name, 0))
            await ctx.tick()
        result.append(ctx.get(dut.longest))

    sim = Simulator(dut)
    sim.add_clock(1e-6)
    sim.add_testbench(bench)
    sim.run()
    return result[0]


@each_row("measure", [Measure.STEP, Measure.FRAME, 2])
def test_the_longest_of_random_lengths(measure):
    rng = random.Random(int(measure))
    lengths = [rng.randint(2, 40) for _ in range(12)]
    events = []
    for length in lengths:
        events += [{}] * rng.randint(1, 3)
        for cycle in range(length):
            end = cycle == length - 1
            events.append(
                {"slot_done": 1, "step_done": end}
                if measure == Measure.STEP
                else {"offered": 1, "first": cycle == 0, "taken": end, "last": end}
                if measure == Measure.FRAME
                else {"windows_open": 1}
            )
    assert play(measure, events) == max(lengths)
    # what was counted before a recording began, or something else was measured, is no part of the next
    half = [{"slot_done": 1}] * 30
    for stop in ("clear", "anew"):
        assert (
            play(Measure.STEP, [*half, {stop: 1, "forget": 1}, *half[:7], {"slot_done": 1, "step_done": 1}])
            == 8
        )


@pytest.mark.slow
def test_it_stays_at_its_end():
    assert play(Measure.STEP, [{"slot_done": 1}] * 65_600) == 65_535
