"""The two memories of maps: a value that is there stays until it is written itself, and only the memory that is not read is written."""

from __future__ import annotations

from amaranth.hdl import Module, Signal

from eskin.golden.core.formats import QFormat
from eskin.golden.core.images import Conv, Dense, stages_of
from eskin.rtl.image.map_memory import MapMemory
from eskin.rtl.program.image_passes import make_plan
from formal.proof import Bug, any_number, assume, free, proof, prove

FILE = "rtl/image/map_memory.py"
PLAN = make_plan(stages_of(2, 4, [Conv(1, 1), Dense(2)]), weight_bits=8, shifts=(0, 0), logit_format=QFormat(16, 0), lanes=1)


@proof(
    "whatever is read and written: a value of either memory stays until it is written itself, and none of the memory that is read ever is",
    method="bounded",
    depth=8,
    reduced="maps of 8 values",
    bugs=(
        Bug("the memory that is read is written", FILE, "Mux(reads, 0, Cat(", "Mux(reads, Cat(self.write, 0), Cat("),
        Bug("a value's neighbour is written with it", FILE, "Cat(~self.write_address[0], self.write_address[0])", "3"),
        Bug("the other byte of a word is read", FILE, "Mux(high, word[8:], word[:8])", "Mux(high, word[:8], word[8:])"),
        Bug("the other memory is read", FILE, "source.eq(self.source)]", "source.eq(~self.source)]"),
    ),
)
def values_stay(m: Module) -> None:
    m.submodules.dut = dut = MapMemory(PLAN)
    for value in (dut.source, dut.read, dut.read_address, dut.write, dut.write_address, dut.write_value):
        free(m, value)
    assume(m, (dut.read_address < 8) & (dut.write_address < 8))
    place, memory = any_number(m, 3, "place"), any_number(m, 1, "memory")
    there, value = Signal(name="there"), Signal(8, name="value")  # it was written, with this
    with m.If(dut.write & (dut.source != memory) & (dut.write_address == place)):
        m.d.sync += [there.eq(1), value.eq(dut.write_value)]
    asked, wanted = Signal(name="asked"), Signal(8, name="wanted")
    m.d.sync += [asked.eq(there & dut.read & (dut.source == memory) & (dut.read_address == place)), wanted.eq(value)]
    prove(m, ~asked | (dut.value == wanted), "a value that is read is the one that was written last")
