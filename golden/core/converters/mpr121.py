"""The MPR121, 12 capacitive electrodes on I2C: figures of its data sheet and application notes, and the plan
for one configuration.

Rows and columns of an array are electrodes; with one chip a place between two electrodes is their mean, with
two chips each row and column is a separate electrode.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import StrictStr

from eskin.golden.core.converters.base import RESERVE, Converter, Plan, too_slow
from eskin.golden.core.group import Refusal

if TYPE_CHECKING:
    from eskin.golden.core.config import AcceleratorConfig

ADDRESS = 0x5A
"""Bus address of the first chip; the second chip has the next one."""
I2C_HZ, LOW_S = 400e3, 1.3e-6
"""Highest frequency of the bus and shortest low time of its clock. Low takes half a bit here, so the bus runs
at 385 kHz."""
RESET_S, FIRST_DATA_S = 1e-3, 10e-3
"""Wait after the soft reset, and from the start of the electrodes to valid data."""
ELECTRODES = {1: 12, 2: 22}
"""Electrodes that an array may have, by number of chips: two chips have 11 each."""
CODE_BITS = 10
FILTERED, THRESHOLDS, CONFIG1, CONFIG2, ECR, SOFT_RESET = 0x04, 0x41, 0x5C, 0x5D, 0x5E, 0x80
RESET_WORD, CONFIG2_AT_RESET, RUNNING = 0x63, 0x24, 0x8F
SETTINGS = (0x10, 0x20)
"""CONFIG1 and CONFIG2: 16 uA, 0.5 us, 4 samples each millisecond."""
DATA_S, INTERVAL_MAX = 4e-3, 7
"""Time of the 4 samples of a value. Bits 2 to 0 of CONFIG2 double it so many times, between whose samples the chip
sleeps."""
STOPPED_A, SAMPLE_AS, SUPPLY_V = 3e-6, (29e-6 - 3e-6) * 16e-3, 3.3
"""Current of a chip that takes no sample, and charge of a sample more: the data sheet has 29 uA at one in 16 ms."""
TOUCH, RELEASE = 12, 6
"""Thresholds of the chip's own touch detection, which is not used."""
FULL = 2 * (1 << CODE_BITS) - 2
"""Twice the largest code. A line between two electrodes has the mean of their codes, so doubled codes are
whole numbers."""


@dataclass(frozen=True, kw_only=True)
class MprPlan(Plan):
    """chips: 1 or 2. electrodes: number read on each chip. rows, columns: of the array. lines: number of
    electrodes of columns, and of rows. quarter: cycles of a quarter of a bit. reset, first: cycles of
    `RESET_S` and `FIRST_DATA_S`. interval: of samples, 1 ms doubled so many times; longest: that a frame leaves
    time for."""

    chips: int
    electrodes: tuple[int, ...]
    rows: int
    columns: int
    lines: tuple[int, int]
    quarter: int
    reset: int
    first: int
    interval: int = 0
    longest: int = 0
    code_bits = CODE_BITS + 1

    @property
    def sleeping(self) -> MprPlan:
        """The plan by which chips take no more samples than there are frames."""
        return dataclasses.replace(self, interval=self.longest, first=self.first << self.longest)

    def awake(self, scans: float) -> float:
        """As often as a chip takes a sample: all the time at one in a millisecond."""
        return 1 / (1 << self.interval)

    def pin_codes(self, config: AcceleratorConfig) -> int:
        return sum(self.lines)

    def to_pins(self, codes: np.ndarray, config: AcceleratorConfig) -> np.ndarray:
        """Electrode codes (frames, electrodes) for codes of cells: each electrode falls as far as the cell on
        it that falls most."""
        step = 1 if self.chips == 2 else 2
        shaped = codes.reshape(-1, self.rows, self.columns)
        fallen = np.concatenate([shaped.max(axis=1)[:, ::step], shaped.max(axis=2)[:, ::step]], axis=1)
        return np.clip((FULL - fallen) // 2, 0, (1 << CODE_BITS) - 1)

    def from_pins(self, codes: np.ndarray, config: AcceleratorConfig) -> np.ndarray:
        """Codes of the array's cells (frames, rows x columns) from the codes of its electrodes: a touch lowers
        both electrodes of its cell, so a cell's code is twice the smaller of their two drops from full
        scale."""
        across, _ = self.lines
        direct = self.chips == 2
        columns = between(codes[:, :across], self.columns, direct)
        rows = between(codes[:, across:], self.rows, direct)
        return (FULL - np.maximum(rows[:, :, None], columns[:, None, :])).reshape(len(codes), -1)

    def wires(self, chip: str) -> dict[str, str]:
        """Ports of a board, and the pin of each."""
        return {"scl": f"{chip}, SCL (pull-up)", "sda": f"{chip}, SDA (pull-up)"}

    def parameters(self, config: AcceleratorConfig) -> dict[str, int]:
        """Parameters of the model in cosim/converters."""
        return {"CHIPS": self.chips, "ELECTRODES": self.pin_codes(config)}

    @property
    def scan_cycles(self) -> int:
        """Cycles from the sample clock to the last code: for each chip one message that reads 2 bytes an
        electrode, and one that reads ECR. Besides the bytes read, a message has a start, 3 bytes, a repeated
        start and a stop."""
        bits = sum(2 * (2 + 1 + 9 * 3) + 9 * (2 * electrodes + 1) for electrodes in self.electrodes)
        return bits * (4 * self.quarter + 1) + 60 * self.chips + self.rows * self.columns + 8


def between(codes: np.ndarray, count: int, direct: bool) -> np.ndarray:
    """Doubled codes (frames, places) of ``count`` places: one electrode per place, or alternately an
    electrode and the mean of two neighbours."""
    wide = codes.astype(np.int64)
    if direct:
        return 2 * wide
    places = np.arange(count)
    return wide[:, places // 2] + wide[:, (places + 1) // 2]


@dataclass(frozen=True, kw_only=True)
class Mpr121(Converter):
    """MPR121 chips.

    chips: 1 (places between electrodes are means) or 2 (11 electrodes each, one for every row and column).
    """

    watt = (STOPPED_A + SAMPLE_AS / 1e-3) * SUPPLY_V
    asleep_watt = STOPPED_A * SUPPLY_V
    stated = "MPR121, rev. 4: 3 uA stopped, 29 uA at a sample in 16 ms, a line through both; 3.3 V"

    name: StrictStr = "mpr121"
    chips: Literal[1, 2] = 1

    def line_counts(self, config: AcceleratorConfig) -> tuple[int, int]:
        """(electrodes of columns, electrodes of rows); column electrodes come first on the chips."""
        rows, columns = config.interface.rows, config.interface.columns
        return (columns, rows) if self.chips == 2 else ((columns + 1) // 2, (rows + 1) // 2)

    def plan(self, config: AcceleratorConfig, clock_hz: float | None = None) -> MprPlan:
        clock, lines = clock_hz or config.hardware.clock_hz, self.line_counts(config)
        rate = config.sensor.scan_rate_hz
        total = sum(lines)
        first = min(total, 11) if self.chips == 2 else total
        bus_hz = min(self.hz or I2C_HZ, I2C_HZ)
        return MprPlan(
            chips=self.chips,
            electrodes=(first, total - first)[: self.chips],
            rows=config.interface.rows,
            columns=config.interface.columns,
            lines=lines,
            quarter=max(3, math.ceil(clock / bus_hz / 4 - 1e-9), math.ceil(LOW_S / 2 * clock - 1e-9)),
            reset=math.ceil(RESET_S * clock),
            first=math.ceil(FIRST_DATA_S * clock),
            longest=min(INTERVAL_MAX, max(0, math.floor(math.log2((1 - RESERVE) / rate / DATA_S)))),
        )

    def misfits(self, config: AcceleratorConfig) -> Iterator[Refusal]:
        array, taxels = config.interface, config.sensor.taxels
        clock, chips = config.hardware.clock_hz, self.chips
        size = f"is {array.rows} with {array.columns} columns"
        if array.rows * array.columns != taxels:
            yield "rows", f"{size}, and there are {taxels} taxels; give the array's own"
        if chips == 1 and not (array.rows % 2 and array.columns % 2):
            yield "rows", f"{size}; with places between electrodes both are odd, or set chips 2"
        electrodes = sum(self.line_counts(config))
        if electrodes > ELECTRODES[chips]:
            yield (
                "converter.chips",
                f"is {chips}; {array.rows} rows and {array.columns} columns are {electrodes} electrodes and "
                f"{ELECTRODES[chips]} are there: use fewer rows or columns",
            )
        if chips == 2 and electrodes < 12:
            yield "converter.chips", f"is 2 for {electrodes} electrodes; set 1"
        if clock < 12 * 1e4:
            yield "clock_hz", f"is {clock:g}; the I2C port needs at least 120000"
        rate = config.sensor.scan_rate_hz
        if rate > 1 / DATA_S:
            yield (
                "sample_rate_hz",
                f"is {rate:g}; an MPR121 has new data {1 / DATA_S:g} times a second: give at most that",
            )
        plan = self.plan(config)
        work = f"{electrodes} electrodes over I2C at {clock / plan.quarter / 4 / 1e3:.0f} kHz"
        yield from too_slow(config, work, plan.scan_cycles / clock)
