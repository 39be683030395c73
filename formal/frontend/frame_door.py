"""The door of the chain: of every four frames the first passes."""

from amaranth.hdl import Module, Mux, Signal

from eskin.golden.core import PRESETS
from eskin.rtl.frontend.frame_door import FrameDoor
from formal.proof import Bug, any_number, placed_free, proof, prove

CONFIG = PRESETS["pvdf"].replace(scan_every=4)


@proof(
    "of every four frames the first passes, as it came and at once; the others are taken whatever waits behind",
    depth=1,
    reduced="scan_every 4",
    quick=True,
    bugs=(
        Bug("the last of four passes", "number != 0", "number != 3"),
        Bug("beats are counted, not frames", "self.i.ready & self.i.p.first", "self.i.ready"),
        Bug("a dropped frame waits", "self.o.ready | drops", "self.o.ready"),
    ),
)
def one_in_four(m: Module) -> None:
    dut = placed_free(FrameDoor(CONFIG), but=("every",))
    m.d.comb += dut.every.eq(any_number(1, "every"))
    begun, under_way = Signal(2), Signal(2)  # the next frame and the frame under way, each modulo 4
    frame = Mux(dut.i.p.first, begun, under_way)
    with m.If(dut.i.valid & dut.i.ready & dut.i.p.first):
        m.d.sync += [begun.eq(begun + 1), under_way.eq(begun)]
    passes = ~dut.every | (frame == 0)
    prove(dut.o.valid == (dut.i.valid & passes), "which beats pass")
    prove(dut.i.ready == Mux(passes, dut.o.ready, 1), "a dropped beat is taken")
    prove(dut.o.payload.as_value() == dut.i.payload.as_value(), "a beat passes as it came")
    prove(dut.number == begun, "the number of the next frame")
    prove(dut.dropped == (dut.every & (under_way != 0)), "the frame under way")
