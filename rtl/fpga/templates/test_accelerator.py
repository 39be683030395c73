"""One recording into the accelerator under cocotb: every value of every stage is compared with the golden model's.

    pip install cocotb numpy
    make SIM=icarus                    (or SIM=verilator)

vectors.npz holds the recording (samples) and what the golden model says of it: an array of each probe, and the decision
words. The first value that differs ends the test.
"""

import json
from pathlib import Path

import cocotb
import numpy as np
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge, ReadOnly, RisingEdge, SimTimeoutError, with_timeout

FOLDER = Path(__file__).parent
CONFIG = json.loads((FOLDER / "config.json").read_text())
REGISTERS = json.loads((FOLDER / "registers.json").read_text())
BITS = CONFIG["sensor"]["sample_bits"]
ENDS = ("valid", "value")
PATIENCE_US = 10_000  # a million cycles


class StageMonitor:
    """Compares the values of one stage as they come."""

    def __init__(self, clk, stage, valid, value, expected):
        self.clk, self.valid, self.value = clk, valid, value
        self.stage, self.expected, self.seen = stage, expected, 0

    async def run(self):
        while True:
            if not int(self.valid.value):
                await RisingEdge(self.valid)
            await RisingEdge(self.clk)
            if not int(self.valid.value):
                continue
            where = f"stage {self.stage}, index {self.seen}"
            assert self.seen < len(self.expected), f"{where}: one too many"
            want, got = int(self.expected[self.seen]), self.value.value.to_signed()
            assert got == want, f"{where}: expected {want}, got {got}"
            self.seen += 1


class Driver:
    """The register bus and the stream of frames, driven at falling edges."""

    def __init__(self, dut):
        self.dut = dut

    async def reset(self):
        dut = self.dut
        dut.rst.value, dut.o__ready.value = 1, 1
        dut.i__valid.value = dut.bus__w_stb.value = dut.bus__r_stb.value = 0
        for _ in range(4):
            await FallingEdge(dut.clk)
        dut.rst.value = 0

    async def write(self, address, word):
        dut = self.dut
        dut.bus__addr.value, dut.bus__w_data.value, dut.bus__w_stb.value = address, word, 1
        await FallingEdge(dut.clk)
        dut.bus__w_stb.value = 0

    async def command(self, name):
        await self.write(REGISTERS["registers"]["CONTROL"], REGISTERS["bits"]["CONTROL"][name])
        await self.idle()

    async def send(self, frame):
        dut, last = self.dut, len(frame) - 1
        for taxel, code in enumerate(frame):
            sample = int(code) & (1 << BITS) - 1
            dut.i__payload.value = sample | (taxel == 0) << BITS | (taxel == last) << BITS + 1
            dut.i__valid.value = 1
            await ReadOnly()
            while not int(dut.i__ready.value):
                await FallingEdge(dut.clk)
            await FallingEdge(dut.clk)  # it was taken at the rising edge in between
        dut.i__valid.value = 0

    async def idle(self):
        quiet = 0
        while quiet < 8:
            await FallingEdge(self.dut.clk)
            quiet = 0 if int(self.dut.busy.value) or int(self.dut.o__valid.value) else quiet + 1


@cocotb.test()
async def recording(dut):
    """Load the model, play the recording, and see all that the golden model sees."""
    with np.load(FOLDER / "vectors.npz") as archive:
        vectors = dict(archive)
    frames, driver = vectors.pop("samples"), Driver(dut)
    Clock(dut.clk, 10, unit="ns").start()
    await driver.reset()
    monitors = []
    for stage, expected in vectors.items():
        ports = (
            ("o__valid", "o__payload") if stage == "decision" else (f"probe__{stage}__{end}" for end in ENDS)
        )
        valid, value = (getattr(dut, port) for port in ports)
        monitors.append(StageMonitor(dut.clk, stage, valid, value, expected))
    for monitor in monitors:
        cocotb.start_soon(monitor.run())
    for line in (FOLDER / "load.hex").read_text().split():
        await driver.write(*divmod(int(line, 16), 1 << 16))
    await driver.command("ARM")
    for number, frame in enumerate(frames):
        try:
            await with_timeout(driver.send(frame), PATIENCE_US, "us")
        except SimTimeoutError:
            raise AssertionError(f"frame {number} is not taken") from None
    await with_timeout(driver.idle(), PATIENCE_US, "us")
    await with_timeout(driver.command("FINISH"), PATIENCE_US, "us")
    for monitor in monitors:
        missing = len(monitor.expected) - monitor.seen
        assert not missing, f"stage {monitor.stage}: {missing} values are missing"
    dut._log.info("%d values in %d frames are bit-exact", sum(m.seen for m in monitors), len(frames))
