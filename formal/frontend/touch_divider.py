"""The store of a touch's sums: every frame of one touch, whatever its end and its last loud frame."""

from amaranth.hdl import Module, Mux, Signal

from eskin.golden.core import PRESETS
from eskin.rtl.frontend.touch_divider import TouchDivider
from formal.proof import Bug, any_number, assume, placed, proof, prove

SUMS, FRAMES, VALUE = 4, 8, 4
"""Of the store; of the longest touch, which doubles the hop twice; the deviation of one frame, else 0."""
CONFIG = PRESETS["thesis"].replace(
    taxels=1, sample_bits=5, clip=VALUE, rest="initial", rest_frames=4, band_low=3, band_high=5,
    window_mode="whole", hop=1, window=2, steps=2, store_per_window=2, touch_frames=FRAMES,
    decision="last", feature_shift=(),
)  # fmt: skip
LEAVES = 2 * (2 * 2 + 2 + 6) + SUMS + 4
"""Cycles from the end of a touch to its last value: two windows, and a store to halve before."""
CLAIM = (
    "every frame up to the last sum that counts is in exactly one sum, also where the hop doubles; the store never "
    "overflows; all windows come, in order, in the stated cycles"
)
REDUCED = (
    "a touch of {} frames and the next, 1 taxel, hop 1, 2 windows of 2 sums; beats and receiver never wait"
)


def _touch(m: Module, last: int, kind: str = "mean") -> None:
    dut, summed = placed(TouchDivider(CONFIG.replace(feature_kinds=(kind,)))), kind == "mean"
    marked, loud = (any_number(range(last + 1), name) for name in ("marked", "loud"))
    flushed = any_number(1, "flushed")
    assume((marked > 0) & (marked <= last) & (loud <= last))
    frame = Signal(range(FRAMES + 2), init=1)
    beat, finished = dut.i.p, Signal()
    m.d.comb += [
        dut.i.valid.eq((frame <= last) | ~flushed),
        beat.touch.eq(1),
        beat.complement.eq(Mux(frame == marked, ~VALUE, ~0)),
        beat.loud.eq(frame == loud),
        beat.end.eq((frame == last) & ~flushed),
        dut.flush.eq(flushed & (frame > last) & ~finished & ~dut.holds),
        dut.o.ready.eq(1),
    ]
    goes = dut.i.valid & dut.i.ready
    m.d.sync += [
        frame.eq(frame + (goes & (frame <= last))),
        finished.eq(finished | (goes & beat.end) | dut.flush),
    ]

    # what the specification says of this touch
    doublings = (last // SUMS).bit_length()
    upwards = (loud + (1 << doublings) - 1) >> doublings
    least, there = Mux(upwards == 0, 1, upwards), last >> doublings
    counts, at = Signal(range(SUMS)), (marked - 1)[:4] >> doublings
    m.d.comb += counts.eq(Mux(least < there, least, there))
    windows = Signal(range(4))
    m.d.sync += windows.eq(windows + dut.o.valid)
    first = Mux(windows[0] & (counts > 1), counts >> 1, 0)
    end = Mux((counts > 1) & ~windows[0], counts >> 1, counts)
    within = ((at >= first) | (not summed)) & (at < end)
    value = VALUE >> doublings if summed else VALUE
    prove(~dut.o.valid | (windows < 2), "no window but these")
    prove(~dut.o.valid | (~dut.o.p.complement == Mux(within, value, 0)), "in one sum, or the largest")
    prove(~dut.o.valid | (dut.o.p.length == end - first - 1), "sums of a window")
    prove(~dut.o.valid | (dut.o.p.final == windows[0]), "in order")
    age = Signal(range(LEAVES + 2))
    m.d.sync += age.eq(age + (finished & (age <= LEAVES)))
    prove((age <= LEAVES) | (windows == 2), "all windows come in time")
    prove(dut.count < SUMS, "no sum beyond the store")


@proof(
    CLAIM,
    method="bounded",
    depth=50,
    reduced=REDUCED.format(3),
    bugs=(
        Bug("a hop goes on", "Mux(second_kind, begins_block, begins)", "0"),
        Bug("the last sum is not repeated", "few & (window + 1 >= counts)", "few & (window > counts)"),
        Bug("the next touch stores while values leave", "(between & ~hop_last)", "between"),
    ),
)
def stored(m: Module) -> None:
    _touch(m, 3)


@proof(
    CLAIM,
    method="bounded",
    depth=55,
    reduced=REDUCED.format("4, which fill the store"),
    bugs=(Bug("that doubling is forgotten", "shifts.eq(now_mask)", "shifts.eq(mask)"),),
)
def filled(m: Module) -> None:
    _touch(m, SUMS)


@proof(
    CLAIM,
    method="bounded",
    depth=65,
    reduced=REDUCED.format(7),
    bugs=(
        Bug("a neighbour is skipped", "Mux(block_last, address + 1,", "Mux(block_last, address + 2,"),
        Bug("a sum too many after a halving", "sums // 2, counted", "sums // 2 + 1, counted"),
        Bug("the hop is not doubled", "Mux(fills, Cat(1, mask), mask)", "mask"),
        Bug("the mark rounds down", "(marked + 1) >> 1", "marked >> 1"),
    ),
)
def doubled(m: Module) -> None:
    _touch(m, 7)


@proof(
    "a window's highest value is that of the frames up to its last sum, also where the hop doubles",
    method="bounded",
    depth=65,
    reduced=REDUCED.format(7),
    bugs=(
        Bug("a neighbour's is lost", "(~adds & first | farther)", "(~adds & first)"),
        Bug("of this window alone", "Mux(of_touch, 0, start)", "start"),
    ),
)
def highest(m: Module) -> None:
    _touch(m, 7, "highest")


@proof(
    CLAIM,
    method="bounded",
    depth=75,
    reduced=REDUCED.format("8, which fill it twice"),
    bugs=(Bug("sums go to the first's place", "Mux(pending, 0, to)", "0"),),
)
def twice(m: Module) -> None:
    _touch(m, FRAMES)
