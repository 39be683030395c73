"""The cocotb bench at the board's pins: the host's own code (cosim/link.py) plays recordings over the serial line.

It runs in the simulator's own Python in the work folder, takes its settings from ``link_bench.json`` there and answers in ``result.json``.

link_bench.json
    map: as registers.json. loads: [[address, word], ...]. vectors: file with samples, offsets. order: positions in it, in the order
    to play. corruptions: whether one is done to every recording but the first play of each, from seed. model: ``fast``, the harness's, or
    ``cocotbext``, cocotbext-uart's. clocks_per_bit.
result.json
    played: for every recording its decisions (31-bit payloads), touches, faults, and what was done to it (kind, direction, byte); where the
    map has them, the registers POSITION, POSITION_PEAK, POSITIONS behind it. pins: for
    every recording the class that the pins named last, -1 none. repeated, replayed, unanswered, damaged, cycles.
"""

from __future__ import annotations

import json
import random
from pathlib import Path

import cocotb
import numpy as np
from cocotb.task import bridge, resume
from cocotb.triggers import FallingEdge, First, RisingEdge, Timer

from eskin.cosim.link import Link
from tests.support.noisy_port import NoisyPort

CLOCK_NS = 10
TIMEOUT_BYTES = 60
"""Byte times to wait for an answer: a packet of decision and one of answer, and the cycles in between, take half of that."""
PUSH_BYTES = 256


class FastPort:
    """The harness's serial port: bulk in, bulk out."""

    def __init__(self, dut, clocks_per_bit: int) -> None:
        self.dut, self.byte_ns = dut, 10 * clocks_per_bit * CLOCK_NS

    @resume
    async def write(self, data: bytes, broken: frozenset[int] = frozenset()) -> None:
        """Send; the bytes at the places in ``broken`` get a low stop bit. Returns when all are out."""
        dut = self.dut
        for low in range(0, len(data), PUSH_BYTES):
            piece = data[low : low + PUSH_BYTES]
            dut.push_data.value = int.from_bytes(piece, "little")
            dut.push_broken.value = sum(1 << place - low for place in broken if low <= place < low + PUSH_BYTES)
            dut.push_count.value = len(piece)
            dut.push.value = 1 - int(dut.push.value)
            await FallingEdge(dut.clk)
            await FallingEdge(dut.clk)
        if int(dut.busy.value):
            await FallingEdge(dut.busy)

    @resume
    async def read(self, timeout_s: float) -> bytes:
        """Bytes up to a flag; ``timeout_s`` is taken as byte times."""
        dut = self.dut
        if not int(dut.arrived.value) and timeout_s > 0:
            await First(RisingEdge(dut.arrived), Timer(int(timeout_s * self.byte_ns), "ns"))
        await FallingEdge(dut.clk)
        dut.take.value = 1 - int(dut.take.value)
        await FallingEdge(dut.clk)
        await FallingEdge(dut.clk)
        count = int(dut.take_count.value)
        return int(dut.take_data.value).to_bytes(PUSH_BYTES, "little")[:count] if count else b""


class ModelPort:
    """cocotbext-uart at the pins."""

    def __init__(self, dut, clocks_per_bit: int) -> None:
        from cocotbext.uart import UartSink, UartSource

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
    dut.rst.value = 1
    for _ in range(4):
        await FallingEdge(dut.clk)
    dut.rst.value = 0
    await FallingEdge(dut.clk)
    model = ModelPort if settings["model"] == "cocotbext" else FastPort
    result = await bridge(converse)(dut, model(dut, settings["clocks_per_bit"]), settings)
    result["cycles"] = int(dut.cycle.value)
    Path("result.json").write_text(json.dumps(result))


@resume
async def pins(dut) -> int:
    """The class that the decision pins name; -1: they are not valid."""
    await FallingEdge(dut.clk)
    return int(dut.decision.value).bit_length() - 1 if int(dut.decision_valid.value) else -1


def converse(dut, port, settings: dict) -> dict:
    """The session, in a thread of its own: the same calls that a board gets."""
    with np.load(settings["vectors"]) as archive:
        samples, offsets = archive["samples"], archive["offsets"]
    rng = random.Random(settings["seed"])
    noisy = NoisyPort(port, settings["seed"], settings["map"]["registers"]["STATUS"])
    link = Link(noisy, settings["map"], timeout_s=TIMEOUT_BYTES)
    link.connect()
    link.load(settings["loads"])
    played = []
    lengths: dict[int, dict[str, int]] = {}  # bytes each way of a recording played undisturbed
    for turn, position in enumerate(settings["order"]):
        kind = NoisyPort.KINDS[turn % len(NoisyPort.KINDS)] if settings["corruptions"] and position in lengths else None
        noisy.arm(kind or ("none", "none"), rng.randrange(lengths[position][kind[1]]) if kind else 0)
        counts = link.repeated, link.replayed, link.unanswered, link.damaged
        got = link.play(samples[offsets[position] : offsets[position + 1]])
        after = link.repeated, link.replayed, link.unanswered, link.damaged
        if kind is None:
            lengths[position] = dict(noisy.passed)
        played.append(
            {
                "position": position,
                "decisions": got.decisions,
                "touches": got.touches,
                "faults": got.faults,
                "done": noisy.done,
                "noticed": [new - old for new, old in zip(after, counts, strict=True)],
                "pins": pins(dut),
                "where": [link.read(name) for name in ("POSITION", "POSITION_PEAK", "POSITIONS") if name in settings["map"]["registers"]],
            }
        )
    return {"played": played, "repeated": link.repeated, "replayed": link.replayed, "unanswered": link.unanswered, "damaged": link.damaged}
