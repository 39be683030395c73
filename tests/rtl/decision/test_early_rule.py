"""The early rule against the last decisions of a list."""

from __future__ import annotations

import random

from amaranth.sim import Simulator

from eskin.golden.core.config import PRESETS
from eskin.rtl.decision.early_rule import EarlyRule
from tests.support.table import each_row


@each_row(("wanted", "margin"), [(1, 3), (2, 3), (3, 0), (4, 2)])
def test_met_after_as_many_decisions_of_one_class_with_margin_enough(wanted, margin):
    config = PRESETS["thesis"].replace(decision="early", early_steps=wanted, early_margin=margin)
    dut, rng = EarlyRule(config, 3), random.Random(wanted)
    met = 0

    async def bench(ctx):
        nonlocal met
        past: list[tuple[int, int]] = []
        for _ in range(600):
            decision = rng.choice((0, 0, 1)), rng.choice((1, 2, 4, 7))
            ctx.set(dut.best, decision[0])
            ctx.set(dut.margin, decision[1])
            last = [*past, decision][-wanted:]
            expected = len(last) == wanted and all(
                best == decision[0] and size >= margin for best, size in last
            )
            assert ctx.get(dut.met) == expected
            met += expected
            taken, ended = rng.random() < 0.8, rng.random() < 0.1
            ctx.set(dut.taken, taken)
            ctx.set(dut.ended, ended)
            await ctx.tick()
            past = [] if ended else [*past, decision] if taken else past

    sim = Simulator(dut)
    sim.add_clock(1e-6)
    sim.add_testbench(bench)
    sim.run()
    assert met > 20
