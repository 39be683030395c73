"""Multiply-accumulate lanes behind one interface."""

from __future__ import annotations

from amaranth.hdl import Module, Mux, Signal, signed
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out


class PlainLane(wiring.Component):
    """The readable reference lane: an inferred product, added to one of its accumulators.

    ``acc[k] = (load if first else acc[k]) + a * b`` for the accumulator k whose ``valid`` bit is set.

    Parameters
    ----------
    a_bits, b_bits:
        Widths of the signed operands.
    acc_bits:
        Widths of the accumulators, proven large enough by the configuration; lanes that serve rows and element-wise operations
        with one multiplier have two.

    Members
    -------
    a, b : In(signed)
        Operands.
    first : In(1)
        Start from ``load`` instead of the accumulator.
    load : In(signed)
        As wide as the widest accumulator.
    valid : In(number of accumulators)
    acc : Out(array)
        Contains the product of a cycle two cycles later.

    Latency 2 cycles, one product a cycle.
    """

    def __init__(self, a_bits: int, b_bits: int, acc_bits: tuple[int, ...]) -> None:
        super().__init__(
            {
                "a": In(signed(a_bits)), "b": In(signed(b_bits)), "first": In(1), "load": In(signed(max(acc_bits))),
                "valid": In(len(acc_bits)), "acc": Out(data.StructLayout({f"acc{k}": signed(bits) for k, bits in enumerate(acc_bits)})),
            }
        )  # fmt: skip

    def elaborate(self, platform):
        m = Module()
        a, b, load = Signal.like(self.a), Signal.like(self.b), Signal.like(self.load)
        first, valid = Signal(), Signal.like(self.valid)
        m.d.sync += [a.eq(self.a), b.eq(self.b), load.eq(self.load), first.eq(self.first), valid.eq(self.valid)]
        product = Signal(signed(len(a) + len(b)))
        m.d.comb += product.eq(a * b)
        for k in range(len(self.valid)):
            acc = self.acc[f"acc{k}"]
            with m.If(valid[k]):
                m.d.sync += acc.eq(Mux(first, load, acc) + product)
        return m
