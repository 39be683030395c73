"""Multiply-accumulate lanes behind one interface: a lane takes operands at the end of a slot and has their product added two slots on.

A slot is one cycle for `PlainLane`, one cycle a multiplier bit for `SerialLane` (rtl/schedule.py: ``slot_cycles``).
"""

from __future__ import annotations

from amaranth.hdl import Module, Mux, Signal, signed
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from golden.config import AcceleratorConfig


def lane_signature(a_bits: int, b_bits: int, acc_bits: tuple[int, ...]) -> wiring.Signature:
    """What every lane type offers, seen from the lane.

    Members
    -------
    tick : In(1)
        The slot ends with this cycle: operands are taken.
    a, b : In(signed)
        Operands; the serial lane goes through ``b`` bit by bit.
    first : In(1)
        Start from ``load`` instead of the accumulator.
    load : In(signed)
        As wide as the widest accumulator.
    valid : In
        One bit an accumulator: ``acc[k] = (load if first else acc[k]) + a * b``.
    acc : Out(struct of ``acc0``, ``acc1`` ...)
        Holds the product of a slot two slots later (serial, b longer than a slot: as many slots more). Widths are proven large enough by
        the configuration.
    """
    accumulators = data.StructLayout({f"acc{k}": signed(bits) for k, bits in enumerate(acc_bits)})
    return wiring.Signature(
        {
            "tick": In(1), "a": In(signed(a_bits)), "b": In(signed(b_bits)), "first": In(1), "load": In(signed(max(acc_bits))),
            "valid": In(len(acc_bits)), "acc": Out(accumulators),
        }
    )  # fmt: skip


class PlainLane(wiring.Component):
    """The readable reference lane: an inferred product, one a cycle, added to one of its accumulators.

    Parameters: see `lane_signature`. With two accumulators one multiplier serves rows and element-wise operations.
    """

    def __init__(self, a_bits: int, b_bits: int, acc_bits: tuple[int, ...]) -> None:
        super().__init__(lane_signature(a_bits, b_bits, acc_bits))

    def elaborate(self, platform):
        m = Module()
        a, b, load = Signal.like(self.a), Signal.like(self.b), Signal.like(self.load)
        first, valid = Signal(), Signal.like(self.valid)
        with m.If(self.tick):
            m.d.sync += [a.eq(self.a), b.eq(self.b), load.eq(self.load), first.eq(self.first), valid.eq(self.valid)]
        product = Signal(signed(len(a) + len(b)))
        m.d.comb += product.eq(a * b)
        for k in range(len(self.valid)):
            acc = self.acc[f"acc{k}"]
            with m.If(valid[k] & self.tick):
                m.d.sync += acc.eq(Mux(first, load, acc) + product)
        return m


class SerialLane(wiring.Component):
    """No multiplier at all: ``a`` is shifted and added where ``b`` has a bit, least significant first; the sign bit subtracts.

    Parameters: see `lane_signature`; one accumulator. A product takes as many cycles as ``b`` has bits, beginning with the cycle after
    the tick that took it.
    """

    def __init__(self, a_bits: int, b_bits: int, acc_bits: tuple[int, ...]) -> None:
        if len(acc_bits) != 1:
            raise ValueError("a serial lane has one accumulator")
        super().__init__(lane_signature(a_bits, b_bits, acc_bits))

    def elaborate(self, platform):
        m = Module()
        bits = len(self.b)
        shifted, rest = Signal(signed(len(self.a) + bits - 1)), Signal(bits)
        load, first = Signal.like(self.load), Signal()
        left = Signal(range(bits + 1))  # bits of b still to go through
        total, following = Signal.like(self.acc.acc0), Signal.like(self.acc.acc0)
        base = Mux(first, load, total)
        m.d.comb += following.eq(total)
        with m.If(left != 0):
            m.d.comb += following.eq(Mux(rest[0], Mux(left == 1, base - shifted, base + shifted), base))
            m.d.sync += [shifted.eq(shifted << 1), rest.eq(rest >> 1), left.eq(left - 1), first.eq(0)]
        m.d.sync += total.eq(following)
        # The next product begins at once, so what the slot ends with is kept for the whole next slot.
        with m.If(self.tick):
            m.d.sync += self.acc.acc0.eq(following)
        with m.If(self.tick & self.valid.any()):
            m.d.sync += [shifted.eq(self.a), rest.eq(self.b), load.eq(self.load), first.eq(self.first), left.eq(bits)]
        return m


LANE_TYPES = {"plain": PlainLane, "serial": SerialLane}
"""Lane of each ``config.lane_type``."""


def make_lane(config: AcceleratorConfig, a_bits: int, b_bits: int, acc_bits: tuple[int, ...]) -> wiring.Component:
    """A lane of the configured type."""
    return LANE_TYPES[config.lane_type](a_bits, b_bits, acc_bits)
