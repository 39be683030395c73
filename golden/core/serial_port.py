"""What serial ports to converters have in common: how fast their wires may be."""

from __future__ import annotations

import math

HALF_MIN = 2
"""Cycles of half a clock period at least: a data line crosses two flip-flops before it is looked at."""
USUAL_HZ = 2e6
"""What is taken of a faster data sheet where nothing is said: wires on a breadboard carry it."""


def half_period(clock_hz: float, wanted_hz: float, least: int = HALF_MIN) -> int:
    """Cycles of half a period of the fastest clock that is not faster than ``wanted_hz``."""
    return max(least, math.ceil(clock_hz / wanted_hz / 2 - 1e-9))
