"""The cocotb test of bus_board.sv: frames at the converter's taxels, and a CPU that reads decisions as they interrupt it."""

import json
import random
from pathlib import Path

import cocotb
import numpy as np
from cocotb.clock import Clock
from cocotb.triggers import RisingEdge, SimTimeoutError, Timer, with_timeout

from eskin.rtl.program.memory_map import NO_DECISION, Control, Event, Register, ShellRegister
from tests.support.bus_cocotb import master

CYCLE_NS = 10


@cocotb.test()
async def play(dut) -> None:
    """One recording. Answer: the words of its decisions, FAULTS, violations of the converter's data sheet."""
    settings, codes = json.loads(Path("board.json").read_text()), np.load("codes.npy")
    cocotb.start_soon(Clock(dut.clk, CYCLE_NS, "ns").start())
    dut.rst.value = 1
    await Timer(1, "ns")
    read, write = master(dut, settings["bus"], random.Random(1))
    words, frame_ns = list[int](), CYCLE_NS * settings["period"]

    def show(frame) -> None:
        dut.analog.value = int.from_bytes(frame.astype("<u4").tobytes(), "little")

    async def taxels() -> None:
        """Behind the second scan, before which a converter may have been set up."""
        for _ in range(2):
            await with_timeout(quiet(), 20 * frame_ns, "ns")
            await RisingEdge(dut.moving)
        await Timer(0.9 * frame_ns, "ns")
        for frame in codes[1:]:
            show(frame)
            await Timer(frame_ns, "ns")

    async def quiet() -> None:
        """The port has rested for a tenth of a frame."""
        while True:
            try:
                await with_timeout(dut.moving.value_change, 0.1 * frame_ns, "ns")
            except SimTimeoutError:
                return

    async def cpu() -> None:
        while True:
            if not int(dut.irq.value):
                await RisingEdge(dut.irq)
            if (word := await read(ShellRegister.DECISION)) != NO_DECISION:
                words.append(word)

    show(codes[0])
    await Timer(4 * CYCLE_NS, "ns")
    dut.rst.value = 0
    await RisingEdge(dut.clk)
    await write(ShellRegister.ENABLE, Event.DECISION)
    frames = cocotb.start_soon(taxels())
    await write(Register.CONTROL, Control.ARM)
    reader = cocotb.start_soon(cpu())
    await frames
    reader.cancel()
    while (word := await read(ShellRegister.DECISION)) != NO_DECISION:
        words.append(word)
    faults = await read(Register.FAULTS)
    answer = {"words": words, "faults": faults, "violations": dut.violations.value.to_unsigned()}
    Path("result.json").write_text(json.dumps(answer))
