"""The reciprocal of the settling sum, and levels of one taxel against plain arithmetic (all formats:
test_onset_detector.py)."""

from __future__ import annotations

import random

import numpy as np

from eskin.golden.core.config import PRESETS
from eskin.rtl.frontend.rest_level import RestLevel, exact_reciprocal
from tests.support.stream_bench import put, simulate
from tests.support.table import each_row


@each_row("frames", [8, 12])
@each_row("rule", ["tracked", "initial"])
def test_a_level_settles_on_the_mean_and_then_follows_by_a_sixteenth_or_stays(rule, frames):
    config = PRESETS["synthetic"].replace(rest=rule, rest_frames=frames)
    dut, rng = RestLevel(config), random.Random(frames)
    samples, seen = [rng.randint(20000, 20400) for _ in range(60)], []

    async def bench(ctx):
        put(ctx, dut, coming_index=3, w_index=3, advance=1)
        await ctx.tick()
        for number, sample in enumerate(samples):
            put(ctx, dut, sample=~sample, settle_first=number == 0)
            deviation = ctx.get(dut.deviation)
            await ctx.tick()
            settling = number < frames
            put(
                ctx,
                dut,
                settling=settling,
                settle_last=number == frames - 1,
                negative=not settling and deviation < 0,
            )
            level = ctx.get(dut.next)
            if settling or rule == "tracked":
                put(ctx, dut, w_level=level, w_enable=1)
            await ctx.tick()
            ctx.set(dut.w_enable, 0)
            await ctx.tick()
            if not settling:
                seen.append((~deviation, level >> dut.level_frac - 4))

    simulate(dut, bench)
    baseline, expected = (32 * sum(samples[:frames]) + frames) // (2 * frames), []
    for sample in samples[frames:]:
        deviation = sample - (baseline + 8 >> 4)
        after = baseline + (0 if rule == "initial" else (16 * sample > baseline) - (16 * sample < baseline))
        expected.append((deviation, after))
        baseline = after
    if rule == "initial":
        assert [deviation for deviation, _ in seen] == [deviation for deviation, _ in expected]
    else:
        assert seen == expected


@each_row("divisor", [3, 5, 6, 7, 48, 100, 4095])
def test_reciprocal_is_exact(divisor):
    largest = 16 * divisor * 65535 + divisor // 2
    factor, shift = exact_reciprocal(divisor, largest)
    multiples = np.arange(0, largest + 1, divisor, dtype=np.int64)
    for number in (multiples, np.minimum(multiples + divisor - 1, largest)):  # where a floor can go wrong
        assert all(
            int(n) * factor >> shift == int(n) // divisor for n in number[:: max(1, len(number) // 5000)]
        )
    assert largest * factor >> shift == largest // divisor
