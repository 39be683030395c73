"""Recordings from text tables as people have them: a folder of files by class, or one long table.

A file's form is found, never guessed past what it shows: what cannot be read for certain is refused with file, line and the option that
settles it. What was understood stands in ``Recordings.notes``.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.data.codes import place_of, to_codes
from eskin.golden.data.lvm import groups_of_names
from eskin.golden.data.recordings import Recordings, recordings_of

SUFFIXES = (".csv", ".tsv", ".txt")
DELIMITERS = {";": "semicolons", "\t": "tabs", ",": "commas", " ": "blanks"}
"""In the order in which they are tried: a comma may be a decimal point where something else separates."""
MOST_BYTES = 2 << 30
RATE_TOLERANCE = 0.02

_UNITS = {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_TIME = re.compile(r"^(?:time|t|timestamp|elapsed|seconds|zeit|x_value)(?:[ _]*[(\[]?(s|sec|seconds|ms|msec|us|µs|ns)[)\]]?)?$")
_INDEX = ("", "index", "frame", "sample", "n", "no", "number", "row", "counter", "unnamed: 0")
_RECORDING = (
    "recording",
    "recording_id",
    "rec",
    "rec_id",
    "record",
    "series",
    "series_id",
    "sequence_id",
    "sample_id",
    "measurement",
    "id",
)
_CLASS = ("class", "label", "target", "class_name", "category", "material", "object", "texture", "surface", "gesture")
_GROUPS = (
    "person",
    "subject",
    "participant",
    "user",
    "session",
    "block",
    "trial",
    "run",
    "fold",
    "group",
    "day",
    "speed",
    "seq",
    "sequence",
)


@dataclass(frozen=True)
class Reading:
    """What a user says about a source; None and empty: it is found out.

    rate_hz: frames a second. time, recording, label: columns, by name or by number from 1. columns: the taxels. groups: columns of a long
    table, or arrays of a .mat file. delimiter: what separates columns. scale: what one code is worth. samples: array of a .mat file.
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


@dataclass(frozen=True)
class Table:
    """A file of text: rows of as many cells each. lines (rows): their numbers in the file, from 1. names: the header, empty without one.
    cells: by column, float64, or text where most cells are no numbers."""

    path: Path
    names: tuple[str, ...]
    lines: np.ndarray
    cells: tuple[np.ndarray, ...]

    def refuse(self, why: str, row: int | None = None) -> NoReturn:
        """Raise InputError about this file, or a row of it."""
        where = "" if row is None else f", line {self.lines[row]}"
        raise InputError(f"recordings '{self.path}'{where}: {why}")

    def called(self, column: int) -> str:
        """A column in words."""
        return f"column '{self.names[column]}'" if self.names else f"column {column + 1}"

    def find(self, name: str, option: str) -> int:
        """The column that an option names, by its name or by its number from 1."""
        if self.names.count(name) == 1:
            return self.names.index(name)
        if name.isdecimal() and 1 <= int(name) <= len(self.cells):
            return int(name) - 1
        known = ", ".join(self.names[:12]) if self.names else f"numbers 1..{len(self.cells)}"
        why = "has several columns of that name" if name in self.names else f"has no such column; it has {known}"
        self.refuse(f"{option} {name}: the file {why}")

    def numbers(self, columns: Sequence[int]) -> np.ndarray:
        """(rows, columns) float64, all finite."""
        for column in columns:
            if self.cells[column].dtype.kind != "f":
                row = next(row for row, cell in enumerate(self.cells[column]) if _number(cell) is None)
                shown = self.cells[column][row][:20]
                self.refuse(
                    f"{self.called(column)} holds '{shown}', which is no number; repair it, or choose the taxels with --columns", row
                )
        values = np.stack([self.cells[column] for column in columns], axis=1)
        if not np.isfinite(values).all():
            row, column = place_of(~np.isfinite(values))
            self.refuse(f"{self.called(columns[column])} holds {values[row, column]}, not a finite number; repair or remove the line", row)
        return values


# ---------------------------------------------------------------------- one file
def read_table(path: Path, reading: Reading) -> Table:
    """The cells of a text file.

    Raises
    ------
    InputError
        It is no text, empty, or its rows have different numbers of cells; with file, line and the fix.
    """

    def refuse(why: str, line: int | None = None) -> NoReturn:
        raise InputError(f"recordings '{path}'{'' if line is None else f', line {line}'}: {why}")

    if not path.is_file():
        refuse("is no regular file; remove it or write it again")
    if path.stat().st_size > MOST_BYTES:
        refuse(f"has more than {MOST_BYTES >> 30} GB; split it into files")
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        refuse(f"is no UTF-8 text (byte {error.start}); save it as CSV in UTF-8")
    if "\0" in text:
        refuse("holds a zero byte, so it is no text; save it as CSV in UTF-8")
    numbered = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip(" \t;,\r")]
    while numbered and numbered[0][1].lstrip()[:1] in ("#", "%"):
        numbered.pop(0)
    if not numbered:
        refuse("holds no row; leave the file out or write it again")
    delimiter = _delimiter([line for _, line in numbered[:50]], reading.delimiter, refuse)
    first = _split(numbered[0][1], delimiter)
    comma = delimiter != "," and any(re.fullmatch(r"[-+]?\d+,\d+", cell) for _, line in numbered[:20] for cell in _split(line, delimiter))
    header = any(cell and _number(cell, comma) is None for cell in first)
    if header and any(_number(cell, comma) is not None and cell.strip() for cell in first) and sum(map(bool, first)) > 1:
        # numbers beside text: a row of a table without a header, unless the rows below have numbers where it has text
        below = _split(numbered[1][1], delimiter) if len(numbered) > 1 else first
        header = any(_number(a, comma) is None and _number(b, comma) is not None for a, b in zip(first, below, strict=False))
    body = numbered[1:] if header else numbered
    if header and len(body) > 1 and not any(_number(cell, comma) is not None for cell in _split(body[0][1], delimiter)):
        second = _split(body[1][1], delimiter)
        if any(_number(cell, comma) is not None for cell in second):
            body = body[1:]  # a row of units
    if not body:
        refuse("holds a header and no row; leave the file out or write it again", numbered[0][0])
    width = len(first) if header else len(_split(body[0][1], delimiter))
    lines = np.array([number for number, _ in body])
    names = tuple(cell.strip() for cell in first) if header else ()
    quick = _quick([line for _, line in body], delimiter, width, comma)
    if quick is not None:
        return Table(path, names, lines, tuple(quick.T))
    rows = []
    for number, line in body:
        cells = _split(line, delimiter)
        if len(cells) == width + 1 and not cells[-1]:
            cells.pop()  # a separator at the end of the line
        if len(cells) != width:
            of = "the header" if header else f"line {body[0][0]}"
            refuse(f"has {len(cells)} cells where {of} has {width}; repair or remove the line, or give --delimiter", number)
        rows.append(cells)
    columns = []
    for column, cells in enumerate(zip(*rows, strict=True)):
        found = [_number(cell, comma) for cell in cells]
        bad = sum(value is None for value in found)
        if bad and 2 * bad < len(found):
            row = next(row for row, value in enumerate(found) if value is None)
            called = f"column '{names[column]}'" if names else f"column {column + 1}"
            shown = f"'{cells[row][:20]}', which is no number" if cells[row] else "an empty cell"
            refuse(f"{called} holds {shown}; repair or remove the line", int(lines[row]))
        columns.append(np.array(cells) if bad else np.array(found, dtype=np.float64))
    return Table(path, names, lines, tuple(columns))


def _quick(lines: list[str], delimiter: str, width: int, comma: bool) -> np.ndarray | None:
    """(rows, width) of a body of nothing but numbers in full rows; None: look closer."""
    try:
        rows = [line.replace(",", ".") for line in lines] if comma else lines
        values = np.loadtxt(rows, delimiter=None if delimiter == " " else delimiter, comments=None, ndmin=2)
    except ValueError:
        return None
    return values if values.shape == (len(lines), width) else None


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    if '"' in line:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    return [cell.strip() for cell in line.split(delimiter)]


def _number(cell: str, comma: bool = False) -> float | None:
    try:
        return float(cell.replace(",", ".") if comma else cell)
    except ValueError:
        return None


def _delimiter(lines: list[str], asked: str | None, refuse) -> str:
    """What separates the cells: as asked for, or what splits most lines alike into two cells or more."""
    if asked is not None:
        asked = {"tab": "\t", "\\t": "\t", "blank": " ", "space": " ", "comma": ",", "semicolon": ";"}.get(asked, asked)
        if len(asked) != 1 or asked.isalnum() or asked in '".-+\n\r':
            refuse(f"--delimiter {asked!r}: cannot separate numbers; give a comma, a semicolon, tab or blank")
        if max(len(_split(line, asked)) for line in lines) < 2:
            refuse(f"is one column when it is split at {DELIMITERS.get(asked, repr(asked))}; give another --delimiter, or leave it out", 1)
        return asked
    for delimiter in DELIMITERS:
        counts = Counter(len(_split(line, delimiter)) for line in lines)
        cells, often = counts.most_common(1)[0]
        if cells > 1 and often >= 0.6 * len(lines):
            return delimiter
    refuse("is one column when it is split at commas, semicolons, tabs or blanks; name what separates its cells with --delimiter", 1)


# ---------------------------------------------------------------------- columns
@dataclass(frozen=True)
class _Columns:
    """Of a table: its taxels, its time column (None) and that column's unit, s (0: not said)."""

    taxels: tuple[int, ...]
    time: int | None
    unit: float
    notes: tuple[str, ...]


def _choose(table: Table, reading: Reading, taken: Sequence[int] = ()) -> _Columns:
    """Taxels and time of a table, whose columns ``taken`` are something else."""
    notes, time, unit = [], None, 0.0
    free = [column for column in range(len(table.cells)) if column not in taken]
    chosen = [column for word in reading.columns for column in _range(table, word)]
    if reading.time is not None:
        time = table.find(reading.time, "--time")
        match = _TIME.match(table.names[time].lower()) if table.names else None
        unit = _UNITS.get(match[1] or "", 0.0) if match else 0.0
    for column in free if table.names else ():
        name = table.names[column].lower()
        if time is None and column not in chosen and (match := _TIME.match(name)):
            time, unit = column, _UNITS.get(match[1] or "", 0.0)
            if name == "seconds":
                unit = 1.0
            notes.append(f"{table.called(column)} is time")
    counting = [column for column in free if column not in chosen and column != time and _counts(table, column)]
    if counting:
        notes.append(f"{', '.join(table.called(column) for column in counting)} numbers the rows and was left out")
    if not table.names and time is None and 0 in free and 0 not in chosen and 0 not in counting and _steady(table.cells[0]):
        time = 0
        notes.append("column 1 goes up in even steps and is time")
    taxels = chosen or [column for column in free if column != time and column not in counting]
    if not taxels:
        table.refuse("has no column left for taxels; choose them with --columns")
    return _Columns(tuple(taxels), time, unit, tuple(notes))


def _range(table: Table, word: str) -> list[int]:
    """Columns of one word of --columns: a name, a number from 1, or a range of numbers such as 2-9."""
    match = re.fullmatch(r"(\d+)-(\d+)", word)
    if match and word not in table.names:
        first, last = table.find(match[1], "--columns"), table.find(match[2], "--columns")
        if last < first:
            table.refuse(f"--columns {word}: runs backwards; give the smaller number first")
        return list(range(first, last + 1))
    return [table.find(word, "--columns")]


def _counts(table: Table, column: int) -> bool:
    """Whether a column numbers the rows: 0, 1, 2, ... or from 1, by its name or, without a header, as the first column."""
    cells = table.cells[column]
    named = table.names[column].lower() in _INDEX if table.names else column == 0
    return named and cells.dtype.kind == "f" and len(cells) > 2 and cells[0] in (0, 1) and bool((np.diff(cells) == 1).all())


def _steady(cells: np.ndarray) -> bool:
    if cells.dtype.kind != "f" or len(cells) < 8 or not np.isfinite(cells).all():
        return False
    steps = np.diff(cells)
    return bool(steps.min() > 0 and steps.max() - steps.min() < 0.02 * steps.mean())


def _rate(table: Table, columns: _Columns, rows: slice) -> float | None:
    """Frames a second of the time column over ``rows``; None with fewer than two rows."""
    if columns.time is None:
        return None
    time = table.numbers([columns.time])[rows, 0]
    if len(time) < 2:
        return None
    first = rows.start or 0
    steps = np.diff(time)
    if steps.min() <= 0:
        row = int(np.argmax(steps <= 0)) + 1
        table.refuse(f"{table.called(columns.time)} does not go up, from {time[row - 1]:g} to {time[row]:g}; give --rate HZ", first + row)
    middle = float(np.median(steps))
    if np.abs(steps - middle).max() > 0.5 * middle:
        row = int(np.argmax(np.abs(steps - middle))) + 1
        table.refuse(
            f"{table.called(columns.time)} jumps by {steps[row - 1]:g} where others go by {middle:g}; "
            "split the recording there, sample it evenly, or give --rate HZ",
            first + row,
        )
    unit = columns.unit or 1.0
    rate = (len(time) - 1) / float(time[-1] - time[0]) / unit
    if not columns.unit and rate < 2:
        table.refuse(
            f"{table.called(columns.time)} goes by {middle:g}, which in seconds is {rate:.3g} frames a second; "
            "name its unit in the header, time_ms say, or give --rate HZ",
            first + 1,
        )
    return float(f"{rate:.5g}")


def _told_rate(table: Table, columns: _Columns, rows: slice, reading: Reading) -> float | None:
    """``_rate``; None too where another rate is asked for and the column tells none."""
    try:
        return _rate(table, columns, rows)
    except InputError:
        if reading.rate_hz is None:
            raise
        return None


def _common_rate(
    rates: Sequence[tuple[float | None, str]], reading: Reading, config: AcceleratorConfig | None, source: str
) -> tuple[float, str]:
    """One rate for all recordings, and where it comes from, in words."""
    known = [(rate, name) for rate, name in rates if rate is not None]
    if reading.rate_hz is not None:
        told = float(np.median([rate for rate, _ in known])) if known else reading.rate_hz
        if abs(told / reading.rate_hz - 1) <= RATE_TOLERANCE:
            return reading.rate_hz, "the sample rate is as asked for"
        return reading.rate_hz, f"the sample rate is as asked for, {reading.rate_hz:g} Hz; but the time columns say {told:.5g} Hz"
    if not known:
        if config is not None:
            return config.sensor.sample_rate_hz, f"there is no time column; the rate is that of configuration '{config.name}'"
        raise InputError(
            f"recordings '{source}': have no time column, so their rate is not known; "
            "write an archive with it, eskin convert SOURCE --rate HZ --out FILE.npz"
        )
    (low, slow), (high, fast) = min(known), max(known)
    if high > (1 + RATE_TOLERANCE) * low:
        raise InputError(
            f"recordings '{source}': '{slow}' has {low:g} frames a second and '{fast}' {high:g}; "
            "give recordings of one rate, or the rate of all with --rate HZ"
        )
    return float(f"{np.median([rate for rate, _ in known]):.5g}"), "the sample rate is that of the time columns"


# ---------------------------------------------------------------------- sets of recordings
def assemble(
    parts: Sequence[np.ndarray],
    labels: Sequence[int],
    class_names: Sequence[str],
    rate: float,
    groups: dict[str, np.ndarray],
    source: str,
    scale: float | None,
    config: AcceleratorConfig | None,
    notes: Sequence[str],
) -> Recordings:
    """Recordings of finite real samples: scaled to codes, by the configuration's ``volt_per_code`` where there is one, and checked."""
    values = np.concatenate(parts)
    known = config.sensor.volt_per_code if config is not None and scale is None else 0.0
    whole = known > 0 and np.array_equal(values, np.rint(values))
    codes, step, said = to_codes(values, f"recordings '{source}'", known if known > 0 and not whole else scale)
    arrays = {
        "samples": codes,
        "offsets": np.cumsum([0, *(len(part) for part in parts)]),
        "labels": np.array(labels, dtype=np.int64),
        "class_names": np.array(class_names, dtype=np.str_),
        "sample_rate_hz": np.array(rate),
        **({"lsb_volt": np.array(step)} if step else {}),
        **groups,
    }
    return recordings_of(arrays, source, notes=(*notes, *said))


def is_table_folder(folder: Path) -> bool:
    """Whether any sub-folder holds a text table."""
    return any(
        file.suffix.lower() in SUFFIXES
        for entry in folder.iterdir()
        if entry.is_dir() and not entry.name.startswith(".")
        for file in entry.iterdir()
    )


def load_table_folder(folder: Path, reading: Reading, config: AcceleratorConfig | None) -> Recordings:
    """One recording a file; class_names are the sub-folders in natural order; groups: source_file and what names tell (as of .lvm files).

    Raises
    ------
    InputError
        Files that cannot be read, or that are not of one array and rate.
    """
    for option, given in (("--recording", reading.recording), ("--class", reading.label), ("--group", reading.groups)):
        if given:
            raise InputError(
                f"recordings '{folder}': {option} is for one long table; in a folder a file is a recording, a sub-folder a class"
            )
    class_folders = sorted((e for e in folder.iterdir() if e.is_dir() and not e.name.startswith(".")), key=lambda e: natural(e.name))
    parts, labels, names, rates, skipped = [], [], [], [], 0
    first: Table | None = None
    notes: tuple[str, ...] = ()
    for label, class_folder in enumerate(class_folders):
        entries = sorted((e for e in class_folder.iterdir() if not e.name.startswith(".")), key=lambda e: natural(e.name))
        files = [entry for entry in entries if entry.suffix.lower() in SUFFIXES]
        skipped += len(entries) - len(files)
        if not files:
            raise InputError(
                f"recordings '{class_folder}': has no .csv, .tsv or .txt file; add the class's recordings or remove the folder"
            )
        for file in files:
            table = read_table(file, reading)
            columns = _choose(table, reading)
            values = table.numbers(columns.taxels)
            if first is None:
                first, notes = table, columns.notes
                called = [table.names[column] for column in columns.taxels] if table.names else []
                taxels = [*columns.taxels]
            elif values.shape[1] != parts[0].shape[1]:
                table.refuse(f"has {values.shape[1]} taxels where '{names[0]}' has {parts[0].shape[1]}; all files must agree")
            elif [table.names[column] for column in columns.taxels] != called if table.names else bool(called):
                table.refuse(f"its columns are not called as those of '{names[0]}'; give all files one header")
            parts.append(values)
            labels.append(label)
            names.append(f"{class_folder.name}/{file.name}")
            rates.append((_told_rate(table, columns, slice(None), reading), names[-1]))
    rate, why = _common_rate(rates, reading, config, str(folder))
    which = (
        f"columns {', '.join(called[:4])}{', ...' if len(called) > 4 else ''}" if called else f"columns {taxels[0] + 1} to {taxels[-1] + 1}"
    )
    said = [f"{len(class_folders)} folders are classes, {len(parts)} files recordings; {which} are the {len(taxels)} taxels", *notes, why]
    if skipped:
        said.append(f"{skipped} files that are no .csv, .tsv or .txt were left out")
    groups = {"source_file": np.array(names)} | groups_of_names([Path(name).stem for name in names])
    return assemble(parts, labels, [f.name for f in class_folders], rate, groups, str(folder), reading.scale, config, said)


def load_long_table(path: Path, reading: Reading, config: AcceleratorConfig | None) -> Recordings:
    """One table of all recordings: columns for recording, class, groups, time and taxels, one row a frame.

    A recording is a run of rows with one value of recording, class and groups.

    Raises
    ------
    InputError
        There is no header, no class or recording column, or rows of a recording do not stand together.
    """
    table = read_table(path, reading)
    if not table.names:
        table.refuse("has no header, so its columns have no names; add one, or make it a folder with a sub-folder a class", 0)
    lower = [name.lower() for name in table.names]

    def column(asked: str | None, words: Sequence[str], option: str, what: str) -> int:
        if asked is not None:
            return table.find(asked, option)
        found = [lower.index(word) for word in words if word in lower]
        if not found:
            table.refuse(f"has no column that says the {what} ({', '.join(words[:4])}, ...); name it with {option}", 0)
        return found[0]

    label = column(reading.label, _CLASS, "--class", "class of a row")
    recording = column(reading.recording, [word for word in _RECORDING if word != lower[label]], "--recording", "recording of a row")
    asked = [table.find(name, "--group") for name in reading.groups]
    found = [number for number, name in enumerate(lower) if name in _GROUPS and number not in (label, recording)]
    groups = asked or found
    keys = np.zeros(len(table.lines), dtype=np.int64)
    for number in (recording, label, *groups):
        _, codes = np.unique(table.cells[number], return_inverse=True)
        _, keys = np.unique(keys * (codes.max() + 1) + codes, return_inverse=True)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(keys)) + 1])
    seen: dict[int, int] = {}
    for start in starts.tolist():
        before = seen.setdefault(int(keys[start]), start)
        if before != start:
            name = _shown(table.cells[recording][start])
            table.refuse(
                f"recording {name} of line {table.lines[before]} goes on here after another one; sort the rows by recording", start
            )
    columns = _choose(table, reading, (label, recording, *groups))
    text = [number for number in columns.taxels if table.cells[number].dtype.kind != "f"] if not reading.columns else []
    constant = [
        number for number in text if all((table.cells[number][a:b] == table.cells[number][a]).all() for a, b in _spans(starts, keys))
    ]
    if constant and not asked:
        groups = [*groups, *constant]
    columns = _choose(table, reading, (label, recording, *groups))
    values = table.numbers(columns.taxels)
    spans = _spans(starts, keys)
    rates = [(_told_rate(table, columns, slice(a, b), reading), f"recording {_shown(table.cells[recording][a])}") for a, b in spans]
    rate, why = _common_rate(rates, reading, config, str(path))
    names, labels = np.unique(table.cells[label][starts], return_inverse=True)
    order = sorted(range(len(names)), key=lambda number: natural(_shown(names[number])))
    place = np.argsort(order)
    class_names = [_shown(names[number]) for number in order]
    said = [
        f"{table.called(label)} is the class, {table.called(recording)} the recording; "
        f"{len(columns.taxels)} taxels from {table.called(columns.taxels[0])} to {table.called(columns.taxels[-1])}",
        *columns.notes,
        why,
    ]
    if groups:
        said.append(f"groups: {', '.join(table.names[number] for number in groups)}")
    of_group = {table.names[number]: _whole(table.cells[number][starts]) for number in (*groups, recording)}
    parts = [values[a:b] for a, b in spans]
    return assemble(parts, place[labels].tolist(), class_names, rate, of_group, str(path), reading.scale, config, said)


def _spans(starts: np.ndarray, keys: np.ndarray) -> list[tuple[int, int]]:
    return list(zip(starts.tolist(), [*starts[1:].tolist(), len(keys)], strict=True))


def _shown(value) -> str:
    return f"{value:g}" if isinstance(value, float | np.floating) else str(value)


def _whole(values: np.ndarray) -> np.ndarray:
    """Whole numbers as integers, all else as it is."""
    return values.astype(np.int64) if values.dtype.kind == "f" and np.array_equal(values, np.rint(values)) else values


def natural(name: str) -> list:
    """A key that sorts mat2 before mat10."""
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in re.split(r"(\d+)", name) if part]
