"""rtl/interface/interface_registers.py: what the host reads and sets beside the accelerator; everything else
goes through."""

from __future__ import annotations

import random

from amaranth.sim import Simulator

from eskin.golden.core.config import PRESETS
from eskin.golden.core.converters import ConverterFault
from eskin.rtl.interface.interface_registers import InterfaceRegisters
from eskin.rtl.program.memory_map import Control, InterfaceRegister, Register, interface_registers, mapped

ALL = PRESETS["thesis"].replace(converter="ads7953", position=True, stimulator="decisions")


def play(body, config=ALL):
    """Run ``async body(ctx, dut, write, read)``; the accelerator's side answers a read with the address times
    257."""
    dut = InterfaceRegisters(config)
    through: list[tuple[str, int, int]] = []

    async def accelerator(ctx):
        while True:
            _, _, w_stb, r_stb, addr, w_data = await ctx.tick().sample(
                dut.inner.w_stb, dut.inner.r_stb, dut.inner.addr, dut.inner.w_data
            )
            if w_stb:
                through.append(("write", addr, w_data))
            if r_stb:
                through.append(("read", addr, 0))
                ctx.set(dut.inner.r_data, 257 * addr)

    async def bench(ctx):
        async def write(register, word):
            ctx.set(dut.bus.addr, int(register))
            ctx.set(dut.bus.w_data, word)
            ctx.set(dut.bus.w_stb, 1)
            await ctx.tick()
            ctx.set(dut.bus.w_stb, 0)

        async def read(register):
            ctx.set(dut.bus.addr, int(register))
            ctx.set(dut.bus.r_stb, 1)
            await ctx.tick()
            ctx.set(dut.bus.r_stb, 0)
            return ctx.get(dut.bus.r_data)

        await body(ctx, dut, write, read)

    sim = Simulator(dut)
    sim.add_clock(1e-6)
    sim.add_testbench(accelerator, background=True)
    sim.add_testbench(bench)
    sim.run()
    return through


def test_settings_start_as_configured_and_hold_what_was_written():
    names = ("amplitude", "delay", "frequency", "width")
    registers = [InterfaceRegister[f"STIM_{name.upper()}"] for name in names]

    async def body(ctx, dut, write, read):
        assert [await read(register) for register in registers] == [
            getattr(ALL.interface, f"stim_{name}") for name in names
        ]
        rng = random.Random(3)
        for _ in range(20):
            words = [rng.getrandbits(16) for _ in names]
            for register, word in zip(registers, words, strict=True):
                await write(register, word)
            expected = [min(words[0], 255), *words[1:]]
            assert [await read(register) for register in registers] == expected
            assert [ctx.get(dut.settings[name]) for name in names] == expected

    assert play(body) == []  # none of it reached the accelerator, whose register ADDRESS would tell


def test_the_latest_position_and_how_many():
    async def body(ctx, dut, write, read):
        rng = random.Random(4)
        for count in range(1, 12):
            told = {
                "x": rng.randrange(256),
                "y": rng.randrange(256),
                "peak": rng.randrange(160),
                "ended": count % 2,
                "direction": count % 5,
            }
            ctx.set(dut.position.payload, told)
            ctx.set(dut.position.valid, 1)
            await ctx.tick()
            ctx.set(dut.position.valid, 0)
            ctx.set(dut.position.payload, {"x": 1, "y": 2, "peak": 3, "ended": 0, "direction": 0})
            assert await read(InterfaceRegister.POSITION) == told["x"] | told["y"] << 8
            assert (
                await read(InterfaceRegister.POSITION_PEAK)
                == told["peak"] | told["direction"] << 8 | told["ended"] << 11
            )
            assert await read(InterfaceRegister.POSITIONS) == count
        assert not ctx.get(dut.armed)
        await write(Register.CONTROL, Control.CLEAR_FAULTS)
        assert not ctx.get(dut.armed)
        await write(Register.CONTROL, Control.ARM)
        assert await read(InterfaceRegister.POSITIONS) == 0 and ctx.get(dut.armed)

    assert play(body) == [
        ("write", int(Register.CONTROL), int(Control.CLEAR_FAULTS)),
        ("write", int(Register.CONTROL), int(Control.ARM)),
    ]


def test_faults_stay_until_they_are_cleared():
    async def body(ctx, dut, write, read):
        for fault in (ConverterFault.STUCK, ConverterFault.LATE):
            ctx.set(dut.fault, int(fault))
            await ctx.tick()
            ctx.set(dut.fault, 0)
        assert await read(InterfaceRegister.CONVERTER_FAULTS) == ConverterFault.STUCK | ConverterFault.LATE
        await write(Register.CONTROL, Control.CLEAR_FAULTS)
        assert await read(InterfaceRegister.CONVERTER_FAULTS) == 0

    play(body)


def test_every_other_access_goes_through_in_its_cycle():
    others = [number for number in range(64) if number not in interface_registers(ALL)]

    async def body(ctx, dut, write, read):
        for number in others:
            assert await read(number) == 257 * number
            await write(number, 0x1234)

    assert play(body) == [
        event for number in others for event in (("read", number, 0), ("write", number, 0x1234))
    ]
    assert not set(mapped(ALL)) & set(map(int, interface_registers(ALL)))
    assert interface_registers(PRESETS["thesis"]) == []
