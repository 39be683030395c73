"""Faults that `make mutants` showed no test to see; each test fails on its mutant."""

from __future__ import annotations

from amaranth.hdl import signed
from amaranth.sim import Simulator

from golden import formats
from golden.config import PRESETS
from golden.formats import QFormat
from rtl import fixed
from rtl.control import HostControl
from rtl.memory_map import Register
from rtl.microcode import Microcode
from rtl.schedule import schedule
from rtl.sequencer import Sequencer
from tests import test_activation_unit, test_lanes
from tests.test_accelerator import Host
from tests.test_rtl_fixed import evaluate, span


def test_a_signed_value_as_wide_as_an_unsigned_format_saturates():
    target = QFormat(5, 0, False)
    codes = list(span(signed(5)))
    got, _ = evaluate(signed(5), lambda value: fixed.saturate(value, target), codes)
    assert got == [formats.clamp(code, target) for code in codes]


def test_tanh_may_reach_one_where_codes_are_coarse():
    """tanh(4) rounds to 1.0 with 8 fraction bits: the complement of the code needs every bit of the state's format."""
    test_activation_unit.test_hardware_gives_every_entry_one_cycle_later({"state_format": QFormat(2, 8)})


def test_a_sum_may_start_from_either_end_of_the_accumulator():
    ends = [-(1 << test_lanes.ACC_BITS - 1), (1 << test_lanes.ACC_BITS - 1) - 1]
    test_lanes.play("plain", False, True, [(end, [(0, 0)]) for end in ends], slot=1)


def test_a_register_that_wakes_up_with_ones_has_the_right_parity():
    dut, flags = HostControl(PRESETS["thesis"].replace(checksum=True, masked_taxels=(3,))), []

    async def bench(ctx):
        host = Host(dut, ctx)
        await ctx.tick().repeat(3)
        flags.append(await host.read(Register.FAULTS))

    sim = Simulator(dut)
    sim.add_clock(1e-6)
    sim.add_testbench(bench)
    sim.run()
    assert flags == [0]


def test_a_checked_program_is_found_right_word_by_word_and_a_changed_word_wrong():
    small = {"taxels": 4, "hidden": 4, "state_format": QFormat(4, 12), "lanes": 3, "checksum": True}

    class Changed(Sequencer):
        """Bit ``turns`` of one word inverted, without its parity."""

        def elaborate(self, platform):
            m = super().elaborate(platform)
            init = m.submodules.program.init
            init[0] = {**init[0], "turns": 1 - init[0]["turns"]}
            return m

    found = []
    for kind in (Sequencer, Changed):
        code = Microcode(schedule(PRESETS["thesis"].replace(**small)))
        dut, wrong = kind(code), set()

        async def bench(ctx, dut=dut, wrong=wrong, code=code):
            ctx.set(dut.tick, 1)
            ctx.set(dut.go, 1)
            for _ in range(2 * len(code.unrolled())):
                wrong.add((await ctx.tick().sample(dut.enable, dut.wrong))[-2:])

        sim = Simulator(dut)
        sim.add_clock(1e-6)
        sim.add_testbench(bench)
        sim.run()
        found.append((1, 1) in wrong)
    assert found == [False, True]
