"""One recording into the accelerator under cocotb: every value of every stage is compared with the golden model's.

vectors.npz holds the recording (samples) and the golden model's values: an array of each probe, the decision words,
registers at its end (end).
To run: pip install cocotb numpy && make SIM=icarus (or SIM=verilator)
"""

import json
from pathlib import Path

import cocotb
import numpy as np
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge, ReadOnly, RisingEdge, Timer, with_timeout

FOLDER = Path(__file__).parent
CONFIG, REGISTERS = (json.loads((FOLDER / f"{name}.json").read_text()) for name in ("config", "registers"))

END = "ID VERSION STATUS TOUCHES FAULTS".split()
WAITS = sum(REGISTERS["bits"]["FAULTS"][name] for name in ("INPUT_STALLED", "OVERRUN"))
"""A frame or a window had to wait: they come as fast as they are taken."""


async def follow(dut, stage, expected, seen):
    """Compare the values of one stage as they come; ``seen`` counts them."""
    begin, end = ("o__", "payload") if stage == "decision" else (f"probe__{stage}__", "value")
    valid, value = getattr(dut, f"{begin}valid"), getattr(dut, begin + end)
    while True:
        if not int(valid.value):
            await RisingEdge(valid)
        await RisingEdge(dut.clk)
        if int(valid.value):
            place, got = seen[stage], value.value.to_signed()
            want = int(expected[place]) if place < len(expected) else "nothing more"
            if got != want:  # python -O leaves assert out
                raise AssertionError(f"stage {stage}, index {place}: expected {want}, got {got}")
            seen[stage] += 1


async def write(dut, address, word):
    dut.bus__addr.value, dut.bus__w_data.value, dut.bus__w_stb.value = address, word, 1
    await FallingEdge(dut.clk)
    dut.bus__w_stb.value = 0


async def command(dut, name):
    await write(dut, REGISTERS["registers"]["CONTROL"], REGISTERS["bits"]["CONTROL"][name])
    quiet = 0  # some cycles pass before busy shows it
    while quiet < 8:
        await FallingEdge(dut.clk)
        quiet = 0 if int(dut.busy.value) or int(dut.o__valid.value) else quiet + 1


async def send(dut, frame):
    bits = CONFIG["sensor"]["sample_bits"]
    for taxel, code in enumerate(frame.tolist()):
        marks = (taxel == 0) << bits | (taxel == len(frame) - 1) << bits + 1
        dut.i__payload.value, dut.i__valid.value = code & (1 << bits) - 1 | marks, 1
        await ReadOnly()
        while not int(dut.i__ready.value):
            await FallingEdge(dut.clk)
        await FallingEdge(dut.clk)  # it was taken at the rising edge in between
    dut.i__valid.value = 0


@cocotb.test(timeout_time=10, timeout_unit="sec")
async def recording(dut):
    """Load the model, play the recording, and see all that the golden model sees."""
    vectors = dict(np.load(FOLDER / "vectors.npz"))
    frames, end = vectors.pop("samples"), vectors.pop("end").tolist()
    seen = dict.fromkeys(vectors, 0)
    Clock(dut.clk, 10, unit="ns").start()
    dut.rst.value = dut.o__ready.value = 1
    dut.i__valid.value = dut.bus__w_stb.value = dut.bus__r_stb.value = 0
    await Timer(46, "ns")  # behind a falling edge, so that the next one is another
    dut.rst.value = 0
    for stage, expected in vectors.items():
        cocotb.start_soon(follow(dut, stage, expected, seen))
    for line in (FOLDER / "load.hex").read_text().split():
        await write(dut, *divmod(int(line, 16), 1 << 16))
    await with_timeout(command(dut, "ARM"), 100, "ms")
    for frame in frames:
        await with_timeout(send(dut, frame), 10, "ms")
    await with_timeout(command(dut, "FINISH"), 100, "ms")
    for stage, expected in vectors.items():
        if seen[stage] != len(expected):
            raise AssertionError(f"stage {stage}: {len(expected) - seen[stage]} missing")
    if not seen["decision"]:
        raise AssertionError("vectors.npz: holds no decision, so nothing was compared")
    for name, want in zip(END, end, strict=True):
        dut.bus__addr.value, dut.bus__r_stb.value = REGISTERS["registers"][name], 1
        await FallingEdge(dut.clk)
        dut.bus__r_stb.value, got = 0, dut.bus__r_data.value.to_unsigned()
        if got & ~(WAITS * (name == "FAULTS")) != want:
            raise AssertionError(f"register {name}: expected {want}, got {got}")
    dut._log.info("%d values in %d frames are bit-exact", sum(seen.values()), len(frames))
