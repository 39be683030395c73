"""Whole frames only: what is handed on is a good frame, once, in order; the stream rule; nothing is written
while it is read."""

from amaranth.hdl import Module, Mux, Signal

from eskin.golden.core import PRESETS
from eskin.rtl.interface.frame_guard import FrameGuard
from formal.proof import Bug, before, free_inputs, opened_up, proof, prove

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
            depth=8,
        ),
        Bug(
            "a late frame is handed on",
            "self.finished & (self.bad | spoilt | self.handing)",
            "self.finished & (self.bad | self.handing)",
            depth=30,
        ),
        Bug(
            "a sample is written while the frame is read",
            "self.put.valid & ~self.handing",
            "self.put.valid",
            depth=10,
        ),
        Bug("the next beat does not wait", "m.Elif(self.o.ready)", "m.Elif(1)", depth=10),
        Bug("a frame stops a taxel early", "place == taxels - 1", "place == taxels - 2", depth=20),
    ),
)
def whole_frames(m: Module) -> None:
    dut = FrameGuard(CONFIG)
    inside = opened_up(dut)
    free_inputs(dut)
    taxels = CONFIG.sensor.taxels
    stalled = before(dut.o.valid & ~dut.o.ready, "stalled")
    marks = before(dut.o.p.first | dut.o.p.last << 1, "marks")
    prove(~stalled | dut.o.valid & ((dut.o.p.first | dut.o.p.last << 1) == marks), "offered beat stays")
    prove(~inside.write.en | ~dut.handing, "nothing is written while a frame is handed on")
    prove(~(stalled & inside.read.en), "nothing is read while a beat waits")
    beats = Signal(range(taxels + 1))
    taken = dut.o.valid & dut.o.ready
    with m.If(taken):
        m.d.sync += beats.eq(Mux(dut.o.p.last, 0, beats + 1))
    prove(
        ~dut.o.valid | (dut.o.p.first == (beats == 0)) & (dut.o.p.last == (beats == taxels - 1)),
        "first and last",
    )
    # ---- a reference of its own: samples of this frame that came too late, and whether a frame waits to be handed on
    late, owed = Signal(name="came_late"), Signal(name="owed")
    ends = taken & (beats == taxels - 1)
    good = dut.finished & ~dut.bad & ~owed & ~late
    m.d.sync += [late.eq(Mux(dut.finished, 0, late | dut.put.valid & owed)), owed.eq(good | owed & ~ends)]
    prove(dut.broken == (dut.finished & ~good), "broken where a frame is not handed on")
    prove(~dut.o.valid | owed, "only good frames, once")
    prove(~owed | dut.handing, "a good frame is handed on")
    prove((inside.spoilt == late) & (owed == dut.handing), "reference")
    prove(Mux(dut.handing, inside.place == beats, beats == 0), "place")
    prove(beats < taxels, "beats")
