"""rtl/top/sensing.py: a broken frame arms the chain, once, in the first cycle in which nobody needs the bus
and no frame is handed on."""

import random

from eskin.golden.core import PRESETS, ConverterFault, converter_plan
from eskin.rtl.interface.acquisition import Acquisition
from eskin.rtl.program.memory_map import Control, Register
from eskin.rtl.top import sensing
from tests.support.silent import Silent
from tests.support.stream_bench import simulate

ARM = (int(Register.CONTROL), int(Control.ARM))


def test_the_arm_after_a_broken_frame_waits_for_bus_and_frame(monkeypatch):
    acquisition_of, accelerator_of = sensing.Acquisition, sensing.Accelerator
    monkeypatch.setattr(sensing, "Acquisition", lambda *arguments: Silent(acquisition_of(*arguments)))
    monkeypatch.setattr(sensing, "Accelerator", lambda *arguments: Silent(accelerator_of(*arguments)))
    dut = sensing.Sensing(PRESETS["thesis"].replace(converter="ads7953"))
    rng, seen = random.Random(1), []

    async def play(ctx):
        acquisition, bus, inner, waits = dut.acquisition, dut.bus, dut.accelerator.bus, False
        for _ in range(600):
            handing, writes, reads, broken = (rng.random() < share for share in (0.4, 0.3, 0.3, 0.1))
            access = (rng.randrange(1 << len(bus.addr)), rng.randrange(1 << len(bus.w_data)))
            for signal, value in (
                (acquisition.handing, handing),
                (acquisition.broken, broken),
                (bus.addr, access[0]),
                (bus.w_data, access[1]),
                (bus.w_stb, writes),
                (bus.r_stb, reads),
            ):
                ctx.set(signal, value)
            got = (ctx.get(inner.addr), ctx.get(inner.w_data))
            arms = waits and not (handing or writes or reads)
            assert (ctx.get(inner.w_stb), ctx.get(inner.r_stb)) == (writes or arms, reads)
            assert got == (ARM if arms else access) and ctx.get(dut.busy) == (handing or waits)
            seen.append((waits, handing, writes, reads))
            waits = not arms and (waits or broken)
            await ctx.tick()

    simulate(dut, play)
    single = {
        (True, True, False, False),
        (True, False, True, False),
        (True, False, False, True),
        (True, False, False, False),
    }
    assert single <= set(seen)


def test_a_converter_s_faults_are_known_when_its_scan_ends_and_a_scan_that_is_missed_at_once():
    config = PRESETS["thesis"].replace(converter="ads7953")
    dut = Acquisition(config, plan=converter_plan(config).sleeping)
    dut.converter = converter = Silent(dut.converter)
    rng, late = random.Random(2), int(ConverterFault.LATE)

    async def play(ctx):
        for _ in range(200):
            finished, run, busy, away = (rng.random() < 0.5 for _ in range(4))
            faults, missed = rng.randrange(1 << len(dut.fault)) & ~late, run and busy and not away
            for signal, value in ((converter.finished, finished), (converter.fault, faults), (dut.run, run)):
                ctx.set(signal, value)
            ctx.set(converter.busy, busy)
            ctx.set(converter.away, away)
            assert ctx.get(dut.fault) == finished * faults | missed * late
            assert ctx.get(dut.broken) >= missed
            await ctx.tick()

    simulate(dut, play)
