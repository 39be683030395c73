"""Memories that carry NO_COLLISION: a read that collides with a write gives garbage here, as it may in an
FPGA, and nothing may change."""

import pytest
from amaranth.back import rtlil
from amaranth.hdl import Cat, Module, Signal, Value, unsigned
from amaranth.lib.memory import Memory

from eskin.rtl.common import NO_COLLISION, without_contents
from tests.rtl.top import test_accelerator
from tests.support.stream_bench import simulate
from tests.support.table import each_row


@pytest.fixture(autouse=True)
def garbage(monkeypatch):
    """Marked memories invert what a read gives that collided with a write; their ports."""
    elaborate, marked = Memory.elaborate, []

    def with_garbage(self, platform):
        m, reads = Module(), [(port, port.data) for port in self.read_ports if self.attrs.get("no_rw_check")]
        marked.extend(port for port, _ in reads)
        for port, value in reads:
            port.data = Signal(len(Value.cast(value)))
            hit = Signal(reset_less=True)
            with m.If(port.en):
                m.d.sync += hit.eq(
                    Cat(write.en.any() & (write.addr == port.addr) for write in self.write_ports).any()
                )
            m.d.comb += Value.cast(value).eq(port.data ^ hit.replicate(len(port.data)))
        m.submodules.memory = elaborate(self, platform)
        for port, value in reads:
            port.data = value
        return m

    monkeypatch.setattr(Memory, "elaborate", with_garbage)
    return marked


@each_row("attributes, value", [({}, 0), (NO_COLLISION, 0xFF)])
def test_a_collision_shows(attributes, value):
    m = Module()
    m.submodules.memory = memory = Memory(shape=unsigned(8), depth=4, init=[], attrs=attributes)
    read, write = memory.read_port(), memory.write_port()
    m.d.comb += [write.en.eq(1), write.data.eq(5)]

    async def bench(ctx):
        await ctx.tick()
        assert ctx.get(read.data) == value

    simulate(m, bench)


@pytest.mark.parametrize(
    "name", [pytest.param("two windows end together", marks=pytest.mark.slow), "tracked, free"]
)
def test_whole_design(name):
    test_accelerator.test_bit_exact_at_every_stage(name, 0.4)


def test_only_large_memories_begin_as_anything():
    """Two memories with contents, which may have one name in two modules: what the part cannot fill loses
    them, the other keeps them."""
    m = Module()
    for name, style, word in (("large", "huge", 0xA5), ("small", "block", 0x5A)):
        m.submodules[name] = memory = Memory(
            shape=8, depth=1, init=[word], attrs={"ram_style": style, "no_rw_check": 1}
        )
        memory.read_port()
    text = rtlil.convert(m, name="top", ports=(), emit_src=False)
    assert text.count("8'10100101") == text.count("8'01011010") == 1 and text.count("cell $meminit_v2") == 2
    left = without_contents(text)
    assert "8'10100101" not in left and left.count("8'01011010") == 1 and left.count("memory width 8") == 2
