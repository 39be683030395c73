"""The compact engine's accumulator against the same sequence in plain integers: random instructions, words
and weights."""

from __future__ import annotations

import random

from eskin.rtl.engine.compact_accumulator import CompactAccumulator
from eskin.rtl.program.compact_program import Use
from eskin.rtl.program.schedule import schedule
from tests.rtl.engine.test_engine import small
from tests.support.stream_bench import put, simulate
from tests.support.table import each_row


@each_row("seed", range(3))
def test_random_sums(seed):
    """Each sum begins with ``clear``; what an instruction says acts when its word is there, a cycle later.
    Sums stay within the width."""
    config = small("gru", "before", 1, lane_type="serial")
    code, rng = schedule(config).compact, random.Random(seed)
    dut = CompactAccumulator(config, code)
    fields = ("shift", "inverted", "fetch", "use", "fresh")

    async def bench(ctx):
        bit = 0  # one that was fetched stays over sums
        for _ in range(60):
            put(ctx, dut, mac=0, clear=1)
            await ctx.tick()
            ctx.set(dut.clear, 0)
            acc, plane, due = code.reset_value, code.first_plane, None
            for number in range(rng.randrange(1, 14)):
                now = {name: rng.randrange(4) == 0 for name in fields} | {
                    "use": rng.choice(list(Use)),
                    "fresh": rng.random() < 0.7,
                }
                word, weight = rng.randrange(-(1 << 11), 1 << 11), rng.randrange(2)
                ctx.set(dut.mac, 1)
                for name in fields:
                    ctx.set(getattr(dut, name), int(now[name]))
                ctx.set(dut.data, word)  # of the instruction before
                ctx.set(dut.weight, weight)
                await ctx.tick()
                if due is not None:
                    acc, bit = after(acc, bit, due, word, weight)
                assert ctx.get(dut.acc) == acc, number
                plane = (plane + now["shift"]) % 16
                due = now | {"plane": plane}
            ctx.set(dut.mac, 0)
            await ctx.tick()
            acc, bit = after(acc, bit, due, word, weight)
            assert ctx.get(dut.acc) == acc
            await ctx.tick()
            assert ctx.get(dut.acc) == acc, "no instruction, no sum"

    def after(acc: int, bit: int, said: dict, word: int, weight: int) -> tuple[int, int]:
        if said["fresh"]:
            acc = acc >> 1 if said["shift"] else acc
            acc = ~acc if said["inverted"] else acc
        added = {Use.NEVER: 0, Use.WEIGHT: weight, Use.BIT: bit, Use.ALWAYS: 1}[said["use"]]
        acc += (word << code.guard) * added
        assert -(1 << code.accumulator_bits - 1) <= acc < 1 << code.accumulator_bits - 1
        return acc, word >> said["plane"] & 1 if said["fetch"] else bit

    simulate(dut, bench)
