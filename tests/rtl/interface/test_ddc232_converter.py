"""rtl/interface/ddc232_converter.py: set-up, a frame's codes at their taxels, quiet times, and each kind of
wrong answer."""

from __future__ import annotations

import dataclasses
import random

import pytest

from eskin.golden.core.config import PRESETS
from eskin.golden.core.converters import ConverterFault
from eskin.golden.core.ddc232 import WARM_UP, ddc_plan
from eskin.rtl.interface.ddc232_converter import Ddc232Converter
from tests.support.pin_chips import DdcSlave
from tests.support.stream_bench import Bench

PERIOD, QUIET = 1800, 30


def plan_of(**fields):
    """The real order and formats, with times that a bench can wait for."""
    config = PRESETS["thesis"].replace(**(dict(converter="ddc232", sample_rate_hz=1000.0, taxels=5) | fields))
    plan = ddc_plan(config)
    quick = dataclasses.replace(plan, wait=20, half=2, clk_half=1, quiet=QUIET)
    return dataclasses.replace(quick, deadline=PERIOD - QUIET - quick.read_cycles)


def play(frames: int, codes, spoil=lambda name, value: value, **fields):
    """(for every frame that ended (codes by taxel, fault, was away), the slave); ``codes(channel)`` are those
    of inputs 1..32."""
    plan = plan_of(**fields)
    dut = Ddc232Converter(plan, 5)
    bench, ended, got = Bench(dut, max_cycles=100_000, quiet=10), [], {}
    order = range(1, 33) if fields.get("ddc_ascending") else range(32, 0, -1)
    slave = DdcSlave(dut.pins, lambda: [codes(channel) for channel in order], plan.bits, spoil=spoil)
    bench._sim.add_testbench(slave.play, background=True)

    async def drive(ctx):
        cycle = 0
        while len(ended) < frames:
            ctx.set(dut.start, cycle % PERIOD == 0)
            if ctx.get(dut.put.valid):
                assert ctx.get(dut.put.place) not in got
                got[ctx.get(dut.put.place)] = ctx.get(dut.put.code)
            if ctx.get(dut.finished):
                ended.append((dict(got), ConverterFault(ctx.get(dut.fault)), bool(ctx.get(dut.away))))
                got.clear()
            await ctx.tick()
            cycle += 1

    bench.process(drive)
    bench.run()
    return ended, slave


@pytest.mark.parametrize(
    ("fields", "first"),
    [
        (dict(), 28),
        pytest.param(dict(ddc_ascending=True), 1, marks=pytest.mark.slow),
        pytest.param(dict(ddc_first=20), 20, marks=pytest.mark.slow),
        (dict(ddc_bits=16, ddc_first=3, ddc_ascending=True), 3),
    ],
)
def test_every_code_at_its_taxel(fields, first):
    rng = random.Random(first)
    table = [rng.getrandbits(fields.get("ddc_bits", 20)) for _ in range(33)]
    ended, slave = play(2, lambda channel: table[channel], **fields)
    assert ended == [({taxel: table[first + taxel] for taxel in range(5)}, ConverterFault(0), False)] * 2
    assert slave.configurations == [7 << 9 | (fields.get("ddc_bits", 20) == 20) << 8 | 1 << 7]
    assert len(slave.conv_edges) == WARM_UP + 2 and {
        b - a for a, b in zip(slave.conv_edges, slave.conv_edges[1:], strict=False)
    } == {PERIOD}
    for conv in slave.conv_edges:
        assert all(abs(edge - conv) >= QUIET for edge in slave.dclk_edges)


def test_what_is_wrong_is_told_and_the_chip_is_set_up_anew():
    asked = {"dvalid": 0, "readback": 0}

    def spoil(name, value):
        asked[name] += 1
        if name == "dvalid":
            return asked[name] != WARM_UP + 2  # of the second frame
        return value ^ 1 << 40 if asked[name] in (1, 3) else value

    ended, slave = play(5, lambda channel: 1000 + channel, spoil)
    assert [(fault, away) for _, fault, away in ended] == [
        (ConverterFault.READBACK, True),
        (ConverterFault(0), False),
        (ConverterFault.SILENT, False),
        (ConverterFault.READBACK, True),
        (ConverterFault(0), False),
    ]
    assert len(slave.configurations) == 4 and ended[1][0] == ended[4][0]


@pytest.mark.parametrize("bit", range(88))
@pytest.mark.slow
def test_every_bit_of_the_readback_is_looked_at_but_those_of_the_revision(bit):
    ended, _ = play(
        1, lambda channel: 1000, lambda name, value: value ^ 1 << bit if name == "readback" else value
    )
    assert (ended[0][1] == ConverterFault.READBACK) == (not 72 <= bit < 76)


@pytest.mark.parametrize("level", [0, pytest.param(0xFFFFF, marks=pytest.mark.slow)])
def test_a_stuck_line_is_a_fault(level):
    assert play(1, lambda channel: level)[0][0][1] == ConverterFault.STUCK
