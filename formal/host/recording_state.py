"""The life of a recording: finish comes once, when nothing is under way, and ends."""

from amaranth.hdl import Cat, Module, Mux, Signal

from eskin.golden.core import PRESETS
from eskin.rtl.host.recording_state import RecordingState
from formal.proof import Bug, before, placed_free, proof, prove

CONFIG = PRESETS["thesis"].replace(taxels=4, feature_shift=(4, 9))


@proof(
    "what is asked to finish pulses finish once, and is over (busy falls) 20 cycles after the last beat, "
    "step and decision at the latest",
    depth=24,
    reduced="4 taxels",
    bugs=(
        Bug("finish never ends", "finishing.eq(0), finished.eq(0)", "finished.eq(0)"),
        Bug("finish does not wait for the decision", "& ~moving & self.decider_idle", "& ~moving"),
        Bug("finish does not wait for what passes", "moving | self.finish_asked |", "moving |"),
        Bug(
            "the next recording's finish is lost in its clear",
            "with m.If(self.finish_asked):",
            "with m.Elif(self.finish_asked):",
        ),
    ),
)
def finish_ends(m: Module) -> None:
    dut = placed_free(RecordingState(CONFIG))
    work = dut.passing | dut.engine.working
    still = ~Cat(
        work,
        dut.moving,
        dut.detector.started,
        dut.global_taken,
        dut.finish_asked,
        dut.clear,
        ~dut.decider_idle,
    ).any()
    quiet = Signal(range(21))  # cycles without anything under way and without a command
    m.d.sync += quiet.eq(Mux(still, quiet + (quiet < 20), 0))
    prove((quiet < 20) | ~still | ~dut.busy, "busy falls")
    worked = before(work, "worked")
    prove(~dut.finish | (dut.decider_idle & ~worked), "finish comes when nothing is under way")
    prove(~before(dut.finish_asked, "asked_now") | dut.finishing, "what is asked for is begun")
    wanted = Signal()
    given = Signal()
    m.d.sync += [
        wanted.eq(dut.finish_asked | (wanted & ~dut.clear)),
        given.eq((given | dut.finish) & dut.busy & ~dut.finish_asked),
    ]
    prove(~(dut.finish | dut.finishing) | wanted, "what goes on was asked for")
    prove(~given | ~dut.finishing | dut.finished, "what was given is known")
    prove(~dut.finished | dut.finishing, "finished only while it goes on")
    prove(~(dut.finish & given), "finish pulses once")
