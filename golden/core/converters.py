"""What is known of each converter, and what follows for one configuration: the plan that hardware and golden
model share.

Facts are the data sheets'; where they leave something open, the slower or wider figure is taken. On a board
with 3.3 V pins a converter runs at 3.3 V; one whose data sheet tells its limits for 2.7 V and 5 V only gets
those for 2.7 V.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from enum import IntFlag
from fractions import Fraction
from typing import TYPE_CHECKING

from eskin.golden.core import ddc232, mpr121
from eskin.golden.core.formats import QFormat
from eskin.golden.core.matrix_scan import MatrixPlan, matrix_plan, matrix_refusal
from eskin.golden.core.serial_port import HALF_MIN, USUAL_HZ, half_period

if TYPE_CHECKING:
    from eskin.golden.core.config import AcceleratorConfig

RESERVE = 0.1
"""Of a frame's time that a scan leaves free: the frame is handed on then, and the last taxel still belongs to
this frame's instant."""
LINES_MAX = 16
"""Data lines at most."""


class ConverterFault(IntFlag):
    """What was wrong with a frame; it is not handed on."""

    STUCK = 1  # every code of a data line is at the same end of its range
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
    most. high_s, lead_s: select high between transfers, and from its fall to the first clock, at least.
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
    ),
    "ad7476": SpiChip(
        bits=16, channels=1, zeros=0xF000, sclk_hz=20e6, conversions_hz=1e6, high_s=100e-9, lead_s=40e-9
    ),
}
"""``mcp3208x2`` at 3.3 V: its limits at 2.7 V. ``high_s`` of the ads7953 and ad7476 are wider than their data
sheets ask for."""


@dataclass(frozen=True, kw_only=True)
class SpiPlan:
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
        said = {"cs_n": "CS", "mosi": "data in", "miso": "data out", "sclk": "clock"}
        further = [(name, k) for name, count in many.items() for k in range(1, count)]
        wires = {}
        for name, k in [*((name, 0) for name in said), *further]:
            wide = many.get(name, 1) > 1
            wires[f"pins__{name}[{k}]" if wide else f"pins__{name}"] = f"{chip}, {said[name]}" + (
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


def sample_clock(clock_hz: float, rate_hz: float) -> tuple[int, int]:
    """(p, q) with p / q = rate / clock in lowest terms: p frames in q cycles. p = 1: every frame takes q
    cycles exactly; otherwise the start of a scan is up to one cycle late."""
    ratio = Fraction(str(rate_hz)) / Fraction(str(clock_hz))
    return ratio.numerator, ratio.denominator


Plan = SpiPlan | ddc232.DdcPlan | MatrixPlan | mpr121.MprPlan


def converter_plan(config: AcceleratorConfig, clock_hz: float | None = None) -> Plan:
    """How the configuration's converter is read at ``clock_hz``, by default the configuration's."""
    kind = config.interface.converter
    if kind == "ddc232":
        return ddc232.ddc_plan(config, clock_hz)
    if kind == "mpr121":
        return mpr121.mpr_plan(config, clock_hz)
    plan = spi_plan(config, clock_hz)
    return matrix_plan(config, plan, clock_hz) if kind == "matrix" else plan


def code_bits(config: AcceleratorConfig) -> int:
    """Bits of the converter's code of a taxel."""
    kind = config.interface.converter
    if kind == "ddc232":
        return config.interface.ddc_bits
    return mpr121.CODE_BITS + 1 if kind == "mpr121" else spi_chip(config).code_bits


def pin_codes(config: AcceleratorConfig) -> int:
    """Codes of a frame at the converter's pins: the taxels, or an array's electrodes."""
    return sum(mpr121.line_counts(config)) if config.interface.converter == "mpr121" else config.sensor.taxels


def spi_chip(config: AcceleratorConfig) -> SpiChip:
    """The chip of a configuration whose converter has an SPI port."""
    interface = config.interface
    if interface.converter == "matrix":
        return SPI_CHIPS["ad7476"]
    if interface.converter in SPI_CHIPS:
        return SPI_CHIPS[interface.converter]
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
    asked = [
        chip.command | channel << chip.channel_bit if chip.channels > 1 else chip.command
        for channel in range(channels)
    ]
    words = asked + [0] * chip.delay
    sclk = min(chip.sclk_hz, config.interface.converter_hz or USUAL_HZ)
    half = half_period(clock, sclk)
    period = clock / chip.conversions_hz
    lead = max(half, math.ceil(chip.lead_s * clock))
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


def code_offset(config: AcceleratorConfig) -> int:
    """The code that becomes sample 0."""
    offset, bits = config.interface.code_offset, code_bits(config)
    if offset is not None:
        return offset
    if config.interface.converter == "ddc232":
        return ddc232.ZERO[config.interface.ddc_bits]
    return 1 << bits - 1 if config.sensor.sample_signed else 0


def code_shift(config: AcceleratorConfig) -> int:
    """Bits rounded away from (code - offset); below 0: zeros appended."""
    shift = config.interface.code_shift
    return code_bits(config) - config.sensor.sample_bits if shift is None else shift


def code_format(config: AcceleratorConfig) -> QFormat:
    """Format of a code."""
    return QFormat(code_bits(config), 0, False)


def refusal(config: AcceleratorConfig) -> tuple[str, str] | None:
    """(field, why) where the converter cannot deliver these frames; None where it can."""
    interface, taxels = config.interface, config.sensor.taxels
    if interface.converter == "none":
        return None
    left_s = (1 - RESERVE) / config.sensor.sample_rate_hz
    if interface.converter == "ddc232":
        return ddc232.ddc_refusal(config, lambda **changes: _with(config, **changes))
    if interface.converter == "mpr121":
        return mpr121.mpr_refusal(config, left_s)
    if interface.converter == "matrix":
        return matrix_refusal(config, matrix_plan(config, spi_plan(config)), left_s)
    if interface.converter == "spi":
        wrong = _wrong_frame(config)
        if wrong:
            return wrong
    chip, count = spi_chip(config), chips(config)
    per_chip = f"{chip.channels} channel{'s' * (chip.channels > 1)}"
    if interface.converter == "ads7953" and count > 1:
        return (
            "converter",
            f"is 'ads7953' with {taxels} taxels; it has 16 channels: use mcp3208x2 or spi with more lines, "
            "or fewer taxels",
        )
    if interface.converter == "mcp3208x2" and count > 2:
        return (
            "converter",
            f"is 'mcp3208x2' with {taxels} taxels; two chips have 16 channels: use fewer taxels or another "
            "converter",
        )
    lines = interface.data_lines or count
    if not 1 <= lines <= min(count, LINES_MAX):
        return (
            "data_lines",
            f"is {interface.data_lines}; {taxels} taxels are {count} chips of {per_chip}: give 1 to "
            f"{min(count, LINES_MAX)}",
        )
    if taxels % min(chip.channels, taxels):
        return "taxels", f"is {taxels}; chips of {per_chip} take a multiple of {chip.channels}"
    if count % lines:
        return "data_lines", f"is {lines} for {count} chips; give a number that divides them"
    if config.hardware.clock_hz < 2 * HALF_MIN * 1e5:
        return (
            "clock_hz",
            f"is {config.hardware.clock_hz:g}; an SPI converter needs at least {2 * HALF_MIN * 1e5:g}",
        )
    return _too_slow(config)


def _wrong_frame(config: AcceleratorConfig) -> tuple[str, str] | None:
    one = config.interface
    for name, low, bits in (
        ("spi_code_bit", one.spi_code_bit, one.spi_code_bits),
        ("spi_tag_bit", one.spi_tag_bit, one.spi_tag_bits),
    ):
        if low + bits > one.spi_frame_bits:
            return (
                name,
                f"is {low} with {bits} bits; they must lie in the {one.spi_frame_bits} bits of a frame",
            )
    for name, value in (("spi_command", one.spi_command), ("spi_zeros", one.spi_zeros)):
        if value >> one.spi_frame_bits:
            return name, f"is {value:#x}; a frame has {one.spi_frame_bits} bits"
    if (
        one.spi_channels > 1
        and one.spi_channel_bit + (one.spi_channels - 1).bit_length() > one.spi_frame_bits
    ):
        return (
            "spi_channel_bit",
            f"is {one.spi_channel_bit}; the channel's number must lie in the {one.spi_frame_bits} bits of a "
            "frame",
        )
    if (
        one.spi_channels > 1
        and not one.spi_delay
        and one.spi_channel_bit < one.spi_code_bit + one.spi_code_bits
    ):
        return "spi_channel_bit", (
            f"is {one.spi_channel_bit} with the code's first bit at "
            f"{one.spi_code_bit + one.spi_code_bits - 1}; a code that comes in its "
            "command's own transfer must come after the channel's number: put it higher, or give spi_delay"
        )
    if one.spi_tag_bits and one.spi_channels > 1 << one.spi_tag_bits:
        return (
            "spi_tag_bits",
            f"is {one.spi_tag_bits}; {one.spi_channels} channels need "
            f"{(one.spi_channels - 1).bit_length()}, or 0 for none",
        )
    return None


def _too_slow(config: AcceleratorConfig) -> tuple[str, str] | None:
    """Whether a scan leaves RESERVE of a frame; with the nearest that does."""
    clock, rate = config.hardware.clock_hz, config.sensor.sample_rate_hz
    plan, left = spi_plan(config), (1 - RESERVE) / config.sensor.sample_rate_hz
    took = plan.scan_cycles / clock
    if took <= left:
        return None
    most = math.floor((1 - RESERVE) / took)
    count = chips(config)
    helps = []
    for lines in range(plan.lines + 1, count + 1):
        parallel = spi_plan(_with(config, data_lines=lines))
        if count % lines == 0 and parallel.scan_cycles / clock <= left:
            helps.append(
                f"data_lines {lines} (chips side by side) takes {1e6 * parallel.scan_cycles / clock:.0f} us"
            )
            break
    chip = spi_chip(config)
    if chip.sclk_hz > clock / plan.half / 2:
        faster = _with(config, converter_hz=chip.sclk_hz)
        if spi_plan(faster).scan_cycles / clock <= left:
            helps.append(
                f"converter_hz {chip.sclk_hz:g} takes {1e6 * spi_plan(faster).scan_cycles / clock:.0f} us"
            )
    if config.interface.converter != "ads7953" and config.sensor.taxels <= 16 and not helps:
        fast = spi_plan(_with(config, converter="ads7953", data_lines=0, converter_hz=0.0))
        if fast.scan_cycles / clock <= left:
            helps.append(f"converter ads7953 takes {1e6 * fast.scan_cycles / clock:.0f} us")
    helps.append(f"a rate of at most {most} Hz works as it is")
    series = f" of {plan.selects} chips in series" if plan.selects > 1 else ""
    return "converter", (
        f"is '{config.interface.converter}', which cannot keep up: {len(plan.transfers)} transfers{series} "
        f"at {clock / plan.half / 2 / 1e6:.3g} MHz take {1e6 * took:.0f} us, and of {1e6 / rate:.0f} us a "
        f"frame at {rate:g} Hz {1e6 * left:.0f} may be used; {', or '.join(helps)}"
    )


class _Changed:
    """A configuration seen with other fields of its interface, without the checks that would refuse it while
    they are made."""

    def __init__(self, config: AcceleratorConfig, interface) -> None:
        self.sensor, self.hardware, self.interface = config.sensor, config.hardware, interface


def _with(config: AcceleratorConfig, **changes) -> AcceleratorConfig:
    return _Changed(config, config.interface.replace(**changes))  # type: ignore[return-value]
