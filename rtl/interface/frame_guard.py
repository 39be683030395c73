"""Whole frames only: samples are kept until their frame is known to be good (docs/specification_interfaces.md section
12)."""

from amaranth.hdl import Module, Signal
from amaranth.lib import stream
from amaranth.lib.memory import Memory

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import Block, drive, inputs, outputs, sample_layout, shape_of, struct


class FrameGuard(Block):
    """Keeps the samples of a frame in a memory and hands them on, taxel 0 first, when the frame has ended
    well.

    Parameters
    ----------
    config:
        ``taxels`` and the sample format.

    Members
    -------
    put : In(struct: valid, place, sample)
        A sample and its taxel, any order; never held up.
    finished : In(1), bad : In(1)
        The frame is over, and whether something was wrong with it.
    o : Out(stream of sample_layout)
    handing : Out(1)
        A frame is being forwarded.
    late : Out(1)
        One cycle for every sample that came while the previous frame was still being forwarded; it is dropped.
    broken : Out(1)
        One cycle: a frame has ended that will not be forwarded, because it was bad or late.

    The first beat is offered 2 cycles after ``finished``, then a beat every 2 cycles while they are taken.
    """

    def ports(self, config: AcceleratorConfig):
        put = struct("valid", place=range(config.sensor.taxels), sample=shape_of(config.sample_format))
        return inputs("finished", "bad", put=put) | outputs(
            o=stream.Signature(sample_layout(config)), handing=1, late=1, broken=1
        )

    def elaborate(self, platform):
        m = Module()
        taxels = self.spec.sensor.taxels
        m.submodules.memory = memory = Memory(shape=shape_of(self.spec.sample_format), depth=taxels, init=[])
        write, read = memory.write_port(), memory.read_port()
        self.write, self.read = write, read
        place = self.place = Signal(range(taxels))
        spoilt = self.spoilt = Signal()
        read_yet = Signal()
        drive(m, write, addr=self.put.place, data=self.put.sample, en=self.put.valid & ~self.handing)
        drive(
            m,
            self,
            late=self.put.valid & self.handing,
            broken=self.finished & (self.bad | spoilt | self.handing),
        )
        drive(m, read, addr=place, en=self.handing & ~read_yet)
        m.d.comb += self.o.valid.eq(self.handing & read_yet)
        drive(m, self.o.p, sample=read.data, first=place == 0, last=place == taxels - 1)
        m.d.sync += spoilt.eq((spoilt | self.late) & ~self.finished)
        with m.If(~self.handing):
            m.d.sync += [self.handing.eq(self.finished & ~self.broken), place.eq(0)]
        with m.Elif(~read_yet):
            m.d.sync += read_yet.eq(1)
        with m.Elif(self.o.ready):
            m.d.sync += [read_yet.eq(0), place.eq(place + 1), self.handing.eq(~self.o.p.last)]
        return m
