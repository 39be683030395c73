"""Whole frames only: each frame that is forwarded is good, once, in order; the stream rule; nothing is written
while it is read."""

from amaranth.hdl import Module, Mux, Signal

from eskin.golden.core import PRESETS
from eskin.rtl.interface.frame_guard import FrameGuard
from formal.proof import Bug, before, placed_free, proof, prove

CONFIG = PRESETS["thesis"].replace(taxels=5, feature_shift=())


@proof(
    "whatever a converter does: offered beats stay until taken, frames have all taxels in order, each good "
    "one that came in time is handed "
    "on once, no other, and no sample is written while a frame is handed on",
    depth=4,
    reduced="5 taxels",
    bugs=(
        Bug(
            "a bad frame is handed on",
            "self.finished & (self.bad | spoilt | self.handing)",
            "self.finished & (spoilt | self.handing)",
        ),
        Bug(
            "a late frame is handed on",
            "self.finished & (self.bad | spoilt | self.handing)",
            "self.finished & (self.bad | self.handing)",
        ),
        Bug(
            "a sample is written while the frame is read", "self.put.valid & ~self.handing", "self.put.valid"
        ),
        Bug("the next beat does not wait", "m.Elif(self.o.ready)", "m.Elif(1)"),
        Bug("a frame stops a taxel early", "place == taxels - 1", "place == taxels - 2"),
    ),
)
def whole_frames(m: Module) -> None:
    dut = placed_free(FrameGuard(CONFIG))
    taxels = CONFIG.sensor.taxels
    stalled = before(dut.o.valid & ~dut.o.ready, "stalled")
    marks = before(dut.o.p.first | dut.o.p.last << 1, "marks")
    prove(~stalled | dut.o.valid & ((dut.o.p.first | dut.o.p.last << 1) == marks), "offered beat stays")
    prove(~dut.write.en | ~dut.handing, "nothing is written while a frame is handed on")
    prove(~(stalled & dut.read.en), "nothing is read while a beat waits")
    beats = Signal(range(taxels + 1))
    accepted = dut.o.valid & dut.o.ready
    with m.If(accepted):
        m.d.sync += beats.eq(Mux(dut.o.p.last, 0, beats + 1))
    prove(
        ~dut.o.valid | (dut.o.p.first == (beats == 0)) & (dut.o.p.last == (beats == taxels - 1)),
        "first and last",
    )
    # ---- a reference: samples of this frame that came too late, and whether a frame waits to be forwarded
    late, owed = Signal(name="came_late"), Signal(name="owed")
    ends = accepted & (beats == taxels - 1)
    good = dut.finished & ~dut.bad & ~owed & ~late
    m.d.sync += [late.eq(Mux(dut.finished, 0, late | dut.put.valid & owed)), owed.eq(good | owed & ~ends)]
    prove(dut.broken == (dut.finished & ~good), "broken where a frame is not handed on")
    prove(~dut.o.valid | owed, "only good frames, once")
    prove(~owed | dut.handing, "a good frame is handed on")
    prove((dut.spoilt == late) & (owed == dut.handing), "reference")
    prove(Mux(dut.handing, dut.place == beats, beats == 0), "place")
    prove(beats < taxels, "beats")
