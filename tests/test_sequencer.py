"""Runs without gaps, waiting, holding, and starting over."""

from __future__ import annotations

import random

from amaranth.sim import Simulator

from rtl.sequencer import Sequencer

RUNS = [
    {"length": 2, "index": 0, "wait": 0, "end": 0, "tag": 1},
    {"length": 1, "index": 7, "wait": 0, "end": 0, "tag": 2},
    {"length": 3, "index": 4, "wait": 1, "end": 0, "tag": 3},
    {"length": 1, "index": 9, "wait": 0, "end": 1, "tag": 4},
]
PASS = [(3, 4), (3, 5), (3, 6), (4, 9)]


def play(advance, go, restart, cycles):
    """Taken (tag, index) with their cycles."""
    dut, taken = Sequencer({"tag": 3}, RUNS, again=2), []

    async def bench(ctx):
        for cycle in range(cycles):
            ctx.set(dut.advance, advance(cycle))
            ctx.set(dut.go, go(cycle))
            ctx.set(dut.restart, restart(cycle))
            _, _, valid, word, index, ended = await ctx.tick().sample(dut.valid, dut.word, dut.index, dut.ended)
            if valid and advance(cycle):
                taken.append((cycle, word.tag, index))
                assert ended == (word.tag == 4)

    sim = Simulator(dut)
    sim.add_clock(1e-6)
    sim.add_testbench(bench)
    sim.run()
    return taken


def test_runs_follow_without_a_gap_and_wait_for_go():
    taken = play(lambda c: 1, lambda c: c == 10, lambda c: 0, 16)
    assert taken == [(1, 1, 0), (2, 1, 1), (3, 2, 7), (10, 3, 4), (11, 3, 5), (12, 3, 6), (13, 4, 9)]


def test_restart_begins_at_the_first_run():
    taken = play(lambda c: 1, lambda c: 1, lambda c: 1, 12)
    assert [entry[1:] for entry in taken][:9] == [(1, 0), (1, 1), (2, 7), *PASS, (1, 0), (1, 1)]


def test_a_go_in_a_held_cycle_is_remembered():
    taken = play(lambda c: c != 10, lambda c: c == 10, lambda c: 0, 16)
    assert [entry for entry in taken if entry[0] >= 10] == [(11, 3, 4), (12, 3, 5), (13, 3, 6), (14, 4, 9)]


def test_holding_at_random_changes_no_order():
    rng = random.Random(3)
    held = [rng.random() < 0.5 for _ in range(200)]
    taken = play(lambda c: held[c], lambda c: 1, lambda c: 0, 200)
    order = [entry[1:] for entry in taken]
    assert order[:3] == [(1, 0), (1, 1), (2, 7)]
    assert order[3:] == (PASS * 50)[: len(order) - 3] and len(order) > 40
