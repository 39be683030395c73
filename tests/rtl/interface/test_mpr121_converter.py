"""rtl/interface/mpr121_converter.py and i2c_master.py: bytes written, cells between electrodes, each kind
of wrong answer."""

import dataclasses
import random

import numpy as np

from eskin.golden.core import PRESETS, ConverterFault, converter_plan
from eskin.golden.core.converters import mpr121
from eskin.rtl.interface.mpr121_converter import Mpr121Converter
from tests.support.converter_bench import play_frames
from tests.support.pin_chips import MprSlave
from tests.support.table import each_row

SMALL = PRESETS["thesis"].replace(
    converter="mpr121",
    rows=5,
    columns=3,
    taxels=15,
    sample_rate_hz=100.0,
    sample_bits=11,
    band_low=100,
    band_high=2000,
)
TWO = SMALL.replace(rows=6, columns=7, taxels=42, converter=dict(name="mpr121", chips=2))


def play(config, count: int, electrodes, spoil=lambda chip, ended: None, *, first=50, interval=0):
    """The frames, the chips and the plan; ``first``: cycles before the chip's first data."""
    plan = dataclasses.replace(converter_plan(config), quarter=3, reset=20, first=first, interval=interval)
    dut = Mpr121Converter(plan)
    chip = MprSlave(dut.pins, electrodes)
    return play_frames(dut, chip, count, between=lambda ended: spoil(chip, ended)), chip, plan


@each_row("config, cycles", [(SMALL, 1947), (TWO, 4559)])
def test_every_cell_of_its_electrodes(config, cycles):
    rng = random.Random(3)
    table = {address: [rng.randrange(1024) for _ in range(12)] for address in (0x5A, 0x5B)}
    frames, chip, plan = play(config, 1 + (config is SMALL), table.__getitem__)
    own = np.array([[*table[0x5A][: plan.electrodes[0]], *table[0x5B][: sum(plan.electrodes[1:])]]])
    cells = dict(enumerate(plan.from_pins(own, config)[0].tolist()))
    assert [frame[:3] for frame in frames] == [(cells, ConverterFault(0), False)] * len(frames)
    assert {frame.cycles for frame in frames} == {cycles} and cycles <= plan.scan_cycles
    assert chip.shortest == 2 * plan.quarter
    set_up = [(0x80, 0x63), (0x5E, 0), *((0x41 + k, (12, 6)[k % 2]) for k in range(24))]
    set_up += [(0x5C, 0x10), (0x5D, 0x20), (0x5E, 0x8F)]
    assert chip.written == [(0x5A + chip, *word) for chip in range(plan.chips) for word in set_up]
    waits = {(0x80, 0x63): plan.reset, (0x5E, 0): 0, (0x58, 6): 0, (0x5D, 0x20): 0}
    for address in range(0x5A, 0x5A + plan.chips):
        assert [chip.pauses[address, *word] for word in waits] == [{16 + cycles} for cycles in waits.values()]
    assert max(chip.pauses[address, 0x5E, 0x8F]) == 18 + plan.first  # and the frame is asked for


REST, ZEROS, FULL, RUNNING = [700 + k for k in range(12)], [0] * 12, [1023] * 12, 0x8F
FAULTS = {
    SMALL: [
        (0x5A, {"config2": 0}, REST, ConverterFault.READBACK),
        (0x5A, {}, REST, ConverterFault(0)),
        (0x5A, {"silent": {0x5A}}, REST, ConverterFault.SILENT),
        (0x5A, {"upper": 4}, REST, ConverterFault.ORDER),
        (0x5A, {}, FULL, ConverterFault.STUCK),
        (0x5A, {}, REST, ConverterFault(0)),
        (0x5A, {"ecr": 0}, REST, ConverterFault.READBACK),  # it has lost its supply
    ],
    TWO: [
        (0x5B, {}, ZEROS, ConverterFault.STUCK),
        (0x5A, {}, ZEROS, ConverterFault.STUCK),
        (0x5B, {}, [1, *ZEROS[1:]], ConverterFault(0)),
        (0x5A, {}, FULL, ConverterFault(0)),  # the other chip's are not
        (0x5B, {"ecr": RUNNING - 1}, REST, ConverterFault.READBACK),
    ],
}
"""Of a frame: a chip, its fault, its electrodes, the frame's flags."""


@each_row("config", FAULTS)
def test_what_is_wrong_with_a_chip_is_told_and_all_are_set_up_anew(config):
    table, rows = {0x5A: REST, 0x5B: REST}, FAULTS[config]

    def spoil(chip, ended):
        address, wrong, codes, _ = rows[min(ended, len(rows) - 1)]
        table.update({0x5A: REST, 0x5B: REST, address: codes})
        chip.config2, chip.silent, chip.upper = 0x24, set(), 0
        for name, value in wrong.items():
            if name == "ecr":
                chip.ecr[address] = value
            else:
                setattr(chip, name, value)

    frames, chip, plan = play(config, len(rows), table.__getitem__, spoil)
    assert [frame.fault for frame in frames] == [fault for *_, fault in rows]
    assert [frame.away for frame in frames] == ["config2" in wrong for _, wrong, *_ in rows]
    if config is SMALL:
        own = np.array([REST[: sum(plan.electrodes)]])
        assert frames[1].codes == frames[-2].codes == dict(enumerate(plan.from_pins(own, config)[0].tolist()))
    faults = sum(map(bool, (fault for *_, fault in rows[:-1])))
    assert chip.written.count((0x5A + plan.chips - 1, 0x5E, RUNNING)) == faults + (config is TWO)
    assert chip.idle >= 9 * faults  # the bus is freed before each


def test_the_chip_has_its_time_before_its_first_data():
    early, late = (play(SMALL, 1, lambda address: REST, first=first)[0][0].end for first in (50, 500))
    assert late - early == 450
    plan = converter_plan(SMALL.replace(converter=dict(name="mpr121", hz=1e5)), 12e6)
    assert (plan.quarter, plan.reset, plan.first) == (30, 12_000, 120_000)
    rare = converter_plan(
        SMALL.replace(sample_rate_hz=10.0), 12e6
    ).sleeping  # a sample in 16 ms, four within 90
    assert (rare.first, rare.interval) == (16 * 120_000, 4)
    chip = play(SMALL, 1, lambda address: REST, interval=4)[1]
    assert (0x5A, 0x5D, 0x24) in chip.written


def test_electrodes_of_cells_are_the_codes_that_make_them():
    config = SMALL.replace(rows=13, columns=9, taxels=117)
    plan = converter_plan(config)
    cells = plan.from_pins(np.random.default_rng(1).integers(0, 1024, (50, 12)), config)
    assert cells.min() >= 0 and cells.max() <= mpr121.FULL
    # a touch on one cell lowers its row and its column, and is seen there alone
    rest = np.full((1, 12), 800)
    rest[0, [2, 5 + 3]] = 300
    seen = plan.from_pins(rest, config)[0].reshape(13, 9)
    assert seen[6, 4] == seen.max() == mpr121.FULL - 600 and (seen == seen.max()).sum() == 1
    again = plan.from_pins(plan.to_pins(seen.reshape(1, -1), config), config)[0].reshape(13, 9)
    assert again[6, 4] == seen[6, 4]
