"""The normaliser: a beat out for each beat in, the same window, exact narrowing."""

from __future__ import annotations

from amaranth.hdl import Module

from formal.proof import Bug, free, free_sink, free_source, keeps_its_beat, proof, prove
from golden.config import PRESETS
from rtl.normaliser import Normaliser

FILE = "rtl/normaliser.py"
CONFIG = PRESETS["thesis"].replace(taxels=4, feature_shift=(4, 9))
LONE = CONFIG.replace(window_mode="free", pretrigger_frames=0, window=614, feature_shift=(4,))


def _block(m: Module, config=CONFIG) -> Normaliser:
    m.submodules.dut = dut = Normaliser(config, [0] * len(config.feature_shift))
    free_source(m, dut.i)
    free_sink(m, dut.o)
    return dut


@proof(
    "each sum leaves as one centred value of its taxel and window; offered values stay until taken, whatever the mask does",
    depth=3, reduced="4 taxels", quick=True,
    bugs=(
        Bug("the mask is looked at again while the beat waits", FILE, "with m.If(~added):", "with m.If(1):"),
        Bug("a beat is taken before its result", FILE, "self.i.ready.eq(added & self.o.ready)", "self.i.ready.eq(added)"),
    ),
)  # fmt: skip
def stream_rules(m: Module) -> None:
    dut = _block(m)
    free(m, dut.mask)
    keeps_its_beat(m, dut.o, "o")
    prove(m, (dut.i.valid & dut.i.ready) == (dut.o.valid & dut.o.ready), "one out for one in")
    prove(m, ~dut.o.valid | (dut.o.p.last == (dut.i.p.taxel == CONFIG.taxels - 1)), "last is the last taxel")
    prove(m, ~dut.o.valid | (dut.o.p.first == (dut.i.p.taxel == 0)), "first is taxel 0")
    prove(m, ~dut.o.valid | ((dut.o.p.length == dut.i.p.length) & (dut.o.p.final == dut.i.p.final)), "the window's own flags")
