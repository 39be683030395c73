"""The host's registers on their own: commands, masks, refused writes, sticky faults, counters."""

from __future__ import annotations

import pytest
from amaranth.sim import Simulator

from golden.config import PRESETS
from rtl.control import HostControl
from rtl.memory_map import ID_VALUE, VERSION_VALUE, Control, Fault, Memory, Register, Status


def play(body, **changes):
    """Run ``async body(ctx, dut, write, read)`` on a HostControl of 20 taxels."""
    dut = HostControl(PRESETS["thesis"].replace(taxels=20, masked_taxels=(1, 17), **changes))

    async def bench(ctx):
        async def write(register, word):
            ctx.set(dut.bus.addr, register)
            ctx.set(dut.bus.w_data, word)
            ctx.set(dut.bus.w_stb, 1)
            await ctx.tick()
            ctx.set(dut.bus.w_stb, 0)

        async def read(register):
            ctx.set(dut.bus.addr, register)
            ctx.set(dut.bus.r_stb, 1)
            await ctx.tick()
            ctx.set(dut.bus.r_stb, 0)
            return ctx.get(dut.bus.r_data)

        ctx.set(dut.decider_idle, 1)
        await body(ctx, dut, write, read)

    sim = Simulator(dut)
    sim.add_clock(1e-6)
    sim.add_testbench(bench)
    sim.run()


async def pulse(ctx, *signals):
    for signal in signals:
        ctx.set(signal, 1)
    await ctx.tick()
    for signal in signals:
        ctx.set(signal, 0)


def test_identity_masks_and_unknown_addresses():
    async def body(ctx, dut, write, read):
        assert (await read(Register.ID), await read(Register.VERSION)) == (ID_VALUE, VERSION_VALUE)
        assert (await read(Register.MASK), await read(Register.MASK + 1)) == (1 << 1, 1 << 1)
        assert ctx.get(dut.mask) == 1 << 1 | 1 << 17
        await write(Register.MASK + 1, 0xFFFF)
        assert await read(Register.MASK + 1) == 0xF, "20 taxels leave 4 bits in the second word"
        assert ctx.get(dut.mask) == 1 << 1 | 0xF << 16
        await write(Register.MASK, 0)
        assert await read(Register.MASK) == 0 and ctx.get(dut.mask) == 0xF << 16
        assert await read(0x7F) == 0

    play(body)


def test_loading_counts_the_address_up_and_is_refused_during_a_touch():
    async def body(ctx, dut, write, read):
        await write(Register.MEMORY_SELECT, Memory.MEANS)
        await write(Register.MEMORY_ADDRESS, 5)
        ctx.set(dut.bus.addr, Register.MEMORY_DATA)
        ctx.set(dut.bus.w_data, 0xBEEF)
        ctx.set(dut.bus.w_stb, 1)
        load = dut.load
        assert [ctx.get(s) for s in (load.enable, load.select, load.address, load.data)] == [1, Memory.MEANS, 5, 0xBEEF]
        await ctx.tick()
        assert ctx.get(load.address) == 6
        ctx.set(dut.bus.w_stb, 0)
        await pulse(ctx, dut.touch_started)
        assert await read(Register.STATUS) & Status.TOUCH
        ctx.set(dut.bus.addr, Register.MEMORY_DATA)
        ctx.set(dut.bus.w_stb, 1)
        assert ctx.get(load.enable) == 0
        await ctx.tick()
        ctx.set(dut.bus.w_stb, 0)
        assert await read(Register.FAULTS) == Fault.WRITE_REFUSED
        await pulse(ctx, dut.global_taken)
        assert not await read(Register.STATUS) & Status.TOUCH
        assert await read(Register.FAULTS) == Fault.WRITE_REFUSED, "faults are sticky"
        await write(Register.CONTROL, Control.CLEAR_FAULTS)
        assert await read(Register.FAULTS) == 0

    play(body)


@pytest.mark.parametrize(("signals", "fault"), [
    (("beat_offered", "frame_first"), Fault.INPUT_STALLED), (("beat_offered",), 0),
    (("framing_fault",), Fault.FRAMING), (("engine_overrun",), Fault.OVERRUN),
])  # fmt: skip
def test_faults(signals, fault):
    async def body(ctx, dut, write, read):
        await pulse(ctx, *(getattr(dut, name) for name in signals))
        assert await read(Register.FAULTS) == fault

    play(body)


def test_finish_waits_for_everything_in_flight_and_ends_the_touch():
    async def body(ctx, dut, write, read):
        await pulse(ctx, dut.touch_started)
        assert await read(Register.TOUCHES) == 1
        ctx.set(dut.engine_busy, 1)
        await write(Register.CONTROL, Control.FINISH)
        for _ in range(100):
            assert ctx.get(dut.busy) and not ctx.get(dut.finish)
            await ctx.tick()
        ctx.set(dut.engine_busy, 0)
        await pulse(ctx, dut.moving)
        for _ in range(30):
            assert not ctx.get(dut.finish), "a beat that just left one stage may not have reached the next"
            await ctx.tick()
        finishes = 0
        for _ in range(10):
            finishes += ctx.get(dut.finish)
            await ctx.tick()
        assert finishes == 1 and not ctx.get(dut.busy)
        assert not await read(Register.STATUS) & Status.TOUCH
        await write(Register.CONTROL, Control.ARM)
        assert await read(Register.TOUCHES) == 0
        assert await read(Register.STATUS) & Status.NO_TOUCH

    play(body)


def test_arm_is_one_cycle_of_clear():
    async def body(ctx, dut, write, read):
        ctx.set(dut.bus.addr, Register.CONTROL)
        ctx.set(dut.bus.w_data, Control.ARM)
        ctx.set(dut.bus.w_stb, 1)
        assert ctx.get(dut.clear)
        await ctx.tick()
        ctx.set(dut.bus.w_stb, 0)
        assert not ctx.get(dut.clear)

    play(body)


def test_counters():
    async def body(ctx, dut, write, read):
        # a frame: first beat offered, held up for two cycles, then 3 beats
        ctx.set(dut.beat_offered, 1)
        ctx.set(dut.frame_first, 1)
        await ctx.tick().repeat(2)
        ctx.set(dut.frame_beat, 1)
        await ctx.tick()
        ctx.set(dut.frame_first, 0)
        await ctx.tick()
        ctx.set(dut.frame_last, 1)
        await ctx.tick()
        for signal in (dut.beat_offered, dut.frame_beat, dut.frame_last):
            ctx.set(signal, 0)
        assert await read(Register.FRAME_CYCLES_MAX) == 5
        # its window: complete 4 cycles after the last beat, decided 20 cycles after it; the step issued 100 slots
        await ctx.tick().repeat(2)
        await pulse(ctx, dut.slot_filled)
        await ctx.tick().repeat(9)
        ctx.set(dut.step_slots, 100)
        await pulse(ctx, dut.step_done)
        await ctx.tick().repeat(4)
        ctx.set(dut.decision_offered, 1)
        assert ctx.get(dut.step_counted) and ctx.get(dut.step_total) == 104
        await ctx.tick()
        ctx.set(dut.decision_offered, 0)
        assert await read(Register.STEP_CYCLES_MAX) == 104
        assert await read(Register.LATENCY_MAX) == 1 + 2 + 1 + 9 + 1 + 4 + 1
        await write(Register.CONTROL, Control.CLEAR_FAULTS)
        assert await read(Register.LATENCY_MAX) == 0

    play(body)
