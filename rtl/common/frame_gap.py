"""Cycles between two frames of an array so small that its state would be read before it is written."""

from amaranth.hdl import Module, Signal, Value

from eskin.rtl.program.timing import STATE_BEATS


def frame_gap(m: Module, taxels: int, frame_ends: Value) -> Value:
    """1 in the ``STATE_BEATS - taxels`` cycles after ``frame_ends``, in which no beat may be taken; with
    ``STATE_BEATS`` taxels and more always 0, without a register."""
    left = Signal(range(STATE_BEATS - taxels + 1), name="gap_left")
    with m.If(frame_ends):
        m.d.sync += left.eq(STATE_BEATS - taxels)
    with m.Elif(left != 0):
        m.d.sync += left.eq(left - 1)
    return left != 0
