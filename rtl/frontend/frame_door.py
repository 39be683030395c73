"""The door of the chain: of the source's frames it passes those that the chain takes (docs/specification.md,
section 2; the model drops the others in golden/data/recordings.py and golden/model/stream.py)."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import stream

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import Block, inputs, outputs, sample_layout


class FrameDoor(Block):
    """With ``every`` it forwards the first of every ``scan_every`` frames and drops the others; without it
    forwards all.

    A reset begins a recording. Frames are counted at their first beat; beats before a frame are forwarded.

    Members
    -------
    every : In(1)
        Constant from the reset on.
    i : In(stream of sample_layout), o : Out(stream of sample_layout)

    Latency 0, a beat a cycle; a beat that is dropped takes a cycle, whatever ``o`` waits for.
    """

    def ports(self, config: AcceleratorConfig):
        beat = stream.Signature(sample_layout(config))
        return inputs("every", i=beat) | outputs(o=beat)

    def elaborate(self, platform):
        m = Module()
        # of the next frame; a power of two, so it wraps
        number = self.number = Signal(range(self.spec.sensor.scan_every))
        dropped = self.dropped = Signal()  # the frame under way
        drops = Signal()
        m.d.comb += [
            drops.eq(self.every & Mux(self.i.p.first, number != 0, dropped)),
            self.o.payload.eq(self.i.payload),
            self.o.valid.eq(self.i.valid & ~drops),
            self.i.ready.eq(self.o.ready | drops),
        ]
        with m.If(self.i.valid & self.i.ready & self.i.p.first):
            m.d.sync += [number.eq(number + 1), dropped.eq(drops)]
        return m
