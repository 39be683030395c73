"""Tables of text as people have them, CSV and LabVIEW's ``.lvm``: pandas parses, this module finds the form
out.

What separates the cells, whether a comma is a decimal point and whether there is a header is inferred from
the file; anything ambiguous is refused with file, line and the option that decides.
"""

import csv
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from io import StringIO
from itertools import takewhile
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from eskin.data.table import NUMBER, TIME, Names, Reading, Table, check_regular
from eskin.golden.core import InputError

DELIMITERS = {";": "semicolon", "\t": "tab", ",": "comma", " ": "blank"}
LONGEST_LINE = 100_000
"""Letters; 256 taxels take 8000 at most."""

_WITH_COMMA = re.compile(r"(?<![\w.,])[-+]?\d+(?:,\d+)+(?:\.\d*)?")
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d*)?")
_HEAD = re.compile(
    r"(?:\A(?![-+\d\s])|^LabVIEW Measurement|^Channels\b).*?^\s*\*\*\*End_of_Header\*\*\*[^\n]*", re.M | re.S
)
"""LabVIEW's head, of a file and of each segment."""
_DATE = (
    r"(?:[A-Za-z]{3},? +)?(?:[A-Za-z]{3} +\d{1,2}|\d{1,4}([-/.])(?:\d{1,2}|[A-Za-z]{3})\1\d{1,4})[T,;\t ]\s*"
)
_DAY = (
    r"(?=(\d{1,2}:\d\d:\d\d(?:\.\d+|[,.]\d{3}(?=[;\s\])>]|->))?))\2(?: ?[AaPp][Mm])?(?:Z|[-+]\d\d:?\d\d\b)?"
)
_COUNT = r"(\d+(?:\.\d+)?)(?: ?s)?(?= *[\])]|\s*(?:[-=]*>|:\s))"
_STAMP = re.compile(
    rf"\s*[\[(<]? *(?:(?:{_DATE})?{_DAY}(?![\w.]|:\d)(?: \d{{4}}(?= *\]))?|{_COUNT})"
    r" *[\])]?(?:\s*(?:[-=]*>|[:-](?=\s))\s*| *[,;\t]? *)"
)
"""What a serial monitor puts in front of a line, up to the samples: a time of day, which a date may precede, or in
brackets or before an arrow a number."""


def read_text(path: Path, reading: Reading) -> Table:
    """The cells of a text file.

    Parameters
    ----------
    reading:
        Its delimiter counts.

    Raises
    ------
    InputError
        It is not text, is empty, or its rows have different numbers of cells; with file, line and the fix.
    """
    import pandas as pd

    file = _File(path, reading.delimiter)
    names, units = file.header()
    comma = file.decimal_comma()
    width, most, filled = file.width(len(names))
    frame = pd.read_csv(
        StringIO("\n".join(file.lines[row] for row in file.rows)),
        sep=r"\s+" if file.delimiter == " " else file.delimiter,
        header=None,
        names=range(most),
        usecols=filled,
        index_col=False,
        keep_default_na=False,
        na_values=[],
        low_memory=False,
        skipinitialspace=True,
        skip_blank_lines=False,
        quoting=file.quoting,
        decimal="," if comma else ".",
    )
    for column in frame.select_dtypes(exclude="number"):
        cells = frame[column].fillna("").astype(str).str.strip()
        if comma:
            cells = cells.str.replace(r"^([-+]?\d*),(\d)", r"\1.\2", regex=True)
        frame[column] = cells
    frame.index = [row + 1 for row in file.rows]
    breaks = sorted({int(at) for at in np.searchsorted(file.rows, file.breaks)} - {0, len(frame)})
    # two lines or more between two such places: a blank line behind every line parts nothing
    if len(frame) > 1 and np.diff([0, *breaks, len(frame)]).max() < 2:
        breaks = []
    table = Table(
        frame,
        names[:width],
        f"'{path}'",
        breaks=tuple(breaks),
        units=(*units[:width], "") if units else (),
        notes=tuple(file.notes),
        width=width,
    )
    if file.stamps:
        frame[width] = file.clock()
        table = replace(table, names=(*table.names, file.time) if names else (), clock=width, width=width + 1)
    return _of_labview(table, file) if file.lvm else table


class _File:
    """Lines of a file, and the form that was found of them.

    rows: the places of lines that are frames, at first the header's, too. breaks: places that part the rows.
    heads: LabVIEW's fields of each segment, the first with the fields of the file. stamps: a serial monitor's, of lines;
    time: what the header calls them.
    """

    time = "time"

    def __init__(self, path: Path, delimiter: str | None) -> None:
        self.path, self.lvm = path, path.suffix.lower() == ".lvm"
        self.quoting: Any = csv.QUOTE_NONE if self.lvm else csv.QUOTE_MINIMAL
        self.notes: list[str] = []
        self.lines = self._decoded().splitlines()
        excel = re.fullmatch(r'"?sep=(.)"?[;,]*', self.lines[0], re.I) if self.lines else None
        if excel:
            self.lines[0], delimiter = "", delimiter or excel[1]
        self.heads, self.breaks = self._without_heads() if self.lvm else ([{}], [])
        self.stamps = {} if self.lvm else self._stamps()
        self.rows = self._rows()
        if delimiter is None and self.heads[0].get("Separator"):
            delimiter = {"Comma": ",", "Semicolon": ";"}.get(self.heads[0]["Separator"][0], "\t")
        self.delimiter = self._found(delimiter)

    def refuse(self, why: str, row: int | None = None) -> NoReturn:
        """Raise InputError about the file, or a line of it."""
        raise InputError(f"recordings '{self.path}'{'' if row is None else f', line {row + 1}'}: {why}")

    def _decoded(self) -> str:
        check_regular(self.path, self.refuse)
        raw = self.path.read_bytes()
        try:
            text = raw.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            if not self.lvm:
                self.refuse(f"is not UTF-8 text (byte {error.start}); save it as CSV in UTF-8")
            text = raw.decode("latin-1")
        if "\0" in text:
            self.refuse("holds a zero byte, so it is not text; save it as CSV in UTF-8")
        return text

    def _without_heads(self) -> tuple[list[dict[str, list[str]]], list[int]]:
        """LabVIEW's heads, which become blank lines, and where they end."""
        heads: list[dict[str, list[str]]] = []
        ends: list[int] = []
        text = "\n".join(self.lines)
        comma = re.search(r"^Separator,", text, re.M)
        cells = re.compile("," if comma else r"[\t;]")
        for match in _HEAD.finditer(text):
            rows = [[cell.strip() for cell in cells.split(line)] for line in match[0].split("\n")]
            fields = {name: cells for name, *cells in rows}
            start = text.count("\n", 0, match.start())
            if heads and not any(map(str.strip, self.lines[ends[-1] + 1 : start])):
                heads[-1] |= fields
            else:
                heads.append(fields)
            ends.append(text.count("\n", 0, match.end()))
        self.lines = _HEAD.sub(lambda match: "\n" * match[0].count("\n"), text).split("\n")
        return heads or [{}], ends

    def _stamps(self) -> dict[int, re.Match[str]]:
        """The stamps of a serial monitor by their lines, which lose them; none where most lines have none."""
        stamps = {row: match for row, line in enumerate(self.lines) if (match := _STAMP.match(line))}
        if 2 * len(stamps) <= sum(bool(line.strip()) for line in self.lines):
            return {}
        for row, match in stamps.items():
            self.lines[row] = match.string[match.end() :]
        return stamps

    def clock(self) -> np.ndarray:
        """The time of each row by its stamp, in seconds or in a unit that is not said; times of day go on after twelve
        hours."""
        odd = next((row for row in self.rows if row not in self.stamps), None)
        if odd is not None:
            self.refuse("has no time stamp where other lines have one; repair or remove the line", odd)
        texts = [(self.stamps[row][2] or self.stamps[row][3]).replace(",", ".") for row in self.rows]
        times = np.array([[float(part) for part in text.split(":")] for text in texts])
        if times.shape[1] == 1:
            return times[:, 0]
        return np.unwrap(times @ [3600, 60, 1], period=12 * 3600)

    def _rows(self) -> list[int]:
        """The lines that hold something; comments above them, and titles of later segments, are left out."""
        rows: list[int] = []
        separators = []
        for row, line in enumerate(self.lines):
            if len(line) > LONGEST_LINE:
                self.refuse(f"has more than {LONGEST_LINE} letters; repair or remove the line", row)
            if not line.strip(" \t;,\r"):
                separators += [row] if line.strip() else []
                self.breaks += [] if self.lvm else [row]
            elif rows or line.lstrip()[:1] not in ("#", "%"):
                rows += [] if rows and self.lvm and line.lstrip().startswith("X_Value") else [row]
        if separators:
            what = f"{len(separators)} rows of separators alone, first line {separators[0] + 1}"
            self.notes.append(f"{what}, were left out")
        if not rows:
            self.refuse("holds no row of samples; leave the file out or write it again")
        if len(rows) > 1 and self.lines[rows[-1]].count('"') % 2:
            self._cut(rows.pop())
        odd = next((row for row in rows if self.lines[row].count('"') % 2 and not self.lvm), None)
        if odd is not None:
            self.refuse("has an unmatched quotation mark; repair or remove the line", odd)
        return rows

    def _cut(self, row: int) -> None:
        """The writer was stopped inside the last row."""
        self.notes.append(f"line {row + 1}, the last of '{self.path.name}', is cut off and was dropped")

    def _cells(self, delimiter: str, rows: Sequence[int]) -> Iterator[list[str]]:
        """The cells of rows; text in quotation marks is one cell. Among blanks a tab is another."""
        tab = " " if delimiter == " " else "\t"
        lines = (self.lines[row].replace("\t", tab).rstrip(" \r") for row in rows)
        for cells in csv.reader(lines, delimiter=delimiter, skipinitialspace=True, quoting=self.quoting):
            yield [cell and cell.strip() for cell in cells]

    def _found(self, wanted: str | None) -> str:
        """Separator of the cells: the sign that splits most lines alike, into the largest share of numbers;
        a comma may be a decimal point where another separator is used."""
        shown = self.rows[:200]
        if wanted is not None:
            wanted = next((sign for sign, word in DELIMITERS.items() if word == wanted), wanted)
            if len(wanted) != 1 or wanted.isalnum() or wanted in '".-+\n\r\0':
                self.refuse(
                    f"--delimiter {wanted!r}: cannot separate numbers; give a comma, a semicolon, tab or blank"
                )
            return wanted

        def share_of_numbers(delimiter: str) -> float:
            rows = [*self._cells(delimiter, shown)]
            cells, often = Counter(map(len, rows)).most_common(1)[0]
            if cells < 2 or often < 0.6 * len(rows):
                return 0.0
            filled = [cell for row in rows for cell in row if cell]
            return (1 + _numeric(filled)) / (1 + len(filled))

        best = max(DELIMITERS, key=share_of_numbers)
        text = not share_of_numbers(best)
        if text and all(NUMBER.fullmatch(self.lines[row].strip()) for row in shown[-1:] + shown[1:]):
            return ","  # one taxel
        if text:
            why = "is one column when it is split at commas, semicolons, tabs or blanks"
            self.refuse(f"{why}; name what separates its cells with --delimiter", shown[0])
        if self.lvm and best == "," and not any("." in self.lines[row] for row in shown):
            self.refuse(
                "commas may be decimal points or separators; name what separates its cells with --delimiter"
            )
        return best

    def header(self) -> tuple[Names, Names]:
        """Names and units of the columns; their lines no longer count as rows."""
        first, *rest = self._cells(self.delimiter, self.rows[:3])
        if self.stamps and rest:  # the line may have names for the stamps, too
            first[:1] = re.split(r" *[-=]*> *", first[0])
            self.time = next(filter(TIME.match, first[: -len(rest[0])]), "time")
            first = first[-len(rest[0]) :]
        numbers = [cell for cell in first if NUMBER.fullmatch(cell)]
        counts = len(numbers) > 2 and numbers in (
            [*map(str, range(start, start + len(numbers)))] for start in (0, 1)
        )
        if len(numbers) == len(first):
            if counts:
                self.refuse("numbers the columns or is a frame; name the columns in it", self.rows[0])
            return (), ()
        pairs = zip(first, rest[0], strict=False) if rest else ()
        below = any(a and not NUMBER.fullmatch(a) and NUMBER.fullmatch(b) for a, b in pairs)
        below |= not first[0] and [cells[0] for cells in rest] == ["0", "1"]  # numbers of rows
        if numbers and not counts and not (below and all(map(str.isdecimal, numbers))):
            return (), ()  # a frame with a text in it; whole numbers may be names of taxels
        line = self.rows.pop(0)
        if not self.rows:
            self.refuse("holds a header and no row; leave the file out or write it again", line)
        if len(rest) < 2 or _numeric(rest[0]) or not _numeric(rest[1]) or len(rest[0]) != len(first):
            return tuple(first), ()
        self.rows.pop(0)
        if all(rest[0]) and "" in first:  # names above names: one holds up to the next
            for column in range(1, len(first)):
                first[column] = first[column] or first[column - 1]
            return tuple(" ".join(pair).strip() for pair in zip(first, rest[0], strict=True)), ()
        return tuple(first), tuple(rest[0])

    def decimal_comma(self) -> bool:
        """True if numbers have decimal commas. A number such as 1,234 alone is ambiguous."""
        text = "\n".join(self.lines[row] for row in self.rows)
        text = "\n".join(re.findall(r'"[^"]*"', text)) if self.delimiter == "," else text
        found = _WITH_COMMA.findall(text)
        if (
            found
            and self.heads[0].get("Decimal_Separator") != [","]
            and all(map(_THOUSANDS.fullmatch, found))
        ):
            row = next(row for row in self.rows if found[0] in self.lines[row])
            fix = "write a decimal point and no separators"
            self.refuse(f"'{found[0]}' may have a decimal comma or separators of thousands; {fix}", row)
        return bool(found)

    def width(self, names: int) -> tuple[int, int, list[int]]:
        """The cells of every row, the most that one has, and the columns that are not empty: empty cells more, and in
        LabVIEW's form remarks behind the numbers, are left out. A last row with fewer is dropped."""
        first = next(self._cells(self.delimiter, self.rows))
        width = names or len(first)
        if self.lvm:
            width = 1 + len([*takewhile(NUMBER.fullmatch, first[1:])])
            if 0 < names < width:
                fix = "name every column in the line above it, or remove that line"
                self.refuse(f"has {width} numbers where the header has {names} names; {fix}", self.rows[0])
        most, filled = 0, {0}  # LabVIEW's time may be blank
        remarks, last = 0, self.rows[-1]
        for row, cells in zip([*self.rows], self._cells(self.delimiter, self.rows), strict=True):
            most = max(most, len(cells))
            filled |= {column for column, cell in enumerate(cells[:width]) if cell}
            while len(cells) > width and not cells[-1]:
                cells.pop()
            if self.lvm and len(cells) > width and not NUMBER.fullmatch(cells[width]):
                remarks += 1
            elif row == last and len(cells) < width and len(self.rows) > 1:
                self._cut(self.rows.pop())
            elif len(cells) != width:
                of = "the header" if names else f"line {self.rows[0] + 1}"
                fix = "repair or remove the line, or give --delimiter"
                self.refuse(f"has {len(cells)} cells where {of} has {width}; {fix}", row)
        if remarks:
            self.notes.append(f"remarks behind {remarks} rows of '{self.path.name}' were left out")
        return width, most, sorted(filled)


def _of_labview(table: Table, file: _File) -> Table:
    """The table of an ``.lvm`` file: column 1 is time and the others are in volt, unless the headers say
    otherwise. Where the time is blank the rate comes from Delta_X."""
    import pandas as pd

    cells = [cell.replace(",", ".") for head in file.heads for cell in head.get("Delta_X", [])]
    steps = {float(step) for step in pd.to_numeric(cells, errors="coerce") if step > 0}
    if len(steps) > 1:
        file.refuse("its channels have several Delta_X, so no common clock; write one file per rate")
    frame, rate = table.frame, {}
    if table.is_missing(0).all():
        frame = frame.drop(columns=0)
        rate = {"sample_rate_hz": float(f"{1 / max(steps):.6g}")} if steps else {}
    else:
        table.check_filled(0)
    unit = next((cell for cell in file.heads[0].get("Y_Unit_Label", []) if cell), "V")
    unit = "V" if unit.lower() in ("volts", "volt", "v") else unit
    names = table.names or ("x_value", *[""] * (table.width - 1))
    units = table.units or tuple("s" if name.lower().startswith("x_value") else unit for name in names)
    return replace(table, frame=frame, units=units, clock=0 if 0 in frame else None,
                   attributes=rate, width=frame.shape[1])  # fmt: skip


# ---------------------------------------------------------------------- cells
def _numeric(cells: Sequence[str]) -> int:
    return sum(NUMBER.fullmatch(cell) is not None for cell in cells)
