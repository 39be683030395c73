"""The whole chain, wiring included: from the first frame to the decision, with no pauses and with any."""

from amaranth.hdl import Module, Mux, Signal

from eskin.golden.core import PRESETS, QFormat
from eskin.rtl.top.accelerator import Accelerator
from formal.proof import Bug, assume, free, free_sink, keeps_its_beat, opened_up, proof, prove

CONFIG = PRESETS["thesis"].replace(
    taxels=4,
    hidden=4,
    class_names=("a", "b"),
    lanes=4,
    state_format=QFormat(4, 12),
    onset="immediate",
    window_mode="free",
    rest="none",
    pretrigger_frames=0,
    hop=1,
    window=2,
    steps=1,
    feature_shift=(4,),
    sample_bits=4,
    band_low=0,
    band_high=0,
)
REDUCED = "4 taxels, 4 units, 2 classes, 1 step of 2 frames, immediate onset, 4 lanes"
IN_TIME = 90
"""Cycles in which the only touch is decided, where nothing pauses."""


def _whole_frames(m: Module, pauses: bool) -> None:
    dut = Accelerator(CONFIG)
    inside = opened_up(dut)
    free(dut.i.valid)
    free(dut.i.payload)
    keeps_its_beat(dut.i, "i", assume)
    free_sink(dut.o)
    if not pauses:
        assume(dut.i.valid & dut.o.ready)
    taxels = CONFIG.sensor.taxels
    beat = Signal(range(taxels))
    cycle = Signal(8)
    with m.If(dut.i.valid & dut.i.ready):
        m.d.sync += beat.eq(Mux(beat == taxels - 1, 0, beat + 1))
    m.d.sync += cycle.eq(cycle + 1)
    assume((dut.i.p.first == (beat == 0)) & (dut.i.p.last == (beat == taxels - 1)))
    taken = dut.o.valid & dut.o.ready
    locals_, globals_, begun = (Signal(2, name=name) for name in ("locals", "globals", "begun"))
    m.d.sync += [
        locals_.eq(locals_ + (taken & ~dut.o.p.is_global)),
        globals_.eq(globals_ + (taken & dut.o.p.is_global)),
        begun.eq(begun + inside.front_end.touch_started),
    ]
    prove((locals_ <= 1) & (globals_ <= locals_), "one local decision, then one global one")
    prove(~dut.o.valid | (dut.o.p.partial == 0), "which is not partial")
    prove(inside.parts["RecordingState"].undecided == (begun - globals_)[:3], "the touch is open until then")
    if not pauses:
        prove((cycle < IN_TIME) | (globals_ == 1), "decided in time")


@proof(
    "frames into the whole accelerator: its touch gets one local decision, then one global one, in time; "
    "STATUS has it open until then",
    method="bounded",
    depth=IN_TIME + 8,
    reduced=f"{REDUCED}, no pauses",
    bugs=(
        Bug(
            "the classifier's end of a touch does not reach the host's side",
            "control.global_taken.eq(classifier.ended)",
            "control.global_taken.eq(0)",
            depth=IN_TIME + 2,
        ),
        Bug(
            "windows do not reach the engine",
            "wiring.connect(m, front_end.o, engine.i)",
            "pass",
            depth=IN_TIME + 2,
        ),
    ),
)
def one_decision(m: Module) -> None:
    _whole_frames(m, pauses=False)
