"""Benches on Amaranth's simulator: beats in, beats out, random stalls on both sides, a protocol check, a timeout.

A bench is short::

    bench = Bench(dut, seed=1)
    bench.drive(dut.i, beats, stall=0.3)
    out = bench.collect(dut.o, stall=0.3)
    bench.run()
    assert values(out) == expected

A run ends when every driver is done and nothing has moved for ``quiet`` cycles, so ``collect`` also shows beats too many. Collected
streams are checked: once ``valid`` is up, ``valid`` and payload must hold until ``ready``.
"""

from __future__ import annotations

import random
from typing import Any, NamedTuple

from amaranth.hdl import Shape
from amaranth.lib import data
from amaranth.sim import Simulator


class Beat(NamedTuple):
    """One transfer: the cycle (0 = first clock edge) whose edge took it, and the payload (int, or dict of ints for a struct)."""

    cycle: int
    value: Any


def values(beats: list[Beat]) -> list[Any]:
    """Payloads only."""
    return [beat.value for beat in beats]


def plain(value: Any) -> Any:
    """A sampled payload as an int or a dict of ints."""
    if isinstance(value, data.Const):
        layout = value.shape()
        if isinstance(layout, data.ArrayLayout):
            return [plain(value[index]) for index in range(layout.length)]
        return {name: plain(value[name]) for name, _ in layout}
    return int(value)


def fits(shape: Any, value: Any, where: str = "payload") -> None:
    """Raise ValueError when ``value`` is outside its signal: the simulator would wrap it silently."""
    if isinstance(shape, data.StructLayout):
        for name, field in shape:
            fits(field.shape, value.get(name, 0), f"{where}.{name}")
        return
    if isinstance(shape, data.ArrayLayout):
        for index, item in enumerate(value):
            fits(shape.elem_shape, item, f"{where}[{index}]")
        return
    width, is_signed = Shape.cast(shape).width, Shape.cast(shape).signed
    low, high = (-(1 << width - 1), (1 << width - 1) - 1) if is_signed else (0, (1 << width) - 1)
    if not low <= value <= high:
        raise ValueError(f"{where}: {value} is outside {low}..{high}")


class Bench:
    """One simulation of ``dut`` in the ``sync`` domain.

    Parameters
    ----------
    seed:
        Of all stalls of this bench.
    max_cycles:
        The simulation fails after so many.
    quiet:
        Cycles without a transfer, after the last driver is done, that end it.
    """

    def __init__(self, dut, *, seed: int = 0, max_cycles: int = 200_000, quiet: int = 80) -> None:
        self.dut, self.max_cycles, self.quiet = dut, max_cycles, quiet
        self.cycle = 0
        self._moved = 0
        self._busy = 0
        self._random = random.Random(seed)
        self._sim = Simulator(dut)
        self._sim.add_clock(1e-6)

    def drive(self, stream, beats, *, stall: float = 0.0, gaps=None, after: int = 0) -> list[int]:
        """Send ``beats`` (ints, or dicts for a struct) one by one; returns the list of cycles in which they were taken.

        stall: chance of an idle cycle before each beat, repeated. gaps: idle cycles before each beat, instead (0 for the rest).
        after: cycle before which nothing is sent.
        """
        rng, taken, payload = random.Random(self._random.random()), [], stream.payload
        beats, pauses = list(beats), iter(gaps or ())
        for beat in beats:
            fits(payload.shape(), beat)
        self._busy += 1

        async def driver(ctx):
            while self.cycle < after:
                await ctx.tick()
            for beat in beats:
                idle = next(pauses, 0)
                while stall and rng.random() < stall:
                    idle += 1
                if idle:
                    ctx.set(stream.valid, 0)
                    await ctx.tick().repeat(idle)
                ctx.set(payload, beat)
                ctx.set(stream.valid, 1)
                while not (await ctx.tick().sample(stream.ready))[-1]:
                    pass
                taken.append(self.cycle)
                self._moved = self.cycle
            ctx.set(stream.valid, 0)
            self._busy -= 1

        self._sim.add_testbench(driver)
        return taken

    def collect(self, stream, *, stall: float = 0.0) -> list[Beat]:
        """Take everything ``stream`` offers; ``ready`` is low with chance ``stall``, drawn anew each cycle. Protocol checked."""
        rng, out = random.Random(self._random.random()), []

        async def taker(ctx):
            held = None
            while True:
                ready = not (stall and rng.random() < stall)
                ctx.set(stream.ready, ready)
                _, _, valid, payload = await ctx.tick().sample(stream.valid, stream.payload)
                value = plain(payload) if valid else None
                if held is not None:
                    assert valid, f"cycle {self.cycle}: valid fell before ready"
                    assert value == held, f"cycle {self.cycle}: payload changed while stalled: {held} -> {value}"
                held = value if valid and not ready else None
                if valid and ready:
                    out.append(Beat(self.cycle, value))
                    self._moved = self.cycle

        self._sim.add_testbench(taker, background=True)
        return out

    def watch(self, signal) -> list[int]:
        """Cycles in which ``signal`` (one bit) is high: pulses and flags."""
        seen: list[int] = []

        async def watcher(ctx):
            while True:
                if (await ctx.tick().sample(signal))[-1]:
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
            while self._busy or self.cycle - self._moved < self.quiet:
                await ctx.tick()
                assert self.cycle < self.max_cycles, f"timeout: {self._busy} drivers still busy after {self.cycle} cycles"

        async def count(ctx):
            # added last: the others see the number of the cycle whose edge they woke at
            while True:
                await ctx.tick()
                self.cycle += 1

        self._sim.add_testbench(conductor)
        self._sim.add_testbench(count, background=True)
        self._sim.run()
        return self.cycle
