"""A generated design behind a bus, Verilated, with its C driver: the driver's reads and writes are accesses at the
design's pins, with pauses at random."""

import random
from pathlib import Path

from eskin.cosim.device import Design, Device
from tests.support.c_driver import Driver

BUILDS = Path("build") / "simulators"
LIMIT = 5000
"""Cycles within which an access must end."""


class Board:
    """``driver`` and ``device``, and accesses without the driver.

    Parameters
    ----------
    folder:
        Of `eskin.rtl.fpga.generate.generate` with ``bus``.
    pause:
        Probability of each further cycle of a pause, before an access and between its phases.
    """

    def __init__(self, folder: Path, bus: str = "wishbone", *, seed: int = 0, pause: float = 0.0) -> None:
        verilog = (folder / f"eskin_{bus}.sv").read_text()
        self.device = Device(Design(verilog, BUILDS, top=f"eskin_{bus}"))
        self.device.reset()
        self._access = getattr(self, f"_{bus}")
        self._random, self._pause = random.Random(seed), pause
        self.driver = Driver(folder, self.read, self.write)

    def read(self, offset):
        return self._access(offset, None)

    def write(self, offset, word):
        self._access(offset, word)

    def _pauses(self):
        while self._random.random() < self._pause:
            self.device.cycle()

    def _put(self, prefix, **values):
        for name, value in values.items():
            self.device.put(prefix + name, int(value))

    def _until(self, *names):
        """Cycle until one of ``names`` is high; those that are."""
        for _ in range(LIMIT):
            high = [name for name in names if self.device.get(name)]
            if high:
                return high
            self.device.cycle()
        raise AssertionError(f"no {names} in {LIMIT} cycles")

    def _wishbone(self, offset, word):
        self._pauses()
        self._put("wb_", cyc=1, stb=1, we=word is not None, adr=offset, sel=15, dat_w=word or 0)
        self.device.cycle()
        self._until("wb_ack")
        value = self.device.get("wb_dat_r")
        self.device.cycle()
        self._put("wb_", cyc=self._random.random() < 0.5, stb=0)
        return value

    def _axi4lite(self, offset, word):
        if word is None:
            self._pauses()
            self._send({"ar": {"araddr": offset}})
            return self._response("r", "rdata")
        self._send({"aw": {"awaddr": offset}, "w": {"wdata": word, "wstrb": 15}})
        return self._response("b")

    def _send(self, channels):
        """Offer what goes over each channel after a pause of its own, until it is taken."""
        waits = {channel: self._random.randrange(4) if self._pause else 0 for channel in channels}
        for cycle in range(LIMIT):
            for channel, wait in waits.items():
                if wait == cycle:
                    self._put("s_axi_", **channels[channel], **{f"{channel}valid": 1})
            taken = [c for c in waits if waits[c] <= cycle and self.device.get(f"s_axi_{c}ready")]
            self.device.cycle()
            for channel in taken:
                self._put("s_axi_", **{f"{channel}valid": 0})
                del waits[channel]
            if not waits:
                return
        raise AssertionError(f"{', '.join(waits)}: not taken in {LIMIT} cycles")

    def _response(self, channel, data=""):
        self._pauses()
        self._put("s_axi_", **{f"{channel}ready": 1})
        self._until(f"s_axi_{channel}valid")
        value, response = self.device.get(f"s_axi_{data}"), self.device.get(f"s_axi_{channel}resp")
        self.device.cycle()
        self._put("s_axi_", **{f"{channel}ready": 0})
        assert response == 0
        return value
