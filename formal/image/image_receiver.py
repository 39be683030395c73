"""Rows become an image: no pixel outside it, none over an image that is read, each image once."""

from __future__ import annotations

from amaranth.hdl import Module, Mux, Signal

from eskin.golden.core.config import AcceleratorConfig
from eskin.rtl.image.image_receiver import ImageReceiver
from formal.proof import Bug, assume, before, free, free_source, opened_up, proof, prove

FILE = "rtl/image/image_receiver.py"
CONFIG = AcceleratorConfig.of_image(4, 4, ["dense 2"], ("a", "b"))
PIXELS = 16


@proof(
    "whatever rows come: pixels of an image are written in order, each once, never while the engine works or a whole image waits; the "
    "engine is started for a whole image alone, and when it and the classifier are free",
    depth=4,
    reduced="images of 4 x 4",
    bugs=(
        Bug("a pixel is written while the engine reads", FILE, "~self.busy & ~self.waiting)", "~self.waiting)", depth=8),
        Bug("a pixel is written over an image that waits", FILE, "~self.busy & ~self.waiting)", "~self.busy)", depth=30),
        Bug("an image is one pixel short", FILE, "address == pixels - 1", "address == pixels - 2", depth=30),
        Bug("the engine is started while the classifier is not free", FILE, "~self.busy & self.free)", "~self.busy)", depth=30),
    ),
    quick=True,
)
def pixels_in_order(m: Module) -> None:
    dut = ImageReceiver(CONFIG)
    inside = opened_up(m, "dut", dut)
    free_source(m, dut.i)
    free(m, dut.busy)
    free(m, dut.free)
    assume(m, ~before(m, dut.start, "started") | dut.busy)  # the engine
    count = Signal(range(PIXELS + 1), name="count")  # pixels that are there
    m.d.sync += count.eq(Mux(dut.start, 0, count + dut.fill.valid))
    prove(m, ~dut.fill.valid | (~dut.busy & (count < PIXELS) & (dut.fill.address == count)), "pixels in order")
    prove(m, ~dut.start | (~dut.busy & dut.free & (count == PIXELS)), "started for a whole image")
    prove(m, dut.begun == (dut.fill.valid & (count == 0)), "begun with the first pixel")
    prove(m, dut.waiting == (count == PIXELS), "waiting")
    prove(m, dut.open == ((count != 0) & (count != PIXELS)), "open")
    prove(m, inside.address == Mux(count == PIXELS, 0, count), "address")
