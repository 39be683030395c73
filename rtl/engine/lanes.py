"""Multiply-accumulate lanes behind one interface (docs/specification.md, section 4).

A slot is one cycle for `PlainLane` and `DspLane`, one cycle a multiplier bit for `SerialLane` (rtl/program/schedule.py: ``slot_cycles``).
"""

from __future__ import annotations

from amaranth.hdl import Module, Mux, Signal, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from eskin.golden.core.config import AcceleratorConfig
from eskin.rtl.engine.sb_mac16 import DspLane


def lane_signature(a_bits: int, b_bits: int, acc_bits: int, *, load_with_operands: bool, accumulates: bool = True) -> wiring.Signature:
    """What every lane type offers, seen from the lane.

    Parameters
    ----------
    a_bits, b_bits, acc_bits:
        Widths; the accumulator's is proven large enough by the configuration.
    load_with_operands:
        ``load`` comes in the slot of the first operands; otherwise it is there in the slot of ``swap``.
    accumulates:
        False: every sum has one product, ``swap`` need not be looked at.

    Members
    -------
    tick : In(1)
        The slot ends with this cycle: what follows is done.
    a, b : In(signed)
        Operands of the slot; the serial lane goes through ``b`` bit by bit.
    swap : In(1)
        The sum begins anew from ``load``.
    load : In(signed(acc_bits))
    valid : In(1)
        ``acc = (load if swap else acc) + a * b``, told `Timing.valid` slots after the operands' issue; without it no product is added. The
        plain lane is told a slot early. The DSP block's own accumulator cannot do both in one slot: `Timing.gap`.
    acc : Out(signed(acc_bits))
        The sum, `Timing.acc` slots after the last operands' issue.
    """
    members = {
        "tick": In(1),
        "a": In(signed(a_bits)),
        "b": In(signed(b_bits)),
        "swap": In(1),
        "load": In(signed(acc_bits)),
        "valid": In(1),
        "acc": Out(signed(acc_bits)),
    }
    return LaneSignature(members, load_with_operands, accumulates)


class LaneSignature(wiring.Signature):
    """`lane_signature`, which keeps its parameters."""

    def __init__(self, members: dict, load_with_operands: bool, accumulates: bool) -> None:
        super().__init__(members)
        self.load_with_operands, self.accumulates = load_with_operands, accumulates


class PlainLane(wiring.Component):
    """The readable reference lane: an inferred product, one a cycle, and an adder."""

    def elaborate(self, platform):
        m = Module()
        # no reset: it would keep the registers out of DSP blocks, and `valid` says what counts
        a, b = Signal.like(self.a, reset_less=True), Signal.like(self.b, reset_less=True)
        counts = Signal()  # the operands do; others are 0, so that nothing has to choose between their product and the sum
        with m.If(self.tick):
            m.d.sync += [a.eq(Mux(self.valid, self.a, 0)), b.eq(Mux(self.valid, self.b, 0)), counts.eq(self.valid)]
        load = self.load
        if self.signature.load_with_operands:
            load = Signal.like(self.load, reset_less=True)
            with m.If(self.tick):
                m.d.sync += load.eq(self.load)
        total = Signal.like(self.acc, reset_less=True)
        m.d.comb += self.acc.eq(total)
        base = Mux(self.swap, load, total) if self.signature.accumulates else load
        with m.If(self.tick & (counts | self.swap)):
            m.d.sync += total.eq(base + a * b)
        return m


class SerialLane(wiring.Component):
    """No multiplier at all: ``a`` is shifted and added where ``b`` has a bit, least significant first; the sign bit subtracts.

    ``load`` is taken in the slot of ``swap``. A product takes as many cycles as ``b`` has bits, beginning with the cycle after the tick
    with ``valid``; ``acc`` is the sum at the tick that ends the product's last slot.
    """

    def elaborate(self, platform):
        m = Module()
        bits = len(self.b)
        shifted, rest = Signal(signed(len(self.a) + bits - 1), reset_less=True), Signal(bits, reset_less=True)
        left = Signal(range(bits + 1))  # bits of b still to go through
        total = Signal.like(self.acc, reset_less=True)
        with m.If((left != 0) & rest[0]):
            m.d.comb += self.acc.eq(Mux(left == 1, total - shifted, total + shifted))
        with m.Else():
            m.d.comb += self.acc.eq(total)
        m.d.sync += total.eq(self.acc)
        with m.If(left != 0):
            m.d.sync += [shifted.eq(shifted << 1), rest.eq(rest >> 1), left.eq(left - 1)]
        with m.If(self.tick & self.swap):
            m.d.sync += total.eq(self.load)
        with m.If(self.tick & self.valid):
            m.d.sync += [shifted.eq(self.a), rest.eq(self.b), left.eq(bits)]
        return m


LANE_TYPES = {"plain": PlainLane, "dsp": DspLane, "serial": SerialLane}
"""Lane of each ``config.hardware.lane_type``."""


def make_lane(config: AcceleratorConfig, signature: LaneSignature) -> wiring.Component:
    """A lane of the configured type."""
    return LANE_TYPES[config.hardware.lane_type](signature)
