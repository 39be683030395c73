"""The compact engine's sequencer: the instructions of the program as it is done, loops, columns and waiting
included; its words."""

from __future__ import annotations

import random

from eskin.golden.core.config import PRESETS
from eskin.rtl.engine.compact_sequencer import FIELDS, CompactSequencer, Packing
from eskin.rtl.program.compact_program import Executed, Op
from eskin.rtl.program.schedule import schedule
from tests.rtl.engine.test_engine import small
from tests.support.stream_bench import simulate
from tests.support.table import each_row


def test_packed_instructions_read_back():
    code = schedule(PRESETS["thesis"].replace(lanes=1, lane_type="serial")).compact
    packed, rng = Packing(code), random.Random(1)
    for number in rng.sample(range(len(packed.words)), 100):
        instruction = code.instructions[number]
        for name in ("op", *FIELDS[instruction.op]):
            place, width = packed.places[name]
            assert packed.words[number] >> place & (1 << width) - 1 == getattr(instruction, name)


@each_row("held", [False, True])
def test_every_instruction_in_its_place_and_number(held):
    """A touch and the next one's first steps: operation, word and index of every cycle."""
    config = small("gru", "before", 1, lane_type="serial")
    code, rng = schedule(config).compact, random.Random(3)
    dut = CompactSequencer(config, code)
    steps = config.windows.steps
    # the jump back acts after it
    behind = Executed(code.instructions[-1], len(code.instructions) - 1, 0, 0, 1)
    wanted = [
        (one, step) for step in range(steps) for one in (*(code.prologue if step == 0 else ()), *code.step)
    ]
    wanted = [
        pair
        for one, step in wanted
        for pair in ([(one, step)] + [(behind, (step + 1) % steps)] * (one is code.step[-1]))
    ]
    wanted += [(one, 0) for one in (*code.prologue, *code.step[:40])]

    async def bench(ctx):
        assert not any(ctx.get(flag) for flag in (dut.mac, dut.store, dut.jump, dut.control)), (
            "nothing has come yet"
        )
        ctx.set(dut.go, 0)
        await ctx.tick()
        for one, step in wanted:
            instruction, flags = one.instruction, (dut.mac, dut.store, dut.jump, dut.control)
            if instruction.op == Op.CONTROL and instruction.wait:
                for _ in range(rng.randrange(5) if held else 0):
                    ctx.set(dut.go, 0)
                    assert ctx.get(dut.waits) and not ctx.get(dut.started)
                    await ctx.tick()
                ctx.set(dut.go, 1)
                assert ctx.get(dut.started)
            columns = code.limit(instruction.limit) if instruction.op == Op.MAC and instruction.run else 1
            for column in range(columns):
                assert [ctx.get(flag) for flag in flags] == [
                    instruction.op == op for op in (Op.MAC, Op.STORE, Op.JUMP, Op.CONTROL)
                ]
                assert ctx.get(dut.word) == dut.packing.words[one.address] and ctx.get(dut.index) == one.index
                assert ctx.get(dut.column) == column and ctx.get(dut.first_step) == (step == 0)
                assert ctx.get(dut.runs) == (columns > 1) and (
                    ctx.get(dut.fresh) == (column == 0) or instruction.op == Op.CONTROL
                )
                assert ctx.get(dut.last_class) == (one.index == config.classes - 1)
                await ctx.tick()
            ctx.set(dut.go, 0)

    simulate(dut, bench)
