"""rtl/interface/frame_guard.py: good frames whole and in order, bad ones not at all; that late ones are left out is
proved in formal/interface/frame_guard.py."""

import random

from eskin.golden.core import PRESETS
from eskin.rtl.interface.frame_guard import FrameGuard
from tests.support.stream_bench import Bench, put, values
from tests.support.table import each_row

CONFIG = PRESETS["fabric"].replace(taxels=5)
"""Signed samples."""


def beats(samples):
    return [{"sample": sample, "first": k == 0, "last": k == 4} for k, sample in enumerate(samples)]


@each_row("stall", [0.0, 0.3])
def test_good_frames_whole_bad_ones_not_at_all(stall):
    rng, dut, ends = random.Random(1), FrameGuard(CONFIG), []
    frames = [([rng.randrange(-32768, 32768) for _ in range(5)], rng.random() < 0.4) for _ in range(30)]
    bench = Bench(dut, seed=2)

    async def play(ctx):
        for samples, bad in frames:
            for place in rng.sample(range(5), 5):
                put(ctx, dut.put, valid=1, place=place, sample=samples[place])
                await ctx.tick()
                ctx.set(dut.put.valid, 0)
                await ctx.tick()
            put(ctx, dut, finished=1, bad=bad)
            ends.append(bench.cycle + 1)  # the edge that sees it
            await ctx.tick()
            ctx.set(dut.finished, 0)
            await ctx.tick().repeat(60)

    out, broken = bench.collect(dut.o, stall=stall), bench.watch(dut.broken)
    bench.process(play)
    bench.run()
    assert values(out) == [beat for samples, bad in frames if not bad for beat in beats(samples)]
    assert broken == [end for end, (_, bad) in zip(ends, frames, strict=True) if bad]
    if not stall:
        assert out[0].cycle == next(end for end, (_, bad) in zip(ends, frames, strict=True) if not bad) + 2
        assert [later.cycle - out[0].cycle for later in out[:5]] == [0, 2, 4, 6, 8]
