"""Frames of a converter for the host, each whole or not at all: docs/specification_interfaces.md section 9."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import stream
from amaranth.lib.memory import Memory

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import Block, drive, inputs, outputs, sample_layout, struct

word_layout = struct(word=16, last=1)
"""A word of a frame's packet; ``last`` ends it."""


class FrameSender(Block):
    """Keeps a frame until the line has taken it. A frame that begins before that is left out; the numbers show it.

    Parameters
    ----------
    config:
        ``taxels`` and the sample format.

    Members
    -------
    on : In(1)
        Frames that begin are wanted.
    frame : In(struct: valid, ready, payload)
        The accelerator's input, a beat in each cycle with valid and ready.
    broken : In(1)
        One cycle: a frame is missing there.
    o : Out(stream of word_layout)
        The number of the frame, missing ones counted, and its samples.
    """

    def ports(self, config: AcceleratorConfig):
        frame = struct("valid", "ready", payload=sample_layout(config))
        return inputs("on", "broken", frame=frame) | outputs(o=stream.Signature(word_layout))

    def elaborate(self, platform):
        m, taxels, beat = Module(), self.spec.sensor.taxels, self.frame.payload
        m.submodules.memory = memory = Memory(shape=beat.sample.shape(), depth=taxels, init=[])
        write, read = memory.write_port(), memory.read_port()
        count, number = Signal.like(self.o.p.word), Signal.like(self.o.p.word)
        keeping = self.keeping = Signal()
        # words that are in the memory, or, while one is offered, those that were taken
        place = self.place = Signal(range(taxels + 1))
        comes = self.frame.valid & self.frame.ready
        stores = comes & ~self.o.valid & (keeping | self.on & beat.first)
        leaves = self.o.valid & self.o.ready
        drive(m, write, addr=place, data=beat.sample, en=stores)
        drive(m, read, addr=place, en=leaves)
        drive(m, self.o.p, word=Mux(place == 0, number, read.data), last=place == taxels)
        m.d.sync += count.eq(count + (comes & beat.last) + self.broken)
        with m.If(stores):
            m.d.sync += [keeping.eq(~beat.last), self.o.valid.eq(beat.last)]
            with m.If(beat.first):
                m.d.sync += number.eq(count)
        with m.If(leaves & self.o.p.last):
            m.d.sync += self.o.valid.eq(0)
        with m.If(stores | leaves):
            m.d.sync += place.eq(Mux(Mux(leaves, self.o.p.last, beat.last), 0, place + 1))
        return m
