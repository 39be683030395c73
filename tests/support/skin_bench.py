"""The cocotb bench of skin_harness.sv: it waits until the recording has been played."""

from pathlib import Path

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import RisingEdge


@cocotb.test()
async def play(dut) -> None:
    """Nothing but the wait."""
    Clock(dut.clk, 10, unit="ns").start()
    await RisingEdge(dut.done)
    Path("result.json").write_text("{}")
