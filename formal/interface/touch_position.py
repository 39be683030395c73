"""Where the array is touched: every whole frame with a touched cell is told once, in time, and nothing else
is."""

from amaranth.hdl import Module, Mux, Signal

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.interface.touch_position import FRACTION, TouchPosition
from formal.proof import Bug, assume, free_inputs, opened_up, proof, prove

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
    "every whole frame with a touched cell is told once, a fixed time behind its last taxel; the first "
    "whole one without, behind one that "
    "had, is told as the end; of a frame with a clear in it nothing is told; the divider comes to rest",
    depth=2,
    reduced="4 x 4 cells of 8 bits; no frame ends while one is divided",
    bugs=(
        Bug(
            "the rest of a frame counts after a clear",
            "self.i.valid & (inside | self.i.payload.first)",
            "self.i.valid",
            depth=40,
        ),
        Bug(
            "y is not divided",
            "rest.eq(other), left.eq(bits), second.eq(1)",
            "rest.eq(other), second.eq(1)",
            depth=45,
        ),
        Bug(
            "a clear forgets the touch's end only",
            "(*frame, inside, left, second, touch, known",
            "(*frame, inside, second, touch, known",
            depth=45,
        ),
        Bug(
            "an end is told twice",
            "touch.eq(total_now != 0)",
            "touch.eq(touch | (total_now != 0))",
            depth=70,
            eager=True,
        ),
    ),
)
def told_once(m: Module) -> None:
    dut = TouchPosition(CONFIG)
    inside = opened_up(dut)
    free_inputs(dut)
    beat, first, last, sample = dut.i.valid, dut.i.payload.first, dut.i.payload.last, dut.i.payload.sample
    # ---- the sender: whole frames; a clear does not change where it is
    at = Signal(range(CELLS))
    assume(~beat | ((first == (at == 0)) & (last == (at == CELLS - 1))))
    with m.If(beat):
        m.d.sync += at.eq(at + 1)
    # ---- a reference of its own: is this frame whole so far, has it a touched cell, had the one before
    whole = Signal()
    some = Signal()
    had = Signal()
    touched = sample > 252
    some_now, ends = (some & ~first) | touched, beat & last & (whole | first)
    assume(~(ends & (inside.left != 0)))
    due = Signal(range(2 * BITS + 3))  # cycles until a position is told
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
    prove(dut.o.valid == ((due == 1) | over), "told when it is due, and only then")
    prove(dut.o.payload.ended == over, "ended")
    # ---- for the induction
    prove(inside.inside == whole, "a frame under way")
    prove(whole | (at == 0) | ~inside.inside, "place")
    prove(~whole | (at != 0), "under way behind the first")
    prove(~whole | (inside.place == at), "place in the frame")
    prove(whole | ((inside.place == 0) & (inside.total == 0)), "nothing held between frames")
    prove((inside.total != 0) == (some & whole), "a touched cell")
    prove(inside.total <= at * 5, "no sum overflows")
    prove(~some | whole, "touched in a frame")
    prove(inside.touch == had, "the frame before")
    prove((inside.left != 0) == (due > 1), "the divider")
    prove((due <= 1) | (due == inside.left + 1 + Mux(inside.second, 0, BITS)), "cycles to go")
    prove(inside.known == (due == 1), "known")
    prove(inside.left <= BITS, "range")
    prove(due <= 2 * BITS + 1, "range of what is due")
    prove(inside.over == over, "over")
