"""The longest of what is measured, against a list of events; that it saturates is proved in
formal/host/cycle_counter.py."""

from __future__ import annotations

import random

from eskin.rtl.host.cycle_counter import CycleCounter
from eskin.rtl.program.memory_map import Measure
from tests.support.stream_bench import simulate
from tests.support.table import each_row


def longest(measure: Measure, events) -> int:
    """What LONGEST is after ``events``, the inputs of each cycle that are high."""
    dut, result = CycleCounter(), []

    async def bench(ctx):
        ctx.set(dut.measure, int(measure))
        for event in [*events, *[()] * 4]:
            for name in event:
                ctx.set(getattr(dut, name), 1)
            await ctx.tick()
            for name in event:
                ctx.set(getattr(dut, name), 0)
        result.append(ctx.get(dut.longest))

    simulate(dut, bench)
    return result[0]


@each_row("measure", Measure)
def test_the_longest_of_random_lengths(measure):
    rng = random.Random(int(measure))
    lengths, events = [rng.randint(2, 40) for _ in range(12)], []
    ends = {Measure.STEP: ("step_done",), Measure.FRAME: ("taken", "last"), Measure.WINDOWS: ()}[measure]
    each = {Measure.STEP: "slot_done", Measure.FRAME: "offered", Measure.WINDOWS: "windows_open"}[measure]
    begins = ("first",) * (measure == Measure.FRAME)
    for length in lengths:
        events += [()] * rng.randint(1, 3) + [(each, *begins)] + [(each,)] * (length - 2) + [(each, *ends)]
    assert longest(measure, events) == max(lengths)


@each_row("stop", ["clear", "anew"])
def test_what_was_counted_before_is_no_part_of_the_next(stop):
    slot, end = ("slot_done",), ("slot_done", "step_done")
    assert longest(Measure.STEP, [slot] * 30 + [(stop, "forget")] + [slot] * 7 + [end]) == 8
