"""Windows come in at random and are released at random: order, lengths, marks, and that nothing is taken
without room."""

from __future__ import annotations

import random

from eskin.golden.core.config import PRESETS
from eskin.rtl.engine.window_queue import WindowQueue
from tests.support.stream_bench import put, simulate
from tests.support.table import each_row

CONFIG = PRESETS["thesis"].replace(taxels=5)


@each_row("eager", [0.95, 0.5])
def test_windows_are_read_in_order_and_never_overwritten(eager):
    dut, rng = WindowQueue(CONFIG, 3), random.Random(2)
    lengths = len(CONFIG.window_lengths)
    windows = [(rng.randrange(lengths), rng.random() < 0.3) for _ in range(60)]
    written: dict[int, list[int]] = {0: [], 1: []}  # windows whose beats went to each buffer, the newest last
    seen, overruns = [], 0

    async def bench(ctx):
        nonlocal overruns
        beats = [(number, taxel) for number in range(len(windows)) for taxel in range(CONFIG.inputs)]
        at, held = 0, []
        while len(seen) < len(windows):
            offers, hold = at < len(beats) and rng.random() < eager, rng.random() < 0.2
            number, taxel = beats[min(at, len(beats) - 1)]
            length, final = windows[number]
            put(
                ctx,
                dut.i,
                valid=offers,
                p={
                    "value": 0,
                    "length": length,
                    "first": taxel == 0,
                    "last": taxel == CONFIG.inputs - 1,
                    "final": final,
                },
            )
            ctx.set(dut.hold, hold)
            assert ctx.get(dut.waiting) == bool(held) == ctx.get(dut.any)
            release = bool(held) and rng.random() < 0.1
            ctx.set(dut.released, release)
            took = ctx.get(dut.take)
            assert took == (offers and ctx.get(dut.i.ready)) and not (hold and took)
            overruns += ctx.get(dut.overrun)
            assert ctx.get(dut.overrun) == (offers and taxel == 0 and len(held) == 2)
            if took:
                buffer = ctx.get(dut.writing)
                assert len(held) < 2 and ctx.get(dut.taxel) == taxel
                written[buffer].append(number)
                at += 1
            if release:
                one, buffer = held.pop(0), ctx.get(dut.reading)
                assert written[buffer][-1] == one, "another window has come into the buffer that is read"
                seen.append((ctx.get(dut.length), ctx.get(dut.final)))
            await ctx.tick()
            if took and taxel == CONFIG.inputs - 1:
                held.append(number)

    simulate(dut, bench)
    assert seen == windows and overruns > 3


def test_a_step_is_open_from_its_start_to_its_end():
    dut, seen = WindowQueue(CONFIG, 3), []

    async def bench(ctx):
        for started, done in ((0, 0), (1, 0), (0, 0), (0, 1), (0, 0)):
            put(ctx, dut, started=started, step_done=done)
            seen.append((ctx.get(dut.computing), ctx.get(dut.open)))
            await ctx.tick()

    simulate(dut, bench)
    assert seen == [(0, 0), (0, 0), (1, 1), (1, 1), (0, 0)]
