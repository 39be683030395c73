"""Frames become an image: row by row into the image engine's memory (specification, section 15)."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import stream

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import Block, detector_status, drive, forward, inputs, outputs, sample_layout, struct
from eskin.rtl.frontend.frame_aligner import FrameAligner
from eskin.rtl.program.image_passes import plan_of


class ImageReceiver(Block):
    """Takes ``height`` frames of ``width`` pixels, then starts the engine.

    A frame with too few pixels is padded with its last one. Frames after the image are taken and ignored
    until the reset that begins the next recording.

    Members
    -------
    i : In(stream of sample_layout)
        Ready in every cycle, but while a frame is filled up.
    free : In(1)
        The classifier takes logits.
    fill : Out(struct: valid, address, value)
        A pixel for the engine, in the cycle in which it is taken.
    start : Out(1)
        Pulse: the image is whole, and the classifier is free. At the soonest one cycle after the last pixel
        is taken.
    open, waiting, over : Out(1)
        A pixel of the image is there, not all of them; all are, and the engine is not started; all are.
    passing, moving, wrong : Out(1)
        As of `eskin.rtl.frontend.front_end.FrontEnd`; nothing is on its way, and no word is checked.
    status : Out(detector_status)
        A touch is an image from its first pixel until the next recording; it starts when that pixel is taken.
    """

    def ports(self, config: AcceleratorConfig):
        fill = struct("valid", address=plan_of(config).address_bits, value=8)
        return inputs("free", i=stream.Signature(sample_layout(config))) | outputs(
            "start",
            "open",
            "waiting",
            "over",
            "passing",
            "moving",
            "wrong",
            fill=fill,
            status=detector_status(config),
        )

    def elaborate(self, platform):
        m = Module()
        image = self.spec.image
        m.submodules.aligner = aligner = FrameAligner(self.spec)
        forward(m, self, aligner, "i")
        pixels = image.height * image.width
        address = Signal(range(pixels))
        before = Signal(8)  # the pixel before this one
        last = address == pixels - 1
        m.d.comb += aligner.advance.eq(1)
        drive(
            m,
            self.fill,
            valid=aligner.offered & ~self.over,
            address=address,
            value=Mux(aligner.fresh, self.i.p.sample, before),
        )
        drive(
            m,
            self.status,
            framing_fault=aligner.framing_fault,
            started=self.fill.valid & ~self.open,
            touch=self.open | self.over,
            armed=~self.open & ~self.over,
        )
        drive(m, self, start=self.waiting & self.free, moving=self.i.valid | self.fill.valid)
        with m.If(self.fill.valid):
            m.d.sync += [
                before.eq(self.fill.value),
                address.eq(address + 1),
                self.open.eq(~last),
                self.waiting.eq(last),
                self.over.eq(last),
            ]
        with m.If(self.start):
            m.d.sync += self.waiting.eq(0)
        return m
