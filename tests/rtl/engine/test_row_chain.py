"""Sums out, addends in: a swap takes all lanes, each shift moves on by one, nothing moves without a tick."""

from __future__ import annotations

import random

from eskin.rtl.engine.row_chain import RowChain
from tests.support.stream_bench import put, simulate
from tests.support.table import each_row

BITS = 26


@each_row("lanes", [2, 3, 7])
def test_chain_against_a_list(lanes):
    dut, rng = RowChain(BITS, lanes), random.Random(lanes)
    top = 1 << BITS - 1
    places, moved = [0] * lanes, {"swap": 0, "shift": 0, "held": 0}

    async def bench(ctx):
        for cycle in range(400):
            tick, swap, shift = (
                cycle == 0 or rng.random() < 0.8,
                cycle == 0 or rng.random() < 0.15,
                rng.random() < 0.6,
            )
            shift &= not swap  # never asked for together
            sums = [rng.choice([-top, top - 1, rng.randrange(-top, top)]) for _ in range(lanes)]
            addend = rng.choice([-top, top - 1, rng.randrange(-top, top)])
            put(ctx, dut, tick=tick, swap=swap, shift=shift, addend=addend)
            for lane, value in enumerate(sums):
                ctx.set(dut.acc[lane], value)
            await ctx.tick()
            if tick and swap:
                places[:] = sums
            elif tick and shift:
                places[:] = [*places[1:], addend]
            moved["held" if not tick else "swap" if swap else "shift"] += 1
            assert ctx.get(dut.total) == places[0]
            assert [ctx.get(dut.load[lane]) for lane in range(lanes)] == places

    simulate(dut, bench)
    assert min(moved.values()) > 20


def test_addends_are_in_place_after_as_many_shifts_as_lanes_while_the_sums_leave():
    lanes, sums, addends = 4, [11, 22, 33, 44], [5, 6, 7, 8]
    dut, left = RowChain(BITS, lanes), []

    async def bench(ctx):
        put(ctx, dut, tick=1, swap=1)
        for lane, value in enumerate(sums):
            ctx.set(dut.acc[lane], value)
        await ctx.tick()
        put(ctx, dut, swap=0, shift=1)
        for value in addends:
            left.append(ctx.get(dut.total))
            ctx.set(dut.addend, value)
            await ctx.tick()
        assert [ctx.get(dut.load[lane]) for lane in range(lanes)] == addends

    simulate(dut, bench)
    assert left == sums
