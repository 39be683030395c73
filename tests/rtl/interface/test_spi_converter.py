"""rtl/interface/spi_converter.py: a frame's codes at their taxels, and each kind of wrong answer."""

from __future__ import annotations

import random

import pytest

from eskin.golden.core.config import PRESETS
from eskin.golden.core.converters import ConverterFault, spi_chip, spi_plan
from eskin.rtl.interface.spi_converter import SpiConverter
from tests.support.spi_chip import SpiSlave
from tests.support.stream_bench import Bench

SLOW = dict(clock_hz=2e6, sample_rate_hz=500.0)
"""A clock at which half a period has the fewest cycles."""
FIELDS = {
    "ads7953": dict(converter="ads7953"),
    "mcp3208x2": dict(converter="mcp3208x2"),
    "in series": dict(converter="mcp3208x2", data_lines=1),
    "ad7476": dict(converter="ad7476"),
    "spi": dict(
        converter="spi",
        spi_frame_bits=24,
        spi_channels=4,
        spi_channel_bit=20,
        spi_code_bit=2,
        spi_delay=1,
        spi_tag_bits=2,
    ),
}


def frame_of(fields: dict, codes: list[int], spoil=None):
    """(codes by taxel, fault, cycles) of one frame; ``spoil(word, select, line, transfer)`` changes what a
    line says."""
    config = PRESETS["thesis"].replace(**(SLOW | fields))
    plan, chip = spi_plan(config), spi_chip(config)
    dut, channels = SpiConverter(plan, 16), plan.chip.channels
    bench, transfer = Bench(dut, quiet=10), [-1]

    def answer(line, fell):
        if line == 0:
            transfer[0] += 1
        select = fell.bit_length() - 1
        channel = transfer[0] % plan.per_select - chip.delay
        code = (
            codes[(select * plan.lines + line) * channels + channel]
            if channel >= 0
            else random.getrandbits(chip.code_bits)
        )
        word = code << chip.code_bit | (
            (channel if channel >= 0 else 9) << chip.tag_bit & (1 << chip.tag_bits + chip.tag_bit) - 1
        )
        return spoil(word, select, line, channel) if spoil else word

    slave = SpiSlave(dut.pins, chip.bits, answer)
    bench._sim.add_testbench(slave.play, background=True)
    got, result = {}, []

    async def play(ctx):
        ctx.set(dut.start, 1)
        begin = bench.cycle
        await ctx.tick()
        ctx.set(dut.start, 0)
        while True:
            if ctx.get(dut.put.valid):
                assert ctx.get(dut.put.place) not in got
                got[ctx.get(dut.put.place)] = ctx.get(dut.put.code)
            if ctx.get(dut.finished):
                result.extend([ConverterFault(ctx.get(dut.fault)), bench.cycle - begin])
                break
            await ctx.tick()
        await ctx.tick()
        assert not ctx.get(dut.busy)

    bench.process(play)
    bench.run()
    assert result[1] <= plan.scan_cycles
    return got, result[0], slave


@pytest.mark.parametrize("name", FIELDS)
def test_every_code_at_its_taxel(name):
    codes = random.Random(name).choices(range(1, 4095), k=16)
    got, fault, slave = frame_of(FIELDS[name], codes)
    assert got == dict(enumerate(codes)) and not fault
    plan = spi_plan(PRESETS["thesis"].replace(**(SLOW | FIELDS[name])))
    assert [command for _, command in slave.heard] == [command for _, command in plan.transfers]


def test_commands_are_those_of_the_data_sheets():
    plan = spi_plan(PRESETS["thesis"].replace(converter="ads7953"))
    assert [command for _, command in plan.transfers] == [0x1800 | channel << 7 for channel in range(16)] + [
        0,
        0,
    ]
    plan = spi_plan(PRESETS["thesis"].replace(converter="mcp3208x2"))
    assert [f"{command:019b}"[:5] for _, command in plan.transfers] == [
        f"11{channel:03b}" for channel in range(8)
    ]


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("level", [0, 1])
def test_a_stuck_line_is_a_fault(name, level):
    chip = spi_chip(PRESETS["thesis"].replace(**(SLOW | FIELDS[name])))
    lines = 1 if name in ("ads7953", "in series", "ad7476") else 2
    spoiled = {"ad7476": range(16)}.get(name, [lines - 1])

    def spoil(word, select, line, channel):
        return (-level & (1 << chip.bits) - 1) if line in spoiled else word

    fault = frame_of(FIELDS[name], [700 + k for k in range(16)], spoil)[1]
    assert ConverterFault.STUCK in fault
    assert (ConverterFault.ORDER in fault) == bool(chip.tag_bits or (level and chip.zeros))


@pytest.mark.parametrize("absent", [0, 1])
def test_one_chip_of_a_series_that_is_stuck_is_a_fault(absent):
    fault = frame_of(
        FIELDS["in series"],
        [700 + k for k in range(16)],
        lambda word, select, *_: 0 if select == absent else word,
    )[1]
    assert fault == ConverterFault.STUCK


def test_one_taxel_at_its_end_is_no_fault():
    assert not frame_of(FIELDS["ad7476"], [0, 4095] + [700] * 14)[1]
    assert not frame_of(FIELDS["mcp3208x2"], [0] * 7 + [700] * 9)[1]


def test_a_wrong_number_and_a_wrong_null_bit_are_faults():
    for at in (0, 5, 15):
        assert (
            frame_of(FIELDS["ads7953"], [700] * 16, lambda w, s, line, c: w ^ 0x2000 if c == at else w)[1]  # noqa: B023
            == ConverterFault.ORDER
        )
    assert (
        frame_of(
            FIELDS["mcp3208x2"], [700] * 16, lambda w, s, line, c: w | 1 << 12 if (line, c) == (1, 7) else w
        )[1]
        == ConverterFault.ORDER
    )
