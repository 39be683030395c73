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
from cocotb.triggers import FallingEdge, ReadOnly, RisingEdge

FOLDER = Path(__file__).parent
CONFIG, REGISTERS = (json.loads((FOLDER / f"{name}.json").read_text()) for name in ("config", "registers"))
PATIENCE = 1_000_000  # cycles


class StageMonitor:
    """Compares the values of one stage as they come."""

    def __init__(self, dut, stage, expected):
        begin, end = ("o__", "payload") if stage == "decision" else (f"probe__{stage}__", "value")
        self.clk, self.valid, self.value = dut.clk, getattr(dut, f"{begin}valid"), getattr(dut, begin + end)
        self.stage, self.expected, self.seen = stage, expected, 0

    async def run(self):
        while True:
            if not int(self.valid.value):
                await RisingEdge(self.valid)
            await RisingEdge(self.clk)
            if int(self.valid.value):
                want = int(self.expected[self.seen]) if self.seen < len(self.expected) else "nothing more"
                got = self.value.value.to_signed()
                assert got == want, f"stage {self.stage}, index {self.seen}: expected {want}, got {got}"
                self.seen += 1


async def until(dut, holds, fails):
    for _ in range(PATIENCE):
        if holds():
            return
        await FallingEdge(dut.clk)
    raise AssertionError(fails)


async def idle(dut):
    for _ in range(8):
        await FallingEdge(dut.clk)
        await until(dut, lambda: not int(dut.busy.value) and not int(dut.o__valid.value), "it stays busy")


async def write(dut, address, word):
    dut.bus__addr.value, dut.bus__w_data.value, dut.bus__w_stb.value = address, word, 1
    await FallingEdge(dut.clk)
    dut.bus__w_stb.value = 0


async def command(dut, name):
    await write(dut, REGISTERS["registers"]["CONTROL"], REGISTERS["bits"]["CONTROL"][name])
    await idle(dut)


async def send(dut, frame):
    bits = CONFIG["sensor"]["sample_bits"]
    for taxel, code in enumerate(frame.tolist()):
        marks = (taxel == 0) << bits | (taxel == len(frame) - 1) << bits + 1
        dut.i__payload.value, dut.i__valid.value = code & (1 << bits) - 1 | marks, 1
        await ReadOnly()
        await until(dut, lambda: int(dut.i__ready.value), "a number is not taken")
        await FallingEdge(dut.clk)  # it was taken at the rising edge in between
    dut.i__valid.value = 0


@cocotb.test()
async def recording(dut):
    """Load the model, play the recording, and see all that the golden model sees."""
    with np.load(FOLDER / "vectors.npz") as archive:
        vectors = dict(archive)
    frames = vectors.pop("samples")
    Clock(dut.clk, 10, unit="ns").start()
    dut.rst.value, dut.o__ready.value = 1, 1
    dut.i__valid.value = dut.bus__w_stb.value = dut.bus__r_stb.value = 0
    for _ in range(4):
        await FallingEdge(dut.clk)
    dut.rst.value = 0
    monitors = [StageMonitor(dut, stage, expected) for stage, expected in vectors.items()]
    for monitor in monitors:
        cocotb.start_soon(monitor.run())
    for line in (FOLDER / "load.hex").read_text().split():
        await write(dut, *divmod(int(line, 16), 1 << 16))
    await command(dut, "ARM")
    for frame in frames:
        await send(dut, frame)
    await idle(dut)
    await command(dut, "FINISH")
    for monitor in monitors:
        missing = len(monitor.expected) - monitor.seen
        assert not missing, f"stage {monitor.stage}: {missing} values are missing"
    dut._log.info("%d values in %d frames are bit-exact", sum(m.seen for m in monitors), len(frames))
