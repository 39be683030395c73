"""Tables, into which every reader turns a file: rows with names, a clock and attributes, and the user's
remarks about a source (``Reading``)."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from eskin.golden.core import InputError, Record
from eskin.golden.data.codes import Worth, place_of

DataFrame = Any
"""The type of pandas, which is slow to import: functions import it."""
MOST_BYTES = 2 << 30
UNPACKED_BYTES, MOST_TIMES = 128 << 20, 50
"""Size to which a file may always unpack, and beyond it the multiple of the packed size: recordings shrink to
a half or a tenth."""
NUMBER = re.compile(r"[-+]?(?:(?:\d[\d.,]*|\.\d+)(?:e[-+]?\d+)?|nan|inf(?:inity)?)", re.I)
MISSING = ("", "nan", "n/a", "<na>", "null")

Refuse = Callable[..., NoReturn]
Names = tuple[str, ...]


@dataclass(frozen=True)
class Reading:
    """What the user specified about a source. None or empty: to be inferred from the file.

    rate_hz: frames a second. recording, label: columns, by name or by number from 1, or an attribute. columns:
    the taxels. delimiter: what separates columns. scale: what one code is worth. samples: array of a .mat or
    HDF5 file, topic of a log. labels: of a log, a table of times. clock: source of a log's frame times, log
    or header.
    """

    rate_hz: float | None = None
    columns: Names = ()
    recording: str | None = None
    label: str | None = None
    delimiter: str | None = None
    scale: Worth | None = None
    samples: str | None = None
    labels: Path | None = None
    clock: str = "log"


@dataclass(frozen=True)
class Table:
    """Rows of one source, or of several, one after the other.

    frame: the cells; a column is called by its number in the source, from 0, and a row by its line, from 1; columns that
    are empty may be missing. width: the columns of the source. names: the header, empty without one. source: what it is
    called in messages, in quotation marks. path: the class's folder, levels between, file. attributes: values that hold
    for all rows. breaks: rows before which the source itself has a blank line or a new head. units: of each column.
    clock: the time column, and grid: rows and columns of the taxels, where the source's form says them. taxels: their
    columns, and class_names: the classes in order, of which the number first_class is the first unless the numbers tell
    another, where the source lists them. parts, firsts: of several sources the
    tables, and the first row of each; source, path and attributes are then the first table's.
    """

    frame: DataFrame
    names: Names
    source: str
    path: Names = ()
    attributes: Record = field(default_factory=dict)
    breaks: tuple[int, ...] = ()
    parts: tuple[Table, ...] = ()
    firsts: tuple[int, ...] = (0,)
    units: Names = ()
    clock: int | None = None
    row_is: str = "line"
    class_names: Names = ()
    first_class: int = 0
    notes: Names = ()
    width: int = 0
    grid: tuple[int, ...] = ()
    taxels: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "width", self.width or self.frame.shape[1])

    @classmethod
    def joined(cls, tables: Sequence[Table]) -> Table:
        """Tables with the same columns, one after the other.

        Raises
        ------
        InputError
            A table has other columns than the first.
        """
        import pandas as pd

        first = tables[0]
        called = f"'{'/'.join(first.path)}'" if first.path else first.source
        for table in tables[1:]:
            if table.width != first.width:
                why = f"has {table.width} columns where {called} has {first.width}; all files must agree"
                table.refuse(why)
            if table.grid != first.grid:
                table.refuse(f"is a grid {table.grid} where {called} is {first.grid}; all files must agree")
            if table.header() != first.header():
                table.refuse(
                    f"its column names differ from those of {called}; give all files the same header"
                )
        firsts = np.cumsum([0, *(len(table.frame) for table in tables[:-1])]).tolist()
        return replace(
            first,
            frame=pd.concat([table.frame for table in tables]).sort_index(axis=1),
            parts=tuple(tables),
            firsts=tuple(firsts),
            breaks=tuple(at + row for at, table in zip(firsts, tables, strict=True) for row in table.breaks),
            notes=tuple(dict.fromkeys(note for table in tables for note in table.notes)),
        )

    @property
    def lines(self) -> np.ndarray:
        """(rows) numbers in the source, from 1."""
        return self.frame.index.to_numpy()

    def header(self) -> list[str]:
        """The columns' names; how a table calls its time may differ."""
        return [TIME.sub("time", name) for name in self.names]

    def units_of(self, columns: Sequence[int]) -> list[str]:
        """The unit of each column, or of all of them: as the source says it, or behind their names as in
        ``a (mV)``. None where some have none."""
        suffixes = [re.search(r"[(\[]([^()\[\]]+)[)\]]$", name) for name in self.names]
        texts = self.units or [match[1] if match else "" for match in suffixes]
        units = [texts[column].strip("()[] ") for column in columns] if texts else []
        return units[: 1 if len({*units}) == 1 else None] if all(units) else []

    def is_missing(self, column: int) -> np.ndarray:
        """(rows) where a cell has no value, or one of the words for none."""
        return self.frame[column].astype(str).str.lower().isin(MISSING).to_numpy()

    def is_empty(self, column: int) -> bool:
        """True if no cell of a column has a value."""
        cells = self.frame[column].unique()
        return len(cells) < 9 and {str(cell).lower() for cell in cells} <= {*MISSING, "na", "-"}

    def check_filled(self, column: int) -> None:
        """Raise InputError for a column with an empty cell, or with a word for a missing value."""
        empty = self.is_missing(column)
        if empty.any():
            row = int(np.argmax(empty))
            shown = self.frame[column].iloc[row] or "an empty cell"
            self.refuse(
                f"{self.called(column)} holds {shown}, which is not a value; fill it in or remove the line",
                row,
            )

    def part(self, row: int) -> int:
        """The number of the source of a row."""
        return bisect_right(self.firsts, row) - 1

    def refuse(self, why: str, row: int | None = None) -> NoReturn:
        """Raise InputError about the table, or a row of it."""
        line = "" if row is None else f", {self.row_is} {self.lines[row]}"
        source = self.parts[self.part(row or 0)].source if self.parts else self.source
        raise InputError(f"recordings {source}{line}: {why}")

    def called(self, column: int) -> str:
        """A column in words."""
        named = self.names and self.names[column]
        return f"column '{self.names[column]}'" if named else f"column {column + 1}"

    def find(self, name: str, option: str) -> int:
        """The column that an option names, by its name or by its number from 1."""
        if self.names.count(name) == 1 and self.names.index(name) in self.frame:
            return self.names.index(name)
        if re.fullmatch(r"\d{1,9}", name) and int(name) - 1 in self.frame:
            return int(name) - 1
        there = ", ".join(self.names[:12]) or f"numbers 1..{self.width}"
        several = "has several columns of that name; give a number from 1"
        no_such = (
            "has nothing in that column" if name in self.names else f"has no such column; it has {there}"
        )
        why = several if self.names.count(name) > 1 else no_such
        self.refuse(f"{option} {name[:40]}: the file {why}")

    def parsed(self, column: int) -> np.ndarray:
        """(rows) float64; NaN where a cell is not a number."""
        import pandas as pd

        cells = self.frame[column]
        if cells.dtype.kind in "iufb":
            return cells.to_numpy(dtype=np.float64, na_value=np.nan)
        if cells.dtype.kind == "M":
            return (cells - cells.iloc[0]).dt.total_seconds().to_numpy()
        return pd.to_numeric(cells.astype(str), errors="coerce").to_numpy(dtype=np.float64)

    def is_text(self, column: int) -> bool:
        """True if most cells of a column are not numbers."""
        return self.frame[column].dtype.kind not in "iufbM" and bool(
            2 * np.isnan(self.parsed(column)).sum() >= len(self.lines)
        )

    def numbers(self, columns: Sequence[int]) -> np.ndarray:
        """(rows, columns) float64.

        Raises
        ------
        InputError
            A cell is not a finite number; with its file and line.
        """
        values = np.stack([self.parsed(column) for column in columns], axis=1)
        if np.isfinite(values).all():
            return values
        row, number = place_of(~np.isfinite(values))
        column, cell = columns[number], str(self.frame[columns[number]].iloc[row])[:30]
        kind = "not a finite number" if NUMBER.fullmatch(cell) else "not a number"
        else_ = ", or choose the taxels with --columns, and the rate with --rate HZ" * self.is_text(column)
        why = f"holds {repr(cell) if cell else 'an empty cell'}, which is {kind}; repair or remove the line{else_}"
        self.refuse(f"{self.called(column)} {why}", row)


TIME = re.compile(
    r"^(?:times?|t|timestamps?|elapsed|seconds|zeit|x_value)(?:[ _]*[(\[]?(s|sec|seconds|ms|msec|us|µs|ns)[)\]]?)?$",
    re.I,
)
"""Names of time columns, and their unit."""


def table_of(frame: DataFrame, source: str, **more: Any) -> Table:
    """A table of a DataFrame; an index that has a name is columns, too. ``attrs["units"]``: the unit of
    all."""
    if not len(frame) or not frame.shape[1]:
        raise InputError(f"recordings {source}: holds no row or no column; give one row per frame")
    units_of = frame.attrs.get("units", "")
    frame = frame.reset_index() if any(name is not None for name in frame.index.names) else frame
    names = [str(name) for name in frame.columns]
    frame = frame.set_axis(range(len(names)), axis=1).set_axis(range(1, len(frame) + 1))
    for column in frame.select_dtypes(exclude=["number", "datetime", "datetimetz"]):
        if isinstance(frame[column].iloc[0], list | np.ndarray):
            fix = "give a column for each place, as in DataFrame(column.tolist())"
            raise InputError(f"recordings {source}: column '{names[column]}' holds lists; {fix}")
        frame[column] = frame[column].astype(object).where(frame[column].notna(), "").map(_text)
    units = (str(units_of),) * len(names) if units_of else ()
    return Table(frame, tuple(names), source, units=units, **more)


def _text(cell: object) -> str:
    return cell.decode("utf-8", "replace") if isinstance(cell, bytes) else str(cell)


def check_unpacked(path: Path, unpacked: int, refuse: Refuse) -> None:
    """Refuse a file that unpacks to more than UNPACKED_BYTES and MOST_TIMES its size."""
    size = sum(file.stat().st_size for file in (path.iterdir() if path.is_dir() else [path]))
    if unpacked > max(UNPACKED_BYTES, MOST_TIMES * size):
        refuse(
            f"has {size} bytes and unpacks to {unpacked / 1e6:.0f} MB or more, which recordings do not; write it "
            "again with less compression or without fill values"
        )


def check_regular(path: Path, refuse: Refuse) -> None:
    """Raise InputError for anything but a regular file (a pipe without a writer would block for ever), or for
    a file that is too large."""
    if not path.is_file():
        refuse(f"{path.name} is not a regular file; remove it or write it again")
    if path.stat().st_size > MOST_BYTES:
        refuse(f"has more than {MOST_BYTES >> 30} GB; split it into files")
