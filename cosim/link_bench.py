"""The cocotb bench at the board's pins: the host's own code (cosim/link.py) plays recordings over the serial line.

It runs in the simulator's own Python in the work folder, takes its settings from ``link_bench.json`` there and answers in ``result.json``.

link_bench.json
    map: as registers.json. loads: [[address, word], ...]. vectors: file with samples, offsets. order: positions in it, in the order
    to play. corruptions: whether one is done to every recording but the first play of each, from seed. model: ``fast``, the harness's serial port, or ``cocotbext``,
    cocotbext-uart's. clocks_per_bit.
result.json
    played: for every recording its decisions (31-bit payloads), touches, faults, and what was done to it (kind, direction, byte). pins: for
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

from cosim.link import Link, read_packet

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


class NoisyPort:
    """Another port, with one thing done to its bytes when it is told to.

    Kinds, towards the device: ``flip`` a bit, ``drop`` a byte, ``double`` it, ``broken`` stop bit, ``break``: the line low for three bytes, ``cut`` a run of bytes, ``garbage`` bytes
    in between, ``swap`` two neighbours, ``overrun``: a read in between, during whose answer the device drops what comes. From it: ``flip``,
    ``drop``, ``double``, ``cut``, ``garbage``.
    """

    KINDS = (
        *((kind, "to") for kind in ("flip", "drop", "double", "broken", "break", "cut", "garbage", "swap", "overrun")),
        *((kind, "from") for kind in ("flip", "drop", "double", "cut", "garbage")),
    )

    def __init__(self, port, seed: int, address: int) -> None:
        self.port, self.rng, self.address = port, random.Random(seed), address
        self.plan: tuple[str, str, int] | None = None
        self.passed = {"to": 0, "from": 0}
        self.done: tuple[str, str, int] | None = None

    def arm(self, kind: tuple[str, str], place: int) -> None:
        """Do ``kind`` to the byte ``place`` of its direction, counted from now on."""
        self.plan, self.done, self.passed = (*kind, place), None, {"to": 0, "from": 0}

    def _place(self, direction: str, data: bytes) -> int | None:
        """Where in ``data`` the plan strikes."""
        begin = self.passed[direction]
        self.passed[direction] += len(data)
        if self.plan and self.plan[1] == direction and begin <= self.plan[2] < begin + len(data):
            self.done, place, self.plan = self.plan, self.plan[2] - begin, None
            return place
        return None

    def _damage(self, kind: str, data: bytes, at: int) -> bytes:
        rng = self.rng
        changed = {
            "flip": lambda: bytes([data[at] ^ 1 << rng.randrange(8)]),
            "drop": lambda: b"",
            "double": lambda: data[at : at + 1] * 2,
            "garbage": lambda: rng.randbytes(rng.randint(1, 20)) + data[at : at + 1],
            "overrun": lambda: read_packet(self.address) + data[at : at + 1],
        }
        if kind == "cut":
            return data[:at] + data[at + rng.randint(2, 60) :]
        if kind == "swap":
            return data[:at] + data[at : at + 2][::-1] + data[at + 2 :]
        return data[:at] + changed[kind]() + data[at + 1 :]

    def write(self, data: bytes) -> None:
        """As the port's."""
        place = self._place("to", data)
        if place is None:
            self.port.write(data)
        elif self.done[0] == "broken":
            self.port.write(data, frozenset([place]))
        elif self.done[0] == "break":
            self.port.write(data[:place] + bytes(3) + data[place:], frozenset(range(place, place + 3)))
        else:
            if self.done[0] == "overrun":
                place = data.find(0x7E, place) + 1 or place  # between packets: a read that is not itself damaged
            self.port.write(self._damage(self.done[0], data, place) if place < len(data) else data + read_packet(self.address))

    def read(self, timeout_s: float) -> bytes:
        """As the port's."""
        data = self.port.read(timeout_s)
        place = self._place("from", data)
        return data if place is None else self._damage(self.done[0], data, place)


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
            {"position": position, "decisions": got.decisions, "touches": got.touches, "faults": got.faults, "done": noisy.done,
             "noticed": [new - old for new, old in zip(after, counts, strict=True)], "pins": pins(dut)}
        )  # fmt: skip
    return {
        "played": played, "repeated": link.repeated, "replayed": link.replayed, "unanswered": link.unanswered, "damaged": link.damaged,
    }  # fmt: skip
