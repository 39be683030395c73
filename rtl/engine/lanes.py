"""Multiply-accumulate lanes behind one interface (docs/specification.md, section 4)."""

from amaranth.hdl import Module, Mux, Signal, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from eskin.golden.core import AcceleratorConfig, Record
from eskin.rtl.common import CHIP
from eskin.rtl.engine.recoded_product import sum_with_product
from eskin.rtl.engine.sb_mac16 import DspLane


def lane_signature(
    a_bits: int, b_bits: int, acc_bits: int, *, load_with_operands: bool, accumulates: bool = True
) -> wiring.Signature:
    """Interface of every lane type, seen from the lane.

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
        Operands of the slot.
    swap : In(1)
        The sum restarts from ``load``.
    load : In(signed(acc_bits))
    valid : In(1)
        ``acc = (load if swap else acc) + a * b``; without it no product is added. It comes `Timing.valid`
        slots after the operands are issued, one slot earlier for the plain lane. The DSP block's own
        accumulator cannot load and add in one slot: `Timing.gap`.
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

    def __init__(self, members: dict, load_with_operands: bool, accumulates: bool):
        super().__init__(members)
        self.load_with_operands, self.accumulates = load_with_operands, accumulates


class PlainLane(wiring.Component):
    """The readable reference lane: an inferred product, one a cycle, and an adder; on a chip
    `eskin.rtl.engine.recoded_product`."""

    def elaborate(self, platform):
        m = Module()
        # no reset: it would keep the registers out of DSP blocks, and `valid` says what counts
        a = Signal.like(self.a, reset_less=True)
        b = Signal.like(self.b, reset_less=True)
        # Operands that do not count are 0: their product is added as it is, and no multiplexer is needed.
        counts = Signal()
        with m.If(self.tick):
            m.d.sync += [
                a.eq(Mux(self.valid, self.a, 0)),
                b.eq(Mux(self.valid, self.b, 0)),
                counts.eq(self.valid),
            ]
        load = self.load
        if self.signature.load_with_operands:
            load = Signal.like(self.load, reset_less=True)
            with m.If(self.tick):
                m.d.sync += load.eq(self.load)
        total = Signal.like(self.acc, reset_less=True)
        m.d.comb += self.acc.eq(total)
        base = Mux(self.swap, load, total) if self.signature.accumulates else load
        with m.If(self.tick & (counts | self.swap)):
            m.d.sync += total.eq(sum_with_product(base, a, b) if platform == CHIP else base + a * b)
        return m


LANE_TYPES: Record = {"plain": PlainLane, "dsp": DspLane}
"""Lane of each ``config.hardware.lane_type``."""


def make_lane(config: AcceleratorConfig, signature: LaneSignature) -> wiring.Component:
    """A lane of the configured type."""
    return LANE_TYPES[config.hardware.lane_type](signature)
