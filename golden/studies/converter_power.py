"""What a converter takes by itself, by its data sheet: beside the chain's estimate, never in its sum."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.converters import SpiPlan, converter_plan


@dataclass(frozen=True)
class Stated:
    """watt: of one chip while it converts at its highest rate. says: the data sheet's words for it."""

    watt: float
    says: str


STATED = {
    "ads7953": Stated(14.5e-3, "SLAS605: 14.5 mW typical at 1 MS/s, +VA 5 V, +VBD 3 V"),
    "mcp3208x2": Stated(320e-6 * 5.0, "DS21298: 320 uA typical while active, 5 V"),
    "ad7476": Stated(5.1e-3, "AD7476A, rev. F: 5.1 mW in normal operation at 1 MS/s, 3 V"),
    "matrix": Stated(
        5.1e-3,
        "its AD7476A, rev. F: 5.1 mW in normal operation at 1 MS/s, 3 V; multiplexers and amplifier not "
        "counted",
    ),
}
"""Converters of which a figure was read in the data sheet. Of the others (``ddc232``, ``mpr121``) none was at
hand; ``spi`` is any chip."""


def chips(config: AcceleratorConfig) -> int:
    """Chips of the configuration's converter."""
    plan = converter_plan(config)
    return plan.lines * plan.selects if isinstance(plan, SpiPlan) else 1


def converter_power(config: AcceleratorConfig) -> dict[str, Any] | None:
    """What the converter takes at most while it runs all the time; None without a converter.

    Returns
    -------
    dict
        converter, chips, power_w (None: no figure at hand), per_touch_j (of the touch's frames, None
        likewise), rests_on (words).
    """
    name = config.interface.converter
    if name == "none":
        return None
    stated, count = STATED.get(name), chips(config)
    if stated is None:
        return {
            "converter": name,
            "chips": count,
            "power_w": None,
            "per_touch_j": None,
            "rests_on": "no figure of its data sheet at hand",
        }
    power = count * stated.watt
    seconds = config.last_frame / config.sensor.sample_rate_hz
    words = f"{stated.says}; never idle, so an upper figure at this rate; not measured"
    return {
        "converter": name,
        "chips": count,
        "power_w": power,
        "per_touch_j": power * seconds,
        "rests_on": words,
    }


def in_words(power: dict[str, Any]) -> str:
    """A row of a table."""
    if power["power_w"] is None:
        return f"{power['converter']}: {power['rests_on']}"
    many = f"{power['chips']} chips, " if power["chips"] > 1 else ""
    figures = f"{1e3 * power['power_w']:.3g} mW at most, {1e3 * power['per_touch_j']:.3g} mJ a touch"
    return f"{figures} ({many}{power['rests_on']}); in no other figure"
