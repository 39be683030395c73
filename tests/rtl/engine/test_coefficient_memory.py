"""Gates and constants under one address: every word the host or the step writes is read back, and nothing in
the other's place."""

import random

from amaranth.hdl import Fragment

from eskin.rtl.common import load_lines
from eskin.rtl.engine.coefficient_memory import CoefficientMemory
from eskin.rtl.program.cells import cell_program
from eskin.rtl.program.memory_map import Memory
from eskin.rtl.program.microcode import Layout
from tests.support.small_designs import reference
from tests.support.stream_bench import put, simulate
from tests.support.table import each_row


@each_row(
    "lanes, cell, platform",
    [
        (lanes, cell, platform)
        for lanes, cell in ((1, "gru"), (4, "lstm"), (4, "linear"))
        for platform in (None, "ice40")
    ],
)
def test_what_is_written_is_read_and_nothing_with_it(lanes, cell, platform):
    config = reference(cell, lanes=lanes, lane_type="dsp", steps=1, gate_frac=14)
    program = cell_program(config)
    place, rng = Layout(config, program), random.Random(lanes)
    dut = CoefficientMemory(config, program)

    async def body(ctx):
        expected = {}

        async def load(select, address, word):
            line = 1 << load_lines(config)[select]
            put(ctx, dut.load, select=line, address=address, data=word, enable=1)
            await ctx.tick()
            ctx.set(dut.load.enable, 0)

        for offset in range(place.constant_words):
            expected[place.constants + offset] = word = rng.randrange(1, 1 << 15)
            await load(Memory.CONSTANTS, offset, word)
        await load(Memory.ADDENDS, 0, 77)  # another memory's word
        for region in program.gate_regions:
            for index in range(config.network.hidden):
                address = place.gate(region, index)
                expected[address] = code = (
                    config.gate_one if index == 0 else rng.randrange(1, config.gate_one)
                )
                put(ctx, dut, write_address=address, write_data=code, write=1)
                await ctx.tick()
                ctx.set(dut.write, 0)
        ctx.set(dut.enable, 1)
        for address, word in expected.items():
            ctx.set(dut.address, address)
            await ctx.tick()
            assert (ctx.get(dut.gate) | ctx.get(dut.constant)) == word, address
        put(ctx, dut, enable=0, address=0)
        await ctx.tick()
        assert (ctx.get(dut.gate) | ctx.get(dut.constant)) == word, "without enable the word stays"

    simulate(dut, body, platform=platform)


@each_row("lanes", [1, 4])
def test_where_memories_begin_as_told_only_a_shared_lane_has_one_for_each(lanes):
    config = reference("gru", lanes=lanes, lane_type="dsp")

    def parts(platform: str | None) -> set[str]:
        return {
            name
            for _, name, _ in Fragment.get(
                CoefficientMemory(config, cell_program(config)), platform
            ).subfragments
        }

    assert parts("ice40") == ({"gates", "constants"} if lanes == 1 else {"both"})
    assert parts(None) == {"gates", "constants"}
