"""rtl/interface/matrix_converter.py: every cell's code at its taxel after its time to settle, and each kind
of wrong answer."""

import random
from dataclasses import replace

from amaranth.hdl import Const

from eskin.golden.core import PRESETS, ConverterFault, converter_plan
from eskin.rtl.interface.matrix_converter import MatrixConverter
from tests.support.converter_bench import play_frames
from tests.support.table import each_row

PLAN = replace(
    converter_plan(
        PRESETS["thesis"].replace(
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
    ),
    settle=32,  # takes one bit more than any number below it
)


class Cells:
    """The multiplexers and the converter behind them. samples: of each fall of select the cell, and the
    cycles since the address changed or the multiplexers were off. clocks: of each transfer. off: cycles in which they
    are, since the first transfer."""

    def __init__(self, pins, word_of) -> None:
        self.pins, self.word_of = pins, word_of
        self.samples: list[tuple[int, int]] = []
        self.clocks: list[int] = []
        self.off = 0

    async def play(self, ctx) -> None:
        pins, word, bits, select, clock, since, at = self.pins, 0, 0, 1, 0, 0, (0, 0)
        off = getattr(pins, "off", Const(0))
        while True:
            await ctx.tick()
            now, level, row, column, is_off = (
                ctx.get(each) for each in (pins.cs_n, pins.sclk, pins.row, pins.column, off)
            )
            since = 0 if (row, column) != at or is_off else since + 1
            self.off += is_off and self.samples != []
            if now and not select:
                self.clocks.append(bits)
            at = (row, column)
            if select and not now:
                self.samples.append((row * 5 + column, since))
                word, bits = self.word_of(row * 5 + column), 0
            elif not now and clock and not level:
                bits += 1
            select, clock = now, level
            ctx.set(pins.miso, 1 if now or bits > 15 else word >> 15 - bits & 1)


def play(word_of, count=2, plan=PLAN):
    """The frames, and the cells."""
    dut = MatrixConverter(plan)
    cells = Cells(dut.pins, word_of)
    return play_frames(dut, cells, count), cells


def test_every_cell_at_its_taxel_when_it_has_settled():
    codes = random.Random(1).choices(range(1, 4095), k=15)
    frames, cells = play(codes.__getitem__)
    assert [frame[:2] for frame in frames] == [(dict(enumerate(codes)), ConverterFault(0))] * 2
    assert [cell for cell, _ in cells.samples] == list(range(15)) * 2
    assert min(since for _, since in cells.samples[1:]) == PLAN.settle + 1
    assert all(frame.cycles <= PLAN.scan_cycles for frame in frames)
    lines = {name: len(getattr(cells.pins, name)) for name in cells.pins.signature.members}
    assert [*PLAN.wires("matrix")] == ["pins__cs_n", "pins__miso", "pins__sclk"] + [
        f"pins__{name}[{k}]" for name in ("row", "column") for k in range(lines.pop(name))
    ]
    assert lines == {"cs_n": 1, "sclk": 1, "miso": 1}


def test_a_converter_that_sleeps_is_woken_before_the_cells_and_the_multiplexers_are_off_between_scans():
    plan, codes = replace(PLAN.sleeping, settle=33), range(700, 715)
    waking = iter([None, *codes, None] * 2)  # codes of the first and the last transfer count for nothing
    frames, cells = play(lambda cell: next(waking) or 0, 2, plan)
    assert [frame[:2] for frame in frames] == [(dict(enumerate(codes)), ConverterFault(0))] * 2
    assert cells.clocks == [*[16] * 16, 6] * 2
    order = [cell for cell, _ in cells.samples]
    assert order == [0, *range(15), 0] * 2
    assert all(since >= plan.settle for _, since in cells.samples[1:16] + cells.samples[18:33])
    assert cells.off > 100 and all(frame.cycles <= plan.scan_cycles for frame in frames)
    assert plan.wires("matrix")["pins__off"] == "multiplexers, disable"


def test_a_cell_that_settles_within_the_converters_pause_takes_the_transfer_alone():
    plan = replace(PLAN, settle=1, port=replace(PLAN.port, high=9))
    frames, _ = play(lambda cell: 700, 3, plan)
    assert [frame.cycles for frame in frames[1:]] == [15 * plan.port.transfer_cycles - 1] * 2


def test_an_address_has_a_pin_for_each_bit_and_one_at_least():
    addresses = [*replace(PLAN, rows=4, columns=1).wires("matrix")][3:]
    assert addresses == ["pins__row[0]", "pins__row[1]", "pins__column"]


@each_row(
    "codes, fault",
    [
        ([0] * 15, ConverterFault.STUCK),
        ([0x0FFF] * 15, ConverterFault.STUCK),
        ([0, *[700] * 13, 4095], ConverterFault(0)),
    ],
)
def test_a_stuck_line_is_a_fault_and_one_cell_at_its_end_is_none(codes, fault):
    assert play(codes.__getitem__, 1)[0][0].fault == fault


def test_a_leading_bit_that_is_not_zero_is_a_fault_of_that_frame_alone():
    bad = iter([*[0] * 14, 1, 1, *[0] * 29])  # the last cell of the first frame, the first of the second
    frames, _ = play(lambda cell: 700 | next(bad) << 13, 3)
    assert [frame.fault for frame in frames] == [ConverterFault.ORDER] * 2 + [ConverterFault(0)]
