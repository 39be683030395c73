"""rtl/interface/mpr121_converter.py and i2c_master.py: what is written, cells between electrodes, each kind
of wrong answer."""

from __future__ import annotations

import dataclasses
import random

import numpy as np
import pytest

from eskin.golden.core import mpr121
from eskin.golden.core.config import PRESETS
from eskin.golden.core.converters import ConverterFault
from eskin.golden.core.mpr121 import cells_of, mpr_plan
from eskin.rtl.interface.mpr121_converter import Mpr121Converter
from tests.support.pin_chips import MprSlave
from tests.support.stream_bench import Bench

SMALL = dict(
    converter="mpr121",
    rows=5,
    columns=3,
    taxels=15,
    sample_rate_hz=100.0,
    sample_bits=11,
    band_low=100,
    band_high=2000,
)
TWO = SMALL | dict(rows=6, columns=7, taxels=42, mpr_chips=2)


def play(
    frames: int,
    electrodes,
    spoil=lambda slave, ended: None,
    *,
    first=50,
    ends: list[int] | None = None,
    **fields,
):
    """(for every frame that ended (codes by taxel, fault, was away), the slave, cycles of each frame, the
    plan); ``first`` cycles before the chip's first data; to ``ends`` the cycle in which each frame ended."""
    config = PRESETS["thesis"].replace(**(SMALL | fields))
    plan = dataclasses.replace(mpr_plan(config), quarter=3, reset=20, first=first)
    dut = Mpr121Converter(plan)
    bench, ended, got, took = Bench(dut, max_cycles=100_000, quiet=10), [], {}, []
    slave = MprSlave(dut.pins, electrodes)
    bench._sim.add_testbench(slave.play, background=True)

    async def drive(ctx):
        begun, cycle = 0, 0
        while len(ended) < frames:
            spoil(slave, len(ended))
            wanted = not ctx.get(dut.busy) and not ctx.get(dut.away)
            ctx.set(dut.start, wanted)
            begun = cycle if wanted else begun
            if ctx.get(dut.put.valid):
                assert ctx.get(dut.put.place) not in got
                got[ctx.get(dut.put.place)] = ctx.get(dut.put.code)
            if ctx.get(dut.finished):
                ended.append((dict(got), ConverterFault(ctx.get(dut.fault)), bool(ctx.get(dut.away))))
                took.append(cycle - begun)
                if ends is not None:
                    ends.append(cycle)
                got.clear()
            await ctx.tick()
            cycle += 1

    bench.process(drive)
    bench.run()
    return ended, slave, took, plan, config


@pytest.mark.parametrize("fields", [SMALL, TWO])
def test_every_cell_of_its_electrodes(fields):
    rng = random.Random(3)
    table = {address: [rng.randrange(1024) for _ in range(12)] for address in (0x5A, 0x5B)}
    ended, slave, took, plan, config = play(2, table.__getitem__, **fields)
    own = np.array([[*table[0x5A][: plan.electrodes[0]], *table[0x5B][: sum(plan.electrodes[1:])]]])
    assert ended == [(dict(enumerate(cells_of(own, config)[0].tolist())), ConverterFault(0), False)] * 2
    assert max(took) <= plan.scan_cycles
    one = [
        (0x80, 0x63),
        (0x5E, 0),
        *((0x41 + k, (12, 6)[k % 2]) for k in range(24)),
        (0x5C, 0x10),
        (0x5D, 0x20),
        (0x5E, 0x8F),
    ]
    assert slave.written == [(0x5A + chip, *word) for chip in range(plan.chips) for word in one]


def test_the_chip_has_its_time_before_its_first_data():
    ends: list[int] = []
    for first in (50, 500):
        play(1, lambda address: list(range(12)), first=first, ends=ends)
    assert ends[1] - ends[0] == 450


def test_what_is_wrong_is_told_and_the_chip_is_set_up_anew():
    codes = [700 + k for k in range(12)]
    now = {}

    def spoil(slave, ended):
        slave.config2 = 0 if ended == 0 else 0x24
        slave.silent = {0x5A} if ended == 2 else set()
        slave.upper = 4 if ended == 3 else 0
        now["codes"] = [0] * 12 if ended == 4 else [1023] * 12 if ended == 5 else codes

    ended, slave, *_ = play(7, lambda address: now["codes"], spoil)
    assert [(fault, away) for _, fault, away in ended] == [
        (ConverterFault.READBACK, True),
        (ConverterFault(0), False),
        (ConverterFault.SILENT, False),
        (ConverterFault.ORDER, False),
        (ConverterFault.STUCK, False),
        (ConverterFault.STUCK, False),
        (ConverterFault(0), False),
    ]
    assert slave.written.count((0x5A, 0x5E, 0x8F)) == 5 and ended[1][0] == ended[6][0]


REST, ZEROS, RUNNING = [700 + k for k in range(12)], [0] * 12, 0x8F
STATES = [
    (0x5A, 0, REST, ConverterFault.READBACK),  # it has lost its supply
    (0x5B, RUNNING - 1, REST, ConverterFault.READBACK),
    (0x5A, RUNNING, ZEROS, ConverterFault.STUCK),
    (0x5B, RUNNING, ZEROS, ConverterFault.STUCK),
    (0x5B, RUNNING, [1, *ZEROS[1:]], ConverterFault(0)),
    (0x5A, RUNNING, [1023] * 12, ConverterFault(0)),
    (0x5A, RUNNING, REST, ConverterFault(0)),
]
"""Of a frame: a chip, its ECR, its electrodes, what is told of the frame."""


def test_one_of_two_chips_that_answers_and_is_not_as_it_was_set_up():
    table = {0x5A: REST, 0x5B: REST}

    def spoil(slave, ended):
        chip, ecr, codes, _ = STATES[min(ended, len(STATES) - 1)]
        table.update({0x5A: REST, 0x5B: REST, chip: codes})
        if ecr != RUNNING:
            slave.ecr[chip] = ecr

    ended, slave, *_, config = play(len(STATES), lambda address: table[address], spoil, **TWO)
    assert [fault for _, fault, _ in ended] == [fault for *_, fault in STATES]
    assert [len(cells) for cells, *_ in ended] == [0, 0, 42, 42, 42, 42, 42]
    assert ended[-1][0] == dict(enumerate(cells_of(np.array([REST[:11] + REST[:2]]), config)[0].tolist()))
    assert slave.written.count((0x5B, 0x5E, 0x8F)) == 5


def test_electrodes_of_cells_are_the_codes_that_make_them():
    config = PRESETS["thesis"].replace(**(SMALL | dict(rows=13, columns=9, taxels=117)))
    rng = np.random.default_rng(1)
    electrodes = rng.integers(0, 1024, (50, 12))
    cells = cells_of(electrodes, config)
    assert cells.min() >= 0 and cells.max() <= mpr121.FULL
    # a touch on one cell lowers its row and its column, and is seen there alone
    rest = np.full((1, 12), 800)
    rest[0, [2, 5 + 3]] = 300
    seen = cells_of(rest, config)[0].reshape(13, 9)
    assert seen[6, 4] == seen.max() == mpr121.FULL - 600 and (seen == seen.max()).sum() == 1
    again = cells_of(mpr121.electrodes_of(seen.reshape(1, -1), config), config)[0].reshape(13, 9)
    assert again[6, 4] == seen[6, 4]
