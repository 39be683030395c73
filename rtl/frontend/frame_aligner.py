"""Beats become frames of taxels 0 to D - 1, for any behaviour of the sender (docs/specification.md, section
2)."""

from amaranth.hdl import Module, Signal
from amaranth.lib import stream

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import Block, drive, inputs, outputs, reaches, sample_layout, wrapping_increment


class FrameAligner(Block):
    """Counts the taxels of a frame, fills up a frame that ends early, and drops samples outside a frame.

    Members
    -------
    i : In(stream of ``sample_layout``)
    advance : In(1)
        The stage behind takes a beat in this cycle, if there is one.
    offered : Out(1)
        There is a beat; known before ``advance``, which comes late.
    fresh : Out(1)
        It is the sender's own; otherwise the missing taxels of a frame repeat its last sample.
    filling : Out(1)
        A frame is completed by itself.
    index, last : Out
        Its taxel, and whether that is the frame's last.
    frame_taken : Out(1)
        The frame's last beat is taken.
    framing_fault : Out(1)
        One cycle: ``first`` or ``last`` did not agree with the taxel count.
    """

    def ports(self, config: AcceleratorConfig):
        return inputs("advance", i=stream.Signature(sample_layout(config))) | outputs(
            "offered",
            "fresh",
            "filling",
            "last",
            "frame_taken",
            "framing_fault",
            index=range(config.sensor.taxels),
        )

    def elaborate(self, platform):
        m = Module()
        index, advance, taxels = self.index, self.advance, self.spec.sensor.taxels
        filling = self.filling
        inside = self.inside = Signal()  # a frame has begun: the index is not 0
        at_last = reaches(index, taxels - 1)
        early = self.i.valid & self.i.p.first & inside
        stray = ~self.i.p.first & ~inside
        drive(
            m,
            self,
            fresh=self.i.valid & ~filling & ~early & ~stray,
            offered=self.fresh | filling,
            last=at_last,
            frame_taken=advance & self.offered & at_last,
        )
        m.d.comb += [
            self.i.ready.eq(advance & ~filling & ~early),
            self.framing_fault.eq(
                self.i.valid & ~filling & (early | (self.i.ready & (stray | (self.i.p.last != at_last))))
            ),
        ]
        with m.If(advance & self.offered):
            m.d.sync += [index.eq(wrapping_increment(index, taxels)), inside.eq(~at_last)]
        with m.If(self.frame_taken):
            m.d.sync += filling.eq(0)
        with m.Elif(early | (advance & (self.fresh & self.i.p.last))):
            m.d.sync += filling.eq(1)
        return m
