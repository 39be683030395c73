"""What converters have in common: what the rest of the project asks of one, how fast its wires may be, how
much of a frame's time a scan may take."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from eskin.golden.core.config import AcceleratorConfig

RESERVE = 0.1
"""Of a frame's time that a scan leaves free: the frame is handed on then, and the last taxel still belongs to
this frame's instant."""

HALF_MIN = 2
"""Cycles of half a clock period at least: a data line crosses two flip-flops before it is looked at."""
USUAL_HZ = 2e6
"""What is taken of a faster data sheet where nothing is said: wires on a breadboard carry it."""


def half_period(clock_hz: float, wanted_hz: float, least: int = HALF_MIN) -> int:
    """Cycles of half a period of the fastest clock that is not faster than ``wanted_hz``."""
    return max(least, math.ceil(clock_hz / wanted_hz / 2 - 1e-9))


Refusal = tuple[str, str]
"""(field, why): what is wrong with a configuration."""


class Plan:
    """How a configuration's converter is read, as everybody but its own driver sees it. Each plan has
    ``wires`` (of a board), ``parameters`` (of the model in cosim/converters), ``scan_cycles`` and
    ``code_bits`` too."""

    chips: int = 1
    zero: int | None = None
    """The code of sample 0, where the data sheet says one."""

    def pin_codes(self, config: AcceleratorConfig) -> int:
        """Codes of a frame at the pins."""
        return config.sensor.taxels

    def to_pins(self, codes: np.ndarray, config: AcceleratorConfig) -> np.ndarray:
        """Codes at the pins (frames, pin codes) for codes of the taxels (frames, taxels)."""
        return codes

    def from_pins(self, codes: np.ndarray, config: AcceleratorConfig) -> np.ndarray:
        """The way back."""
        return codes


@dataclass(frozen=True)
class Converter:
    """plan: of (configuration, Hz of the clock; None: the configuration's). refusals: what it cannot deliver.
    watt: of a chip that converts at its highest rate, by the data sheet's words ``stated``; None where none
    was at hand."""

    plan: Callable[[AcceleratorConfig, float | None], Any]
    refusals: Callable[[AcceleratorConfig], Iterator[Refusal]]
    watt: float | None = None
    stated: str = ""


def frame_s(config: AcceleratorConfig) -> float:
    """Seconds that a scan may take."""
    return (1 - RESERVE) / config.sensor.sample_rate_hz


def slow_clock(config: AcceleratorConfig) -> Iterator[Refusal]:
    """A clock too slow for a serial port of 100 kHz."""
    clock, least = config.hardware.clock_hz, 2 * HALF_MIN * 1e5
    if clock < least:
        yield "clock_hz", f"is {clock:g}; an SPI converter needs at least {least:g}"
