"""Biases and partial sums: words at both ends of the accumulator, in two halves from the host or whole from a step."""

from __future__ import annotations

import random

from amaranth.sim import Simulator

from golden.config import PRESETS
from rtl.engine import _AddendMemory
from rtl.load_port import load_lines
from rtl.memory_map import Memory
from rtl.schedule import schedule


def test_every_word_is_read_back_whole():
    config = PRESETS["thesis"]
    plan, rng = schedule(config), random.Random(1)
    dut = _AddendMemory(config, plan, [])
    top = 1 << config.accumulator_bits - 1
    words = [rng.choice([-top, top - 1, -1, 0, rng.randrange(-top, top)]) for _ in range(plan.addend_words)]
    assert {-top, top - 1} <= set(words) and plan.partial_rows > 0

    async def bench(ctx):
        for address, word in enumerate(words):
            if address < len(plan.bias_rows):
                ctx.set(dut.load.select, 1 << load_lines(config)[Memory.ADDENDS])
                ctx.set(dut.load.enable, 1)
                for half in range(2):
                    ctx.set(dut.load.address, 2 * address + half)
                    ctx.set(dut.load.data, word >> 16 * half & 0xFFFF)
                    await ctx.tick()
                ctx.set(dut.load.enable, 0)
            else:
                for signal, value in ((dut.write_address, address), (dut.write_data, word), (dut.write, 1)):
                    ctx.set(signal, value)
                await ctx.tick()
                ctx.set(dut.write, 0)
        ctx.set(dut.load.select, 1 << load_lines(config)[0])  # another memory's word
        ctx.set(dut.load.enable, 1)
        await ctx.tick()
        ctx.set(dut.load.enable, 0)
        ctx.set(dut.read_enable, 1)
        for address, word in enumerate(words):
            ctx.set(dut.read_address, address)
            await ctx.tick()
            assert ctx.get(dut.read_data) == word, address

    sim = Simulator(dut)
    sim.add_clock(1e-6)
    sim.add_testbench(bench)
    sim.run()
