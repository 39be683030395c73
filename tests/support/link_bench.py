"""The cocotb bench at the board's pins: the host's own code (eskin/live/link.py) over cocotbext-uart.

It runs in the simulator's own Python in the work folder, takes its settings from ``link_bench.json`` there
and answers in ``result.json``.
"""

import json
from pathlib import Path

import cocotb
from cocotb.clock import Clock
from cocotb.task import bridge, resume
from cocotb.triggers import FallingEdge
from cocotbext.uart import UartSink, UartSource

from tests.support.link_flow import converse

CLOCK_NS = 10


class ModelPort:
    """cocotbext-uart at the pins."""

    def __init__(self, dut, clocks_per_bit: int) -> None:
        self.byte_ns = 10 * clocks_per_bit * CLOCK_NS
        baud = 1e9 / (clocks_per_bit * CLOCK_NS)
        self.source, self.sink = UartSource(dut.rx, baud=baud), UartSink(dut.tx, baud=baud)
        for model in (self.source, self.sink):
            model.log.setLevel("WARNING")

    @resume
    async def write(self, data: bytes, broken: frozenset[int] = frozenset()) -> None:
        """Send; returns when all is out."""
        await self.source.write(data)
        await self.source.wait()

    @resume
    async def read(self, timeout_s: float) -> bytes:
        """What has come; ``timeout_s`` is taken as byte times."""
        if self.sink.empty() and timeout_s > 0:
            await self.sink.wait(timeout=int(timeout_s * self.byte_ns), timeout_unit="ns")
        return bytes(self.sink.read_nowait())


@cocotb.test()
async def play(dut) -> None:
    """Reset, load, play every recording in order, write down what came back."""
    settings = json.loads(Path("link_bench.json").read_text())
    Clock(dut.clk, CLOCK_NS, unit="ns").start()
    dut.rst.value, dut.rx.value = 1, 1
    for _ in range(4):
        await FallingEdge(dut.clk)
    dut.rst.value = 0
    await FallingEdge(dut.clk)

    @resume
    async def pins() -> int:
        await FallingEdge(dut.clk)
        return int(dut.decision.value).bit_length() - 1 if int(dut.decision_valid.value) else -1

    result = await bridge(converse)(ModelPort(dut, settings["clocks_per_bit"]), settings, pins)
    Path("result.json").write_text(json.dumps(result))
