"""A matrix of rows and columns behind multiplexers, an amplifier and one converter channel: the plan for one
configuration.

The converter is an AD7476: its select line falls when the amplifier has settled, which takes the sample.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge
from pydantic import StrictStr

from eskin.golden.core.converters.base import Converter, Plan, slow_clock, too_slow
from eskin.golden.core.converters.spi import SPI_CHIPS, SpiByName, SpiPlan
from eskin.golden.core.group import Real, Refusal

if TYPE_CHECKING:
    from eskin.golden.core.config import AcceleratorConfig


@dataclass(frozen=True, kw_only=True)
class MatrixPlan(Plan):
    """rows, columns: of the matrix. settle, settle_s: cycles and seconds from a new address to the sample.
    port: plan of the converter's SPI port, one transfer per cell, and where it sleeps one before and one behind all."""

    rows: int
    columns: int
    settle: int
    settle_s: float
    port: SpiPlan

    def wires(self, chip: str) -> dict[str, str]:
        """Ports of a board in wiring order, and the pin of each."""
        wires = {"pins__cs_n": "ad7476, CS", "pins__miso": "ad7476, data out", "pins__sclk": "ad7476, clock"}
        wires |= {"pins__off": "multiplexers, disable"} if self.port.short else {}
        for name, count in (("row", self.rows), ("column", self.columns)):
            bits = len(f"{count - 1:b}")  # binary digits, one at least
            ports = [f"pins__{name}[{k}]" if bits > 1 else f"pins__{name}" for k in range(bits)]
            wires |= {port: f"multiplexer of {name}s, address {k}" for k, port in enumerate(ports)}
        return wires

    def parameters(self, config: AcceleratorConfig) -> dict[str, int]:
        """Parameters of the model in cosim/converters."""
        return {"ROWS": self.rows, "COLUMNS": self.columns, "SETTLE_PS": round(1e12 * self.settle_s)}

    @property
    def sleeping(self) -> MatrixPlan:
        """The plan by which converter and multiplexers are off between scans."""
        return dataclasses.replace(self, port=self.port.sleeping)

    @property
    def sclk_cycles(self) -> int:  # type: ignore[override]
        """Cycles of a period of SCLK."""
        return self.port.sclk_cycles

    @property
    def code_bits(self) -> int:
        """Bits of a code."""
        return self.port.code_bits

    @property
    def cell_cycles(self) -> int:
        """Cycles from one cell's address to the next one's."""
        return self.settle + self.port.transfer_cycles + 3

    @property
    def scan_cycles(self) -> int:
        """Cycles from the sample clock to the last code."""
        others = self.port.per_select - 1
        return self.rows * self.columns * self.cell_cycles + others * (self.port.transfer_cycles + 3)


@dataclass(frozen=True, kw_only=True)
class Matrix(Converter):
    """Rows and columns on multiplexers, one ad7476. settle_s: seconds from a new address to the sample."""

    watt = SPI_CHIPS["ad7476"].watt
    stated = f"its {SPI_CHIPS['ad7476'].stated}; multiplexers and amplifier not counted"
    asleep_watt = SPI_CHIPS["ad7476"].asleep_watt

    name: StrictStr = "matrix"
    settle_s: Annotated[Real, Ge(0)] = 20e-6

    def plan(self, config: AcceleratorConfig, clock_hz: float | None = None) -> MatrixPlan:
        clock, array = clock_hz or config.hardware.clock_hz, config.interface
        settle = math.ceil(self.settle_s * clock)
        port = OneCell(name="ad7476", hz=self.hz).plan(config, clock_hz)
        return MatrixPlan(
            rows=array.rows, columns=array.columns, settle=settle, settle_s=self.settle_s, port=port
        )

    def misfits(self, config: AcceleratorConfig) -> Iterator[Refusal]:
        taxels, plan, clock = config.sensor.taxels, self.plan(config), config.hardware.clock_hz
        if plan.rows * plan.columns != taxels:
            yield (
                "rows",
                f"is {plan.rows} with {plan.columns} columns, and there are {taxels} taxels; give the matrix's own",
            )
        yield from slow_clock(config)
        cell_us = 1e6 * plan.cell_cycles / clock
        work = f"{taxels} cells of {cell_us:.3g} us, {1e6 * self.settle_s:.3g} of them to settle (settle_s),"
        yield from too_slow(config, work, plan.scan_cycles / clock)


class OneCell(SpiByName):
    """The chip behind the multiplexers."""

    def chips(self, config: AcceleratorConfig) -> int:
        return 1
