"""Where the array is touched: every whole frame with a touched cell is told once, in time, and nothing else is."""

from __future__ import annotations

from amaranth.hdl import Module, Mux, Signal

from eskin.golden.core.config import AcceleratorConfig
from eskin.rtl.interface.touch_position import FRACTION, TouchPosition
from formal.proof import Bug, assume, free, opened_up, proof, prove

FILE = "rtl/interface/touch_position.py"
CELLS, BITS = 16, 2 + FRACTION + 1
CONFIG = AcceleratorConfig.of(
    taxels=CELLS,
    rows=4,
    columns=4,
    sample_bits=8,
    sample_rate_hz=100.0,
    band_high=255,
    position=True,
    position_rest=250,
    position_threshold=2,
)
TOP = 255


@proof(
    "every whole frame with a touched cell is told once, a fixed time behind its last taxel; the first whole one without, behind one that "
    "had, is told as the end; of a frame with a clear in it nothing is told; the divider comes to rest",
    depth=2,
    reduced="4 x 4 cells of 8 bits; no frame ends while one is divided",
    bugs=(
        Bug("the rest of a frame counts after a clear", FILE, "self.i.valid & (inside | self.i.payload.first)", "self.i.valid", depth=40),
        Bug("y is not divided", FILE, "rest.eq(other), left.eq(bits), second.eq(1)", "rest.eq(other), second.eq(1)", depth=45),
        Bug(
            "a clear forgets the touch's end only",
            FILE,
            "(*frame, inside, left, second, touch, known",
            "(*frame, inside, second, touch, known",
            depth=45,
        ),
        Bug("an end is told twice", FILE, "touch.eq(total_now != 0)", "touch.eq(touch | (total_now != 0))", depth=70, eager=True),
    ),
)
def told_once(m: Module) -> None:
    dut = TouchPosition(CONFIG)
    inside = opened_up(m, "dut", dut)
    for signal in (dut.i, dut.clear):
        free(m, signal)
    beat, first, last, sample = dut.i.valid, dut.i.payload.first, dut.i.payload.last, dut.i.payload.sample
    # ---- the sender: whole frames; a clear does not change where it is
    at = Signal(range(CELLS), name="at")
    assume(m, ~beat | ((first == (at == 0)) & (last == (at == CELLS - 1))))
    with m.If(beat):
        m.d.sync += at.eq(at + 1)
    # ---- a reference of its own: is this frame whole so far, has it a touched cell, had the one before
    whole, some, had = Signal(name="whole"), Signal(name="some"), Signal(name="had")
    touched = sample > 252
    some_now, ends = (some & ~first) | touched, beat & last & (whole | first)
    assume(m, ~(ends & (inside.left != 0)))
    due = Signal(range(2 * BITS + 3), name="due")  # cycles until a position is told
    over = Signal(name="over_due")
    m.d.sync += [due.eq(due - (due != 0)), over.eq(ends & ~some_now & had)]
    with m.If(beat):
        m.d.sync += [whole.eq((whole | first) & ~last), some.eq(some_now & (whole | first) & ~last)]
    with m.If(ends):
        m.d.sync += had.eq(some_now)
        with m.If(some_now):
            m.d.sync += due.eq(2 * BITS + 1)
    with m.If(dut.clear):
        m.d.sync += [whole.eq(0), some.eq(0), had.eq(0), due.eq(0), over.eq(0)]
    prove(m, dut.o.valid == ((due == 1) | over), "told when it is due, and only then")
    prove(m, dut.o.payload.ended == over, "ended")
    # ---- for the induction
    prove(m, inside.inside == whole, "a frame under way")
    prove(m, whole | (at == 0) | ~inside.inside, "place")
    prove(m, ~whole | (at != 0), "under way behind the first")
    prove(m, ~whole | (inside.place == at), "place in the frame")
    prove(m, whole | ((inside.place == 0) & (inside.total == 0)), "nothing held between frames")
    prove(m, (inside.total != 0) == (some & whole), "a touched cell")
    prove(m, inside.total <= at * 5, "no sum overflows")
    prove(m, ~some | whole, "touched in a frame")
    prove(m, inside.touch == had, "the frame before")
    prove(m, (inside.left != 0) == (due > 1), "the divider")
    prove(m, (due <= 1) | (due == inside.left + 1 + Mux(inside.second, 0, BITS)), "cycles to go")
    prove(m, inside.known == (due == 1), "known")
    prove(m, inside.left <= BITS, "range")
    prove(m, due <= 2 * BITS + 1, "range of what is due")
    prove(m, inside.over == over, "over")
