"""The two memories of maps: a stored value stays until it is written itself, and only the memory that is not
read is written."""

from amaranth.hdl import Module, Signal

from eskin.golden.core import Conv, Dense, QFormat
from eskin.golden.core.images import layer_stages
from eskin.rtl.image.map_memory import MapMemory
from eskin.rtl.program.image_passes import ImagePlan
from formal.proof import Bug, any_number, assume, placed_free, proof, prove

PLAN = ImagePlan(
    layer_stages(2, 4, [Conv(1, 1), Dense(2)]),
    weight_bits=8,
    shifts=(0, 0),
    logit_format=QFormat(16, 0),
    lanes=1,
)


@proof(
    "whatever is read and written: a value of either memory stays until it is written itself, and none of "
    "the memory that is read ever is",
    method="bounded",
    depth=8,
    reduced="maps of 8 values",
    bugs=(
        Bug(
            "the memory that is read is written", "Mux(reads, 0, Cat(", "Mux(reads, Cat(self.write, 0), Cat("
        ),
        Bug(
            "a value's neighbour is written with it",
            "Cat(~self.write_address[0], self.write_address[0])",
            "3",
        ),
        Bug("the other byte of a word is read", "Mux(high, word[8:], word)", "Mux(high, word, word[8:])"),
        Bug("the other memory is read", "source.eq(self.source)]", "source.eq(~self.source)]"),
    ),
)
def values_stay(m: Module) -> None:
    dut = placed_free(MapMemory(PLAN))
    assume((dut.read_address < 8) & (dut.write_address < 8))
    place, memory = any_number(3, "place"), any_number(1, "memory")
    there = Signal()
    value = Signal(8)  # it was written, with this
    with m.If(dut.write & (dut.source != memory) & (dut.write_address == place)):
        m.d.sync += [there.eq(1), value.eq(dut.write_value)]
    wanted = Signal()
    expected = Signal(8)
    m.d.sync += [
        wanted.eq(there & dut.read & (dut.source == memory) & (dut.read_address == place)),
        expected.eq(value),
    ]
    prove(~wanted | (dut.value == expected), "a value that is read is the one that was written last")
