"""Liberty files: kinds, functions, areas and energies of a process's cells and memory macros. They are read
in place; nothing of them is kept.

The format: Liberty User Guide (Synopsys, open source). Read here: groups, simple and complex attributes; of
tables the middle.
"""

from __future__ import annotations

import gzip
import math
import re
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

from eskin.golden.core import InputError, Record

STATEMENT = re.compile(
    r"""(?P<close>\})|(?P<name>[^\s{}();:,"\\]+)
    (?:\s*\((?P<arguments>(?:"(?:[^"\\]|\\.)*"|[^)"])*)\)\s*(?P<open>\{)?
      |\s*:[ \t]*(?:"(?P<text>(?:[^"\\]|\\.)*)"|(?P<value>[^;\n}"]*)))?
    |[^\s;,]""",
    re.DOTALL | re.VERBOSE,
)
"""``name (arguments) {``, ``name (arguments)``, ``name : value``, ``}``, or any other text."""
ARGUMENT = re.compile(r'"((?:[^"\\]|\\.)*)"|([^\s,"]+)', re.DOTALL)
COMMENT = re.compile(r"/\*.*?\*/|\\\n", re.DOTALL)
MOST_BYTES = 128 << 20
"""Largest unpacked text of a file: ten times the largest open one. A few kB can unpack to more than any
memory."""
UNITS = {"m": 1e-3, "u": 1e-6, "n": 1e-9, "p": 1e-12, "f": 1e-15, "": 1.0}

ROLES = {
    "flip-flop": {"clocked_on", "next_state"},
    "latch": {"enable", "data_in"},
    "gate": {"clock", "enable", "output"},
}
"""Attributes that a cell of each kind must have."""
GATE_PINS = {
    "clock": "clock_gate_clock_pin",
    "enable": "clock_gate_enable_pin",
    "test": "clock_gate_test_pin",
    "output": "clock_gate_out_pin",
}
"""Attributes that mark the pins of a clock gate, by role."""
ACCESSES = {"read": {"A_MEN", "!A_WEN", "A_REN"}, "write": {"A_MEN", "A_WEN", "!A_REN"}}
"""Levels of the pins of a macro at its clock edge (``!``: low), by access."""


@dataclass
class Group:
    """``kind (arguments) { attributes, groups }``; a complex attribute is a group without contents, too, as it may
    come again and again."""

    kind: str
    arguments: tuple[str, ...]
    attributes: dict[str, str] = field(default_factory=dict)
    groups: list[Group] = field(default_factory=list)

    def named(self, *kinds: str) -> Iterator[Group]:
        """Groups of these kinds."""
        return (group for group in self.groups if group.kind in kinds)

    def number(self, name: str, default: float = 0.0) -> float:
        """An attribute as a number; ``default`` where there is none.

        Raises
        ------
        ValueError
            It is text, or too large.
        """
        return _number(self.attributes[name]) if name in self.attributes else default


@dataclass(frozen=True, kw_only=True)
class Pin:
    """A pin. function: of an output, in Liberty's operators; capacitance in farad; toggle_j: joule of the
    cell each time it changes."""

    direction: str
    function: str = ""
    capacitance: float = 0.0
    toggle_j: float = 0.0
    clock: bool = False
    gate: str = ""  # of a clock gate: "clock", "enable", "test" or "output"


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A cell. kind: ``logic``, ``flip-flop``, ``latch``, ``gate`` (of a clock), ``memory``, ``other``. area
    in um2; leakage in watt. state: clocked_on and next_state, or enable and data_in, and clear, preset; the
    names of the two states as ``state`` and ``inverse``. access_j: of a memory by what it does, ``read`` or
    ``write``; words, bits: its shape."""

    name: str
    kind: str
    area: float
    leakage: float
    pins: Mapping[str, Pin]
    state: Mapping[str, str] = field(default_factory=dict)
    access_j: Mapping[str, float] = field(default_factory=dict)
    words: int = 0
    bits: int = 0
    usable: bool = True

    @property
    def gate_pins(self) -> dict[str, str]:
        """Pins of a clock gate by their role."""
        return {pin.gate: name for name, pin in self.pins.items() if pin.gate}


@dataclass(frozen=True, kw_only=True)
class WireLoad:
    """lengths: of a net by its number of receivers; slope: length of each receiver beyond the table; farad:
    of a length of 1."""

    lengths: Mapping[int, float]
    slope: float
    farad: float

    def capacitance(self, receivers: int) -> float:
        """Farad of a net's wire."""
        if not receivers or not self.lengths:
            return 0.0
        counts = sorted(self.lengths)
        inside = np.interp(receivers, counts, [self.lengths[count] for count in counts])
        return (inside + self.slope * max(0, receivers - counts[-1])) * self.farad


@dataclass(frozen=True, kw_only=True)
class Library:
    """A file. voltage and temperature identify its corner; wire_loads: models of a net's wire by name."""

    path: Path
    name: str
    voltage: float
    temperature: float
    cells: Mapping[str, Cell]
    wire_loads: Mapping[str, WireLoad]

    @property
    def macros(self) -> list[Cell]:
        """Memory macros, the smallest first."""
        return sorted(
            (cell for cell in self.cells.values() if cell.kind == "memory"), key=lambda cell: cell.area
        )

    @property
    def holds_logic(self) -> bool:
        """Standard cells, not macros alone."""
        return any(cell.kind == "logic" for cell in self.cells.values())


def text_of(path: Path) -> str:
    """The text of a file, unpacked where it is packed.

    Raises
    ------
    InputError
    """
    try:
        with Path(path).open("rb") as raw:
            packed = raw.peek(2)[:2] == b"\x1f\x8b"
            text = (gzip.GzipFile(fileobj=raw) if packed else raw).read(MOST_BYTES + 1)
        if len(text) <= MOST_BYTES:
            return text.decode()
        fault = f"holds more than {MOST_BYTES >> 20} MB of text"
    except OSError as error:
        fault = error.strerror or "is no gzip file"
    except (UnicodeDecodeError, EOFError, zlib.error):
        fault = "is not text"
    raise InputError(f"`liberty` {path}: {fault}; give a Liberty file (.lib or .lib.gz)")


def parse(text: str) -> Group:
    """The topmost group, ``library``.

    Raises
    ------
    ValueError
        The text is no Liberty.
    """
    root = Group("", ())
    stack = [root]
    for statement in STATEMENT.finditer(COMMENT.sub(" ", text)):
        group, name = stack[-1], statement["name"]
        if statement["close"]:
            if len(stack) == 1:
                raise ValueError("a closing bracket has no opening one")
            stack.pop()
        elif statement["arguments"] is not None:
            arguments = tuple(quoted or plain for quoted, plain in ARGUMENT.findall(statement["arguments"]))
            inner = Group(name, arguments)
            group.groups.append(inner)
            if statement["open"]:
                stack.append(inner)
            else:
                group.attributes[name] = " ".join(arguments)
        elif statement["text"] is not None or statement["value"]:
            group.attributes[name] = statement["text"] or " ".join((statement["value"] or "").split())
        elif group is root:
            raise ValueError(f"'{statement[0][:20]}' is no group")
    library = next(root.named("library"), None)
    if library is None or len(stack) > 1:
        raise ValueError("there is no whole group 'library'")
    return library


def read(path: Path) -> Library:
    """The library in a file.

    Raises
    ------
    InputError
        It cannot be read, or is no Liberty file.
    """
    text = text_of(path)
    try:
        return _library(Path(path), parse(text))
    except ValueError as error:
        fault = " ".join(str(error).split())  # a quote that nobody closes goes on over lines
        raise InputError(
            f"`liberty` {path}: is no Liberty file ({fault}); give the process's .lib or .lib.gz"
        ) from None


def _library(path: Path, top: Group) -> Library:
    conditions = next(top.named("operating_conditions"), Group("", ()))
    farad = _unit(top.attributes.get("capacitive_load_unit", "1 pf").replace(" ", ""))
    watt = _unit(top.attributes.get("leakage_power_unit", "1nW"))
    voltage = top.number("nom_voltage", conditions.number("voltage"))
    joule = farad  # of a volt squared
    return Library(
        path=path,
        name=" ".join(top.arguments),
        voltage=voltage,
        temperature=top.number("nom_temperature", conditions.number("temperature")),
        cells=_by_name(top.named("cell"), lambda group: _cell(group, farad, watt, joule)),
        wire_loads=_by_name(top.named("wire_load"), lambda group: _wire_load(group, farad)),
    )


def _by_name(groups: Iterable[Group], make: Callable[[Group], Any]) -> Record:
    """The result of ``make`` for each group, by the group's first argument.

    Raises
    ------
    ValueError
        A group has no name, or lacks what it must have.
    """
    cells = {}
    for group in groups:
        try:
            cells[group.arguments[0]] = make(group)
        except (ValueError, IndexError) as error:
            fault = "a name is missing" if isinstance(error, IndexError) else str(error)[:80]
            raise ValueError(
                f"{group.kind} ({', '.join(group.arguments)[:40]}) is damaged: {fault}"
            ) from None
    return cells


def corners(libraries: Iterable[Library]) -> dict[str, list[Library]]:
    """Files by corner: ``typ`` at room temperature, ``slow`` above 70 C, ``fast`` below 0 C.

    Raises
    ------
    InputError
        No file has standard cells at the typical corner, or two have.
    """
    found: dict[str, list[Library]] = {"typ": [], "slow": [], "fast": []}
    for library in libraries:
        found["slow" if library.temperature > 70 else "fast" if library.temperature < 0 else "typ"].append(
            library
        )
    for corner, files in found.items():
        logic = [library.path.name for library in files if library.holds_logic]
        if len(logic) > 1:
            raise InputError(
                f"`liberty`: {logic[0]} and {logic[1]} both hold cells of the {corner} corner; give one of "
                "them"
            )
        if corner == "typ" and not logic:
            raise InputError(
                "`liberty`: no file holds standard cells of the typical corner (about 25 C); add it"
            )
    return found


def _wire_load(group: Group, farad: float) -> WireLoad:
    rows = [" ".join(row.arguments).replace(",", " ").split() for row in group.named("fanout_length")]
    if any(len(row) != 2 for row in rows):
        raise ValueError("fanout_length takes two numbers")
    lengths = {int(_number(count)): _number(length) for count, length in rows}
    return WireLoad(lengths=lengths, slope=group.number("slope"), farad=group.number("capacitance") * farad)


def _unit(text: str) -> float:
    unit = re.fullmatch(r"([\d.]+)([munpf]?)[a-zA-Z]", text.strip()) or re.fullmatch(
        r"([\d.]+)(p|f)f", text.strip().lower()
    )
    return _number(unit[1]) * UNITS[unit[2]] if unit else 1e-12


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"'{text[:20]}' is not a number")
    return value


def _middle(table: Group) -> float:
    """The entry of a table at a short edge and a small load, as most nets of a small design have."""
    rows = re.findall(r"[^\s,]+", table.attributes.get("values", "0"))
    numbers = [_number(value) for value in rows if re.match(r"[-+.\d]", value)]
    if not numbers:
        return 0.0
    side = round(len(numbers) ** 0.5)
    return numbers[side + 1] if side * side == len(numbers) and side > 1 else numbers[0]


def _power(pin: Group) -> float:
    """Mean of both edges over all conditions, in the file's unit."""
    edges = [
        [_middle(table) for table in power.named("rise_power", "fall_power", "power")]
        for power in pin.named("internal_power")
    ]
    means = [fmean(values) for values in edges if values]
    return fmean(means) if means else 0.0


def _cell(group: Group, farad: float, watt: float, joule: float) -> Cell:
    pins: dict[str, Pin] = {}
    accesses: dict[str, float] = {}
    for pin in group.named("pin", "bus"):
        gate = next((role for role, name in GATE_PINS.items() if pin.attributes.get(name) == "true"), "")
        name = pin.arguments[0]
        pins[name] = Pin(
            direction=pin.attributes.get("direction", "input"),
            function=pin.attributes.get("function", ""),
            capacitance=pin.number("capacitance") * farad,
            toggle_j=_power(pin) * joule,
            clock=pin.attributes.get("clock") == "true",
            gate=gate,
        )
        if pins[name].clock:
            for power in pin.named("internal_power"):
                when = power.attributes.get("when", "").replace(" ", "")
                value = max(map(_middle, power.groups), default=0.0) * joule
                accesses |= {name: value for name, terms in ACCESSES.items() if set(when.split("&")) == terms}
    memory = next(group.named("memory"), None)
    state = next(group.named("ff", "latch", "ff_bank", "latch_bank"), None)
    gating = "clock_gating_integrated_cell" in group.attributes
    outputs = [pin for pin in pins.values() if pin.direction == "output" and pin.function]
    kind = "memory" if memory else "gate" if gating else "other"
    if not (memory or gating) and outputs:
        kind = "logic" if state is None else "flip-flop" if state.kind.startswith("ff") else "latch"
    words, bits = (int(memory.number(name)) if memory else 0 for name in ("address_width", "word_width"))
    if not (0 <= words <= 32 and 0 <= bits <= 4096):
        raise ValueError("no macro is so large")
    attributes = {}
    if state is not None:
        attributes = dict(state.attributes) | {"state": state.arguments[0], "inverse": state.arguments[1]}
    if not ROLES.get(kind, set()) <= {*attributes, *(pin.gate for pin in pins.values())}:
        kind = "other"  # nobody can say what it does
    return Cell(
        name=group.arguments[0],
        kind=kind,
        area=group.number("area"),
        leakage=group.number("cell_leakage_power") * watt,
        pins=pins,
        state=attributes if kind in ROLES else {},
        access_j=accesses,
        words=1 << words if memory else 0,
        bits=bits,
        usable=group.attributes.get("dont_use") != "true",
    )
