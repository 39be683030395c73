"""Output path of the image engine's sums: they are narrowed one by one, and the largest of a pool's window is
kept (specification, section 15)."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, signed

from eskin.golden.core import QFormat
from eskin.rtl.common import Block, inputs, outputs, saturate, struct
from eskin.rtl.image.layouts import sum_layout
from eskin.rtl.program.image_passes import ImagePlan

ACTIVATION = QFormat(0, 8, signed=False)
"""An activation's code: 0 to 255."""


class SumDrain(Block):
    """Narrows each lane's sum in turn to ``SAT(sum >> shift)``, a logit or a value of the map.

    A map gets the maximum over the sums of a pool's window. The sum already holds the rounding half. In a
    pair the first half of the lanes belongs to the left place, the second half to the right one; the maximum
    is complete when both have gone into it.

    Members
    -------
    swap : In(1), sums : In(sum_layout)
        Pulse: the lanes' sums go into the chain, and what they are.
    shift, last, pairs : In
        Properties of the pass: bits by which a sum is shifted right; its results are logits; it works in pairs.
    move : Out(1)
        The chain moves on by a lane: in as many cycles after a swap as there are lanes.
    total : In(signed(accumulator_bits))
        Output of the chain.
    value : Out(struct: valid, value)
        A value of the map, three cycles after its sum was in ``total``; channel after channel.
    logit : Out(struct: valid, value)
        A logit, as late.
    """

    def ports(self, plan: ImagePlan):
        logit = struct("valid", value=signed(plan.logit_format.width))
        return inputs(
            "swap", "last", "pairs", sums=sum_layout(plan), shift=5, total=signed(plan.accumulator_bits)
        ) | outputs("move", value=struct("valid", value=8), logit=logit)

    def elaborate(self, platform):
        m = Module()
        plan = self.spec
        sums = Signal(sum_layout(plan))
        lane = Signal(range(max(2, plan.lanes)))
        moving = Signal()
        counts = Signal()  # this lane had a channel
        m.d.comb += self.move.eq(moving)
        with m.If(self.swap):
            m.d.sync += [sums.eq(self.sums), lane.eq(0), moving.eq(1), counts.eq(self.sums.valid)]
        with m.Elif(moving):
            m.d.sync += lane.eq(lane + 1)
            with m.If(lane == plan.lanes - 1):
                m.d.sync += [moving.eq(0), counts.eq(0)]
            with m.Elif(lane == sums.lanes):
                m.d.sync += counts.eq(0)
        shifted = Signal(signed(plan.accumulator_bits), reset_less=True)
        moved = Signal()
        opens = Signal()
        closes = Signal()
        counted = Signal()
        m.d.sync += [
            shifted.eq(self.total >> self.shift),
            moved.eq(moving),
            opens.eq(sums.opens),
            closes.eq(counts & sums.closes & ~self.last),
            counted.eq(counts & self.last),
        ]
        # of the lane that comes, and those after it
        held = [Signal(8, name=f"held_{k}", reset_less=True) for k in range(plan.lanes)]
        own = Signal(8)
        largest = Signal(8)
        oldest, first = held[0], Const(1, 1)
        if plan.pairs:
            # The left neighbour came P / 2 lanes earlier. A right place outside the map is 0 and never wins.
            half = plan.lanes // 2
            right = Signal()
            beyond = Signal()
            m.d.comb += right.eq(self.pairs & lane[-1])
            m.d.sync += [
                opens.eq(sums.opens & ~right),
                beyond.eq(right & sums.alone),
                closes.eq(counts & sums.closes & ~self.last & (right | ~self.pairs)),
            ]
            oldest, first = Mux(self.pairs, held[half], held[0]), ~beyond
        m.d.comb += [
            own.eq(Mux(first, saturate(shifted, ACTIVATION), 0)),
            largest.eq(Mux(opens | (own > oldest), own, oldest)),
        ]
        with m.If(moved):
            m.d.sync += Cat(*held).eq(Cat(*held[1:], largest))
        m.d.comb += self.value.value.eq(held[-1])
        m.d.sync += [
            self.value.valid.eq(closes),
            self.logit.valid.eq(counted),
            self.logit.value.eq(saturate(shifted, plan.logit_format)),
        ]
        return m
