"""rtl/interface/sample_clock.py: the rate to the tick, and a new count after a pause."""

import pytest

from eskin.golden.core.converters import sample_clock
from eskin.rtl.interface.sample_clock import SampleClock
from tests.support.stream_bench import Bench
from tests.support.table import each_row


@each_row("clock, rate", [(12e6, 100e3), (1e6, 35714.2), (48e6, 441e3), (100.0, 99.0)])
def test_tick_number_k_comes_k_periods_after_the_first(clock, rate):
    p, q = sample_clock(clock, rate)
    assert p / q == pytest.approx(rate / clock, rel=1e-12)
    dut = SampleClock(p, q)
    bench = Bench(dut)
    ticks, begun = bench.watch(dut.tick), []

    async def play(ctx):
        for cycles in (700, 377):
            ctx.set(dut.run, 1)
            begun.append((bench.cycle + bool(begun), cycles))
            await ctx.tick().repeat(cycles)
            ctx.set(dut.run, 0)
            await ctx.tick().repeat(7)

    bench.process(play)
    bench.run()
    due = [
        begin + -(-k * q // p) for begin, cycles in begun for k in range(cycles) if -(-k * q // p) < cycles
    ]
    assert ticks == due
