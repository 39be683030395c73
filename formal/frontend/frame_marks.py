"""The marks of a touch's frames, against its windows, and the frames that later blocks see."""

from amaranth.hdl import Module, Mux, Signal

from eskin.golden.core import PRESETS, AcceleratorConfig
from eskin.rtl.frontend.frame_marks import TouchMarks
from formal.engine.sequencer import table
from formal.proof import Bug, free, placed, proof, prove

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
EVEN = PRESETS["thesis"].replace(**SMALL, window=4, steps=2, touch_frames=6)
ODD = PRESETS["thesis"].replace(**SMALL, window=5, steps=3, touch_frames=6)


def _marks(m: Module, config: AcceleratorConfig) -> None:
    dut = placed(TouchMarks(config))
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
    prove(dut.hop == table(m, [number // hop for number in range(last)], frame, "hops"), "hop")
    prove(dut.place == table(m, [number % hop for number in range(last)], frame, "places"), "place")


CLAIM = "of every frame of a touch: it ends a hop, it ends a window, it ends the touch"


@proof(
    CLAIM,
    depth=1,
    reduced="touches of 6 frames, windows of 4, hop 2",
    quick=True,
    bugs=(Bug("a frame too late", "divmod(frames - 2, hop_frames)", "divmod(frames - 1, hop_frames)"),),
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
