"""The common part of all converters: their fields, the interface to the rest of the project, the highest
clock of their wires, and the share of a frame's time that a scan may take."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from enum import IntFlag
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from annotated_types import Ge
from pydantic import StrictInt, StrictStr

from eskin.golden.core.group import Group, Real, Refusal

if TYPE_CHECKING:
    import numpy as np

    from eskin.golden.core.config import AcceleratorConfig

RESERVE = 0.1
"""Share of a frame's time that a scan leaves free. The frame is forwarded in this time, and the last taxel
still belongs to this frame's instant."""

HALF_MIN = 2
"""Fewest cycles in half a clock period: a data line crosses two flip-flops before it is read."""
USUAL_HZ = 2e6
"""Default serial clock of converters with a faster data sheet: wires on a breadboard carry it."""


class ConverterFault(IntFlag):
    """Reasons why a frame is wrong and is dropped."""

    STUCK = 1  # every code of a chip is at the same end of its range
    ORDER = 2  # another channel's number, or a bit that the data sheet fixes is wrong
    LATE = 4  # the frame was not complete, or the chain not ready, when the next was due
    SILENT = 8  # no answer: no acknowledge, no DVALID
    READBACK = 16  # the settings read back differ from those written


def half_period(clock_hz: float, wanted_hz: float, least: int = HALF_MIN) -> int:
    """Cycles of half a period of the fastest clock that is not faster than ``wanted_hz``."""
    return max(least, math.ceil(clock_hz / wanted_hz / 2 - 1e-9))


class Plan:
    """Plan by which a configuration's converter is read, for all code except its driver. Each plan also
    has ``wires`` (of a board), ``parameters`` (of the model in cosim/converters), ``scan_cycles`` and
    ``code_bits``."""

    chips: int = 1
    zero: int | None = None
    """The code of sample 0, if the data sheet has one."""
    sclk_cycles: int = 0
    """Cycles of a period of SCLK; 0: the port is no SPI."""

    @property
    def sleeping(self) -> Plan:
        """The plan by which chips sleep between scans; the same where they have no command for it."""
        return self

    def awake(self, scans: float) -> float:
        """Share of time in which a chip that sleeps between scans is awake, at ``scans`` a cycle."""
        return scans * self.scan_cycles  # type: ignore[attr-defined]

    def pin_codes(self, config: AcceleratorConfig) -> int:
        """Number of codes of a frame at the pins."""
        return config.sensor.taxels

    def to_pins(self, codes: np.ndarray, config: AcceleratorConfig) -> np.ndarray:
        """Codes at the pins (frames, pin codes) for codes of the taxels (frames, taxels)."""
        return codes

    def from_pins(self, codes: np.ndarray, config: AcceleratorConfig) -> np.ndarray:
        """Codes of the taxels (frames, taxels) for codes at the pins (frames, pin codes)."""
        return codes


@dataclass(frozen=True, kw_only=True)
class Converter(Group):
    """A converter between sensor and chain; each kind adds the fields that its chip has.

    hz: highest frequency of its serial clock (0: 2 MHz, or the limit of its data sheet if that is lower; the limit of its
    data sheet where it sleeps between scans).
    code_offset (default: half the range where samples are signed, else 0), code_shift (default: full scale on
    full scale): sample = (code - code_offset) >> code_shift, rounded and saturated; a shift below 0 appends
    zeros.
    """

    prefix: ClassVar[str] = "converter."
    watt: ClassVar[float | None] = None
    """Power of a chip that converts at its highest rate, from the data sheet; None if the sheet has no
    figure."""
    stated: ClassVar[str] = ""
    """Data sheet and conditions that ``watt`` is taken from."""
    asleep_watt: ClassVar[float | None] = None
    """Power of a chip that sleeps, from the data sheet; None: it cannot, or the sheet has no figure."""
    sleeps_unselected: ClassVar[bool] = False
    """It sleeps while its select is high, without any command."""

    name: StrictStr = field(repr=False)
    hz: Annotated[Real, Ge(0)] = 0.0
    code_offset: StrictInt | None = None
    code_shift: StrictInt | None = None

    def __str__(self) -> str:
        return self.name

    def refusals(self) -> Iterator[Refusal]:
        if self.code_shift is not None and not -15 <= self.code_shift <= 20:
            yield "code_shift", f"is {self.code_shift}; it must lie in -15..20"
        if self.code_offset is not None and not -(1 << 23) <= self.code_offset < 1 << 24:
            yield "code_offset", f"is {self.code_offset}; it must be a code"

    def plan(self, config: AcceleratorConfig, clock_hz: float | None = None) -> Any:
        """The plan of the chip at ``clock_hz`` (default: the configuration's clock)."""
        raise TypeError("a configuration without a converter has no plan")

    def misfits(self, config: AcceleratorConfig) -> Iterator[Refusal]:
        """Reasons why the chip cannot deliver the configuration's frames, as (field of the configuration,
        reason)."""
        yield from ()

    def settings(self) -> str | dict[str, Any]:
        """Plain values for a file: the name, with the fields that differ from the chip's defaults."""
        changed = {
            each.name: getattr(self, each.name)
            for each in fields(self)
            if each.name != "name" and getattr(self, each.name) != each.default
        }
        return {"name": self.name} | changed if changed else self.name


@dataclass(frozen=True, kw_only=True)
class NoConverter(Converter):
    """Frames come over the link or a bus."""

    name: StrictStr = "none"


def too_slow(config: AcceleratorConfig, work: str, took_s: float) -> Iterator[Refusal]:
    """Refuse a scan that takes longer than a frame without its RESERVE. ``work`` describes the scan; the
    sentence gives the highest rate that works."""
    rate = config.sensor.scan_rate_hz
    usable_s = (1 - RESERVE) / rate
    if took_s > usable_s:
        yield (
            "converter",
            f"is '{config.interface.converter}', which cannot keep up: {work} take {1e6 * took_s:.0f} us, and of "
            f"{1e6 / rate:.0f} us a frame at {rate:g} Hz {1e6 * usable_s:.0f} may be used; a rate of at most "
            f"{math.floor((1 - RESERVE) / took_s)} Hz works as it is",
        )


def slow_clock(config: AcceleratorConfig) -> Iterator[Refusal]:
    """Refuse a clock that is too slow for a serial port of 100 kHz."""
    clock, least = config.hardware.clock_hz, 2 * HALF_MIN * 1e5
    if clock < least:
        yield "clock_hz", f"is {clock:g}; an SPI converter needs at least {least:g}"
