"""rtl/interface/interface_registers.py: what the host reads and sets beside the accelerator; everything else
goes through."""

import random

from eskin.golden.core import PRESETS, ConverterFault
from eskin.rtl.interface.interface_registers import InterfaceRegisters
from eskin.rtl.program.memory_map import Control, InterfaceRegister, Register, interface_registers, mapped
from tests.support.stream_bench import bus_accesses, simulate

ALL = PRESETS["thesis"].replace(converter="ads7953", position=True, stimulator="decisions", send_frames=True)
CLEAR, ARM = ((int(Register.CONTROL), int(command)) for command in (Control.CLEAR_FAULTS, Control.ARM))


def play(body):
    """Run ``async body(ctx, dut, write, read)``; the accelerator's side answers a read with the address times
    257. What reached it: (address, word), (address, None) of a read."""
    dut, through = InterfaceRegisters(ALL), []
    inner = dut.inner

    async def accelerator(ctx):
        async for _, _, writes, reads, address, word in ctx.tick().sample(
            inner.w_stb, inner.r_stb, inner.addr, inner.w_data
        ):
            if writes or reads:
                through.append((address, word if writes else None))
            if reads:
                ctx.set(inner.r_data, 257 * address)

    async def bench(ctx):
        await body(ctx, dut, *bus_accesses(ctx, dut.bus))

    simulate(dut, bench, accelerator)
    return through


def test_settings_start_as_configured_and_hold_what_was_written():
    names = ("amplitude", "delay", "frequency", "width")
    registers = [InterfaceRegister[f"STIM_{name.upper()}"] for name in names]

    async def body(ctx, dut, write, read):
        expected = [getattr(ALL.interface, f"stim_{name}") for name in names]
        rng = random.Random(3)
        for number in range(20):
            assert [await read(register) for register in registers] == expected
            assert [ctx.get(dut.settings[name]) for name in names] == expected
            words = [rng.getrandbits(16) for _ in names]
            words[0] >>= number % 2 * 7  # also just above what the amplitude holds
            for register, word in zip(registers, words, strict=True):
                await write(register, word)
            expected = [min(words[0], 255), *words[1:]]

    assert play(body) == []  # none of it reached the accelerator, whose register ADDRESS would tell


def test_the_latest_position_and_how_many():
    async def body(ctx, dut, write, read):
        rng = random.Random(4)
        for count in range(1, 12):
            x, y, peak, ended, direction = (rng.randrange(top) for top in (256, 256, 160, 2, 5))
            position = {"x": x, "y": y, "peak": peak, "ended": ended, "direction": direction}
            ctx.set(dut.position, {"payload": position, "valid": 1})
            await ctx.tick()
            ctx.set(dut.position, {"payload": {"x": 1, "y": 2, "peak": 3}, "valid": 0})
            assert [await read(register) for register in interface_registers(ALL)[:3]] == [
                x | y << 8,
                peak | direction << 8 | ended << 11,
                count,
            ]
        await write(*CLEAR)
        await write(63, 0xFFFF)
        await read(ARM[0])
        assert not ctx.get(dut.armed)
        await write(*ARM)
        assert await read(InterfaceRegister.POSITIONS) == 0 and ctx.get(dut.armed)

    assert play(body) == [CLEAR, (63, 0xFFFF), (ARM[0], None), ARM]


def test_faults_stay_until_they_are_cleared():
    async def body(ctx, dut, write, read):
        faults = ConverterFault(0)
        for fault in ConverterFault:
            ctx.set(dut.fault, int(fault))
            await ctx.tick()
            ctx.set(dut.fault, 0)
            faults |= fault
            assert await read(InterfaceRegister.CONVERTER_FAULTS) == faults
        for command, left in ((ARM, faults), (CLEAR, 0)):
            await write(*command)
            assert await read(InterfaceRegister.CONVERTER_FAULTS) == left

    play(body)


def test_frames_are_sent_while_the_host_asks_for_them():
    async def body(ctx, dut, write, read):
        for word in (1, 0, 0xFFFF, 0xFFFE):
            await write(InterfaceRegister.FRAMES, word)
            assert await read(InterfaceRegister.FRAMES) == ctx.get(dut.sends) == word & 1

    assert play(body) == []


def test_every_other_access_goes_through_in_its_cycle():
    others = [number for number in range(64) if number not in interface_registers(ALL)]

    async def body(ctx, dut, write, read):
        for number in others:
            assert await read(number) == 257 * number
            await write(number, 0x1234)

    assert play(body) == [event for number in others for event in ((number, None), (number, 0x1234))]
    assert not set(mapped(ALL)) & set(map(int, interface_registers(ALL)))
    assert interface_registers(PRESETS["thesis"]) == []
