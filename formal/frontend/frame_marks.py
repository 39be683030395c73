"""The marks of a touch's frames, against its windows; and the frames that the blocks behind them see."""

from types import SimpleNamespace

from amaranth.hdl import Module, Mux, Signal, Value

from eskin.golden.core import PRESETS, AcceleratorConfig
from eskin.rtl.frontend.frame_marks import TouchMarks
from eskin.rtl.program.timing import STATE_BEATS
from formal.engine.sequencer import table
from formal.proof import Bug, Inside, assume, free, opened_up, proof, prove

SMALL = dict(
    taxels=4,
    sample_bits=3,
    band_low=3,
    band_high=5,
    feature_shift=(),
    pretrigger_frames=0,
    hop=2,
    rearm_frames=20,
    clip=2,
    rest="initial",
    rest_frames=4,
)
KINDS = dict(
    feature_kinds=("mean", "activity", "integral"),
    activity_rule="change",
    activity_block=2,
    integral_knee=1,
    integral_frac=2,
)
EVEN = PRESETS["thesis"].replace(**SMALL, window=4, steps=2, touch_frames=6)
ODD = PRESETS["thesis"].replace(**SMALL, window=5, steps=3, touch_frames=6)
FREE = PRESETS["pvdf"].replace(**SMALL, window=4, steps=2, onset_mean_frames=4, onset_check_frames=2)


def gap_left(inside: Inside, taxels: int) -> Signal:
    """Cycles of `eskin.rtl.common.frame_gap.frame_gap` to come, which are few."""
    left = next(register for register in inside.registers if register.name == "gap_left")
    prove(left <= STATE_BEATS - taxels, "the gap's own cycles")
    return left


def frames(m: Module, config: AcceleratorConfig, port, last_kind: Value) -> SimpleNamespace:
    """Where the beat at ``port`` stands, ``last_kind`` the last of its taxel, and the marks of its frame,
    assumed as `TouchMarks` makes them, or the detector (formal/frontend/onset_detector.py: touches_free).

    beat: its taxel. place: frames of its hop before it. frame: of its touch; where hops run on, as place.
    in_block: frames of its block before it. some: a block was whole before it, in this touch or ever. later:
    a hop was whole. windows: of the touch under way that ended with earlier hops.
    """
    taxels, hop, steps = config.sensor.taxels, config.windows.hop, config.windows.steps
    block, frames_of_touch = config.features.activity_block, config.last_frame
    taken, beat, place = (
        port.valid & port.ready,
        Signal(range(taxels), name="beat"),
        Signal(range(hop), name="place"),
    )
    some, later, windows = Signal(name="some"), Signal(name="later"), Signal(range(steps + 1), name="windows")
    with m.If(taken & last_kind):
        m.d.sync += beat.eq(Mux(beat == taxels - 1, 0, beat + 1))
    in_block = table(m, [number % block for number in range(hop)], place, "in_block")
    at = SimpleNamespace(taken=taken, beat=beat, place=place, some=some, later=later, windows=windows)
    at.in_block, at.block_last = in_block, in_block == block - 1
    at.ends = taken & last_kind & (beat == taxels - 1)
    prove((beat < taxels) & (place < hop), "the reference's own place")
    if config.windows.window_mode == "touch":
        at.frame = frame = Signal(range(frames_of_touch), name="frame")
        at.end = frame == frames_of_touch - 1
        emits = [
            int(number + 1 in {end for _, end in config.window_spans}) for number in range(frames_of_touch)
        ]
        at.emit = table(m, emits, frame, "emits")
        at.hop_last = (place == hop - 1) | at.end
        with m.If(at.ends):
            m.d.sync += [
                frame.eq(Mux(at.end, 0, frame + 1)),
                place.eq(Mux(at.hop_last, 0, place + 1)),
                some.eq(~at.end & (some | at.block_last)),
                later.eq(1),
            ]
        prove(frame < frames_of_touch, "the reference's own frame")
        prove(place == table(m, [number % hop for number in range(frames_of_touch)], frame, "places"), "hops")
        prove(some == (frame >= block), "a block was whole")
        prove(later | (frame == 0), "a frame was whole")
    else:
        at.frame, at.hop_last = place, place == hop - 1
        emits, next_emit = Signal(name="emits"), Signal(name="next_emit")
        free(next_emit)
        at.emit = emits & later & at.hop_last
        at.end = at.emit & (windows == steps - 1)
        with m.If(at.ends):
            m.d.sync += [
                place.eq(Mux(at.hop_last, 0, place + 1)),
                some.eq(some | at.block_last),
                later.eq(later | at.hop_last),
                emits.eq(next_emit),
            ]
            with m.If(at.hop_last):
                m.d.sync += windows.eq(Mux(at.emit & ~at.end, windows + 1, 0))
        prove(windows < steps, "the reference's own window")
        prove((some <= (later | (place >= block))) & (later <= some) & ((place >= block) <= some), "some")
        prove((windows == 0) | later, "windows take two hops")
    marks = port.p
    assume(~port.valid | (marks.hop_last == at.hop_last) & (marks.emit == at.emit) & (marks.end == at.end))
    return at


def _marks(m: Module, config: AcceleratorConfig) -> None:
    dut = TouchMarks(config)
    inside = opened_up(dut)
    free(dut.taken)
    last, hop = config.last_frame, config.windows.hop
    frame = Signal(range(last), name="frame")
    with m.If(dut.taken):
        m.d.sync += frame.eq(Mux(frame == last - 1, 0, frame + 1))
    ends = {end for _, end in config.window_spans}
    expected = {
        "hop_last": [int(number % hop == 0 or number == last) for number in range(1, last + 1)],
        "emit": [int(number in ends) for number in range(1, last + 1)],
        "end": [int(number == last) for number in range(1, last + 1)],
    }
    for name, values in expected.items():
        prove(getattr(dut, name) == table(m, values, frame, name), name)
    prove(frame < last, "the reference's own frame")
    prove(inside.hop == table(m, [number // hop for number in range(last)], frame, "hops"), "hop")
    prove(inside.place == table(m, [number % hop for number in range(last)], frame, "places"), "place")


CLAIM = "of every frame of a touch: it ends a hop, it ends a window, it ends the touch"


@proof(
    CLAIM,
    depth=1,
    reduced="touches of 6 frames, windows of 4, hop 2",
    quick=True,
    bugs=(
        Bug("a frame too late", "divmod(max(frames - 2, 0), hop_frames)", "divmod(frames - 1, hop_frames)"),
    ),
)
def even(m: Module) -> None:
    _marks(m, EVEN)


@proof(
    f"{CLAIM}; windows of 2 hop + 1",
    depth=1,
    reduced="touches of 6 frames, windows of 5, hop 2",
    bugs=(Bug("windows of two hops", "turns if odd else hop_last", "hop_last"),),
)
def odd_and_clipped(m: Module) -> None:
    _marks(m, ODD)
