"""Moving sums of random deviations against plain sums: which taxels exceed the threshold, and when the
verdict is there."""

from __future__ import annotations

import random

from amaranth.hdl import signed

from eskin.golden.core.config import PRESETS
from eskin.rtl.frontend.moving_sums import MovingSums
from tests.support.stream_bench import put, simulate
from tests.support.table import each_row

TAXELS, FRAMES = 5, 40


@each_row(("mean", "check"), [(8, 4), (8, 8), (4, 2), (16, 4)])
def test_the_verdict_of_each_block_is_that_of_plain_sums(mean, check):
    config = PRESETS["synthetic"].replace(
        taxels=TAXELS, onset_mean_frames=mean, onset_check_frames=check, onset_threshold=300, rearm_frames=64
    )
    bits = config.deviation_bound.bit_length() + 1
    dut, rng = MovingSums(config, signed(bits)), random.Random(mean)
    most = config.deviation_bound
    values = [
        [rng.choice((-most, most, 0, rng.randint(-900, 900))) for _ in range(TAXELS)] for _ in range(FRAMES)
    ]
    masked, verdicts = [k == 2 for k in range(TAXELS)], []

    async def bench(ctx):
        beats = [(frame, taxel) for frame in range(FRAMES) for taxel in range(TAXELS)]
        put(ctx, dut, advance=1, coming_valid=1, coming_index=0)
        await ctx.tick()
        over = False
        for number, (frame, taxel) in enumerate(beats):
            end = (frame + 1) % check == 0
            put(
                ctx,
                dut,
                index=taxel,
                last=taxel == TAXELS - 1,
                block_end=end,
                masked=masked[taxel],
                complement=~values[frame][taxel],
                coming_index=(taxel + 1) % TAXELS,
            )
            waits = 0
            ctx.set(dut.last_taken, 0)
            if end and taxel == TAXELS - 1:
                ctx.set(dut.advance, 0)
                while not ctx.get(dut.decided):
                    over |= bool(ctx.get(dut.over))
                    await ctx.tick()
                    waits += 1
                assert waits == 3
                verdicts.append(over)
                over = False
                put(ctx, dut, advance=1, last_taken=1)
            else:
                over |= bool(ctx.get(dut.over))
            assert number or not ctx.get(dut.decided)
            await ctx.tick()

    simulate(dut, bench)
    sums = [
        [sum(row[k] for row in values[max(0, end - mean) : end]) for k in range(TAXELS)]
        for end in range(check, FRAMES + 1, check)
    ]
    wanted = [
        any(abs(value) > 300 * mean for value, off in zip(row, masked, strict=True) if not off)
        for row in sums
    ]
    assert verdicts == wanted and any(wanted) and len(wanted) == FRAMES // check
