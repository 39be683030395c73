"""rtl/fpga/block_memories.py: as many as synthesis makes."""

from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from eskin.golden.core import PRESETS
from eskin.rtl.fpga import block_memories


def test_block_memories_are_those_that_synthesis_makes(monkeypatch):
    """A 24-bit memory takes two blocks of 256 x 16, one of 300 words too; rows of 21 bits share
    blocks; two readers double it; of a ROM
    columns that stay take nothing, a short one is made of LUTs; few bits become flip-flops unless a block is asked for."""

    class Small(wiring.Component):
        i: In(5)
        o: Out(9)

        def elaborate(self, platform):
            m = Module()
            attributes = [{}, {}, {}, {}, {}, {"ram_style": "block"}, {"ram_style": "huge"}]
            shapes = [(24, 16), (9, 300), (21, 2576), (16, 5), (16, 4), (16, 4), (16, 600)]
            for number, ((width, depth), attribute) in enumerate(zip(shapes, attributes, strict=True)):
                m.submodules[f"memory_{number}"] = memory = Memory(
                    shape=width, depth=depth, init=[], attrs=attribute
                )
                memory.read_port()
                memory.write_port()
            memory.read_port()  # the huge one
            rom = Memory(shape=40, depth=128, init=[(word << 8) | (word << 20) | 5 for word in range(128)])
            m.submodules.rom = rom
            rom.read_port()
            m.submodules.short = short = Memory(shape=40, depth=64, init=range(64))
            short.read_port()
            two = Memory(shape=16, depth=32, init=[])
            m.submodules.two = two
            two.write_port()
            two.read_port(), two.read_port()
            return m

    monkeypatch.setattr(block_memories, "_accelerator", lambda config: Small())
    shapes = ((256, 16), (512, 8), (1024, 4), (2048, 2))
    assert (
        block_memories.block_memories(PRESETS["pvdf"], "ice40", shapes) == 2 + 2 + 16 + 1 + 0 + 1 + 0 + 1 + 2
    )
