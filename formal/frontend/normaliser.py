"""The normaliser: a beat out for each beat in, the same window."""

from amaranth.hdl import Module

from eskin.golden.core import PRESETS
from eskin.rtl.frontend.normaliser import Normaliser
from formal.proof import Bug, free, free_sink, free_source, keeps_its_beat, placed, proof, prove

CONFIG = PRESETS["thesis"].replace(taxels=4, feature_shift=(4, 9))


@proof(
    "each sum leaves as one centred value of its taxel and window; offered values stay until taken, "
    "whatever the mask does",
    depth=3,
    reduced="4 taxels",
    quick=True,
    bugs=(
        Bug("the mask is looked at again while the beat waits", "with m.If(looks):", "with m.If(1):"),
        Bug(
            "a beat is taken before its result",
            "self.i.ready.eq(added & self.o.ready)",
            "self.i.ready.eq(added)",
        ),
    ),
)
def stream_rules(m: Module) -> None:
    dut = placed(Normaliser(CONFIG, (12_345_678, -9_876_543)))
    free_source(dut.i)
    free_sink(dut.o)
    free(dut.mask)
    keeps_its_beat(dut.o, "o")
    prove((dut.i.valid & dut.i.ready) == (dut.o.valid & dut.o.ready), "one out for one in")
    prove(
        ~dut.o.valid | (dut.o.p.last == (dut.i.p.taxel == CONFIG.sensor.taxels - 1)), "last is the last taxel"
    )
    prove(~dut.o.valid | (dut.o.p.first == (dut.i.p.taxel == 0)), "first is taxel 0")
    prove(
        ~dut.o.valid | ((dut.o.p.length == dut.i.p.length) & (dut.o.p.final == dut.i.p.final)),
        "the window's own flags",
    )
