"""What is known of each converter, and what follows for one configuration: the plan that hardware and golden
model share.

Facts are the data sheets'; where they leave something open, the slower or wider figure is taken. On a board
with 3.3 V pins a converter runs at 3.3 V; one whose data sheet tells its limits for 2.7 V and 5 V only gets
those for 2.7 V.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntFlag
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from eskin.golden.core import ddc232, matrix_scan, mpr121
from eskin.golden.core.formats import QFormat
from eskin.golden.core.serial_port import (
    RESERVE,
    USUAL_HZ,
    Converter,
    Plan,
    Refusal,
    frame_s,
    half_period,
    slow_clock,
)

if TYPE_CHECKING:
    from eskin.golden.core.config import AcceleratorConfig

LINES_MAX = 16
"""Data lines at most."""


class ConverterFault(IntFlag):
    """What was wrong with a frame; it is not handed on."""

    STUCK = 1  # every code of a chip is at the same end of its range
    ORDER = 2  # another channel's number, or a bit that the data sheet fixes is wrong
    LATE = 4  # the frame was not complete, or the chain not ready, when the next was due
    SILENT = 8  # no answer: no acknowledge, no DVALID
    READBACK = 16  # what was configured does not read back


@dataclass(frozen=True, kw_only=True)
class SpiChip:
    """A converter with a serial port, by its data sheet.

    bits: clocks of a transfer. channels: of a chip. command: what channel 0 is asked for with, most
    significant bit first; channel_bit: where in it the channel's number begins. delay: transfers from a
    command to its data. code_bit, code_bits: place of the code in what comes back; tag_bit, tag_bits: of the
    channel's number (0 bits: none); zeros: bits that are 0 by the data sheet. sclk_hz, conversions_hz: the
    most. high_s, lead_s: select high between transfers, and from its fall to the first clock, at least. most:
    chips at most, and what to do with more taxels (0: any number). watt, stated: as of a `Converter`.
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
    most: int = 0
    instead: str = ""
    watt: float | None = None
    stated: str = ""


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
        most=1,
        instead="it has 16 channels: use mcp3208x2 or spi with more lines, or fewer taxels",
        watt=14.5e-3,
        stated="SLAS605: 14.5 mW typical at 1 MS/s, +VA 5 V, +VBD 3 V",
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
    ),
    "ad7476": SpiChip(
        bits=16,
        channels=1,
        zeros=0xF000,
        sclk_hz=20e6,
        conversions_hz=1e6,
        high_s=100e-9,
        lead_s=40e-9,
        watt=5.1e-3,
        stated="AD7476A, rev. F: 5.1 mW in normal operation at 1 MS/s, 3 V",
    ),
}
"""``mcp3208x2`` at 3.3 V: its limits at 2.7 V. ``high_s`` of the ads7953 and ad7476 are wider than their data
sheets ask for."""


@dataclass(frozen=True, kw_only=True)
class SpiPlan(Plan):
    """Transfers of one frame at one clock.

    lines: data lines, whose chips share clock, command and select. selects: groups of chips asked one after
    the other, each with a select line of its own. transfers: (group, command) of each transfer of a scan.
    half, lead, high: cycles of half an SCLK period, from the fall of select to the first clock, and of select
    high.
    """

    chip: SpiChip
    lines: int
    selects: int
    transfers: tuple[tuple[int, int], ...]
    half: int
    lead: int
    high: int

    def wires(self, chip: str) -> dict[str, str]:
        """Ports of a board, in the order in which they are wired, and what each goes to."""
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
        """Of the model in cosim/converters."""
        fields = ("channel_bit", "delay", "code_bit", "code_bits", "tag_bit", "tag_bits", "zeros", "channels")
        values = {name.upper(): getattr(self.chip, name) for name in fields}
        return values | {"LINES": self.lines, "SELECTS": self.selects, "FRAME_BITS": self.chip.bits}

    @property
    def transfer_cycles(self) -> int:
        """From a transfer's start to that of the next, without what is between them."""
        return self.lead + 2 * self.half * self.chip.bits + self.high

    @property
    def per_select(self) -> int:
        """Transfers of one group of chips in a scan."""
        return self.chip.channels + self.chip.delay

    @property
    def scan_cycles(self) -> int:
        """From the sample clock to the last code of a frame, at most."""
        return len(self.transfers) * (self.transfer_cycles + self.lines + 2)

    @property
    def code_bits(self) -> int:
        """Bits of a code."""
        return self.chip.code_bits

    @property
    def chips(self) -> int:  # type: ignore[override]
        """Of all lines and selects."""
        return self.lines * self.selects


def sample_clock(clock_hz: float, rate_hz: float) -> tuple[int, int]:
    """(p, q) with p / q = rate / clock in lowest terms: p frames in q cycles. p = 1: every frame takes q
    cycles exactly; otherwise the start of a scan is up to one cycle late."""
    # by way of its text 35.6 is 178/5; the float itself is a fraction over 2**47, far too long to count
    ratio = Fraction(str(rate_hz)) / Fraction(str(clock_hz))
    return ratio.numerator, ratio.denominator


def spi_chip(config: AcceleratorConfig) -> SpiChip:
    """The chip of a configuration whose converter has an SPI port."""
    interface = config.interface
    name = "ad7476" if interface.converter == "matrix" else interface.converter
    if name in SPI_CHIPS:
        return SPI_CHIPS[name]
    return SpiChip(
        bits=interface.spi_frame_bits,
        channels=interface.spi_channels,
        command=interface.spi_command,
        channel_bit=interface.spi_channel_bit,
        delay=interface.spi_delay,
        code_bit=interface.spi_code_bit,
        code_bits=interface.spi_code_bits,
        tag_bit=interface.spi_tag_bit,
        tag_bits=interface.spi_tag_bits,
        zeros=interface.spi_zeros,
        sclk_hz=interface.converter_hz or USUAL_HZ,
        conversions_hz=math.inf,
        high_s=500e-9,
        lead_s=100e-9,
    )


def chips(config: AcceleratorConfig) -> int:
    """How many chips the taxels need."""
    if config.interface.converter == "matrix":
        return 1
    return -(-config.sensor.taxels // spi_chip(config).channels)


def spi_plan(config: AcceleratorConfig, clock_hz: float | None = None) -> SpiPlan:
    """The plan at ``clock_hz``, by default the configuration's."""
    chip, clock = spi_chip(config), clock_hz or config.hardware.clock_hz
    lines = config.interface.data_lines or chips(config)
    selects = -(-chips(config) // lines)
    channels = min(chip.channels, config.sensor.taxels)
    words = [chip.command | channel << chip.channel_bit for channel in range(channels)] + [0] * chip.delay
    sclk = min(chip.sclk_hz, config.interface.converter_hz or USUAL_HZ)
    half = half_period(clock, sclk)
    period = clock / chip.conversions_hz  # 0 where the chip's rate has no limit (infinity)
    lead = max(half, math.ceil(chip.lead_s * clock))
    # 1e-9: a quotient that should be whole may come out a hair above, and ceil would take a cycle more
    high = max(math.ceil(chip.high_s * clock), math.ceil(period - 1e-9) - lead - 2 * half * chip.bits, 1)
    return SpiPlan(
        chip=dataclasses.replace(chip, channels=channels),
        lines=lines,
        selects=selects,
        transfers=tuple((group, word) for group in range(selects) for word in words),
        half=half,
        lead=lead,
        high=high,
    )


def spi_refusals(config: AcceleratorConfig) -> Iterator[Refusal]:
    """What an SPI converter cannot deliver."""
    interface, taxels, name = config.interface, config.sensor.taxels, config.interface.converter
    if name == "spi":
        yield from _wrong_frame(config)
    chip, count = spi_chip(config), chips(config)
    per_chip = f"{chip.channels} channel{'s' * (chip.channels > 1)}"
    if chip.most and count > chip.most:
        yield "converter", f"is '{name}' with {taxels} taxels; {chip.instead}"
    lines, most = interface.data_lines or count, min(count, LINES_MAX)
    if not 1 <= lines <= most:
        yield (
            "data_lines",
            f"is {interface.data_lines}; {taxels} taxels are {count} chips of {per_chip}: give 1 to {most}",
        )
    if taxels % min(chip.channels, taxels):
        yield "taxels", f"is {taxels}; chips of {per_chip} take a multiple of {chip.channels}"
    if count % lines:
        yield "data_lines", f"is {lines} for {count} chips; give a number that divides them"
    yield from slow_clock(config)
    yield from _too_slow(config)


def _wrong_frame(config: AcceleratorConfig) -> Iterator[Refusal]:
    port, frame, bit = config.interface, config.interface.spi_frame_bits, config.interface.spi_channel_bit
    for name, low, bits in (
        ("spi_code_bit", port.spi_code_bit, port.spi_code_bits),
        ("spi_tag_bit", port.spi_tag_bit, port.spi_tag_bits),
    ):
        if low + bits > frame:
            yield name, f"is {low} with {bits} bits; they must lie in the {frame} bits of a frame"
    for name, value in (("spi_command", port.spi_command), ("spi_zeros", port.spi_zeros)):
        if value >> frame:
            yield name, f"is {value:#x}; a frame has {frame} bits"
    number_bits, first = (port.spi_channels - 1).bit_length(), port.spi_code_bit + port.spi_code_bits - 1
    if port.spi_channels > 1 and bit + number_bits > frame:
        yield "spi_channel_bit", f"is {bit}; the channel's number must lie in the {frame} bits of a frame"
    if port.spi_channels > 1 and not port.spi_delay and bit <= first:
        yield (
            "spi_channel_bit",
            f"is {bit} with the code's first bit at {first}; a code that comes in its command's own transfer "
            "must come after the channel's number: put it higher, or give spi_delay",
        )
    if port.spi_tag_bits and port.spi_channels > 1 << port.spi_tag_bits:
        yield (
            "spi_tag_bits",
            f"is {port.spi_tag_bits}; {port.spi_channels} channels need {number_bits}, or 0 for none",
        )


def _too_slow(config: AcceleratorConfig) -> Iterator[Refusal]:
    """Whether a scan leaves a reserve of the frame; with the nearest that does."""
    clock, rate, available = config.hardware.clock_hz, config.sensor.sample_rate_hz, frame_s(config)
    plan, chip, count = spi_plan(config), spi_chip(config), chips(config)
    took = plan.scan_cycles / clock
    if took <= available:
        return

    def fits(words: str, **fields: Any) -> list[str]:
        took = spi_plan(_with(config, **fields)).scan_cycles / clock
        return [f"{words} takes {1e6 * took:.0f} us"] if took <= available else []

    divisors = (lines for lines in range(plan.lines + 1, count + 1) if count % lines == 0)
    parallel = (fits(f"data_lines {lines} (chips side by side)", data_lines=lines) for lines in divisors)
    helps = next(filter(None, parallel), [])
    if chip.sclk_hz > clock / plan.half / 2:
        helps = helps + fits(f"converter_hz {chip.sclk_hz:g}", converter_hz=chip.sclk_hz)
    if config.interface.converter != "ads7953" and config.sensor.taxels <= 16 and not helps:
        helps = fits("converter ads7953", converter="ads7953", data_lines=0, converter_hz=0.0)
    helps = [*helps, f"a rate of at most {math.floor((1 - RESERVE) / took)} Hz works as it is"]
    series = f" of {plan.selects} chips in series" if plan.selects > 1 else ""
    yield (
        "converter",
        f"is '{config.interface.converter}', which cannot keep up: {len(plan.transfers)} transfers{series} "
        f"at {clock / plan.half / 2 / 1e6:.3g} MHz take {1e6 * took:.0f} us, and of {1e6 / rate:.0f} us a "
        f"frame at {rate:g} Hz {1e6 * available:.0f} may be used; {', or '.join(helps)}",
    )


class _Changed:
    """A configuration seen with other fields of its interface, without the checks that would refuse it while
    they are made."""

    def __init__(self, config: AcceleratorConfig, interface: Any) -> None:
        self.sensor, self.hardware, self.interface = config.sensor, config.hardware, interface


def _with(config: AcceleratorConfig, **changes: Any) -> AcceleratorConfig:
    return _Changed(config, config.interface.replace(**changes))  # type: ignore[return-value]


# ---------------------------------------------------------------------- all of them
def _matrix_plan(config: AcceleratorConfig, clock_hz: float | None = None) -> matrix_scan.MatrixPlan:
    return matrix_scan.matrix_plan(config, spi_plan(config, clock_hz), clock_hz)


CONVERTERS: dict[str, Converter] = {
    **{name: Converter(spi_plan, spi_refusals, chip.watt, chip.stated) for name, chip in SPI_CHIPS.items()},
    "spi": Converter(spi_plan, spi_refusals),
    "ddc232": Converter(
        ddc232.ddc_plan, lambda config: ddc232.refusals(config, lambda **fields: _with(config, **fields))
    ),
    "mpr121": Converter(mpr121.mpr_plan, mpr121.refusals),
    "matrix": Converter(
        _matrix_plan,
        lambda config: matrix_scan.refusals(config, _matrix_plan(config)),
        SPI_CHIPS["ad7476"].watt,
        f"its {SPI_CHIPS['ad7476'].stated}; multiplexers and amplifier not counted",
    ),
}
"""Every converter by its name in a configuration. A new chip on SPI is a row of `SPI_CHIPS`; one that is read
in another way is a file beside ddc232.py and an entry here."""


def converter_plan(config: AcceleratorConfig, clock_hz: float | None = None) -> Any:
    """How the configuration's converter is read at ``clock_hz``, by default the configuration's."""
    return CONVERTERS[config.interface.converter].plan(config, clock_hz)


def code_bits(config: AcceleratorConfig) -> int:
    """Bits of the converter's code of a taxel."""
    return converter_plan(config).code_bits


def code_offset(config: AcceleratorConfig) -> int:
    """The code that becomes sample 0."""
    middle = 1 << code_bits(config) - 1 if config.sensor.sample_signed else 0
    choices = (config.interface.code_offset, converter_plan(config).zero, middle)
    return next(offset for offset in choices if offset is not None)


def code_shift(config: AcceleratorConfig) -> int:
    """Bits rounded away from (code - offset); below 0: zeros appended."""
    shift = config.interface.code_shift
    return code_bits(config) - config.sensor.sample_bits if shift is None else shift


def code_format(config: AcceleratorConfig) -> QFormat:
    """Format of a code."""
    return QFormat(code_bits(config), 0, False)


def refusals(config: AcceleratorConfig) -> Iterator[Refusal]:
    """Why the converter, where there is one, cannot deliver these frames."""
    if config.interface.converter != "none":
        yield from CONVERTERS[config.interface.converter].refusals(config)
