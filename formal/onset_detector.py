"""The onset detector: every whole frame goes through once, in order, whatever comes in; levels and counters stay in range."""

from __future__ import annotations

from amaranth.hdl import Const, Module, Mux, Signal

from formal.proof import Bug, free, free_sink, free_source, keeps_its_beat, opened_up, proof, prove
from golden.config import PRESETS
from rtl.onset_detector import OnsetDetector

FILE = "rtl/onset_detector.py"
SMALL = dict(taxels=4, sample_bits=4, feature_shift=(), pretrigger_frames=1, hop=2, window=4, steps=2, touch_frames=6, rearm_frames=10)
BAND = PRESETS["thesis"].replace(**SMALL, band_low=5, band_high=9)
MEANS = PRESETS["synthetic"].replace(**SMALL, rest_frames=4, onset_mean_frames=8, onset_check_frames=4, onset_threshold=2)
FREE = PRESETS["pvdf"].replace(**(SMALL | dict(pretrigger_frames=0)), clip=3, rest_frames=4, onset_mean_frames=4, onset_check_frames=2,
                               onset_threshold=2)  # fmt: skip
REDUCED = "4 taxels, 4-bit samples"


def _frames(m: Module, config) -> None:
    """Any beats at all come in, well framed or not; whole frames go out."""
    dut = OnsetDetector(config)
    inside = opened_up(m, "dut", dut)
    free_source(m, dut.i)
    free_sink(m, dut.o)
    free(m, dut.mask)
    taxels = config.taxels
    keeps_its_beat(m, dut.o, "o")
    left = dut.o.valid & dut.o.ready
    made = inside.advance & inside.offered  # a beat of a frame goes into the pipeline, the sender's or a repeated one
    taken = dut.i.valid & dut.i.ready
    good = inside.good & inside.advance
    entered, gone = Signal(range(taxels), name="entered"), Signal(range(taxels), name="gone")
    with m.If(made):
        m.d.sync += entered.eq(Mux(entered == taxels - 1, 0, entered + 1))
    with m.If(left):
        m.d.sync += gone.eq(Mux(gone == taxels - 1, 0, gone + 1))
    held = Signal(range(8), name="held")  # beats in the pipeline
    m.d.sync += held.eq(held + made - left)
    depth = dut.latency
    # the stages of the pipeline, the last first: each holds the taxel that follows those before it
    registers = {signal.name: signal for signal in inside.registers}
    ahead = Const(0)
    for stage in ("clipped", "deviation", "taken")[-depth:]:
        valid, index, last = (registers[f"{stage}_{key}"] for key in ("valid", "index", "last"))
        prove(m, ~valid | (index == ((gone + ahead) & (taxels - 1))), f"the taxel in stage {stage}")
        prove(m, ~valid | (last == (index == taxels - 1)), f"the last one in stage {stage}")
        ahead = ahead + valid
    prove(m, held == ahead, "as many beats as stages that hold one")
    prove(m, inside.index == entered, "taxels in order")
    prove(m, ((gone + held - entered) & (taxels - 1)) == 0, "frames leave whole: as many beats as came in")
    prove(m, good <= taken, "what goes in was taken")
    # of a sender that frames as it should every beat goes in, and none is repeated
    expects = Signal(range(taxels), name="expects")
    with m.If(taken):
        m.d.sync += expects.eq(Mux(expects == taxels - 1, 0, expects + 1))
    fits = (dut.i.p.first == (expects == 0)) & (dut.i.p.last == (expects == taxels - 1))
    ever, unfit = Signal(name="unfit_ever"), Signal(name="unfit")
    m.d.comb += unfit.eq(ever | (dut.i.valid & ~fits))
    m.d.sync += ever.eq(unfit)
    prove(m, unfit | (taken == made), "of whole frames every beat goes in once")
    prove(m, unfit | ~dut.framing_fault, "of whole frames none is called wrong")
    prove(m, unfit | (inside.index == expects), "and the taxel is the sender's")
    prove(m, unfit | ~inside.filling, "and nothing is filled in")
    prove(m, ~(taken & ~fits & ~ever) | dut.framing_fault, "a wrong beat is called wrong")
    if config.onset == "baseline":
        now = inside.now
        decided = inside.decided
        prove(m, ~decided | (now.valid & now.last & now.block_end), "a verdict is of the frame that waits for it")
        prove(m, ~(decided & (inside.fresh | inside.added | inside.moved_last)), "one verdict a frame")
        waits = Signal(range(8), name="waits")
        m.d.sync += waits.eq(Mux(now.valid & ~dut.o.valid, waits + 1, 0))
        prove(m, waits <= 3, "the verdict takes three cycles")
    if config.onset == "band":
        refused = Signal(range(4 * taxels), name="refused")  # cycles in which the sender waits and the next stage does not
        m.d.sync += refused.eq(Mux(taken | ~dut.i.valid, 0, refused + dut.o.ready))
        prove(m, Mux(inside.filling, refused <= inside.index + 1, (inside.index == 0) | (refused == 0)), "a frame is filled up at once")
        prove(m, refused <= taxels + 1, "no sender waits for ever")


@proof(
    "whole frames leave, taxel by taxel, whatever beats come; of whole frames every beat goes in once and none is lost, repeated or called "
    "wrong; offered deviations stay until taken (band)",
    depth=3, reduced=REDUCED, quick=True,
    bugs=(
        Bug("a beat is lost while the next stage waits", FILE, "advance.eq(~now.valid | (self.o.ready & ~waiting))", "advance.eq(1)"),
        Bug("a frame that ends early is not filled up", FILE, "m.d.sync += filling.eq(1)", "m.d.sync += filling.eq(0)"),
    ),
)  # fmt: skip
def frames_band(m: Module) -> None:
    _frames(m, BAND)


@proof(
    "the same with a rest level and moving sums, whose verdict holds the last beat of a block", depth=7, reduced=REDUCED,
    bugs=(Bug("the verdict's wait loses the beat", FILE, "self.o.valid.eq(now.valid & ~waiting)", "self.o.valid.eq(now.valid)", depth=40, eager=True),),
)  # fmt: skip
def frames_baseline(m: Module) -> None:
    _frames(m, MEANS)


@proof(
    "the same with clipped deviations and windows that run freely", depth=5, reduced=REDUCED,
    bugs=(Bug("a beat is lost while the next stage waits", FILE, "advance.eq(~now.valid | (self.o.ready & ~waiting))", "advance.eq(1)"),),
)  # fmt: skip
def frames_free(m: Module) -> None:
    _frames(m, FREE)
