"""Benches on Amaranth's simulator: beats in, beats out, random stalls on both sides, a protocol check, a
timeout.

A bench is short::

    bench = Bench(dut, seed=1)
    bench.drive(dut.i, beats, stall=0.3)
    out = bench.collect(dut.o, stall=0.3)
    bench.run()
    assert values(out) == expected

A run ends when every driver is done and nothing has moved for ``quiet`` cycles, so ``collect`` also shows
beats too many. Collected streams are checked: once ``valid`` is up, ``valid`` and payload must hold until
``ready``.
"""

import random
import re
from typing import Any, NamedTuple
from unittest import mock

from amaranth.hdl import ClockDomain, Fragment, Module, Shape, Signal, Value
from amaranth.lib import data
from amaranth.sim import Simulator, _pyrtl
from amaranth.sim.pysim import PySimEngine

from scripts.crosses import STALLS, blocks
from tests.support.covered import note

SIDES = ((0.3, 0.5), (0.4, 0.0), (0.0, 0.5))
"""Stalls of sender and reader, in each way in which there are any."""


class Beat(NamedTuple):
    """One transfer: the cycle (0 = first clock edge) whose edge took it, and the payload (int, or dict of
    ints for a struct)."""

    cycle: int
    value: Any


def values(beats: list[Beat]) -> list[Any]:
    """Payloads only."""
    return [beat.value for beat in beats]


def pack(shape: Any, value: Any, where: str = "payload") -> int:
    """The bits of ``value`` (int, list for an array, dict for a struct) in a signal of ``shape``.

    ValueError when a number is outside its signal: the simulator would wrap it silently.
    """
    if isinstance(shape, data.StructLayout):
        unknown = set(value) - {name for name, _ in shape}
        if unknown:
            raise ValueError(f"{where} has no {sorted(unknown)}")
        return sum(
            pack(field.shape, value.get(name, 0), f"{where}.{name}") << field.offset for name, field in shape
        )
    if isinstance(shape, data.ArrayLayout):
        width = Shape.cast(shape.elem_shape).width
        return sum(
            pack(shape.elem_shape, item, f"{where}[{index}]") << width * index
            for index, item in enumerate(value)
        )
    width, is_signed = Shape.cast(shape).width, Shape.cast(shape).signed
    low, high = (-(1 << width - 1), (1 << width - 1) - 1) if is_signed else (0, (1 << width) - 1)
    if not low <= value <= high:
        raise ValueError(f"{where}: {value} is outside {low}..{high}")
    return int(value) & ((1 << width) - 1)


def unpack(shape: Any, bits: int) -> Any:
    """The int, list or dict that ``bits`` stand for: the inverse of ``pack``."""
    if isinstance(shape, data.StructLayout):
        return {name: unpack(field.shape, bits >> field.offset) for name, field in shape}
    if isinstance(shape, data.ArrayLayout):
        width = Shape.cast(shape.elem_shape).width
        return [unpack(shape.elem_shape, bits >> width * index) for index in range(shape.length)]
    width, is_signed = Shape.cast(shape).width, Shape.cast(shape).signed
    bits &= (1 << width) - 1
    return bits - (1 << width) if is_signed and bits >> width - 1 else bits


class Engine(PySimEngine):
    """Amaranth's, in two thirds of its time: a sampled signal's state is kept (Amaranth makes a key of the signal in each
    cycle), and the Python that Amaranth writes for a design is made shorter (`_shorter`)."""

    def __init__(self, design) -> None:
        write, flush = _pyrtl._RHSValueCompiler.on_Signal, _pyrtl._PythonEmitter.flush
        shapes: dict[str, Shape] = {}

        def on_signal(compiler, signal):
            text = write(compiler, signal)
            shapes[text] = signal.shape()
            return text

        with (
            mock.patch.object(_pyrtl._RHSValueCompiler, "on_Signal", on_signal),
            mock.patch.object(
                _pyrtl._PythonEmitter, "flush", lambda emitter: _shorter(flush(emitter), shapes)
            ),
        ):
            super().__init__(design)
        self._states: dict[int, Any] = {}

    def get_value(self, expr):
        if type(expr) is not Signal:
            return super().get_value(expr)
        known = self._states.get(id(expr))
        if known is None:  # kept with its signal, whose id no other gets
            known = self._states[id(expr)] = expr, self.state.slots[self.state.get_signal(expr)]
        return known[1].curr


def _shorter(code: str, shapes: dict[str, Shape]) -> str:
    """The same function: a signal's whole value is not masked again, only what changes is handed over, a memory is
    written if it is enabled, and signals have names in place of numbers."""

    def whole(match: re.Match) -> str:
        shape = shapes[match[2]]
        is_whole = int(match[1], 16) == (1 << shape.width) - 1 and shape.signed == ("sign" in match[0])
        return match[2] if is_whole else match[0]

    value = r"\(0x([0-9a-f]+) & (slots\[\d+\]\.curr)\)"
    code = re.sub(rf"(?<!sign\(){value}", whole, re.sub(rf"sign\({value}, -0x[0-9a-f]+\)", whole, code))
    code = re.sub(r"(slots\[(\d+)\]\.)(update\(next_\2\b)", r"if \1next != next_\2: \1\3", code)
    code = re.sub(r"(slots\[\d+\]\.write\(\w+, \w+, (\w+)\))", r"if \2: \1", code)
    names = {f"slot_{number} = slots[{number}]\n" for number in re.findall(r"slots\[(\d+)\]", code)}
    return "".join(sorted(names)) + re.sub(r"slots\[(\d+)\]", r"slot_\1", code)


class Bench:
    """One simulation of ``dut`` in the ``sync`` domain.

    Parameters
    ----------
    seed:
        Of all stalls of this bench.
    max_cycles:
        The simulation fails after so many; 0: after 200 000, or 20 000 in which nothing moves.
    quiet:
        Cycles without a transfer, after the last driver is done, that end it.
    """

    def __init__(self, dut, *, seed: int = 0, max_cycles: int = 0, quiet: int = 80) -> None:
        self.dut, self.max_cycles, self.quiet = dut, max_cycles or 200_000, quiet
        self.patience = max_cycles or 20_000
        self.cycle = 0
        self._moved = 0
        self._busy = 0
        self._random, self.stalls = random.Random(seed), [False, False]
        top = Module()
        top.domains.sync = ClockDomain()  # also for a dut without registers
        top.submodules.dut = dut
        self._sim = Simulator(top, engine=Engine)
        self._sim.add_clock(1e-6)

    def drive(self, stream, beats, *, stall: float = 0.0, gaps=None, after: int = 0) -> list[int]:
        """Send ``beats`` (ints, or dicts for a struct) one by one; returns the list of cycles in which they
        were taken.

        stall: chance of an idle cycle before each beat, repeated. gaps: idle cycles before each beat, instead
        (0 for the rest). after: cycle before which nothing is sent.
        """
        self.stalls[0] |= bool(stall or gaps)
        rng, accepted, payload = random.Random(self._random.random()), [], Value.cast(stream.payload)
        pauses = iter(gaps or ())
        packed = [pack(stream.payload.shape(), beat) for beat in beats]
        self._busy += 1

        async def driver(ctx):
            ticks = aiter(ctx.tick().sample(stream.ready))  # one for all: a new one every cycle costs more
            while self.cycle < after:
                await anext(ticks)
            for bits in packed:
                idle = next(pauses, 0)
                while stall and rng.random() < stall:
                    idle += 1
                if idle:
                    ctx.set(stream.valid, 0)
                    for _ in range(idle):
                        await anext(ticks)
                ctx.set(payload, bits)
                ctx.set(stream.valid, 1)
                while not (await anext(ticks))[-1]:
                    pass
                accepted.append(self.cycle)
                self._moved = self.cycle
            ctx.set(stream.valid, 0)
            self._busy -= 1

        self._sim.add_testbench(driver)
        return accepted

    def collect(self, stream, *, stall: float = 0.0) -> list[Beat]:
        """Take everything ``stream`` offers; ``ready`` is low with chance ``stall``, drawn anew each cycle.
        Protocol checked."""
        self.stalls[1] |= bool(stall)
        rng, out, shape = random.Random(self._random.random()), [], stream.payload.shape()

        async def taker(ctx):
            ticks, offered_bits, ready = (
                aiter(ctx.tick().sample(stream.valid, Value.cast(stream.payload))),
                None,
                None,
            )
            while True:
                stalled = bool(stall and rng.random() < stall)
                if ready is not (not stalled):
                    ready = not stalled
                    ctx.set(stream.ready, ready)
                _, _, valid, bits = await anext(ticks)
                if offered_bits is not None:
                    assert valid, f"cycle {self.cycle}: valid fell before ready"
                    assert bits == offered_bits, (
                        f"cycle {self.cycle}: payload changed while stalled from {unpack(shape, offered_bits)}"
                    )
                offered_bits = bits if valid and stalled else None
                if valid and ready:
                    out.append(Beat(self.cycle, unpack(shape, bits)))
                    self._moved = self.cycle

        self._sim.add_testbench(taker, background=True)
        return out

    def watch(self, signal) -> list[int]:
        """Cycles in which ``signal`` (one bit) is high: pulses and flags."""
        seen: list[int] = []

        async def watcher(ctx):
            async for _, _, high in ctx.tick().sample(signal):
                if high:
                    seen.append(self.cycle)

        self._sim.add_testbench(watcher, background=True)
        return seen

    def process(self, body) -> None:
        """Add ``async def body(ctx)``; the run waits for it."""
        self._busy += 1

        async def wrapped(ctx):
            await body(ctx)
            self._busy -= 1
            self._moved = self.cycle

        self._sim.add_testbench(wrapped)

    def run(self) -> int:
        """Simulate to the end; returns the number of cycles. AssertionError on a timeout."""

        async def conductor(ctx):
            ticks = aiter(ctx.tick())
            while self._busy or self.cycle - self._moved < self.quiet:
                await anext(ticks)
                self.cycle += 1
                assert self.cycle < min(self.max_cycles, self._moved + self.patience), (
                    f"timeout: {self._busy} drivers still busy after {self.cycle} cycles"
                )

        # added last: the others see the number of the cycle whose edge they woke at
        self._sim.add_testbench(conductor)
        self._sim.run()
        name = type(getattr(self.dut, "block", self.dut)).__name__  # of a wrapper its block
        if name in blocks():  # others have one stream, or none
            note("stalls of blocks", name, STALLS[self.stalls[0], self.stalls[1]])
        return self.cycle


def play(dut, beats, stalls=(0.0, 0.0), *, seed: int = 0, quiet: int = 80, gaps=None):
    """(what comes out of ``dut``, the cycles in which ``beats`` were taken); ``stalls`` of sender and reader."""
    bench = Bench(dut, seed=seed, quiet=quiet)
    accepted = bench.drive(dut.i, beats, stall=stalls[0], gaps=gaps)
    out = bench.collect(dut.o, stall=stalls[1])
    bench.run()
    return out, accepted


def put(ctx, block, **values) -> None:
    """Set inputs of a block by their names."""
    for name, value in values.items():
        ctx.set(getattr(block, name), value)


async def give_frame(ctx, port, samples, pauses=lambda: False, count: int | None = None) -> None:
    """Offer a frame, or its first ``count`` samples, each until it is taken, after cycles in which
    ``pauses()``."""
    ticks, payload = aiter(ctx.tick().sample(port.ready)), Value.cast(port.payload)
    for taxel, sample in enumerate(samples[:count]):
        while pauses():
            ctx.set(port.valid, 0)
            await anext(ticks)
        beat = {"sample": int(sample), "first": taxel == 0, "last": taxel == len(samples) - 1}
        ctx.set(payload, pack(port.payload.shape(), beat))
        ctx.set(port.valid, 1)
        while not (await anext(ticks))[-1]:
            pass
    ctx.set(port.valid, 0)


def simulate(dut, body, *background, platform: str | None = None) -> None:
    """Run ``async def body(ctx)`` to its end beside the testbenches ``background``."""
    top = Module()
    top.domains.sync = ClockDomain()  # also for a dut without registers
    top.submodules.dut = Fragment.get(dut, platform)
    simulator = Simulator(top, engine=Engine)
    simulator.add_clock(1e-6)
    for other in background:
        simulator.add_testbench(other, background=True)
    simulator.add_testbench(body)
    simulator.run()


def bus_accesses(ctx, bus):
    """``write(register, word)`` and ``read(register)`` on a register bus, a cycle each."""

    async def access(strobe, register) -> None:
        ctx.set(bus.addr, int(register))
        ctx.set(strobe, 1)
        await ctx.tick()
        ctx.set(strobe, 0)

    async def write(register, word) -> None:
        ctx.set(bus.w_data, word)
        await access(bus.w_stb, register)

    async def read(register) -> int:
        await access(bus.r_stb, register)
        return ctx.get(bus.r_data)

    return write, read


async def write_all(ctx, bus, writes) -> None:
    """Write pairs of a register and a word, one in each cycle."""
    ticks = aiter(ctx.tick())
    ctx.set(bus.w_stb, 1)
    for register, word in writes:
        ctx.set(bus.addr, int(register))
        ctx.set(bus.w_data, word)
        await anext(ticks)
    ctx.set(bus.w_stb, 0)
