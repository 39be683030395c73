"""Beats of any framing become whole frames; faults are told; what the sender frames well goes through as it
is."""

from __future__ import annotations

import random

from eskin.golden.core.config import PRESETS
from eskin.rtl.frontend.frame_aligner import FrameAligner
from tests.support.stream_bench import put, simulate
from tests.support.table import each_row

TAXELS = 5
CONFIG = PRESETS["thesis"].replace(taxels=TAXELS)


def play(beats: list[tuple[int, int]], seed: int) -> tuple[list[tuple[int, int | None]], int]:
    """(taxel, number of the sender's beat or None where one is repeated) of each beat that is taken, and the
    cycles with a fault.

    ``beats``: (first, last) of what the sender offers, one after the other.
    """
    dut, rng, taken, faults = FrameAligner(CONFIG), random.Random(seed), [], 0

    async def bench(ctx):
        nonlocal faults
        number, idle = 0, 0
        while number < len(beats) or idle < 40:
            offers = number < len(beats) and rng.random() < 0.8
            advance = rng.random() < 0.7
            ctx.set(dut.i.valid, offers)
            put(ctx, dut.i.p, first=beats[number][0] if offers else 0, last=beats[number][1] if offers else 0)
            ctx.set(dut.advance, advance)
            if advance and ctx.get(dut.offered):
                taken.append((ctx.get(dut.index), number if ctx.get(dut.fresh) else None))
                assert ctx.get(dut.last) == ctx.get(dut.frame_taken) == (taken[-1][0] == TAXELS - 1)
            else:
                assert not ctx.get(dut.frame_taken)
            faults += ctx.get(dut.framing_fault)
            number += offers and ctx.get(dut.i.ready)
            idle += number == len(beats)
            await ctx.tick()

    simulate(dut, bench)
    return taken, faults


def frame(length: int = TAXELS) -> list[tuple[int, int]]:
    return [(k == 0, k == length - 1) for k in range(length)]


@each_row("seed", range(3))
def test_whole_frames_go_through_beat_by_beat(seed):
    taken, faults = play(frame() * 6, seed)
    assert taken == [(k % TAXELS, k) for k in range(6 * TAXELS)] and not faults


@each_row("seed", range(3))
def test_what_is_framed_badly_is_told_and_frames_stay_whole(seed):
    short, long, stray = frame(3), [(1, 0), *[(0, 0)] * TAXELS, (0, 1)], [(0, 0)] * 2
    taken, faults = play([*frame(), *short, *frame(), *stray, *long, *frame()], seed)
    assert [taxel for taxel, _ in taken] == list(range(TAXELS)) * 5 and faults >= 3
    assert [number is None for _, number in taken[TAXELS : 2 * TAXELS]] == [False] * 3 + [True] * 2, (
        "a short frame is filled up"
    )
    assert None not in [number for _, number in (*taken[:TAXELS], *taken[-TAXELS:])]


def test_a_frame_that_begins_inside_another_comes_after_it():
    taken, faults = play([(1, 0), (0, 0), *frame()], 1)
    assert [number for _, number in taken] == [0, 1, None, None, None, 2, 3, 4, 5, 6] and faults
