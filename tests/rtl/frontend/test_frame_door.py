"""rtl/frontend/frame_door.py: which frames pass, how they are counted, and that dropping costs nothing behind."""

import pytest
from amaranth.hdl import ResetInserter, Signal

from eskin.golden.core import PRESETS
from eskin.rtl.frontend.frame_door import FrameDoor
from tests.support.stream_bench import Bench, values


def frames(count, taxels=3, first=0):
    """Beats of so many frames, numbered."""
    return [
        {"sample": first + frame, "first": taxel == 0, "last": taxel == taxels - 1}
        for frame in range(count)
        for taxel in range(taxels)
    ]


@pytest.mark.parametrize("k", [2, 4, 8, 16])
@pytest.mark.parametrize("every", [0, 1])
@pytest.mark.parametrize("stall", [0.0, 0.4])
def test_the_first_of_every_k_frames_passes_and_without_every_all_do(k, every, stall):
    dut = FrameDoor(PRESETS["pvdf"].replace(scan_every=k))
    bench = Bench(dut, seed=k)

    async def switch(ctx):
        ctx.set(dut.every, every)

    bench.process(switch)
    sent = frames(2 * k + 3)
    taken = bench.drive(dut.i, sent, stall=stall, after=2)
    out = bench.collect(dut.o, stall=stall)
    bench.run()
    kept = [beat for beat in sent if not every or beat["sample"] % k == 0]
    assert values(out) == kept
    # through in the cycle in which they are taken
    assert [beat.cycle for beat in out] == [
        cycle for cycle, beat in zip(taken, sent, strict=True) if beat in kept
    ]
    if not stall:
        assert taken == list(range(taken[0], taken[0] + len(sent)))


def test_a_reset_begins_a_count_and_frames_are_counted_where_they_begin():
    dut, clear = FrameDoor(PRESETS["pvdf"].replace(scan_every=4)), Signal()
    bench = Bench(ResetInserter(clear)(dut), seed=1)
    sent = [
        *frames(1),
        *frames(1, first=1)[:1],  # cut short: a frame all the same
        *frames(1, first=2),
        *frames(1, first=3)[:2],
        # a reset
        *frames(1, first=3)[2:],  # what is left of a frame goes on: the detector says FRAMING
        *frames(6, first=4),
    ]
    got = []

    async def play(ctx):
        ctx.set(dut.every, 1)
        ctx.set(dut.o.ready, 1)
        for number, beat in enumerate(sent):
            if number == 9:
                ctx.set(clear, 1)
                await ctx.tick()
                ctx.set(clear, 0)
            ctx.set(dut.i.valid, 1)
            for name, value in beat.items():
                ctx.set(dut.i.p[name], value)
            if ctx.get(dut.o.valid):
                got.append((number, beat["sample"]))
            await ctx.tick()
            ctx.set(dut.i.valid, 0)

    bench.process(play)
    bench.run()
    assert got == [(0, 0), (1, 0), (2, 0), (9, 3), (10, 4), (11, 4), (12, 4), (22, 8), (23, 8), (24, 8)]
