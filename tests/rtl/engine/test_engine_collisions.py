"""The engine's memories leave open what a read gives of a word that is written in the same cycle: no such
read may matter.

`eskin.rtl.engine.engine.Memory` is replaced by one whose read port gives the complement after such a read;
the engine must stay bit-exact.
"""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import memory, wiring

from eskin.golden.model.model import random_integer_model
from eskin.rtl.engine import coefficient_memory, compact_engine, engine
from tests.rtl.engine.test_engine import expected, run, small, windows
from tests.support.stream_bench import put, simulate

CELLS = [("gru", "before"), ("gru", "after"), ("lstm", "before")]


class PoisonedMemory(wiring.Component):
    """`amaranth.lib.memory.Memory` as the engine uses it, with the poison.

    delay: cycles between the write and the read that collide. 0: what synthesis leaves open; 1: a use that is
    allowed and happens.
    """

    delay = 0

    def __init__(self, **arguments) -> None:
        super().__init__({})
        self.inner = memory.Memory(**arguments)
        self.collisions = Signal(16)

    def read_port(self):
        """As memory.Memory's."""
        port = self.inner.read_port()
        shown = SimpleNamespace(addr=port.addr, en=port.en, data=Signal.like(port.data, name="shown"))
        self.__dict__.setdefault("_reads", []).append((port, shown))
        return shown

    def write_port(self):
        """As memory.Memory's."""
        return self.inner.write_port()

    def elaborate(self, platform):
        m = Module()
        m.submodules.inner = self.inner
        for port, shown in getattr(self, "_reads", []):
            poison, hits = Signal(), []
            for write in self.inner.write_ports:
                enable, address = write.en, write.addr
                for _ in range(self.delay):
                    kept = Signal(1 + len(address))
                    m.d.sync += kept.eq(Cat(enable, address))
                    enable, address = kept[0], kept[1:]
                hits.append(enable & (address == port.addr))
            hit = port.en & Cat(*hits).any()
            m.d.sync += self.collisions.eq(self.collisions + hit)
            with m.If(port.en):
                m.d.sync += poison.eq(hit)
            m.d.comb += shown.data.eq(Mux(poison, ~port.data, port.data))
        return m


def play(monkeypatch, cell, reset, lanes, lane_type, delay=0):
    """(streams as expected, streams as the engine gives them) with poisoned memories, and their number."""
    made: list[PoisonedMemory] = []

    class Kind(PoisonedMemory):
        def __init__(self, **arguments) -> None:
            super().__init__(**arguments)
            made.append(self)

    Kind.delay = delay
    for module in (engine, coefficient_memory, compact_engine):
        monkeypatch.setattr(module, "Memory", Kind)
    model = random_integer_model(small(cell, reset, lanes, lane_type=lane_type), seed=11)
    centred = windows(model.config, touches=1, seed=12)
    seen, rows, _ = run(model, centred)
    return expected(model, centred), (seen["feature"], seen["state"], seen["logit"], rows), len(made)


QUICK = (
    ("gru", "before", 4, "dsp"),
    ("gru", "after", 1, "plain"),
    ("lstm", "before", 4, "plain"),
    ("lstm", "before", 1, "dsp"),
)
SLOW = [
    (*cell, lanes, lane_type)
    for cell in CELLS
    for lanes, lane_type in ((1, "plain"), (4, "plain"), (1, "dsp"), (4, "dsp"), (1, "serial"))
    if (*cell, lanes, lane_type) not in QUICK
]


@pytest.mark.parametrize(
    ("cell", "reset", "lanes", "lane_type"),
    [*QUICK, *(pytest.param(*case, marks=pytest.mark.slow) for case in SLOW)],
)
def test_no_read_of_a_word_that_is_being_written_matters(monkeypatch, cell, reset, lanes, lane_type):
    wanted, got, made = play(monkeypatch, cell, reset, lanes, lane_type)
    if lane_type == "serial":
        assert made == 3, "program, data, weights"
    else:
        apart = lane_type == "plain"  # constants apart from the gates
        assert made == 6 + lanes + apart, "windows, state, gates, T, two halves of addends, weights"
    assert got == wanted


def test_poison_reaches_the_outputs(monkeypatch):
    """The engine does read words in the cycle after they were written: poisoned there, it differs."""
    wanted, got, _ = play(monkeypatch, "gru", "before", 4, "plain", delay=1)
    assert got != wanted


@pytest.mark.parametrize(("read", "seen"), [(5, ~0x1234 & 0xFFFF), (6, 0x0042)])
def test_a_colliding_read_is_poisoned_until_the_next(read, seen):
    dut = PoisonedMemory(shape=16, depth=8, init=[0x42] * 8)
    port, write = dut.read_port(), dut.write_port()

    async def bench(ctx):
        for signal, value in (
            (write.addr, 5),
            (write.data, 0x1234),
            (write.en, 1),
            (port.addr, 5),
            (port.en, 0),
        ):
            ctx.set(signal, value)
        await ctx.tick()
        put(ctx, port, addr=read, en=1)
        await ctx.tick()
        ctx.set(port.en, 0)
        ctx.set(write.en, 0)
        for _ in range(3):
            assert ctx.get(port.data) == seen and ctx.get(dut.collisions) == (read == 5)
            await ctx.tick()
        ctx.set(port.en, 1)
        await ctx.tick()
        assert ctx.get(port.data) == (0x1234 if read == 5 else 0x42)

    simulate(dut, bench)
