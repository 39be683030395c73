"""The registers of a design as files for other tools: C header, SystemRDL 2.0, a table for documents. All are
written from `eskin.rtl.program.memory_map`, by the files of templates/."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from eskin.golden.core import AcceleratorConfig, template
from eskin.rtl.program.memory_map import (
    Bits,
    Described,
    InterfaceRegister,
    Register,
    ShellRegister,
    TeachRegister,
    interface_registers,
    mapped,
    mask_words,
    teach_registers,
)


@dataclass(frozen=True)
class Field:
    """Bits ``low`` to ``high`` of a register."""

    name: str
    low: int
    high: int
    text: str
    reset: int | None

    @property
    def width(self) -> int:
        """Bits."""
        return self.high - self.low + 1

    @property
    def mask(self) -> int:
        """Its bits in the register's word."""
        return (2 << self.high) - (1 << self.low)


@dataclass(frozen=True)
class Entry:
    """A register of a design; ``count`` of them lie side by side. ``reset`` None: depends on the design."""

    name: str
    address: int
    count: int
    bits: int
    access: str
    text: str
    effect: str
    reset: int | None
    fields: tuple[Field, ...]

    @property
    def sentence(self) -> str:
        """One sentence: the content of a register, and the effect of an access."""
        verb = {"ro": "On reading: ", "wo": "On writing: ", "rw": ""}[self.access]
        return f"{self.text}. {verb}{self.effect}." if self.effect else f"{self.text}."

    @property
    def read_acts(self) -> bool:
        """Reading it changes something."""
        return self.access != "wo" and bool(self.effect)


def entry(register: Described, count: int = 1, reset: int | None = None) -> Entry:
    """``register`` as the files have it; ``reset`` in place of the register's value where that depends on the design."""
    bits = 32 if isinstance(register, ShellRegister) else 16
    begin = reset if register.reset is None else register.reset
    places: Iterable[tuple[str, int, int, str]]
    if isinstance(register.fields, Mapping):
        places = [(name, low, high, "") for name, (low, high) in register.fields.items()]
    else:
        flags: type[Bits] = register.fields
        places = [(bit.name or "", bit.bit_length() - 1, bit.bit_length() - 1, bit.text) for bit in flags]
    fields = tuple(
        Field(name, low, high, text, None if begin is None else begin >> low & (2 << high - low) - 1)
        for name, low, high, text in places or [("VALUE", 0, bits - 1, "")]
    )
    return Entry(
        register.name,
        int(register),
        count,
        bits,
        register.access,
        register.text,
        register.effect,
        begin,
        fields,
    )


def entries(config: AcceleratorConfig, shell: bool = False, samples: bool = True) -> list[Entry]:
    """The registers of a design, by address; behind a bus (``shell``) the shell's registers too, with ``samples``
    the registers that take samples."""
    words = len(mask_words(config))
    present = [register for register in Register if register in mapped(config)]
    begin: dict[int, int] = {
        InterfaceRegister[f"STIM_{name}"]: getattr(config.interface, f"stim_{name.lower()}")
        for name in ("AMPLITUDE", "DELAY", "FREQUENCY", "WIDTH")
    }
    if not any(mask_words(config)):
        begin[Register.MASK] = 0
    several: dict[int, int] = {Register.MASK: words, Register.TAXEL_FAULTS: words}
    fed = (ShellRegister.SAMPLE, ShellRegister.SAMPLE_PAIR, ShellRegister.NEXT_TAXEL)
    shells = [register for register in ShellRegister if shell and (samples or register not in fed)]
    return [
        entry(register, several.get(int(register), 1), begin.get(int(register)))
        for register in (*present, *interface_registers(config), *shells, *teach_registers(config))
    ]


# -------------------------------------------------------------------- files
def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


_hex = "0x{:X}".format


def written(name: str, registers: Iterable[Entry], **values: Any) -> str:
    """The text of the file ``name``: its template, filled in."""
    filled = template(__file__, name, hex=_hex, quoted=_quoted)
    return filled.render(registers=registers, **values)


def system_rdl(registers: Iterable[Entry]) -> str:
    """SystemRDL 2.0, byte addresses behind a bus."""
    return written("eskin.rdl", registers)


def markdown() -> str:
    """Every register that a design may have, as a table."""
    every = (*Register, *InterfaceRegister, *ShellRegister, *TeachRegister)
    return written("registers.md", map(entry, every)).rstrip("\n")
