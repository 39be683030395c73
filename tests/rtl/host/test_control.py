"""The host's registers on their own: commands, masks, refused writes, sticky faults, counters."""

from __future__ import annotations

from amaranth.sim import Simulator

from eskin.golden.core.config import PRESETS
from eskin.rtl.common.load_port import load_lines
from eskin.rtl.host.control import HostControl
from eskin.rtl.program.memory_map import (
    ID_VALUE,
    VERSION_VALUE,
    Control,
    Fault,
    Measure,
    Memory,
    Register,
    Status,
)
from tests.support.table import each_row


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


async def begin_or_end(ctx, event):
    """A touch begins or is decided; it is known a cycle later."""
    await pulse(ctx, event)
    await ctx.tick()


def test_identity_masks_and_unknown_addresses():
    async def body(ctx, dut, write, read):
        assert (await read(Register.ID), await read(Register.VERSION)) == (ID_VALUE, VERSION_VALUE)
        assert ctx.get(dut.mask) == 1 << 1 | 1 << 17
        await write(Register.MASK + 1, 0xFFFF)
        assert ctx.get(dut.mask) == 1 << 1 | 0xF << 16, "20 taxels leave 4 bits in the second word"
        await write(Register.MASK, 0)
        assert ctx.get(dut.mask) == 0xF << 16
        assert await read(0x0F) == 0

    play(body)


@each_row(
    ("changes", "there"),
    [({}, {*range(10), 0x10, 0x11}), ({"fault_frames": 16}, {*range(10), 0x10, 0x11, 0x20, 0x21})],
)
def test_an_address_without_a_register_reads_zero_writes_nothing_and_is_flagged(changes, there):
    """Five bits of it were decoded: writing 0x22 armed, reading 0x20 gave the identity."""

    async def body(ctx, dut, write, read):
        mask, longest = ctx.get(dut.mask), await read(Register.LONGEST)
        assert await read(Register.FAULTS) == 0
        for address in range(256):
            ctx.set(dut.bus.addr, address)
            await ctx.tick()
            assert await read(Register.FAULTS) == 0, "only an access counts"
            value = await read(address)
            assert address in there or value == 0, hex(address)
            assert await read(Register.FAULTS) == (0 if address in there else Fault.ADDRESS), hex(address)
            await write(Register.CONTROL, Control.CLEAR_FAULTS)
            if address in there:
                continue
            ctx.set(dut.bus.addr, address)
            for word in (0xFFFF, 1, 2):
                ctx.set(dut.bus.w_data, word)
                ctx.set(dut.bus.w_stb, 1)
                assert not ctx.get(dut.load.enable), hex(address)
                await ctx.tick()
                ctx.set(dut.bus.w_stb, 0)
                assert not ctx.get(dut.clear) and not ctx.get(dut.restart) and not ctx.get(dut.busy), hex(
                    address
                )
            assert ctx.get(dut.mask) == mask and await read(Register.LONGEST) == longest, hex(address)
            assert await read(Register.FAULTS) == Fault.ADDRESS, hex(address)
            await write(Register.CONTROL, Control.CLEAR_FAULTS)

    play(body, **changes)


def test_loading_counts_the_address_up_and_is_refused_during_a_touch():
    async def body(ctx, dut, write, read):
        await write(Register.MEMORY_SELECT, Memory.MEANS)
        ctx.set(dut.bus.addr, Register.MEMORY_DATA)
        ctx.set(dut.bus.w_data, 0xBEEF)
        ctx.set(dut.bus.w_stb, 1)
        load, line = dut.load, {select: 1 << line for select, line in load_lines(dut._config).items()}
        assert [ctx.get(s) for s in (load.enable, load.select, load.address, load.data)] == [
            1,
            line[Memory.MEANS],
            0,
            0xBEEF,
        ]
        await ctx.tick()
        assert ctx.get(load.address) == 1
        ctx.set(dut.bus.w_stb, 0)
        await write(Register.MEMORY_SELECT, Memory.CONSTANTS)
        assert (ctx.get(load.select), ctx.get(load.address)) == (line[Memory.CONSTANTS], 0), (
            "a memory is loaded from its first word on"
        )
        await begin_or_end(ctx, dut.touch_started)
        assert await read(Register.STATUS) & Status.TOUCH
        ctx.set(dut.bus.addr, Register.MEMORY_DATA)
        ctx.set(dut.bus.w_stb, 1)
        assert ctx.get(load.enable) == 0
        await ctx.tick()
        ctx.set(dut.bus.w_stb, 0)
        assert ctx.get(load.address) == 0, "the next word goes where the refused one would have"
        assert await read(Register.FAULTS) == Fault.WRITE_REFUSED
        await begin_or_end(ctx, dut.global_taken)
        assert not await read(Register.STATUS) & Status.TOUCH
        assert await read(Register.FAULTS) == Fault.WRITE_REFUSED, "faults are sticky"
        await write(Register.CONTROL, Control.CLEAR_FAULTS)
        assert await read(Register.FAULTS) == 0

    play(body)


def test_a_touch_that_begins_before_the_decision_of_the_last_is_taken_stays_open():
    async def body(ctx, dut, write, read):
        await pulse(ctx, dut.touch_started)
        await pulse(ctx, dut.touch_started)
        await pulse(ctx, dut.touch_started, dut.global_taken)
        for still_open in (True, False):
            await begin_or_end(ctx, dut.global_taken)
            assert bool(await read(Register.STATUS) & Status.TOUCH) == still_open
            await write(Register.MEMORY_DATA, 1)
            assert bool(await read(Register.FAULTS) & Fault.WRITE_REFUSED) == still_open
            await write(Register.CONTROL, Control.CLEAR_FAULTS)

    play(body)


def test_four_touches_may_wait_for_their_decisions():
    async def body(ctx, dut, write, read):
        assert not ctx.get(dut.busy), "after a reset nothing is in flight"
        ctx.set(dut.touch_started, 1)
        await ctx.tick().repeat(4)
        ctx.set(dut.touch_started, 0)
        for still_open in (True, True, True, False):
            await begin_or_end(ctx, dut.global_taken)
            assert bool(await read(Register.STATUS) & Status.TOUCH) == still_open

    play(body)


@each_row(
    ("signals", "fault"),
    [
        (("beat_offered", "frame_first"), Fault.INPUT_STALLED),
        (("beat_offered",), 0),
        (("framing_fault",), Fault.FRAMING),
        (("engine_overrun",), Fault.OVERRUN),
    ],
)
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
        await pulse(ctx, dut.moving)
        ctx.set(dut.engine_busy, 0)
        for _ in range(14):
            assert not ctx.get(dut.finish), "a beat that just left one stage may not have reached the next"
            await ctx.tick()
        finishes = 0
        for _ in range(10):
            finishes += ctx.get(dut.finish)
            await ctx.tick()
        assert finishes == 1 and not ctx.get(dut.busy)
        assert not await read(Register.STATUS) & Status.TOUCH
        await write(Register.CONTROL, Control.ARM)
        await ctx.tick()
        assert await read(Register.TOUCHES) == 0
        assert await read(Register.STATUS) & Status.NO_TOUCH

    play(body)


def test_arm_is_one_cycle_of_clear_after_the_write():
    async def body(ctx, dut, write, read):
        assert not ctx.get(dut.clear)
        await write(Register.CONTROL, Control.ARM)
        assert ctx.get(dut.clear) and ctx.get(dut.restart) and ctx.get(dut.busy)
        await ctx.tick()
        assert not ctx.get(dut.clear) and not ctx.get(dut.restart)

    play(body)


def test_a_written_word_restarts_the_engine_alone():
    async def body(ctx, dut, write, read):
        await write(Register.MEMORY_DATA, 1)
        assert ctx.get(dut.restart) and not ctx.get(dut.clear)
        await ctx.tick()
        assert not ctx.get(dut.restart)
        await begin_or_end(ctx, dut.touch_started)
        await write(Register.MEMORY_DATA, 1)
        assert not ctx.get(dut.restart), "a refused word changes nothing"

    play(body)


def test_touches_count_modulo_256():
    async def body(ctx, dut, write, read):
        ctx.set(dut.touch_started, 1)
        await ctx.tick().repeat(300)
        ctx.set(dut.touch_started, 0)
        assert await read(Register.TOUCHES) == 300 - 256 and not await read(Register.STATUS) & Status.NO_TOUCH
        await write(Register.CONTROL, Control.ARM)
        await ctx.tick()
        assert await read(Register.TOUCHES) == 0

    play(body)


def test_a_mask_or_measure_as_it_woke_up_or_was_written_is_no_fault():
    """Each with an odd and an even number of ones; what is written above a register's last bit does not
    count."""

    async def body(ctx, dut, write, read):
        await ctx.tick()
        assert await read(Register.FAULTS) == 0, "masks wake up with one taxel each"
        for register in (Register.MASK, Register.MASK + 1, Register.MEASURE):
            for word in (1, 3, 0xFFFF, 0x7FFF, 0x10, 0x20, 4, 0):
                await write(register, word)
                await ctx.tick()
                assert await read(Register.FAULTS) == 0, (register, word)

    play(body, checksum=True)


def test_write_only_registers_read_zero():
    async def body(ctx, dut, write, read):
        for register in (Register.CONTROL, Register.MEASURE, Register.MEMORY_SELECT, Register.MASK):
            await write(register, 2 if register == Register.MEASURE else 0xFFF0)
            assert await read(register) == 0

    play(body)


async def idle(ctx, cycles: int) -> None:
    for _ in range(cycles):
        await ctx.tick()


async def frame(ctx, dut, held: int, beats: int) -> None:
    """A frame whose first beat is held up for ``held`` cycles."""
    ctx.set(dut.beat_offered, 1)
    ctx.set(dut.frame_first, 1)
    await idle(ctx, held)
    ctx.set(dut.frame_beat, 1)
    for beat in range(beats):
        ctx.set(dut.frame_first, beat == 0)
        ctx.set(dut.frame_last, beat == beats - 1)
        await ctx.tick()
    for signal in (dut.beat_offered, dut.frame_beat, dut.frame_last):
        ctx.set(signal, 0)


async def step(ctx, dut, slots: int, pause: int = 0) -> None:
    """A step of ``slots`` slots, ``pause`` idle cycles before each."""
    for slot in range(slots):
        await idle(ctx, pause)
        ctx.set(dut.slot_done, 1)
        ctx.set(dut.step_done, slot == slots - 1)
        await ctx.tick()
        ctx.set(dut.slot_done, 0)
        ctx.set(dut.step_done, 0)


async def windows(ctx, dut, cycles: int) -> None:
    ctx.set(dut.windows_open, 1)
    await idle(ctx, cycles)
    ctx.set(dut.windows_open, 0)
    await ctx.tick()


def test_the_counter_measures_what_is_asked_for():
    """Frame, step and window go on at the same time; only the named one counts, and the longest stays."""

    async def everything(ctx, dut):
        await frame(ctx, dut, 2, 3)
        await step(ctx, dut, 7)
        await windows(ctx, dut, 11)
        await idle(ctx, 3)
        await frame(ctx, dut, 0, 3)
        await step(ctx, dut, 6, pause=2)
        await windows(ctx, dut, 4)

    async def body(ctx, dut, write, read):
        for measure, longest in (
            (Measure.FRAME, 5),
            (Measure.STEP, 7),
            (Measure.WINDOWS, 11),
            (Measure.FRAME, 5),
        ):
            await write(Register.MEASURE, measure)
            assert await read(Register.LONGEST) == 0, "writing MEASURE begins anew"
            await everything(ctx, dut)
            assert await read(Register.LONGEST) == longest, measure
        await write(Register.CONTROL, Control.CLEAR_FAULTS)
        assert await read(Register.LONGEST) == 0
        await frame(ctx, dut, 1, 3)
        await ctx.tick()
        assert await read(Register.LONGEST) == 4

    play(body)


@each_row(
    ("measure", "lengths"),
    [
        (Measure.FRAME, [3, 5, 4, 6, 1]),
        (Measure.STEP, [4, 4, 9, 2, 10, 1]),
        (Measure.WINDOWS, [2, 8, 8, 9, 3]),
    ],
)
def test_the_longest_of_many(measure, lengths):
    async def body(ctx, dut, write, read):
        await write(Register.MEASURE, measure)
        for k, length in enumerate(lengths):
            if measure == Measure.FRAME:
                await frame(ctx, dut, length - 1, 1)
            elif measure == Measure.STEP:
                await step(ctx, dut, length, pause=k % 2)
            else:
                await windows(ctx, dut, length)
            await idle(ctx, k % 3)
            await ctx.tick()  # events are registered before they count
            assert await read(Register.LONGEST) == max(lengths[: k + 1])

    play(body)


def test_the_counter_saturates_and_arm_forgets_what_is_under_way():
    async def body(ctx, dut, write, read):
        await write(Register.MEASURE, Measure.WINDOWS)
        ctx.set(dut.windows_open, 1)
        await idle(ctx, 40)
        await write(Register.CONTROL, Control.ARM)
        ctx.set(dut.windows_open, 0)
        await ctx.tick()
        seen = await read(Register.LONGEST)
        await windows(ctx, dut, seen)
        assert await read(Register.LONGEST) == seen, "a count begun before the arm went on after it"
        ctx.set(dut.windows_open, 1)
        await ctx.tick().repeat(66_000)
        assert await read(Register.LONGEST) == 0xFFFF

    play(body)
