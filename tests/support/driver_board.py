"""A generated design behind a bus, Verilated, with its C driver: the driver's reads and writes are accesses at the
design's pins."""

import random
from pathlib import Path

from eskin.cosim.device import Design, Device
from tests.support.c_driver import Driver

BUILDS = Path("build") / "simulators"
LIMIT = 5000
"""Cycles within which an access must end."""


class Board:
    """``driver`` and ``device``, and accesses without the driver; ``folder`` of `eskin.rtl.fpga.generate.generate` with
    Wishbone."""

    def __init__(self, folder: Path, *, seed: int = 0) -> None:
        verilog = (folder / "eskin_wishbone.sv").read_text()
        self.device = Device(Design(verilog, BUILDS, top="eskin_wishbone"))
        self.device.reset()
        self.random = random.Random(seed)
        self.driver = Driver(folder, self.read, self.write)

    def read(self, offset):
        return self._access(offset, None)

    def write(self, offset, word):
        self._access(offset, word)

    def _put(self, **values):
        for name, value in values.items():
            self.device.put(f"wb_{name}", int(value))

    def _access(self, offset, word):
        self._put(cyc=1, stb=1, we=word is not None, adr=offset, sel=15, dat_w=word or 0)
        self.device.cycle()
        for _ in range(LIMIT):
            if self.device.get("wb_ack"):
                break
            self.device.cycle()
        else:
            raise AssertionError(f"no end of an access in {LIMIT} cycles")
        value = self.device.get("wb_dat_r")
        self.device.cycle()
        self._put(cyc=self.random.random() < 0.5, stb=0)
        return value
