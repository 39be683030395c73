"""The host's registers alone: commands, masks, refused writes, sticky faults, measured cycles.

What a write during a touch and an access to no register may not change is proved in formal/host/control.py.
"""

from operator import attrgetter

from eskin.golden.core import PRESETS
from eskin.rtl.common import load_lines
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
from tests.support.stream_bench import bus_accesses, put, simulate
from tests.support.table import each_row


def play(body, **changes):
    """Run ``async body(ctx, dut, write, read)`` on a HostControl of 20 taxels."""
    sensor = dict(taxels=20, masked_taxels=(1, 17))
    dut = HostControl(PRESETS["thesis"].replace(**sensor | changes))

    async def bench(ctx):
        ctx.set(dut.decider_idle, 1)
        await body(ctx, dut, *bus_accesses(ctx, dut.bus))

    simulate(dut, bench)


async def pulse(ctx, *signals, cycles=1):
    for signal in signals:
        ctx.set(signal, 1)
    await ctx.tick().repeat(cycles)
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
        for register in (Register.CONTROL, Register.MEASURE, Register.MEMORY_SELECT, Register.MASK):
            await write(register, 2 if register == Register.MEASURE else 0xFFF0)
            assert await read(register) == 0, "write only"

    play(body)


@each_row("checksum", [False, True])
def test_loading_and_a_refused_write(checksum):
    """During a touch, and with a checksum behind the memory's end."""

    async def body(ctx, dut, write, read):
        load, line = dut.load, {select: 1 << line for select, line in load_lines(dut._config).items()}
        assert ctx.get(load.select) == line[0]
        await write(Register.MEMORY_SELECT, Memory.MEANS)
        for address in range(2):
            assert (ctx.get(load.select), ctx.get(load.address)) == (line[Memory.MEANS], address)
            await write(Register.MEMORY_DATA, 0xBEEF)
            assert ctx.get(load.data) == 0xBEEF and ctx.get(dut.restart) and not ctx.get(dut.clear)
        await ctx.tick()
        assert not ctx.get(dut.restart)
        await begin_or_end(ctx, dut.detector.started)
        assert await read(Register.STATUS) & Status.TOUCH
        await write(Register.MEMORY_DATA, 1)
        assert ctx.get(load.address) == 2 and not ctx.get(dut.restart), "a refused word changes nothing"
        assert await read(Register.FAULTS) == Fault.WRITE_REFUSED
        await begin_or_end(ctx, dut.global_taken)
        assert not await read(Register.STATUS) & Status.TOUCH
        assert await read(Register.FAULTS) == Fault.WRITE_REFUSED, "faults are sticky"
        await write(Register.CONTROL, Control.CLEAR_FAULTS)
        await write(Register.MEMORY_SELECT, 0)
        for words, fault in ((64, 0), (1, Fault.WRITE_REFUSED * checksum)):
            for _ in range(words):
                await write(Register.MEMORY_DATA, 1)
            assert await read(Register.FAULTS) == fault

    play(body, checksum=checksum, taxels=16, masked_taxels=(), hidden=4, lanes=4)


@each_row(
    "signals, fault",
    [
        (("frames.offered", "frames.first"), Fault.INPUT_STALLED),
        (("frames.offered",), 0),
        (("detector.framing_fault",), Fault.FRAMING),
        (("engine.overrun",), Fault.OVERRUN),
        (("detector.raised",), Fault.TAXEL),
        (("hung",), Fault.WATCHDOG),
        (("check_failed",), Fault.CHECKSUM),
    ],
)
def test_faults(signals, fault):
    async def body(ctx, dut, write, read):
        await pulse(ctx, *(attrgetter(name)(dut) for name in signals))
        assert await read(Register.FAULTS) == fault
        broken = fault in (Fault.WATCHDOG, Fault.CHECKSUM)
        assert bool(await read(Register.STATUS) & Status.FAULT) == broken
        await write(Register.CONTROL, Control.CLEAR_FAULTS)
        assert await read(Register.FAULTS) == 0

    play(body, fault_frames=16, watchdog=True, checksum=True)


def test_a_mask_or_measure_as_it_woke_up_or_was_written_is_no_fault():
    """Each with an odd and an even number of ones; bits written above a register's last bit do not
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


def test_the_counter_measures_what_is_asked_for():
    """Frame, step and window go on at the same time; only the named one counts, and the longest stays. That it counts
    to its end and begins anew is proved in formal/host/cycle_counter.py."""

    async def body(ctx, dut, write, read):
        for measure, longest in ((Measure.FRAME, 6), (Measure.STEP, 7), (Measure.WINDOWS, 11)):
            await write(Register.MEASURE, measure)
            assert await read(Register.LONGEST) == 0, "writing MEASURE begins anew"
            for words, slots, cycles in ((3, 6, 11), (1, 5, 4), (1, 5, 4)):
                put(ctx, dut.frames, offered=1, first=1)
                await ctx.tick().repeat(words)
                for beat in range(3):
                    put(ctx, dut.frames, first=beat == 0, last=beat == 2)
                    await pulse(ctx, dut.frames.taken)
                put(ctx, dut.frames, offered=0, last=0)
                await pulse(ctx, dut.engine.slot_done, cycles=slots)
                await ctx.tick().repeat(3)
                await pulse(ctx, dut.engine.slot_done, dut.engine.step_done)
                # slots that an engine issues before it begins anew are issued again
                await pulse(ctx, dut.engine.slot_done, cycles=4)
                await write(Register.MEMORY_SELECT, Memory.MEANS)
                await (pulse(ctx, dut.anew) if words == 3 else write(Register.MEMORY_DATA, 0))
                await pulse(ctx, dut.engine.windows_open, cycles=cycles)
                await ctx.tick().repeat(2)
            assert await read(Register.LONGEST) == longest, measure
        for command in (Control.ARM, Control.CLEAR_FAULTS):
            await write(Register.CONTROL, command)
        assert await read(Register.LONGEST) == 0

    play(body)
