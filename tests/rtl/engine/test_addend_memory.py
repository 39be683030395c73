"""Biases and partial sums: words at both ends of the accumulator, in two or three parts from the host or
whole from a step."""

from __future__ import annotations

import random

from amaranth.hdl import ResetInserter, Signal

from eskin.golden.core.config import PRESETS
from eskin.golden.core.formats import QFormat
from eskin.rtl.common.load_port import load_lines
from eskin.rtl.engine.engine import _AddendMemory
from eskin.rtl.program.memory_map import Memory
from eskin.rtl.program.schedule import schedule
from tests.support.stream_bench import put, simulate
from tests.support.table import each_row

WIDE = dict(
    weight_format=QFormat(3, 13),
    recurrent_format=QFormat(4, 12),
    feature_format=QFormat(3, 11),
    state_format=QFormat(2, 14),
)


@each_row(("formats", "parts"), [({}, 2), (WIDE, 3)])
def test_every_word_is_read_back_whole(formats, parts):
    """Loaded twice, in the engine's reset after each write as the host's control does it, and after another
    memory's words."""
    config = PRESETS["thesis"].replace(**formats)
    assert config.addend_parts == parts
    plan, rng = schedule(config), random.Random(1)
    dut = _AddendMemory(config, plan, [])
    top = 1 << config.accumulator_bits - 1
    words = [rng.choice([-top, top - 1, -1, 0, rng.randrange(-top, top)]) for _ in range(plan.addend_words)]
    assert {-top, top - 1} <= set(words) and plan.partial_rows > 0

    reset = Signal()

    async def write(ctx, address, data):
        put(ctx, dut.load, address=address, data=data, enable=1)
        await ctx.tick()
        ctx.set(dut.load.enable, 0)
        ctx.set(reset, 1)
        await ctx.tick()
        ctx.set(reset, 0)

    async def bench(ctx):
        ctx.set(dut.load.select, 1 << load_lines(config)[Memory.ADDENDS])
        # a load that is left in the middle of a word; the next one begins anew
        for address in range(2 * parts - 1):
            await write(ctx, address, 0xBEEF)
        for address, word in enumerate(words):
            if address < len(plan.bias_rows):
                for part in range(parts):
                    await write(ctx, parts * address + part, word >> 16 * part & 0xFFFF)
            else:
                put(ctx, dut, write_address=address, write_data=word, write=1)
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

    simulate(ResetInserter(reset)(dut), bench)
