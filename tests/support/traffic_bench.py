"""A cocotb test of the bare accelerator: it does what a script says, and writes down every word of every stage and every X
on an output."""

import json
import random
from pathlib import Path

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import FallingEdge, ReadOnly, RisingEdge

from eskin.cosim.bench import HostBus
from eskin.cosim.scoreboard import FLAT_STAGES

LIMIT = 20000
"""Cycles that a beat or an idle accelerator is waited for."""


class Stuck(Exception):
    """It waited longer."""


class Traffic:
    """Operations of `tests.support.traffic.Script` on ``dut``; said: what came, in order."""

    def __init__(self, dut, control: int) -> None:
        self.dut, self.control = dut, control
        self.bus = HostBus(dut, {"none": 0}, {})
        self.events: list[list] = []
        self._sink = self._alarm = None

    async def start(self) -> None:
        """Clock, reset, monitor."""
        dut = self.dut
        Clock(dut.clk, 10, unit="ns").start()
        dut.rst.value, dut.o__ready.value = 1, 1
        self.withdraw()
        for _ in range(4):
            await FallingEdge(dut.clk)
        dut.rst.value = 0
        cocotb.start_soon(self.watch())
        cocotb.start_soon(self.accept())

    def withdraw(self) -> None:
        """Offer nothing."""
        self.dut.i__valid.value = self.dut.bus__w_stb.value = self.dut.bus__r_stb.value = 0

    async def play(self, ops: list[list[int]]) -> None:
        """All up to the next mark; a reset ends them before."""
        for op, *words in ops:
            try:
                await getattr(self, op)(*words)
            except Stuck:
                self.events.append(["stuck", op])
                self.dut.i__valid.value = 0
                return

    async def segment(self, mark: int, ops: list[list[int]]) -> None:
        """What follows a mark."""
        self.events.append(["mark", mark])
        self._alarm = None
        self._playing = cocotb.start_soon(self.play(ops))
        await self._playing.complete
        if self._playing.cancelled():  # by the reset
            await self._alarm
            return
        self._playing.result()
        if self._alarm is not None:
            self._alarm.cancel()

    async def write(self, address: int, word: int) -> None:
        await self.bus.write(address, word)

    async def read(self, address: int) -> None:
        self.events.append(["read", await self.bus.read("none", address)])

    async def beat(self, payload: int) -> None:
        dut = self.dut
        dut.i__payload.value, dut.i__valid.value = payload, 1
        await ReadOnly()
        for _ in range(LIMIT):
            ready = dut.i__ready.value == 1
            await FallingEdge(dut.clk)
            if ready:
                dut.i__valid.value = 0
                return
        raise Stuck

    async def wait(self, cycles: int) -> None:
        for _ in range(cycles):
            await FallingEdge(self.dut.clk)

    async def until_idle(self) -> None:
        quiet = 0
        for _ in range(LIMIT):
            await FallingEdge(self.dut.clk)
            quiet = quiet + 1 if self.dut.busy.value == 0 and self.dut.o__valid.value == 0 else 0
            if quiet == 8:
                return
        raise Stuck

    async def sink(self, seed: int) -> None:
        self._sink = random.Random(seed) if seed else None

    async def reset(self, cycles: int) -> None:
        self._alarm = cocotb.start_soon(self.break_off(cycles))

    async def break_off(self, cycles: int) -> None:
        """A reset of three cycles, so many from now."""
        await self.wait(cycles)
        self.dut.rst.value = 1
        self.withdraw()
        self._playing.cancel()
        await self.wait(3)
        self.dut.rst.value = 0

    async def accept(self) -> None:
        """Takes decisions, with stalls where a seed is given."""
        while True:
            await FallingEdge(self.dut.clk)
            self.dut.o__ready.value = 1 if self._sink is None else self._sink.random() < 0.25

    async def watch(self) -> None:
        """Values taken or seen at each rising edge."""
        dut, pending = self.dut, None
        stages = [
            (stage, getattr(dut, f"probe__{stage}__valid"), getattr(dut, f"probe__{stage}__value"))
            for stage in FLAT_STAGES
            if hasattr(dut, f"probe__{stage}__valid")
        ]
        flags = [dut.i__ready, dut.o__valid, dut.busy, *(valid for _, valid, _ in stages)]
        while True:
            await RisingEdge(dut.clk)
            if dut.rst.value:
                pending = None
                continue
            unknown = [flag._name for flag in flags if not flag.value.is_resolvable]
            if unknown:
                self.events.append(["unknown", *unknown])
                pending = None
                continue
            for stage, valid, value in stages:
                if valid.value:
                    self.say(stage, value.value)
            offered, payload, writes = (
                dut.o__valid.value == 1,
                dut.o__payload.value,
                dut.bus__w_stb.value == 1,
            )
            if offered and dut.o__ready.value:
                self.say("decision", payload)
            # a decision may be withdrawn by a command (ARM) alone
            if pending is not None and not writes and (not offered or payload != pending):
                self.say("unstable", payload)
            armed = writes and dut.bus__addr.value == self.control
            pending = payload if offered and not dut.o__ready.value and not armed else None

    def say(self, kind: str, word) -> None:
        """A word of 32 bits, or its bits where one is unknown."""
        self.events.append([kind, word.to_unsigned() if word.is_resolvable else str(word)])


@cocotb.test()
async def play(dut) -> None:
    """The script, mark by mark."""
    script = json.loads(Path("script.json").read_text())
    traffic = Traffic(dut, script["control"])
    await traffic.start()
    for mark, ops in script["segments"]:
        await traffic.segment(mark, ops)
    Path("result.json").write_text(json.dumps(traffic.events))
