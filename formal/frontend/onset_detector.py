"""The onset detector: every whole frame goes through once, in order, whatever comes in; levels and counters
stay in range."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal
from amaranth.lib import enum

from eskin.golden.core import PRESETS
from eskin.rtl.frontend.onset_detector import OnsetDetector
from eskin.rtl.program.timing import STATE_BEATS
from formal.proof import Bug, before, free, free_sink, free_source, keeps_its_beat, placed, proof, prove

FILE, ALIGNER, MARKS, STATE = (
    f"rtl/frontend/{name}.py" for name in ("onset_detector", "frame_aligner", "frame_marks", "touch_state")
)
SMALL = dict(
    taxels=4,
    sample_bits=4,
    feature_shift=(),
    pretrigger_frames=1,
    hop=2,
    window=4,
    steps=2,
    touch_frames=6,
    rearm_frames=10,
)
BAND = PRESETS["thesis"].replace(**SMALL, band_low=5, band_high=9)
MEANS = PRESETS["synthetic"].replace(
    **SMALL, rest_frames=4, onset_mean_frames=8, onset_check_frames=4, onset_threshold=2
)
FREE = PRESETS["pvdf"].replace(
    **(SMALL | dict(pretrigger_frames=0)),
    clip=3,
    rest_frames=4,
    onset_mean_frames=4,
    onset_check_frames=2,
    onset_threshold=2,
)
REDUCED = "4 taxels, 4-bit samples"
FORGOTTEN = Bug(
    "the frame before the onset is forgotten",
    "| ~reaches(count, config.windows.pretrigger_frames)",
    "",
    file=STATE,
    eager=True,
)


def _stages(dut: OnsetDetector, gone: Signal):
    """Prove that the stages of the pipeline, the last first, hold taxel after taxel; how many hold one.
    ``gone``: the next to leave."""
    taxels = dut.spec.sensor.taxels
    ahead = Const(0)
    for name, stage in reversed(dut.stages.items()):
        prove(~stage.valid | (stage.index == (gone + ahead) % taxels), f"the taxel in stage {name}")
        prove(~stage.valid | (stage.last == (stage.index == taxels - 1)), f"the last one in stage {name}")
        ahead = ahead + stage.valid
    return ahead


def _last(dut: OnsetDetector):
    """The last of its stages."""
    return [*dut.stages.values()][-1]


def _frames(m: Module, config) -> None:
    """Any beats at all come in, well framed or not; whole frames go out."""
    dut = placed(OnsetDetector(config))
    free_source(dut.i)
    free_sink(dut.o)
    free(dut.mask)
    taxels = config.sensor.taxels
    keeps_its_beat(dut.o, "o")
    left = dut.o.valid & dut.o.ready
    # a beat of a frame goes into the pipeline, the sender's or a repeated one
    aligner = dut.aligner
    made = aligner.advance & aligner.offered
    accepted = dut.i.valid & dut.i.ready
    good = aligner.fresh & aligner.advance
    entered = Signal(range(taxels))
    gone = Signal(range(taxels))
    with m.If(made):
        m.d.sync += entered.eq(Mux(entered == taxels - 1, 0, entered + 1))
    with m.If(left):
        m.d.sync += gone.eq(Mux(gone == taxels - 1, 0, gone + 1))
    beats_ahead = Signal(range(8))  # beats in the pipeline
    m.d.sync += beats_ahead.eq(beats_ahead + made - left)
    ahead = _stages(dut, gone)
    prove(beats_ahead == ahead, "as many beats as stages that hold one")
    prove(aligner.index == entered, "taxels in order")
    prove((gone < taxels) & (entered < taxels), "the reference's own taxels")
    prove(aligner.inside == (aligner.index != 0), "inside a frame")
    prove(~aligner.filling | aligner.inside, "what is filled up has begun")
    prove((gone + beats_ahead) % taxels == entered, "frames leave whole: as many beats as came in")
    if taxels <= STATE_BEATS:
        clear = before(beats_ahead == 0, "clear")
        begins = made & (aligner.index == 0)
        prove(~begins | clear & (beats_ahead == 0), "a frame begins 2 cycles after the one before has left")
        prove(dut.empty == Cat(beats_ahead == 0, clear), "empty stages")
    prove(good <= accepted, "what goes in was taken")
    # of a sender that frames as it should every beat goes in, and none is repeated
    expects = Signal(range(taxels))
    with m.If(accepted):
        m.d.sync += expects.eq(Mux(expects == taxels - 1, 0, expects + 1))
    fits = (dut.i.p.first == (expects == 0)) & (dut.i.p.last == (expects == taxels - 1))
    ever, unfit = Signal(name="unfit_ever"), Signal(name="unfit")
    m.d.comb += unfit.eq(ever | (dut.i.valid & ~fits))
    m.d.sync += ever.eq(unfit)
    prove(unfit | (accepted == made), "of whole frames every beat goes in once")
    prove(unfit | ~dut.status.framing_fault, "of whole frames none is called wrong")
    prove(unfit | (aligner.index == expects), "and the taxel is the sender's")
    prove(unfit | ~aligner.filling, "and nothing is filled in")
    prove(~(accepted & ~fits & ~ever) | dut.status.framing_fault, "a wrong beat is called wrong")
    if config.onset_rule.onset == "baseline":
        now = _last(dut)
        sums = dut.sums
        prove(
            ~sums.decided | (now.valid & now.last & now.block_end),
            "a verdict is of the frame that waits for it",
        )
        prove(~(sums.decided & (sums.fresh | sums.added | sums.moved_last)), "one verdict a frame")
        waits = Signal(range(8))
        m.d.sync += waits.eq(Mux(now.valid & ~dut.o.valid, waits + 1, 0))
        prove(waits <= 3, "the verdict takes three cycles")
    if config.onset_rule.onset == "band":
        refused = Signal(range(4 * taxels))  # cycles in which the sender waits and the next stage does not
        m.d.sync += refused.eq(Mux(accepted | ~dut.i.valid, 0, refused + dut.o.ready))
        prove(
            Mux(aligner.filling, refused <= aligner.index + 1, (aligner.index == 0) | (refused == 0)),
            "a frame is filled up at once",
        )
        wait = 2 if taxels <= STATE_BEATS else 0
        prove(refused <= taxels + 1 + wait, "no sender waits for ever")


@proof(
    "whole frames leave, taxel by taxel, whatever beats come; of whole frames every beat goes in once and "
    "none is lost, repeated or called "
    "wrong; offered deviations stay until taken (band)",
    depth=3,
    reduced=REDUCED,
    quick=True,
    bugs=(
        Bug(
            "a beat is lost while the next stage waits",
            "advance.eq(~now.valid | (self.o.ready & ~waiting))",
            "advance.eq(1)",
            file=FILE,
        ),
        Bug(
            "a frame that ends early is not filled up",
            "m.d.sync += filling.eq(1)",
            "m.d.sync += filling.eq(0)",
            file=ALIGNER,
        ),
    ),
)
def frames_band(m: Module) -> None:
    _frames(m, BAND)


@proof(
    "the same with a fault detector, whose verdict stays with the beat that it masks",
    depth=3,
    reduced=REDUCED,
    bugs=(
        Bug(
            "the detector's block goes on while a beat waits",
            "valid=advance & offered",
            "valid=offered",
            file=FILE,
        ),
    ),
)
def frames_faults(m: Module) -> None:
    _frames(m, BAND.replace(fault_frames=2))


@proof(
    "the same with a rest level and moving sums, whose verdict holds the last beat of a block",
    depth=7,
    reduced=REDUCED,
    bugs=(
        Bug(
            "the verdict's wait loses the beat", "now.valid & ~waiting)", "now.valid)", file=FILE, eager=True
        ),
    ),
)
def frames_baseline(m: Module) -> None:
    _frames(m, MEANS)


@proof(
    "the same with clipped deviations and windows that run freely",
    depth=5,
    reduced=REDUCED,
    bugs=(
        Bug(
            "a beat is lost while the next stage waits",
            "advance.eq(~now.valid | (self.o.ready & ~waiting))",
            "advance.eq(1)",
            file=FILE,
        ),
    ),
)
def frames_free(m: Module) -> None:
    _frames(m, FREE)


FEW = "the same of few taxels: a frame waits until the state that the one before it changed is written"
EARLY = Bug(
    "a frame begins a cycle early", "(index != 0) | empty.all()", "(index != 0) | empty[0]", file=FILE
)


@proof(FEW, depth=6, reduced="1 taxel, 4-bit samples", bugs=(EARLY,))
def one_taxel(m: Module) -> None:
    _frames(m, BAND.replace(taxels=1))


@proof(FEW, depth=7, reduced="2 taxels, 4-bit samples", bugs=(EARLY,))
def two_taxels(m: Module) -> None:
    _frames(m, MEANS.replace(taxels=2))


@proof(FEW, depth=5, reduced="3 taxels, 4-bit samples", bugs=(EARLY,))
def three_taxels(m: Module) -> None:
    _frames(m, FREE.replace(taxels=3))


def _touches(m: Module, config) -> None:
    """ARMED, TOUCH, REARM by docs/specification.md section 2, the rule's verdict on each frame taken as it
    comes."""
    dut = placed(OnsetDetector(config))
    free_source(dut.i)
    free_sink(dut.o)
    free(dut.mask)
    gone = Signal(range(config.sensor.taxels))
    with m.If(dut.o.valid & dut.o.ready):
        m.d.sync += gone.eq(Mux(gone == config.sensor.taxels - 1, 0, gone + 1))
    prove(
        dut.aligner.index == ((gone + _stages(dut, gone)) & (config.sensor.taxels - 1)),
        "the taxel that comes in",
    )
    left = dut.o.valid & dut.o.ready & _last(dut).last
    touches = dut.state
    judged, met = touches.judged, touches.met
    check = config.onset_rule.onset_check_frames if config.onset_rule.onset == "baseline" else 1
    at_once, hop = config.opens_at_once, config.windows.hop
    # frames since arm or the last touch, as many as count
    before_touch = Signal(range(config.windows.pretrigger_frames + 1))
    state = Signal(State, init=State.TOUCH if at_once else State.ARMED)
    remaining = Signal(range(config.last_frame + 1))  # frames of the touch that still come
    windows = Signal(range(config.windows.steps + 1))  # of the touch that have ended
    quiet = Signal(range(config.onset_rule.rearm_frames + check + 1), name="quiet_frames")
    place = Signal(range(hop))
    hops = Signal(2)  # frame in its hop; whole hops before it, 2 for more
    in_touch, free_mode = state == State.TOUCH, config.windows.window_mode == "free"
    boundary = (place == hop - 1) & (hops != 0)
    ends = (boundary & (windows == config.windows.steps - 1)) if free_mode else (remaining == 1)
    onset = (state == State.ARMED) & judged & met
    with m.If(left):
        m.d.sync += [
            place.eq(Mux(place == hop - 1, 0, place + 1)),
            hops.eq(hops + ((place == hop - 1) & (hops != 2))),
        ]
        with m.If(before_touch != config.windows.pretrigger_frames):
            m.d.sync += before_touch.eq(before_touch + 1)
        with m.If(onset):
            m.d.sync += [
                state.eq(State.TOUCH),
                remaining.eq(config.last_frame - 1 - before_touch),
                windows.eq(0),
            ]
        with m.Elif(in_touch):
            m.d.sync += [remaining.eq(remaining - 1), windows.eq(windows + boundary)]
            with m.If(ends):
                m.d.sync += [state.eq(State.REARM), quiet.eq(0), before_touch.eq(0)]
        with m.Elif((state == State.REARM) & judged & (not at_once)):
            m.d.sync += quiet.eq(Mux(met, 0, quiet + check))
            with m.If(~met & (quiet + check >= config.onset_rule.rearm_frames)):
                m.d.sync += state.eq(State.ARMED)
    status = dut.status
    prove(status.armed == (state == State.ARMED), "armed")
    prove(status.touch == in_touch, "touch")
    prove(status.started <= left, "a touch starts with a frame's last beat")
    if not at_once:
        prove(status.started == (left & onset), "a touch starts with its onset")
    if free_mode:
        prove(
            ~left | (dut.o.p.emit == (in_touch & boundary)),
            "windows end with every hop of a touch from the second hop on",
        )
        prove(~left | (dut.o.p.end == (in_touch & ends)), "the touch ends with its last window")
        prove(~left | (dut.o.p.hop_last == (place == hop - 1)), "hops run from frame 1")
    else:
        prove(~left | ((dut.o.p.touch == in_touch) & (dut.o.p.onset == onset)), "the marks of the frame")
    # ---- for the induction
    needed = -(-config.onset_rule.rearm_frames // check)
    prove((state != State.REARM) | (quiet <= (needed - 1) * check) & ((quiet % check) == 0), "quiet frames")
    prove((place < hop) & (hops != 3) & (state.as_value() != 3), "place")
    if free_mode:
        at, done, marks = place, hops != 0, dut.marks
        # each frame in the pipeline carries its place; its beats leave one by one
        for name, stage in reversed(dut.stages.items()):
            at_end = at == hop - 1
            hop_marks = (stage.hop_last == at_end) & (stage.boundary == (at_end & done))
            prove(~stage.valid | hop_marks, f"hop of stage {name}")
            ends_frame = stage.valid & (stage.index == config.sensor.taxels - 1)
            done = done | (ends_frame & (at == hop - 1))
            at = Mux(ends_frame, Mux(at == hop - 1, 0, at + 1), at)
        prove((marks.hop_frame == at) & (marks.hop_zero == ~done), "the frame that comes in")
        prove(~in_touch | (touches.step == windows) & (windows < config.windows.steps), "windows so far")
        prove((state != State.REARM) | (touches.quiet * check == quiet) if not at_once else 1, "quiet checks")
        prove(in_touch | (touches.step == 0), "steps begin at 0")
        prove((state == State.REARM) | (touches.quiet == 0), "quiet begins at 0")
    else:
        count = Mux(state == State.ARMED, before_touch, Mux(in_touch, config.last_frame - remaining, 0))
        rearm = (state == State.REARM) & (touches.count * check == quiet)
        prove(rearm | ((state != State.REARM) & (touches.count == count)), "the counter")
        prove(~in_touch | (remaining != 0) & (remaining < config.last_frame), "frames of the touch to come")
        full = (before_touch == config.windows.pretrigger_frames) | (before_touch * check >= quiet)
        prove((state != State.REARM) | full, "history grows while it is quiet")


class State(enum.Enum, shape=2):
    """States of the detector."""

    ARMED = 0
    TOUCH = 1
    REARM = 2


TOUCHES = (
    "touch after touch: the detector's states are those of docs/specification.md section 2, each touch "
    "ends, with the frame that completes "
    "its last window, and begins again after rearm_frames quiet frames only; one start pulse a touch"
)


@proof(
    TOUCHES,
    depth=2,
    reduced=f"{REDUCED}, touches of 6 frames, 1 of history, rearm 10",
    bugs=(
        Bug(
            "a touch a frame too long",
            "(count, config.last_frame - 1)",
            "(count, config.last_frame)",
            file=STATE,
            eager=True,
        ),
        FORGOTTEN,
    ),
)
def touches_band(m: Module) -> None:
    _touches(m, BAND)


@proof(
    f"{TOUCHES} (moving sums, judged every 4 frames)",
    depth=2,
    reduced=f"{REDUCED}, touches of 6 frames, 1 of history, rearm 10",
    bugs=(FORGOTTEN,),
)
def touches_baseline(m: Module) -> None:
    _touches(m, MEANS)


@proof(
    f"{TOUCHES} (windows that run freely)",
    depth=3,
    reduced=f"{REDUCED}, hops of 2 frames, 2 windows a touch",
    bugs=(
        Bug(
            "a window from the first hop on",
            "boundary=hop_last & ~hop_zero",
            "boundary=hop_last",
            file=MARKS,
            eager=True,
        ),
    ),
)
def touches_free(m: Module) -> None:
    _touches(m, FREE)
