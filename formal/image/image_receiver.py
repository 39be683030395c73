"""Rows become an image: every pixel once, none over an image that is read, one start."""

from __future__ import annotations

from amaranth.hdl import Module, Signal

from eskin.golden.core.config import AcceleratorConfig
from eskin.rtl.image.image_receiver import ImageReceiver
from formal.proof import Bug, free, free_source, opened_up, proof, prove

FILE = "rtl/image/image_receiver.py"
CONFIG = AcceleratorConfig.of_image(4, 4, ["dense 2"], ("a", "b"))
PIXELS = 16


@proof(
    "whatever rows come: the pixels of an image are written in order, each once, none after it; the engine is started once, for a whole "
    "image, when the classifier is free",
    depth=4,
    reduced="images of 4 x 4",
    bugs=(
        Bug("a pixel is written over the image", FILE, "aligner.offered & ~self.over", "aligner.offered & ~self.waiting", depth=30),
        Bug("an image is one pixel short", FILE, "address == pixels - 1", "address == pixels - 2", depth=30),
        Bug("the engine is started while the classifier is not free", FILE, "self.waiting & self.free", "self.waiting", depth=30),
        Bug("the engine is started again", FILE, "self.waiting.eq(0)", "self.waiting.eq(1)", depth=30),
    ),
    quick=True,
)
def pixels_in_order(m: Module) -> None:
    dut = ImageReceiver(CONFIG)
    inside = opened_up(m, "dut", dut)
    free_source(m, dut.i)
    free(m, dut.free)
    count, started = Signal(range(PIXELS + 2), name="count"), Signal(name="started")  # pixels that are there
    m.d.sync += [count.eq(count + dut.fill.valid), started.eq(started | dut.start)]
    prove(m, ~dut.fill.valid | ((count < PIXELS) & (dut.fill.address == count)), "pixels in order, none after the image")
    prove(m, ~dut.start | (dut.free & (count == PIXELS) & ~started), "started once, for a whole image")
    prove(m, dut.begun == (dut.fill.valid & (count == 0)), "begun with the first pixel")
    prove(m, (dut.over == (count == PIXELS)) & (dut.waiting == ((count == PIXELS) & ~started)), "over and waiting")
    prove(m, dut.open == ((count != 0) & (count != PIXELS)), "open")
    prove(m, (inside.address == (count & PIXELS - 1)) & (count <= PIXELS), "address")
    prove(m, ~started | dut.over, "started")
