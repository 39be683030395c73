"""Tables of text as people have them, ``.csv`` and LabVIEW's ``.lvm``: pandas parses, this module finds the
form out.

What separates the cells, whether a comma is a decimal point and whether there is a header is read off the
file; what cannot be read for certain is refused with file, line and the option that settles it.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from eskin.golden.core import InputError
from eskin.golden.data.codes import place_of

if TYPE_CHECKING:
    import pandas as pd

DELIMITERS = {";": "semicolons", "\t": "tabs", ",": "commas", " ": "blanks"}
MOST_BYTES = 2 << 30
UNPACKED_BYTES, MOST_TIMES = 128 << 20, 50
"""What a file may unpack to in any case, and beyond it how many times its own size: recordings shrink to a
half or a tenth."""
LONGEST_LINE = 100_000
"""Letters; 256 taxels take 8000 at most."""

_SPOKEN = {"tab": "\t", "\\t": "\t", "blank": " ", "space": " ", "comma": ",", "semicolon": ";"}
_NUMBER = re.compile(r"[-+]?(?:(?:\d[\d.,]*|\.\d+)(?:e[-+]?\d+)?|nan|inf(?:inity)?)", re.I)
_WITH_COMMA = re.compile(r"(?<![\w.,])[-+]?\d+(?:,\d+)+(?:\.\d*)?")
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d*)?")
_LVM_WORDS = (
    "channels|samples|date|time|y_unit_label|x_dimension|x0|delta_x|x_value|notes|y_dimension|test_name|"
    "test_numbers|test_series|uut_name|uut_m/n|uut_s/n|model_number|serial_number"
)
_LVM_HEADER = re.compile(rf"\s*(?:\*\*\*|(?:{_LVM_WORDS})\s*(?:[\t;, ]|$))", re.I)
"""How the lines begin that LabVIEW writes again at each segment."""


@dataclass(frozen=True)
class Reading:
    """What a user says about a source; None and empty: it is found out.

    rate_hz: frames a second. time, recording, label: columns, by name or by number from 1. columns: the
    taxels. groups: columns of a long table, or arrays of a .mat file. delimiter: what separates columns.
    scale: what one code is worth. samples: array of a .mat or HDF5 file, topic of a log. labels: of a
    log, a table of times.
    """

    rate_hz: float | None = None
    time: str | None = None
    columns: tuple[str, ...] = ()
    recording: str | None = None
    label: str | None = None
    groups: tuple[str, ...] = ()
    delimiter: str | None = None
    scale: float | None = None
    samples: str | None = None
    labels: Path | None = None


@dataclass(frozen=True)
class Table:
    """Rows of recordings, one after the other.

    frame: the cells; columns are numbered from 0. names: the header, empty without one. lines (rows): numbers
    in the file, from 1. starts: the first row of each recording. sources: the file of each recording, or one
    for all. units: of each column, where a row below the header says them.
    """

    frame: pd.DataFrame
    names: tuple[str, ...]
    lines: np.ndarray
    sources: tuple[str, ...]
    starts: np.ndarray
    notes: tuple[str, ...] = ()
    units: tuple[str, ...] = ()

    @property
    def offsets(self) -> np.ndarray:
        """(recordings + 1) the first row of each recording, and the number of rows."""
        return np.append(self.starts, len(self.lines)).astype(np.int64)

    @property
    def spans(self) -> list[slice]:
        """The rows of each recording."""
        return [slice(first, end) for first, end in pairwise(self.offsets)]

    @classmethod
    def joined(cls, tables: Sequence[Table]) -> Table:
        """Tables with the same columns, a recording each, one after the other."""
        import pandas as pd

        starts = np.cumsum([0, *(len(table.lines) for table in tables)])[:-1]
        frame = pd.concat([table.frame for table in tables], ignore_index=True)
        lines = np.concatenate([table.lines for table in tables])
        sources = tuple(table.sources[0] for table in tables)
        return cls(frame, tables[0].names, lines, sources, starts, units=tables[0].units)

    def only(self, columns: list[int]) -> Table:
        """The table with these columns, numbered anew."""
        frame = self.frame[columns].set_axis(range(len(columns)), axis=1)
        names, units = (
            tuple(row[column] for column in columns) if row else () for row in (self.names, self.units)
        )
        return replace(self, frame=frame, names=names, units=units)

    def unit(self, columns: Sequence[int]) -> str:
        """The one unit of columns: of the row below the header, or behind their names as in ``a (mV)``."""
        behind = [re.search(r"[(\[]([^()\[\]]+)[)\]]$", name) for name in self.names]
        texts = self.units or [match[1] if match else "" for match in behind]
        units = {texts[column].strip("()[] ") for column in columns} if texts else {""}
        return units.pop() if len(units) == 1 else ""

    def is_missing(self, column: int, missing: Sequence[str]) -> np.ndarray:
        """(rows) where a cell has no value, or one of the words for none."""
        return self.frame[column].astype(str).str.lower().isin(missing).to_numpy()

    def check_filled(self, column: int, missing: Sequence[str]) -> None:
        """Refuse a column with a cell that has no value, or one of the words for none."""
        empty = self.is_missing(column, missing)
        if empty.any():
            row = int(np.argmax(empty))
            cell = self.frame[column].iloc[row]
            shown = f"'{cell}', which is no value" if str(cell) else "an empty cell"
            self.refuse(f"{self.called(column)} holds {shown}; fill it in or remove the line", row)

    def place(self, row: int) -> str:
        """The file of a row."""
        recording = int(np.searchsorted(self.starts, row, side="right")) - 1
        return self.sources[recording if len(self.sources) > 1 else 0]

    def refuse(self, why: str, row: int | None = None, column: int | None = None) -> NoReturn:
        """Raise InputError about the table, or a row of it, or one of a row's cells."""
        where = "" if row is None else f", line {self.lines[row]}"
        where += "" if column is None else f", column {column + 1}"
        raise InputError(f"recordings '{self.place(row or 0)}'{where}: {why}")

    def called(self, column: int) -> str:
        """A column in words."""
        return f"column '{self.names[column]}'" if self.names else f"column {column + 1}"

    def find(self, name: str, option: str) -> int:
        """The column that an option names, by its name or by its number from 1."""
        if self.names.count(name) == 1:
            return self.names.index(name)
        if re.fullmatch(r"\d{1,9}", name) and 1 <= int(name) <= self.frame.shape[1]:
            return int(name) - 1
        listed = ", ".join(self.names[:12]) if self.names else f"numbers 1..{self.frame.shape[1]}"
        why = (
            "has several columns of that name"
            if name in self.names
            else f"has no such column; it has {listed}"
        )
        self.refuse(f"{option} {name[:40]}: the file {why}")

    def parsed(self, column: int) -> np.ndarray:
        """(rows) float64; NaN where a cell is no number."""
        import pandas as pd

        cells = self.frame[column]
        if cells.dtype.kind in "iuf":
            return cells.to_numpy(dtype=np.float64, na_value=np.nan)
        if cells.dtype.kind == "M":
            return (cells - cells.iloc[0]).dt.total_seconds().to_numpy()
        return pd.to_numeric(cells.astype(str), errors="coerce").to_numpy(dtype=np.float64)

    def is_text(self, column: int) -> bool:
        """Whether most cells of a column are no numbers."""
        return self.frame[column].dtype.kind not in "iufM" and 2 * np.isnan(self.parsed(column)).sum() >= len(
            self.lines
        )

    def numbers(self, columns: Sequence[int]) -> np.ndarray:
        """(rows, columns) float64.

        Raises
        ------
        InputError
            A cell is no finite number; with its file and line.
        """
        values = np.stack([self.parsed(column) for column in columns], axis=1)
        if np.isfinite(values).all():
            return values
        row, number = place_of(~np.isfinite(values))
        column = columns[number]
        cell = str(self.frame[column].iloc[row])[:20]
        repair = "repair or remove the line" + (
            ", or choose the taxels with --columns" if self.is_text(column) else ""
        )
        if self.names:
            shown = f"'{cell}', which is no number" if cell else "an empty cell"
            shown = f"{cell}, not a finite number" if _NUMBER.fullmatch(cell) else shown
            self.refuse(f"{self.called(column)} holds {shown}; {repair}", row)
        why = f"{cell} is not a finite number" if _NUMBER.fullmatch(cell) else f"'{cell}' is no number"
        self.refuse(f"{why}; {repair}", row, column)


def read_table(path: Path, reading: Reading, lvm: bool = False) -> Table:
    """The cells of a text file.

    Parameters
    ----------
    reading:
        Its delimiter counts.
    lvm:
        LabVIEW's form: headers, also between frames, titles, comments behind the numbers and a cut last line
        are left out; no column has a name.

    Raises
    ------
    InputError
        It is no text, empty, or its rows have different numbers of cells; with file, line and the fix.
    """
    import pandas as pd

    def refuse(why: str, line: int | None = None) -> NoReturn:
        raise InputError(f"recordings '{path}'{'' if line is None else f', line {line}'}: {why}")

    numbered = _lines(path, refuse)
    notes: list[str] = []
    if lvm:
        numbered = _without_lvm_headers(numbered)
        if not numbered:
            refuse("holds no frame; leave the file out or record it again")
    else:
        while numbered and numbered[0][1].lstrip()[:1] in ("#", "%"):
            numbered.pop(0)
        if not numbered:
            refuse("holds no row; leave the file out or write it again")
        if len(numbered) > 1 and numbered[-1][1].count('"') % 2:
            notes.append(f"line {numbered.pop()[0]}, the last of '{path.name}', is cut off and was dropped")
        odd = next((number for number, line in numbered if line.count('"') % 2), None)
        if odd is not None:
            refuse("has a quotation mark without its partner; repair or remove the line", odd)
    shown = [line for _, line in numbered[:200]]
    delimiter = _asked_delimiter(shown, reading.delimiter, refuse) if reading.delimiter else _delimiter(shown)
    if delimiter is None and lvm:
        refuse("has no taxel column; column 1 is time, columns 2.. are taxels in volt", numbered[0][0])
    if delimiter is None:
        refuse(
            "is one column when it is split at commas, semicolons, tabs or blanks; name what separates its "
            "cells with --delimiter",
            1,
        )
    if lvm and delimiter == "," and not any("." in line for line in shown):
        refuse("commas may be decimal points or separators; separate the columns by tabs or semicolons")
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    if not lvm:
        first, *rest = (_split(line, delimiter) for line in shown[:3])
        if _is_header(first, rest[0] if rest else first):
            names = tuple(first)
            if not any(cell and not _NUMBER.fullmatch(cell) for cell in first):
                notes.append(f"line {numbered[0][0]} numbers the columns and is their header")
            header = numbered[0][0]
            below = len(rest) == 2 and _numeric(rest[1]) and _is_second(first, rest[0])
            if below and len(rest[0]) == len(names):
                names, units = _two_rows(names, tuple(rest[0]))
                notes += [] if units else [f"lines {header} and {numbered[1][0]} are one header"]
            numbered = numbered[2 if below else 1 :]
            if not numbered:
                refuse("holds a header and no row; leave the file out or write it again", header)
    text, note = _without_commas(numbered, delimiter, refuse)
    notes += [note] if note else []
    counts = [_count(line, delimiter) for line in text]
    if lvm:
        width = max(counts)
    else:
        width = len(names) or counts[0]
        if len(counts) > 1 and counts[-1] < width:  # the writer was stopped inside the last row
            notes.append(f"line {numbered[-1][0]}, the last of '{path.name}', is cut off and was dropped")
            del numbered[-1], text[-1], counts[-1]
        for row, (line, count) in enumerate(zip(text, counts, strict=True)):
            if count == width + 1 and line.rstrip(" ").endswith(delimiter) and delimiter != " ":
                text[row] = line.rstrip(" ")[:-1]
            elif count != width:
                of = "the header" if names else f"line {numbered[0][0]}"
                refuse(
                    f"has {count} cells where {of} has {width}; repair or remove the line, or give "
                    "--delimiter",
                    numbered[row][0],
                )
    frame = pd.read_csv(
        StringIO("\n".join(text)),
        sep=r"\s+" if delimiter == " " else delimiter,
        header=None,
        names=range(width),
        index_col=False,
        keep_default_na=False,
        na_values=[],
        low_memory=False,
        skipinitialspace=True,
        skip_blank_lines=False,
        quoting=3 if lvm else 0,
    )
    for column in frame.columns[frame.dtypes.map(lambda kind: kind.kind not in "iuf")]:
        frame[column] = frame[column].astype(str).str.strip()
    lines = np.array([number for number, _ in numbered])
    table = Table(frame, names, lines, (str(path),), np.array([0]), tuple(notes), units)
    return _frames_of_lvm(table) if lvm else table


def _lines(path: Path, refuse) -> list[tuple[int, str]]:
    """Number and text of every line that holds something."""
    if not path.is_file():
        refuse("is no regular file; remove it or write it again")
    if path.stat().st_size > MOST_BYTES:
        refuse(f"has more than {MOST_BYTES >> 30} GB; split it into files")
    raw = path.read_bytes()
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if path.suffix.lower() != ".lvm":
            refuse(f"is no UTF-8 text (byte {error.start}); save it as CSV in UTF-8")
        text = raw.decode("latin-1")
    if "\0" in text:
        refuse("holds a zero byte, so it is no text; save it as CSV in UTF-8")
    numbered = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip(" \t;,\r")]
    long = next((number for number, line in numbered if len(line) > LONGEST_LINE), None)
    if long is not None:
        refuse(f"has more than {LONGEST_LINE} letters, which no frame has; repair or remove the line", long)
    return numbered


def _without_lvm_headers(numbered: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Lines of frames alone. LabVIEW ends each header (file, then channels) with a marker line; titles and
    units are text above them."""
    start = 0
    for index, (_, line) in enumerate(numbered):
        if line.strip().startswith("***End_of_Header***"):
            start = index + 1
        elif re.match(r"\s*[-+]?[\d.,]+[\t; ,]", line):
            break
    frames = [
        (number, line.rstrip(" \t;,\r")) for number, line in numbered[start:] if not _LVM_HEADER.match(line)
    ]
    while frames and not re.search(r"^\s*[-+]?\d|\d[.,]\d", frames[0][1]):
        frames.pop(0)
    return frames


def _frames_of_lvm(table: Table) -> Table:
    """Time and taxels of a file of LabVIEW: the leading columns that hold numbers in most rows. What is not a
    frame is refused."""
    blank = (table.frame == "").to_numpy()
    values = np.stack([table.parsed(column) for column in table.frame], axis=1)
    is_number = ~np.isnan(values)
    often = is_number.mean(axis=0) >= 0.5
    often[0] = True  # a time column may be blank
    columns = len(often) if often.all() else int(np.argmin(often))
    if columns < 2:
        table.refuse("has no taxel column; column 1 is time, columns 2.. are taxels in volt", 0)
    cells = blank.shape[1] - np.argmin(blank[:, ::-1], axis=1)
    rows = len(cells)
    if rows > 1 and cells[-1] < columns:
        rows -= 1  # the writer was stopped inside the last row
    wrong = (cells < columns) | is_number[:, columns : columns + 1].any(axis=1)
    if wrong[:rows].any():
        row = int(np.argmax(wrong))
        count = cells[row] if cells[row] < columns else columns + np.cumprod(is_number[row, columns:]).sum()
        table.refuse(f"has {count} columns where the file has {columns}; repair or remove the line", row)
    missing = blank[:rows, 0]
    if missing.any() and not missing.all():
        table.refuse(
            "the time is missing; fill it in or leave the whole column blank", int(np.argmax(missing)), 0
        )
    frame = table.frame.iloc[:rows, :columns]
    table_of_rows = Table(frame, (), table.lines[:rows], table.sources, table.starts)
    table_of_rows.numbers(range(1 if missing.all() else 0, columns))
    return table_of_rows


def check_unpacked(path: Path, unpacked: int, fix: str, refuse: Callable[..., NoReturn]) -> None:
    """Refuse a file that unpacks to more than UNPACKED_BYTES and MOST_TIMES its size."""
    size = path.stat().st_size
    if unpacked > max(UNPACKED_BYTES, MOST_TIMES * size):
        refuse(f"has {size} bytes and unpacks to {unpacked / 1e6:.0f} MB, which recordings do not; {fix}")


def comes_back(trial: str, path: Path) -> bool:
    """Whether Python comes back from a trial: compiled readers end their process on some damaged files."""
    return subprocess.run([sys.executable, "-c", trial, str(path)], capture_output=True).returncode >= 0


# ---------------------------------------------------------------------- the form of a file
def _split(line: str, delimiter: str) -> list[str]:
    """The cells of a line; what stands between quotation marks is one."""
    if '"' not in line:
        return line.split() if delimiter == " " else [cell.strip() for cell in line.split(delimiter)]
    texts = iter(re.findall(r'"([^"]*)"', line))
    hidden = re.sub(r'"[^"]*"', "\0", line)
    return [
        re.sub("\0", lambda _: next(texts), cell).strip()
        for cell in _split(hidden.replace('"', ""), delimiter)
    ]


def _count(line: str, delimiter: str) -> int:
    if '"' in line:
        line = re.sub(r'"[^"]*"', "x", line)
    return len(line.split()) if delimiter == " " else line.count(delimiter) + 1


def _numeric(cells: Sequence[str]) -> int:
    return sum(_NUMBER.fullmatch(cell) is not None for cell in cells)


def _asked_delimiter(lines: list[str], asked: str, refuse) -> str:
    asked = _SPOKEN.get(asked, asked)
    if len(asked) != 1 or asked.isalnum() or asked in '".-+\n\r\0':
        refuse(f"--delimiter {asked!r}: cannot separate numbers; give a comma, a semicolon, tab or blank")
    if max(_count(line, asked) for line in lines) < 2:
        refuse(
            f"is one column when it is split at {DELIMITERS.get(asked, repr(asked))}; give another "
            "--delimiter, or leave it out",
            1,
        )
    return asked


def _delimiter(lines: list[str]) -> str | None:
    """What splits most lines alike, into the largest share of numbers: a comma may be a decimal point where
    something else separates."""

    def share_of_numbers(delimiter: str) -> float:
        rows = [_split(line, delimiter) for line in lines]
        cells, often = Counter(map(len, rows)).most_common(1)[0]
        if cells < 2 or often < 0.6 * len(lines):
            return 0.0
        filled = [cell for row in rows for cell in row if cell]
        return (1 + _numeric(filled)) / (1 + len(filled))

    best = max(DELIMITERS, key=share_of_numbers)
    return best if share_of_numbers(best) else None


def _is_header(first: list[str], second: list[str]) -> bool:
    """Whether the first line names the columns: by text, or by numbers that count from 0 or 1 and do not
    count on below."""
    filled = [cell for cell in first if cell]
    numbers = [cell for cell in filled if _NUMBER.fullmatch(cell)]
    counts = len(numbers) > 2 and any(numbers == [str(n + k) for n in range(len(numbers))] for k in (0, 1))
    if len(numbers) == len(filled):
        return counts and not (
            second[0].isdecimal() and first[0].isdecimal() and second[0] == str(int(first[0]) + 1)
        )
    # text beside numbers: a row of a table without a header, unless the row below has numbers where it has
    # text
    below = any(
        not _NUMBER.fullmatch(a) and _NUMBER.fullmatch(b) for a, b in zip(first, second, strict=False)
    )
    return not numbers or counts or below or len(filled) == 1


def _is_second(first: list[str], second: list[str]) -> bool:
    """Whether a second line belongs to the header: without a number, or, where the first does not tell the
    columns apart, with an empty cell, which no frame has."""
    return not _numeric(second) or (len(set(first)) < len(first) and not all(second))


def _two_rows(first: tuple[str, ...], second: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of two header rows: the second has units where the first alone tells the columns apart,
    else both are the names, a blank cell meaning what stands left of it."""
    blank = any(below and not above for above, below in zip(first, second, strict=True))
    if len(set(first)) == len(first) and not blank:
        return first, second
    filled: list[str] = []
    for cell in first:
        filled.append(cell or (filled[-1] if filled else ""))
    return tuple(" ".join(filter(None, pair)) for pair in zip(filled, second, strict=True)), ()


def _without_commas(numbered: list[tuple[int, str]], delimiter: str, refuse) -> tuple[list[str], str]:
    """The lines with decimal points and without separators of thousands, and what was understood of their
    commas.

    Of a number such as 1,234 alone nobody knows which; that no number contradicts one of the two readings is
    no reason to take it.
    """
    lines = [line for _, line in numbered]
    text = "\n".join(lines)
    if "," not in text or (delimiter == "," and '"' not in text):
        return lines, ""
    scope = "\n".join(re.findall(r'"[^"]*"', text)) if delimiter == "," else text
    numbers = _WITH_COMMA.findall(scope)
    if not numbers:
        return lines, ""
    decimal = not all(map(_THOUSANDS.fullmatch, numbers))
    if (
        not decimal
        and not any(number.count(",") > 1 for number in numbers)
        and not re.search(r"\d\.\d", scope)
    ):
        columns = [set(map(bool, map(_WITH_COMMA.fullmatch, filter(_NUMBER.fullmatch, cells))))
                   for cells in zip(*(_split(line, delimiter) for line in lines), strict=False)]  # fmt: skip
        if {True, False} not in columns:
            number = next(number for number, line in numbered if numbers[0] in line)
            refuse(
                f"'{numbers[0]}' may be a decimal number or thousands; write a decimal point, or no "
                "separator of thousands",
                number,
            )
    pattern, point, note = (
        (r"(?<=\d),(?=\d)", ".", "")
        if decimal
        else (r"(?<=\d),(?=\d{3})", "", "commas in numbers separate thousands")
    )
    if delimiter == ",":
        return re.sub(r'"[^"]*"', lambda quoted: re.sub(pattern, point, quoted[0]), text).split("\n"), note
    return re.sub(pattern, point, text).split("\n"), note
