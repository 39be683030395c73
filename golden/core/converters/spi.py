"""Converters with an SPI port: rows of data sheets, and the plan of transfers for one configuration."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge, Interval
from pydantic import StrictInt, StrictStr

from eskin.golden.core.converters.base import (
    HALF_MIN,
    USUAL_HZ,
    Converter,
    Plan,
    half_period,
    slow_clock,
    too_slow,
)
from eskin.golden.core.group import Refusal

if TYPE_CHECKING:
    from eskin.golden.core.config import AcceleratorConfig

LINES_MAX = 16
"""Largest number of data lines."""


@dataclass(frozen=True, kw_only=True)
class SpiChip:
    """A converter with a serial port, by its data sheet.

    bits: clock periods of a transfer. channels: of a chip. command: word that requests channel 0, most
    significant bit first; channel_bit: bit of it at which the channel's number begins. delay: transfers from
    a command to its data. code_bit, code_bits: place of the code in the answer; tag_bit, tag_bits: place of
    the channel's number in it (0 bits: none); zeros: bits of it that are 0 by the data sheet. sclk_hz,
    conversions_hz: highest rates. high_s, lead_s: shortest time with select high between transfers, and from
    its fall to the first clock. answer_s: longest time until a line has the next bit, behind a falling clock or select
    (None: not known). most: largest number of chips (0: any number); instead: advice for more taxels. watt, stated,
    asleep_watt, sleeps_unselected: as in `Converter`. sleep_command: the last word but one of a scan, so that it sleeps from
    the scan's end until the second transfer of the next begins; sleep_bits: a last transfer of so few clocks puts it to
    sleep. waking: transfers of a scan that only wake it.
    """

    bits: int
    channels: int
    command: int = 0
    channel_bit: int = 0
    delay: int = 0
    code_bit: int = 0
    code_bits: int = 12
    tag_bit: int = 0
    tag_bits: int = 0
    zeros: int = 0
    sclk_hz: float
    conversions_hz: float
    high_s: float
    lead_s: float
    answer_s: float | None = None
    most: int = 0
    instead: str = ""
    watt: float | None = None
    stated: str = ""
    asleep_watt: float | None = None
    sleeps_unselected: bool = False
    sleep_command: int | None = None
    sleep_bits: int = 0
    waking: int = 0


SPI_CHIPS: dict[str, SpiChip] = {
    # manual mode 0001, DI11 set so that range and outputs are as asked for; the number comes back with the
    # code, two transfers later
    "ads7953": SpiChip(
        bits=16,
        channels=16,
        command=0x1800,
        channel_bit=7,
        delay=2,
        tag_bit=12,
        tag_bits=4,
        sclk_hz=20e6,
        conversions_hz=1e6,
        high_s=100e-9,
        lead_s=40e-9,
        answer_s=38e-9,
        most=1,
        instead="it has 16 channels: use mcp3208x2 or spi with more lines, or fewer taxels",
        watt=14.5e-3,
        stated="SLAS605: 14.5 mW typical at 1 MS/s, +VA 5 V, +VBD 3 V",
        # DI05: power-down, 1 uA, from the end of the next transfer on, whose word leaves DI05 as it is. A word
        # without it wakes the chip when the next transfer begins: the second of a scan, whose conversion is not valid
        # and is one of those that the delay drops.
        asleep_watt=1e-6 * 5.0,
        sleep_command=0x1820,
    ),
    # start bit, single-ended, three bits of channel, a clock to sample, a null bit, twelve bits of code
    "mcp3208x2": SpiChip(
        bits=19,
        channels=8,
        command=0b11 << 17,
        channel_bit=14,
        zeros=1 << 12,
        sclk_hz=1e6,
        conversions_hz=50e3,
        high_s=500e-9,
        lead_s=100e-9,
        most=2,
        instead="two chips have 16 channels: use fewer taxels or another converter",
        watt=320e-6 * 5.0,
        stated="DS21298: 320 uA typical while active, 5 V",
        asleep_watt=0.5e-6 * 5.0,  # its pin CS/SHDN: 0.5 uA typical
        sleeps_unselected=True,
    ),
    "ad7476": SpiChip(
        bits=16,
        channels=1,
        zeros=0xF000,
        sclk_hz=20e6,
        conversions_hz=1e6,
        high_s=100e-9,
        lead_s=40e-9,
        answer_s=40e-9,
        watt=5.1e-3,
        stated="AD7476A, rev. F: 5.1 mW in normal operation at 1 MS/s, 3 V",
        # select rises between the second and the tenth falling clock edge: power-down, 1 uA; a whole transfer wakes it,
        # and its data are not valid
        asleep_watt=1e-6 * 3.0,
        sleep_bits=6,
        waking=1,
    ),
}
"""``mcp3208x2`` runs at 3.3 V with its limits for 2.7 V. ``high_s`` of the ads7953 and of the ad7476 is
longer than their data sheets require; ``answer_s`` holds down to pins at 1.8 V."""
PADS_S = 30e-9
"""From a register through the part's pad and the wire to a chip, and back from its line to the next register."""


@dataclass(frozen=True, kw_only=True)
class SpiPlan(Plan):
    """Transfers of one frame at one clock.

    lines: data lines, whose chips share clock, command and select. selects: groups of chips that are read one
    after the other, each with a separate select line. transfers: (group, command) of each transfer of a
    scan. half, lead, high: cycles of half an SCLK period, from the fall of select to the first clock, and of
    select high. waking: transfers of a select before its others, whose answers count for nothing; short: clocks of its
    last transfer, which puts its chips to sleep (0: there is none). clock_hz: of these cycles; hz: as in `Converter`.
    """

    chip: SpiChip
    lines: int
    selects: int
    transfers: tuple[tuple[int, int], ...]
    half: int
    lead: int
    high: int
    waking: int = 0
    short: int = 0
    clock_hz: float
    hz: float = 0.0

    @property
    def sleeping(self) -> SpiPlan:
        """The plan by which the chips sleep between scans: they are woken and put to sleep by transfers of a scan, whose
        clock is as fast as data sheet and `hz` let it be."""
        chip, words = self.chip, [word for group, word in self.transfers if group == 0]
        if chip.sleep_command is not None:
            words[-2] = chip.sleep_command
        words = [0] * chip.waking + words + [0] * (chip.sleep_bits > 0)
        transfers = tuple((group, word) for group in range(self.selects) for word in words)
        fast = times(chip, self.clock_hz, self.hz or chip.sclk_hz, fewest_cycles(chip, self.clock_hz))
        return dataclasses.replace(
            self, transfers=transfers, waking=chip.waking, short=chip.sleep_bits, **fast
        )

    def awake(self, scans: float) -> float:
        """A chip is awake in the transfers of its select, less the first where a command has put it to sleep."""
        own = self.per_select - (self.chip.sleep_command is not None)
        return scans * self.scan_cycles * own / len(self.transfers)

    def wires(self, chip: str) -> dict[str, str]:
        """Ports of a board in wiring order, and the pin of each."""
        many = {"miso": self.lines, "cs_n": self.selects}
        functions = {"cs_n": "CS", "mosi": "data in", "miso": "data out", "sclk": "clock"}
        further = [(name, k) for name, count in many.items() for k in range(1, count)]
        wires = {}
        for name, k in [*((name, 0) for name in functions), *further]:
            wide = many.get(name, 1) > 1
            wires[f"pins__{name}[{k}]" if wide else f"pins__{name}"] = f"{chip}, {functions[name]}" + (
                f" {k}" if wide else ""
            )
        return wires

    def parameters(self, config: AcceleratorConfig) -> dict[str, int]:
        """Parameters of the model in cosim/converters."""
        fields = ("channel_bit", "delay", "code_bit", "code_bits", "tag_bit", "tag_bits", "zeros", "channels")
        values = {name.upper(): getattr(self.chip, name) for name in fields}
        return values | {
            "LINES": self.lines,
            "SELECTS": self.selects,
            "FRAME_BITS": self.chip.bits,
            "TAXELS": config.sensor.taxels,
        }

    @property
    def sclk_cycles(self) -> int:  # type: ignore[override]
        """Cycles of a period of SCLK."""
        return 2 * self.half

    @property
    def transfer_cycles(self) -> int:
        """Cycles from a transfer's start to the next one's, without the gap."""
        return self.lead + 2 * self.half * self.chip.bits + self.high

    @property
    def per_select(self) -> int:
        """Transfers of one group of chips in a scan."""
        return len(self.transfers) // self.selects

    @property
    def first(self) -> int:
        """Transfers of one group of chips before the first code."""
        return self.waking + self.chip.delay

    @property
    def scan_cycles(self) -> int:
        """Cycles from the sample clock to the last code of a frame, at most. A transfer waits until all lines of its
        predecessor are handed on."""
        each = self.transfer_cycles + max(0, self.lines + 1 - self.high)
        saved = 2 * self.half * (self.chip.bits - self.short) if self.short else 0
        return len(self.transfers) * each - self.selects * saved + 1

    @property
    def code_bits(self) -> int:
        """Bits of a code."""
        return self.chip.code_bits

    @property
    def chips(self) -> int:  # type: ignore[override]
        """Number of chips on all data lines and selects."""
        return self.lines * self.selects


def fewest_cycles(chip: SpiChip, clock_hz: float) -> int:
    """Fewest cycles of half a period in which the chip's answer reaches the port: it has one where they are one, and all
    but two of a whole period otherwise."""
    if chip.answer_s is None:
        return HALF_MIN
    cycles = clock_hz * (chip.answer_s + PADS_S)
    return 1 if cycles <= 1 else max(HALF_MIN, math.ceil(1 + cycles / 2))


def times(chip: SpiChip, clock_hz: float, sclk_hz: float, fewest: int = HALF_MIN) -> dict[str, Any]:
    """half, lead and high of a plan, by the chip's data sheet."""
    half = half_period(clock_hz, min(chip.sclk_hz, sclk_hz), fewest)
    period = clock_hz / chip.conversions_hz  # 0 where the chip's rate has no limit (infinity)
    lead = max(half, math.ceil(chip.lead_s * clock_hz))
    # 1e-9: a quotient that should be whole may come out slightly above, and ceil would add a cycle
    rest = math.ceil(period - 1e-9) - lead - 2 * half * chip.bits
    return dict(half=half, lead=lead, high=max(math.ceil(chip.high_s * clock_hz), rest, 1))


def sample_clock(clock_hz: float, rate_hz: float) -> tuple[int, int]:
    """(p, q) with p / q = rate / clock in lowest terms: p frames in q cycles. p = 1: every frame takes q
    cycles exactly; otherwise the start of a scan is up to one cycle late."""
    # read from its text, 35.6 is 178/5; the float itself is a fraction over 2**47, far too long to count
    ratio = Fraction(str(rate_hz)) / Fraction(str(clock_hz))
    return ratio.numerator, ratio.denominator


@dataclass(frozen=True, kw_only=True)
class OnSpi(Converter):
    """A chip, or several, on SPI.

    data_lines: chips that are read in parallel (0: all; fewer: groups of so many in turn, each with a select
    line).
    """

    data_lines: Annotated[StrictInt, Ge(0)] = 0

    def chip(self) -> SpiChip:
        """The chip's data sheet; each kind defines it."""
        raise NotImplementedError

    def chips(self, config: AcceleratorConfig) -> int:
        """Number of chips that the taxels need."""
        return -(-config.sensor.taxels // self.chip().channels)

    def plan(self, config: AcceleratorConfig, clock_hz: float | None = None) -> SpiPlan:
        chip, clock, count = self.chip(), clock_hz or config.hardware.clock_hz, self.chips(config)
        lines = self.data_lines or count
        selects = -(-count // lines)
        channels = min(chip.channels, config.sensor.taxels)
        words = [chip.command | channel << chip.channel_bit for channel in range(channels)] + [0] * chip.delay
        return SpiPlan(
            chip=dataclasses.replace(chip, channels=channels),
            lines=lines,
            selects=selects,
            transfers=tuple((group, word) for group in range(selects) for word in words),
            clock_hz=clock,
            hz=self.hz,
            **times(chip, clock, self.hz or USUAL_HZ),
        )

    def misfits(self, config: AcceleratorConfig) -> Iterator[Refusal]:
        chip, count, taxels = self.chip(), self.chips(config), config.sensor.taxels
        per_chip = f"{chip.channels} channel{'s' * (chip.channels > 1)}"
        if chip.most and count > chip.most:
            yield "converter", f"is '{self}' with {taxels} taxels; {chip.instead}"
        lines, most = self.data_lines or count, min(count, LINES_MAX)
        if not 1 <= lines <= most:
            yield (
                "converter.data_lines",
                f"is {self.data_lines}; {taxels} taxels are {count} chips of {per_chip}: give 1 to {most}",
            )
        if taxels % min(chip.channels, taxels):
            yield "taxels", f"is {taxels}; chips of {per_chip} take a multiple of {chip.channels}"
        if count % lines:
            yield "converter.data_lines", f"is {lines} for {count} chips; give a number that divides them"
        yield from slow_clock(config)
        plan = self.plan(config)
        clock, series = config.hardware.clock_hz, plan.selects
        work = f"{len(plan.transfers)} transfers{f' of {series} chips in series' if series > 1 else ''}"
        work += f" at {clock / plan.half / 2 / 1e6:.3g} MHz"
        yield from too_slow(config, work, plan.scan_cycles / clock)


@dataclass(frozen=True, kw_only=True)
class SpiByName(OnSpi):
    """``ads7953`` (16 channels), ``mcp3208x2`` (two chips of 8 on shared clock, command and select) or
    ``ad7476`` (a chip a taxel): a row of `SPI_CHIPS`."""

    def chip(self) -> SpiChip:
        return SPI_CHIPS[self.name]

    @property
    def watt(self) -> float | None:  # type: ignore[override]
        """Power of the row's chip."""
        return self.chip().watt

    @property
    def stated(self) -> str:  # type: ignore[override]
        """Text of the row about the chip's figures."""
        return self.chip().stated

    @property
    def asleep_watt(self) -> float | None:  # type: ignore[override]
        """Power of the row's chip that sleeps."""
        return self.chip().asleep_watt

    @property
    def sleeps_unselected(self) -> bool:  # type: ignore[override]
        """Of the row's chip."""
        return self.chip().sleeps_unselected


@dataclass(frozen=True, kw_only=True)
class Spi(OnSpi):
    """Any other chip on SPI.

    frame_bits: clock periods of a transfer; channels: of a chip; command: word that requests channel 0;
    channel_bit: bit of it at which the channel's number begins; delay: transfers from command to data;
    code_bit, code_bits, tag_bit, tag_bits: place of the code and of the channel's number in the answer (0
    bits: none); zeros: bits of the answer that are always 0.
    """

    name: StrictStr = "spi"
    frame_bits: Annotated[StrictInt, Interval(ge=4, le=32)] = 16
    channels: Annotated[StrictInt, Interval(ge=1, le=32)] = 8
    command: Annotated[StrictInt, Ge(0)] = 0
    channel_bit: Annotated[StrictInt, Interval(ge=0, le=31)] = 13
    delay: Annotated[StrictInt, Interval(ge=0, le=4)] = 0
    code_bit: Annotated[StrictInt, Interval(ge=0, le=31)] = 0
    code_bits: Annotated[StrictInt, Interval(ge=4, le=24)] = 12
    tag_bit: Annotated[StrictInt, Interval(ge=0, le=31)] = 0
    tag_bits: Annotated[StrictInt, Interval(ge=0, le=8)] = 0
    zeros: Annotated[StrictInt, Ge(0)] = 0

    def chip(self) -> SpiChip:
        own = {name: value for name, value in vars(self).items() if name in SpiChip.__dataclass_fields__}
        return SpiChip(
            bits=self.frame_bits,
            **own,
            sclk_hz=self.hz or USUAL_HZ,
            conversions_hz=math.inf,
            high_s=500e-9,
            lead_s=100e-9,
        )

    def refusals(self) -> Iterator[Refusal]:
        yield from super().refusals()
        frame, bit = self.frame_bits, self.channel_bit
        for name, low, bits in (
            ("code_bit", self.code_bit, self.code_bits),
            ("tag_bit", self.tag_bit, self.tag_bits),
        ):
            if low + bits > frame:
                yield name, f"is {low} with {bits} bits; they must lie in the {frame} bits of a frame"
        for name, value in (("command", self.command), ("zeros", self.zeros)):
            if value >> frame:
                yield name, f"is {value:#x}; a frame has {frame} bits"
        number_bits, first = (self.channels - 1).bit_length(), self.code_bit + self.code_bits - 1
        if self.channels > 1 and bit + number_bits > frame:
            yield "channel_bit", f"is {bit}; the channel's number must lie in the {frame} bits of a frame"
        if self.channels > 1 and not self.delay and bit <= first:
            yield (
                "channel_bit",
                f"is {bit} with the code's first bit at {first}; a code that comes in its command's own "
                "transfer must come after the channel's number: give a higher channel_bit, or delay",
            )
        if self.tag_bits and self.channels > 1 << self.tag_bits:
            yield (
                "tag_bits",
                f"is {self.tag_bits}; {self.channels} channels need {number_bits}, or 0 for none",
            )
