"""Converters between sensor and chain. Each is a class with the fields of its chip and the plan by which hardware and
golden model read it.

The figures stand in the data sheets; if a sheet leaves something open, the slower or wider figure is
used. On a board with 3.3 V pins a converter runs at 3.3 V; a converter whose data sheet has limits only for
2.7 V and 5 V gets those for 2.7 V.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from eskin.golden.core.converters.base import Converter, ConverterFault, NoConverter
from eskin.golden.core.converters.ddc232 import Ddc232
from eskin.golden.core.converters.matrix import Matrix
from eskin.golden.core.converters.mpr121 import Mpr121
from eskin.golden.core.converters.spi import SPI_CHIPS, Spi, SpiByName, SpiPlan, sample_clock
from eskin.golden.core.formats import QFormat

if TYPE_CHECKING:
    from eskin.golden.core.config import AcceleratorConfig

CONVERTERS: dict[str, Converter] = {
    **{name: SpiByName(name=name) for name in SPI_CHIPS},
    **{kind.name: kind for kind in (Spi(), Ddc232(), Mpr121(), Matrix())},
}
"""Every converter by its name, with its default fields. A new chip on SPI needs a row in `SPI_CHIPS`; a chip
that is read in another way needs a file beside ddc232.py and an entry here."""


def converter_of(value: Any) -> Any:
    """The converter that ``value`` describes: a name, or an object with the name and fields."""
    if not isinstance(value, (str, dict)):
        return value
    fields = {"name": value} if isinstance(value, str) else dict(value)
    name = fields.pop("name", None)
    known = {"none": NoConverter(), **CONVERTERS}
    if not isinstance(name, str) or name not in known:
        raise ValueError(f"give one of {', '.join(known)}, or an object with such a name and its fields")
    own = [field for field in vars(known[name]) if field != "name"]
    if unknown := sorted(set(fields) - set(own)):
        raise ValueError(f"{name} has no field {unknown[0]}; its fields are {', '.join(own)}")
    return known[name].replace(**fields)


def converter_plan(config: AcceleratorConfig, clock_hz: float | None = None) -> Any:
    """The plan of the configuration's converter at ``clock_hz`` (default: the configuration's clock)."""
    return config.interface.converter.plan(config, clock_hz)


def code_bits(config: AcceleratorConfig) -> int:
    """Bits of the converter's code of a taxel."""
    return converter_plan(config).code_bits


def code_offset(config: AcceleratorConfig) -> int:
    """The code that becomes sample 0."""
    middle = 1 << code_bits(config) - 1 if config.sensor.sample_signed else 0
    choices = (config.interface.converter.code_offset, converter_plan(config).zero, middle)
    return next(offset for offset in choices if offset is not None)


def code_shift(config: AcceleratorConfig) -> int:
    """Bits rounded away from (code - offset); below 0: zeros appended."""
    shift = config.interface.converter.code_shift
    return code_bits(config) - config.sensor.sample_bits if shift is None else shift


def code_format(config: AcceleratorConfig) -> QFormat:
    """Format of a code."""
    return QFormat(code_bits(config), 0, False)
