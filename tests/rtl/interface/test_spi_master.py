"""rtl/interface/spi_master.py: words both ways on several lines, and the cycles of select and clock."""

import random
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from eskin.golden.core import SpiPlan
from eskin.golden.core.converters.spi import SpiChip
from eskin.rtl.interface.spi_master import SpiMaster
from tests.support.spi_chip import SpiSlave
from tests.support.strategies import examples
from tests.support.stream_bench import Bench, put


def plan_of(bits: int, lines: int, selects: int, half: int, longer: int, high: int) -> SpiPlan:
    chip = SpiChip(bits=bits, channels=1, sclk_hz=1e6, conversions_hz=1e6, high_s=0, lead_s=0)
    return SpiPlan(
        chip=chip,
        lines=lines,
        selects=selects,
        transfers=((0, 0),),
        half=half,
        lead=half + longer,
        high=high,
        clock_hz=1e6,
    )


@examples(12, 200)
@given(
    shape=st.fixed_dictionaries(
        {
            "bits": st.integers(1, 24),
            "lines": st.integers(1, 3),
            "selects": st.integers(1, 3),
            "half": st.integers(1, 6),
            "longer": st.integers(0, 5),
            "high": st.integers(1, 9),
        }
    )
)
def test_words_cross_and_every_time_is_kept(shape):
    plan, rng = plan_of(**shape), random.Random(str(shape))
    dut, bits = SpiMaster(plan), plan.chip.bits
    bench = Bench(dut)
    answers = [[rng.getrandbits(bits) for _ in range(plan.lines)] for _ in range(12)]
    requests = [(rng.randrange(plan.selects), rng.getrandbits(bits)) for _ in answers]
    got, starts = [], []
    latest = max(0, 2 * plan.half - 3)  # at which it is there a whole cycle before the port reads it
    slave = SpiSlave(dut.pins, bits, lambda line, fell: answers[len(got)][line], latest)
    bench._sim.add_testbench(slave.play, background=True)

    async def play(ctx):
        await ctx.tick()
        for select, command in requests:
            put(ctx, dut, select=select, command=command, start=1)  # early: it begins when the port is idle
            while not ctx.get(dut.idle):
                await ctx.tick()
            starts.append(bench.cycle)
            await ctx.tick()
            ctx.set(dut.start, 0)
            ctx.set(dut.command, rng.getrandbits(bits))  # taken with start alone
            while not ctx.get(dut.done):
                await ctx.tick()
            await ctx.tick()
            got.append([ctx.get(word) for word in dut.words])

    bench.process(play)
    bench.run()
    assert got == answers and slave.heard == [(1 << select, bits, command) for select, command in requests]
    assert {later - earlier for earlier, later in pairwise(starts)} == {plan.transfer_cycles}
    selects = [cycle for cycle, what, _ in slave.edges if what == "select"]
    clocks = [cycle for cycle, what, _ in slave.edges if what == "clock"]
    for number in range(len(answers)):
        fell, rose = selects[2 * number : 2 * number + 2]
        edges = clocks[2 * bits * number : 2 * bits * (number + 1)]
        assert edges[0] - fell == plan.lead and {b - a for a, b in pairwise([*edges, rose])} == {plan.half}
        assert number == 0 or fell - selects[2 * number - 1] == plan.high
