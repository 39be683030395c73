"""Rows become an image: every pixel once, none over an image that is read, one start."""

from amaranth.hdl import Module, Signal

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.image.image_receiver import ImageReceiver
from formal.proof import Bug, free, free_source, placed, proof, prove

CONFIG = AcceleratorConfig.of_image(4, 4, ["dense 2"], ("a", "b"))
PIXELS = 16


@proof(
    "whatever rows come: the pixels of an image are written in order, each once, none after it; the engine "
    "is started once, for a whole "
    "image, when the classifier is free",
    depth=4,
    reduced="images of 4 x 4",
    bugs=(
        Bug(
            "a pixel is written over the image",
            "aligner.offered & ~self.over",
            "aligner.offered & ~self.waiting",
        ),
        Bug("an image is one pixel short", "address == pixels - 1", "address == pixels - 2"),
        Bug(
            "the engine is started while the classifier is not free",
            "self.waiting & self.free",
            "self.waiting",
        ),
        Bug("the engine is started again", "self.waiting.eq(0)", "self.waiting.eq(1)"),
    ),
    quick=True,
)
def pixels_in_order(m: Module) -> None:
    dut = placed(ImageReceiver(CONFIG))
    free_source(dut.i)
    free(dut.free)
    count = Signal(range(PIXELS + 2))
    started = Signal()  # pixels that are there
    m.d.sync += [count.eq(count + dut.fill.valid), started.eq(started | dut.start)]
    prove(
        ~dut.fill.valid | ((count < PIXELS) & (dut.fill.address == count)),
        "pixels in order, none after the image",
    )
    prove(~dut.start | (dut.free & (count == PIXELS) & ~started), "started once, for a whole image")
    prove(dut.status.started == (dut.fill.valid & (count == 0)), "begun with the first pixel")
    prove(
        (dut.over == (count == PIXELS)) & (dut.waiting == ((count == PIXELS) & ~started)), "over and waiting"
    )
    prove(dut.open == ((count != 0) & (count != PIXELS)), "open")
    prove((dut.fill.address == (count & PIXELS - 1)) & (count <= PIXELS), "address")
    prove(~started | dut.over, "started")
