"""The serial link on its own, at its pins: packets in, frames and bus accesses out, and the other way round; damage of every kind."""

from __future__ import annotations

import binascii
import random
from types import SimpleNamespace

import pytest
from amaranth.lib.crc.catalog import CRC16_IBM_SDLC
from amaranth.sim import Simulator
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim import link
from golden.config import PRESETS
from golden.errors import InputError
from rtl.classifier import decision_layout
from rtl.uart import UartReceiver, uart_divisor
from rtl.uart_link import UartLink
from tests.stream_bench import pack

CONFIG = PRESETS["thesis"].replace(taxels=4)
GOLDEN = random.Random(1)


def frame(number: int, samples) -> bytes:
    return link.ordered_packet(number, link.FRAME, samples)


def write(number: int, address: int, word: int) -> bytes:
    return link.ordered_packet(number, address, [word])


def play(line, *, divisor=4, config=CONFIG, decisions=(), ready=lambda cycle: True, quiet=40, read_value=lambda address: 0):
    """What the link makes of ``line``: bytes, ``None`` (10 bits of idle), or (byte, stop bit).

    frames: complete lists of samples. writes, reads: bus accesses. bodies: of packets it sent. expected, damaged.
    """
    dut = UartLink(config, divisor)
    seen = SimpleNamespace(frames=[], writes=[], reads=[], sent=bytearray(), expected=0, errors=[])
    alive = True

    async def talk(ctx):
        nonlocal alive
        for item in line:
            byte, stop = item if isinstance(item, tuple) else (item, 1)
            for bit in ([1] * 10 if byte is None else [0, *(byte >> k & 1 for k in range(8)), stop]):
                ctx.set(dut.rx, bit)
                await ctx.tick().repeat(divisor)
        ctx.set(dut.rx, 1)
        await ctx.tick().repeat(quiet * 10 * divisor)
        alive = False

    async def hear(ctx):
        while True:
            while ctx.get(dut.tx):
                await ctx.tick()
            await ctx.tick().repeat(divisor // 2)
            byte = 0
            for k in range(8):
                await ctx.tick().repeat(divisor)
                byte |= ctx.get(dut.tx) << k
            await ctx.tick().repeat(divisor)
            if not ctx.get(dut.tx):
                seen.errors.append("stop bit low")
            seen.sent.append(byte)

    async def sink(ctx):
        beats, cycle = [], 0
        while True:
            ctx.set(dut.frame.ready, ready(cycle))
            _, _, valid, is_ready, beat, w_stb, r_stb, address, word, expected = await ctx.tick().sample(
                dut.frame.valid, dut.frame.ready, dut.frame.payload, dut.bus.w_stb, dut.bus.r_stb, dut.bus.addr, dut.bus.w_data, dut.expected
            )
            cycle += 1
            seen.expected = expected
            if valid and is_ready:
                if beat.first != (not beats):
                    seen.errors.append(f"first flag of beat {len(beats)}")
                beats.append(beat.sample)
                if beat.last:
                    seen.frames.append(beats)
                    beats = []
            if w_stb:
                seen.writes.append((address, word))
            if r_stb:
                seen.reads.append(address)
                ctx.set(dut.bus.r_data, read_value(address))

    async def decide(ctx):
        for fields in decisions:
            if callable(fields):
                await fields(ctx, dut)
                continue
            ctx.set(dut.decision.payload, fields)
            ctx.set(dut.decision.valid, 1)
            await ctx.tick().until(dut.decision.ready)
            ctx.set(dut.decision.valid, 0)

    async def init(ctx):
        ctx.set(dut.rx, 1)

    sim = Simulator(dut)
    sim.add_clock(1e-6)
    sim.add_testbench(init)
    sim.add_testbench(talk)
    for body in (hear, sink, decide):
        sim.add_testbench(body, background=True)
    sim.run()
    unpacker = link.Unpacker()
    seen.bodies = unpacker.feed(bytes(seen.sent))
    seen.damaged = unpacker.damaged
    assert not seen.errors
    return seen


def test_frames_writes_and_reads():
    samples = [[1, 2, 3, 4], [0x7E7E, 0x7D7D, 0x5E7D, 0xFFFF], [0, 0x7D5D, 0x8000, 0x7E]]
    line = frame(0, samples[0]) + write(1, 0x02, 0x7D7E) + frame(2, samples[1]) + link.read_packet(0x13) + bytes(0)
    seen = play([*line, *[None] * 20, *frame(3, samples[2]), *write(4, 0x3F, 0xABCD)], read_value=lambda address: 0x7E00 | address)
    assert seen.frames == samples
    assert seen.writes == [(2, 0x7D7E), (0x3F, 0xABCD)] and seen.reads == [0x13]
    assert [link.parse(body) for body in seen.bodies] == [link.Answer(0x13, 0x7E13, 3, 0)] and not seen.damaged
    assert seen.expected == 5


@pytest.mark.parametrize("divisor", [4, 5, 6, 13])
def test_divisors_and_decisions(divisor):
    decisions = [{"class": 3, "margin": 0x7E7D, "step": 0x7D, "is_global": 0, "partial": 1},
                 {"class": 31, "margin": 0xFFFF, "step": 255, "is_global": 1, "partial": 0}]  # fmt: skip
    seen = play([*frame(0, [9, 8, 7, 6]), *[None] * 5], divisor=divisor, decisions=decisions)
    payloads = [pack(decision_layout, fields) for fields in decisions]
    assert [link.parse(body) for body in seen.bodies] == [link.Decision(k, payload) for k, payload in enumerate(payloads)]
    assert seen.frames == [[9, 8, 7, 6]]
