"""rtl/interface/matrix_converter.py: every cell's code at its taxel after its time to settle, and each kind
of wrong answer."""

from __future__ import annotations

import random

import pytest

from eskin.golden.core.config import PRESETS
from eskin.golden.core.converters import ConverterFault, converter_plan
from eskin.rtl.interface.matrix_converter import MatrixConverter
from tests.support.stream_bench import Bench

FIELDS = dict(
    converter="matrix",
    rows=3,
    columns=5,
    taxels=15,
    clock_hz=2e6,
    sample_rate_hz=500.0,
    sample_bits=12,
    band_low=100,
    band_high=4000,
)


def play(codes, spoil=lambda word, cell: word, frames=2):
    """(for every frame that ended (codes by taxel, fault), addresses of select's falls with the cycles since
    they changed, cycles)."""
    plan = converter_plan(PRESETS["thesis"].replace(**FIELDS))
    dut = MatrixConverter(plan)
    bench, ended, got, samples = Bench(dut, max_cycles=50_000, quiet=10), [], {}, []

    async def chip(ctx):
        word, said, select, clock, since, at = 0, 0, 1, 0, 0, (0, 0)
        async for *_, now, level, row, column in ctx.tick().sample(
            dut.pins.cs_n, dut.pins.sclk, dut.pins.row, dut.pins.column
        ):
            since = 0 if (row, column) != at else since + 1
            at = (row, column)
            if select and not now:
                cell = row * 5 + column
                word, said = spoil(codes[cell], cell), 0
                samples.append((cell, since))
            elif not now and clock and not level:
                said += 1
            select, clock = now, level
            ctx.set(dut.pins.miso, 1 if now or said > 15 else word >> 15 - said & 1)

    async def drive(ctx):
        for _ in range(frames):
            ctx.set(dut.start, 1)
            await ctx.tick()
            ctx.set(dut.start, 0)
            cycle = 0
            while True:
                if ctx.get(dut.put.valid):
                    assert ctx.get(dut.put.place) not in got
                    got[ctx.get(dut.put.place)] = ctx.get(dut.put.code)
                if ctx.get(dut.finished):
                    break
                await ctx.tick()
                cycle += 1
            assert cycle <= plan.scan_cycles
            ended.append((dict(got), ConverterFault(ctx.get(dut.fault))))
            got.clear()
            await ctx.tick()

    bench._sim.add_testbench(chip, background=True)
    bench.process(drive)
    bench.run()
    return ended, samples, plan


def test_every_cell_at_its_taxel_when_it_has_settled():
    codes = random.Random(1).choices(range(1, 4095), k=15)
    ended, samples, plan = play(codes)
    assert ended == [(dict(enumerate(codes)), ConverterFault(0))] * 2
    assert [cell for cell, _ in samples] == list(range(15)) * 2
    assert all(since >= plan.settle for cell, since in samples[1:])


@pytest.mark.parametrize("level", [0, 0xFFFF])
def test_a_stuck_line_is_a_fault(level):
    fault = play([700] * 15, lambda word, cell: level, frames=1)[0][0][1]
    assert ConverterFault.STUCK in fault and (ConverterFault.ORDER in fault) == bool(level)


@pytest.mark.parametrize("at", [0, 14])
def test_a_leading_bit_that_is_not_zero_is_a_fault_of_that_frame_alone(at):
    seen = []

    def spoil(word, cell):
        seen.append(cell)
        return word | 1 << 13 if cell == at and len(seen) <= 15 else word

    assert [fault for _, fault in play([700] * 15, spoil)[0]] == [ConverterFault.ORDER, ConverterFault(0)]


def test_one_cell_at_its_end_is_no_fault():
    assert not play([0] + [700] * 13 + [4095], frames=1)[0][0][1]
