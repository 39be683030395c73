"""The DDC232 of Texas Instruments, 32 current inputs of 20 bits: figures of its data sheet (SBAS331), and the
plan for one configuration.

If copies of the data sheet differ or are silent, a configuration field decides or the slower figure is used:
DVALID at most ``dvalid_clocks`` clocks after CONV, either order of channels, milliseconds after reset.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Literal

from annotated_types import Interval
from pydantic import StrictBool, StrictInt, StrictStr

from eskin.golden.core.converters.base import USUAL_HZ, Converter, Plan, half_period
from eskin.golden.core.group import Refusal

if TYPE_CHECKING:
    from eskin.golden.core.config import AcceleratorConfig

CHANNELS = 32
CLOCK_HZ = {"CK": 10e6, "C": 5e6}
"""Highest frequency of the chip's own clock, by version."""
RATE_HZ = 1 / 166.5e-6
"""Integrations a second at most."""
QUIET_S = 10e-6
"""No data clock this long before and after an edge of CONV."""
DCLK_HZ = 16e6
"""Default data clock. This is an assumption; the tables of the data sheet could not be read."""
WAIT_S = 1e-3
"""Wait after a reset, after its end and after the configuration."""
WARM_UP = 4
"""Integrations that are discarded after the configuration; the first one has no defined length."""
READBACK_BITS = 640
PATTERN, PATTERN_BITS, REVISION_BITS, CONFIGURATION_BITS = 0x30F066012480F69055, 72, 4, 12
PINS = ("clk", "reset_n", "conv", "din_cfg", "clk_cfg", "dclk", "dvalid_n", "dout")
ZERO = {20: 0x01000, 16: 0x0100}
"""Code of no current, by format."""


@dataclass(frozen=True, kw_only=True)
class DdcPlan(Plan):
    """The controller's actions at a given clock frequency.

    configuration: the 12 bits, first bit highest. bits: of a code. places: taxel of each word in the order of
    reading; None: not wired. clk_half, half: cycles of half a period of the chip's clock and of the data
    clock. wait, quiet: cycles. deadline: cycles after an edge of CONV; a later DVALID leaves no time to read.
    dvalid: cycles within which DVALID comes by the data sheet.
    """

    configuration: int
    bits: int
    places: tuple[int | None, ...]
    clk_half: int
    half: int
    wait: int
    quiet: int
    deadline: int
    dvalid: int

    def wires(self, chip: str) -> dict[str, str]:
        """Ports of a board in wiring order, and the pin of each."""
        return {f"pins__{name}": f"{chip}, {name.upper().replace('_N', '')}" for name in PINS}

    def parameters(self, config: AcceleratorConfig) -> dict[str, int]:
        """Parameters of the model in cosim/converters; FIRST: input of taxel 0."""
        chip, first = config.interface.converter, self.places.index(0)
        assert isinstance(chip, Ddc232)
        return {
            "TAXELS": config.sensor.taxels,
            "FIRST": first + 1 if chip.ascending else CHANNELS - first,
            "ASCENDING": int(chip.ascending),
            "DELAY": chip.dvalid_clocks,
            "CLOCK_PS": round(1e12 / CLOCK_HZ[chip.version]),
        }

    @property
    def code_bits(self) -> int:
        """Bits of a code."""
        return self.bits

    @property
    def zero(self) -> int:  # type: ignore[override]
        """Code of no current."""
        return ZERO[self.bits]

    @property
    def read_cycles(self) -> int:
        """Cycles from DVALID to the last code."""
        return 2 * self.half * self.bits * len(self.places) + self.half + 6

    @property
    def scan_cycles(self) -> int:
        """Time from the sample clock to the last code, by the data sheet."""
        return self.dvalid + self.read_cycles


@dataclass(frozen=True, kw_only=True)
class Ddc232(Converter):
    """One DDC232.

    version; range (0..7, its full scale); bits: of a code; first: input (from 1) of taxel 0 (0: the taxels
    are on the inputs that are read first); ascending: input 1 is read first, not 32; dvalid_clocks: most
    periods of the chip's own clock from CONV to DVALID.
    """

    name: StrictStr = "ddc232"
    version: Literal["CK", "C"] = "CK"
    range: Annotated[StrictInt, Interval(ge=0, le=7)] = 7
    bits: Literal[16, 20] = 20
    first: Annotated[StrictInt, Interval(ge=0, le=32)] = 0
    ascending: StrictBool = False
    dvalid_clocks: Annotated[StrictInt, Interval(ge=1, le=4095)] = 1382

    def places(self, taxels: int) -> tuple[int | None, ...]:
        """Taxel of each word up to the last one that is needed; inputs are numbered from 1."""
        words = list(range(1, CHANNELS + 1)) if self.ascending else list(range(CHANNELS, 0, -1))
        first = self.first or (1 if self.ascending else CHANNELS + 1 - taxels)
        taxel_of = [channel - first if 0 <= channel - first < taxels else None for channel in words]
        return tuple(taxel_of[: taxel_of.index(taxels - 1 if self.ascending else 0) + 1])

    def plan(self, config: AcceleratorConfig, clock_hz: float | None = None) -> DdcPlan:
        clock = clock_hz or config.hardware.clock_hz
        clk_half = half_period(clock, CLOCK_HZ[self.version], 1)
        quiet = math.ceil(QUIET_S * clock)
        plan = DdcPlan(
            configuration=self.range << 9 | (self.bits == 20) << 8 | (self.version == "CK") << 7,
            bits=self.bits,
            places=self.places(config.sensor.taxels),
            clk_half=clk_half,
            half=half_period(clock, self.hz or USUAL_HZ),
            wait=math.ceil(WAIT_S * clock),
            quiet=quiet,
            deadline=0,
            # an edge of CONV waits for its clock; DVALID crosses two flip-flops
            dvalid=self.dvalid_clocks * 2 * clk_half + 6,
        )
        frame = math.floor(clock / config.sensor.scan_rate_hz)
        return replace(plan, deadline=frame - quiet - plan.read_cycles)

    def misfits(self, config: AcceleratorConfig) -> Iterator[Refusal]:
        taxels = config.sensor.taxels
        clock, rate = config.hardware.clock_hz, config.sensor.scan_rate_hz
        if taxels > CHANNELS:
            yield (
                "taxels",
                f"is {taxels}; a DDC232 has {CHANNELS} inputs: use fewer taxels or another converter",
            )
        if self.first and self.first + taxels - 1 > CHANNELS:
            yield (
                "converter.first",
                f"is {self.first} with {taxels} taxels; inputs end at {CHANNELS}: give at most "
                f"{CHANNELS + 1 - taxels}",
            )
        if self.hz > DCLK_HZ:
            yield (
                "converter.hz",
                f"is {self.hz:g}; the data clock of a DDC232 has at most {DCLK_HZ:g} Hz here",
            )
        if config.sensor.scan_every > 1:
            yield (
                "scan_every",
                f"is {config.sensor.scan_every}; a DDC232 integrates from frame to frame, so that fewer frames have larger "
                "codes: use 1",
            )
        if rate > RATE_HZ:
            yield (
                "sample_rate_hz",
                f"is {rate:g}; a DDC232 integrates for 166.5 us at least: give at most {math.floor(RATE_HZ)}",
            )
        plan = self.plan(config)
        if plan.dvalid <= plan.deadline:
            return
        most = math.floor(clock / (plan.dvalid + plan.read_cycles + plan.quiet + 1))
        us = 1e6 / clock
        yield (
            "converter",
            f"is 'ddc232', which cannot keep up: DVALID comes up to {plan.dvalid * us:.0f} us after CONV "
            f"(version {self.version} at {clock / plan.clk_half / 2e6:.3g} MHz), {len(plan.places)} words of "
            f"{plan.bits} bits at {clock / plan.half / 2e6:.3g} MHz take {plan.read_cycles * us:.0f} us, of "
            f"{1e6 / rate:.0f} us a frame at {rate:g} Hz; a rate of at most {most} Hz works as it is",
        )
