"""The cocotb bench: reset, register checks, start, and the wait for the harness to have played everything.

It runs in the simulator's own Python in the work folder, takes its settings from ``bench.json`` there and
answers in ``result.json``. It drives and samples on falling edges, where both simulators agree on what a
signal holds.

bench.json
    registers: name -> address. id: what register ID must read. measure: what LONGEST counts, a value of
    register MEASURE. probe (or null): while the harness holds before a frame of an open touch, a weight write
    is tried; it must be refused and flagged.
result.json
    registers: name -> value when all is played. probe: FAULTS before and after the refused write, and after
    it was cleared.
"""

import json
from pathlib import Path

import cocotb
from cocotb.triggers import FallingEdge, First, RisingEdge

RESET_CYCLES = 4


class HostBus:
    """The register bus, an access at a time; usable while the harness leaves it to the host: idle, held,
    done."""

    def __init__(self, dut, addresses: dict[str, int]) -> None:
        self.dut = dut
        self.addresses = addresses

    async def write(self, register: str, word: int) -> None:
        """One 16-bit word to one register, one cycle."""
        self.dut.host_addr.value = self.addresses[register]
        self.dut.host_w_data.value = word
        self.dut.host_w_stb.value = 1
        await FallingEdge(self.dut.clk)
        self.dut.host_w_stb.value = 0

    async def read(self, register: str) -> int:
        """One register; fails on an X bit."""
        self.dut.host_addr.value = self.addresses[register]
        self.dut.host_r_stb.value = 1
        await FallingEdge(self.dut.clk)
        self.dut.host_r_stb.value = 0
        value = self.dut.bus_r_data.value
        assert value.is_resolvable, f"register {register} reads {value}"
        return value.to_unsigned()


async def refused_write(dut, bus: HostBus, bits: dict[str, int]) -> dict[str, int]:
    """A weight write in an open touch: FAULTS before, after, and once cleared."""
    status = await bus.read("STATUS")
    assert status & bits["TOUCH"], (
        f"the touch is not open where the weight write is tried: STATUS is 0x{status:04x}"
    )
    before = await bus.read("FAULTS")
    await bus.write("MEMORY_SELECT", 0)
    for _ in range(4):
        await bus.write("MEMORY_DATA", 0x5A5A)
    for _ in range(4):
        await FallingEdge(dut.clk)
    after = await bus.read("FAULTS")
    await bus.write("CONTROL", bits["CLEAR_FAULTS"])
    for _ in range(4):
        await FallingEdge(dut.clk)
    cleared = await bus.read("FAULTS")
    return {"before": before, "after": after, "cleared": cleared}


@cocotb.test()
async def play(dut) -> None:
    """Reset, look at the registers, let the harness play, read the counters."""
    settings = json.loads(Path("bench.json").read_text())
    bus = HostBus(dut, settings["registers"])
    dut.rst.value = 1
    for _ in range(RESET_CYCLES):
        await FallingEdge(dut.clk)
    dut.rst.value = 0
    await FallingEdge(dut.clk)
    identity = await bus.read("ID")
    assert identity == settings["id"], (
        f"register ID reads 0x{identity:04x}, not 0x{settings['id']:04x}: this is no accelerator"
    )
    result: dict[str, dict[str, int]] = {}
    await bus.write("MEASURE", settings["measure"])
    dut.start.value = 1
    if settings["probe"]:
        await First(RisingEdge(dut.held), RisingEdge(dut.done))
        assert not dut.done.value, "all was played before the harness held for the weight write"
        await FallingEdge(dut.clk)
        result["probe"] = await refused_write(dut, bus, settings["bits"])
        dut.resume.value = 1
    if not dut.done.value:
        await RisingEdge(dut.done)
    await FallingEdge(dut.clk)
    readable = ("STATUS", "FAULTS", "TOUCHES", "LONGEST")
    result["registers"] = {name: await bus.read(name) for name in readable}
    Path("result.json").write_text(json.dumps(result))
