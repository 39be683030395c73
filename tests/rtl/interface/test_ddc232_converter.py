"""rtl/interface/ddc232_converter.py: set-up, a frame's codes at their taxels, quiet times, and each kind of
wrong answer."""

import random
from dataclasses import replace
from itertools import pairwise
from unittest import mock

from eskin.golden.core import PRESETS, ConverterFault, converter_plan
from eskin.rtl.interface import ddc232_converter
from eskin.rtl.interface.ddc232_converter import Ddc232Converter
from tests.support.converter_bench import play_frames
from tests.support.pin_chips import DdcSlave
from tests.support.table import each_row

PERIOD, QUIET, WARM_UP = 900, 30, 2
DEADLINE = PERIOD - QUIET - (2 * 2 * 20 * 5 + 8)
"""Of DVALID: behind it come five words of 20 bits and the quiet time."""


def play(count: int, codes, spoil=lambda name, value: value, delay: int = 40, wait: int = 20, **fields):
    """The frames, and the chip; ``codes(channel)`` are the codes of inputs 1..32. The real order and formats, with
    times that a bench can wait for. ``delay``: cycles from CONV to DVALID."""
    converter = dict(name="ddc232", **fields)
    config = PRESETS["thesis"].replace(converter=converter, sample_rate_hz=1000.0, taxels=5)
    plan = replace(converter_plan(config), wait=wait, half=2, clk_half=4, quiet=QUIET)
    plan = replace(plan, deadline=PERIOD - QUIET - plan.read_cycles)
    dut = Ddc232Converter(plan, 5)
    order = range(1, 33) if fields.get("ascending") else range(32, 0, -1)
    chip = DdcSlave(dut.pins, lambda: [codes(channel) for channel in order], plan.bits, delay, spoil)
    with mock.patch.object(ddc232_converter, "WARM_UP", WARM_UP):
        return play_frames(dut, chip, count, period=PERIOD), chip


@each_row("fields, first", [(dict(), 28), (dict(bits=16, first=3, ascending=True), 3)])
def test_every_code_at_its_taxel(fields, first):
    rng = random.Random(first)
    table = [rng.getrandbits(fields.get("bits", 20)) for _ in range(33)]
    frames, chip = play(2, lambda channel: table[channel], **fields)
    expected = dict(enumerate(table[first : first + 5])), ConverterFault(0), False
    assert [frame[:3] for frame in frames] == [expected] * 2
    assert chip.configurations == [7 << 9 | (fields.get("bits", 20) == 20) << 8 | 1 << 7]
    assert len(chip.cfg_edges) == 2 * 12 and set(chip.din_edges) <= {*chip.cfg_edges[::2]}
    assert min(chip.cfg_edges[0], chip.to_readback) >= 20
    assert len(chip.conv_edges) == WARM_UP + 2
    assert {after - before for before, after in pairwise(chip.conv_edges)} == {PERIOD}
    assert {after - before for before, after in pairwise(chip.clk_edges)} == {4}
    for conv in chip.conv_edges:
        assert all(abs(edge - conv) >= QUIET for edge in chip.dclk_edges)


def test_what_is_wrong_is_told_and_the_chip_is_set_up_anew():
    counts = {"dvalid": 0, "readback": 0}

    def spoil(name, value):
        counts[name] += 1
        if name == "dvalid":
            return counts[name] != WARM_UP + 2  # of the second frame
        return value ^ 1 << 40 if counts[name] in (1, 3) else value

    frames, chip = play(5, lambda channel: 1000 + channel, spoil)
    assert [(frame.fault, frame.away) for frame in frames] == [
        (ConverterFault.READBACK, True),
        (ConverterFault(0), False),
        (ConverterFault.SILENT, False),
        (ConverterFault.READBACK, True),
        (ConverterFault(0), False),
    ]
    assert len(chip.configurations) == 4 and frames[1].codes == frames[4].codes


@each_row("delay", [QUIET - 3, QUIET - 2, DEADLINE - 8, DEADLINE - 4])
def test_no_clock_comes_near_an_edge_of_conv_whenever_dvalid_comes(delay):
    """In the quiet time behind CONV it is the DVALID of the edge before, and behind the deadline too late."""
    frames, chip = play(2, lambda channel: 1000 + channel, delay=delay)
    in_time = QUIET - 2 <= delay < DEADLINE - 4  # DVALID passes two flip-flops
    assert {frame.fault for frame in frames} == {ConverterFault(0) if in_time else ConverterFault.SILENT}
    for conv in chip.conv_edges:
        assert all(abs(edge - conv) >= QUIET for edge in chip.dclk_edges)


@each_row("level", [0, 0xFFFFF])
def test_a_stuck_line_is_a_fault_and_a_reset_lasts_its_whole_time(level):
    frames, chip = play(1, lambda channel: level, wait=1024)  # a bit more than any number below it
    assert frames[0].fault == ConverterFault.STUCK and chip.resets[0] >= 1024


def test_bits_of_the_readback_are_looked_at_but_not_those_of_the_revision():
    """The chip is set up anew behind each wrong one."""
    flips = iter([1, 1 << 40, 1 << 71, 1 << 76, 1 << 87, 1 << 72 | 1 << 75])

    def spoil(name, value):
        return value ^ next(flips) if name == "readback" else value

    frames, _ = play(6, lambda channel: 1000, spoil)
    assert [frame.fault for frame in frames] == [ConverterFault.READBACK] * 5 + [ConverterFault(0)]
