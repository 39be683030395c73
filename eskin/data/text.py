"""Tables of text as people have them, CSV and LabVIEW's ``.lvm``: pandas parses, this module finds the form
out.

What separates the cells, whether a comma is a decimal point and whether there is a header is read off the
file; what cannot be read for certain is refused with file, line and the option that settles it.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from eskin.data.table import NUMBER, Reading, Refuse, Table, check_regular
from eskin.golden.core import InputError

DELIMITERS = {";": "semicolons", "\t": "tabs", ",": "commas", " ": "blanks"}
LONGEST_LINE = 100_000
"""Letters; 256 taxels take 8000 at most."""

_SPOKEN = {"tab": "\t", "\\t": "\t", "blank": " ", "space": " ", "comma": ",", "semicolon": ";"}
_WITH_COMMA = re.compile(r"(?<![\w.,])[-+]?\d+(?:,\d+)+(?:\.\d*)?")
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d*)?")
_HEAD_END = "***End_of_Header***"
_HEAD = re.compile(
    r"\s*(?:\*\*\*|(?:LabVIEW Measurement|Channels|Samples|Date|Time|X0|Delta_X|Notes|"
    r"X_(?!Value)\w+|Y_\w+|Test_\w+|UU?T_\S+|\w+_Number|\w+_Version|Separator|Decimal_Separator|"
    r"Multi_Headings|Time_Pref|Operator|Description|Project)\s*(?:[\t;,]|$))",
    re.I,
)
"""How the lines of LabVIEW's heads begin, of the file and of each segment."""


class _Lines(NamedTuple):
    """Lines of frames, their numbers, places before which the file parts them, and what was found."""

    numbers: list[int]
    texts: list[str]
    breaks: list[int]
    notes: list[str]


def read_text(path: Path, reading: Reading) -> Table:
    """The cells of a text file.

    Parameters
    ----------
    reading:
        Its delimiter counts.

    Raises
    ------
    InputError
        It is no text, empty, or its rows have different numbers of cells; with file, line and the fix.
    """
    import pandas as pd

    def refuse(why: str, line: int | None = None) -> NoReturn:
        raise InputError(f"recordings '{path}'{'' if line is None else f', line {line}'}: {why}")

    lvm = path.suffix.lower() == ".lvm"
    raw = _text(path, lvm, refuse).splitlines()
    asked = reading.delimiter
    separates = re.fullmatch(r'"?sep=(.)"?;*,*', raw[0], re.I) if raw else None
    if separates:  # Excel's first line
        raw[0], asked = "", asked or separates[1]
    heads, found = _without_heads(raw) if lvm else ([], _rows(raw, path.name, refuse))
    numbers, texts, breaks, notes = found
    if not texts:
        refuse("holds no row of samples; leave the file out or write it again")
    shown = texts[:200]
    said = heads[0] if heads else {}
    if asked is None and said.get("Separator"):
        asked = {"Comma": ","}.get(said["Separator"][0], "\t")
    delimiter = _asked_delimiter(shown, asked, refuse) if asked else _delimiter(shown)
    if delimiter is None:
        why = "is one column when it is split at commas, semicolons, tabs or blanks"
        refuse(f"{why}; name what separates its cells with --delimiter", numbers[0])
    if lvm and delimiter == "," and not asked and not any("." in line for line in shown):
        refuse("commas may be decimal points or separators; name what separates its cells with --delimiter")
    names, units, rows = _header(shown, delimiter, numbers, notes)
    del numbers[:rows], texts[:rows]
    breaks = [at - rows for at in breaks if at > rows]
    if not texts:
        refuse("holds a header and no row; leave the file out or write it again", rows)
    texts, note = _without_commas(numbers, texts, delimiter, said.get("Decimal_Separator"), refuse)
    notes += [note] if note else []
    if lvm:
        texts = [line.rstrip("\t;, ") for line in texts]
    width = _even(numbers, texts, len(names), delimiter, lvm, notes, path.name, refuse)
    frame = pd.read_csv(
        StringIO("\n".join(texts)),
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
    # two lines or more between two such places: a blank line behind every line parts nothing
    if len(texts) > 1 and np.diff([0, *breaks, len(texts)]).max() < 2:
        breaks = []
    table = Table(frame, names[:width], np.array(numbers), (f"'{path}'",), breaks=tuple(breaks), units=units[:width],
                  notes=tuple(notes))  # fmt: skip
    return _of_labview(table, heads, refuse) if lvm else table


def _text(path: Path, lvm: bool, refuse: Refuse) -> str:
    check_regular(path, refuse)
    raw = path.read_bytes()
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if not lvm:
            refuse(f"is no UTF-8 text (byte {error.start}); save it as CSV in UTF-8")
        text = raw.decode("latin-1")
    if "\0" in text:
        refuse("holds a zero byte, so it is no text; save it as CSV in UTF-8")
    return text


def _rows(raw: list[str], file: str, refuse: Refuse) -> _Lines:
    """The lines that hold something; comments above them are left out."""
    numbers: list[int] = []
    breaks: list[int] = []
    empty = []
    for number, line in enumerate(raw, 1):
        if len(line) > LONGEST_LINE:
            why = f"has more than {LONGEST_LINE} letters, which no frame has; repair or remove the line"
            refuse(why, number)
        if line.strip(" \t;,\r"):
            if numbers or line.lstrip()[:1] not in ("#", "%"):
                numbers.append(number)
            continue
        empty += [number] if line.strip() else []
        if numbers and breaks[-1:] != [len(numbers)]:
            breaks.append(len(numbers))
    texts = [raw[number - 1] for number in numbers]
    notes = []
    if empty:
        notes.append(f"{len(empty)} rows of separators alone, first line {empty[0]}, were left out")
    if len(texts) > 1 and texts[-1].count('"') % 2:
        notes.append(_cut(numbers.pop(), file))
        texts.pop()
    odd = next((number for number, line in zip(numbers, texts, strict=True) if line.count('"') % 2), None)
    if odd is not None:
        refuse("has a quotation mark without its partner; repair or remove the line", odd)
    return _Lines(numbers, texts, [at for at in breaks if at < len(texts)], notes)


def _cut(number: int, file: str) -> str:
    return f"line {number}, the last of '{file}', is cut off and was dropped"


def _without_heads(raw: list[str]) -> tuple[list[dict[str, list[str]]], _Lines]:
    """LabVIEW's heads, fields by name, first that of the file; and the other lines. A head parts them."""
    heads: list[dict[str, list[str]]] = [{}]
    numbers: list[int] = []
    breaks: list[int] = []
    end = max((number for number, line in enumerate(raw) if line.lstrip().startswith(_HEAD_END)), default=-1)
    first = next(
        (number for number, line in enumerate(raw) if re.match(r"\s*[-+]?[\d.,]+[\t; ,]", line)), len(raw)
    )
    for number, line in enumerate(raw):
        cells = [cell.strip() for cell in re.split(r"[\t;]", line)]
        if _HEAD.match(line) or (number < min(first, end) and not _numeric(cells)):
            if numbers and breaks[-1:] != [len(numbers)]:
                heads.append({})
                breaks.append(len(numbers))
            heads[-1].setdefault(cells[0], cells[1:])
        elif line.strip(" \t;,\r") and not (breaks and breaks[-1] == len(numbers) and "X_Value" in line):
            numbers.append(number + 1)
    return heads, _Lines(numbers, [raw[number - 1] for number in numbers], breaks, [])


def _even(numbers: list[int], texts: list[str], names: int, delimiter: str, lvm: bool, notes: list[str],
          file: str, refuse: Refuse) -> int:  # fmt: skip
    """The number of cells of every row; a last row with fewer is dropped. Of LabVIEW remarks behind the
    numbers are left out."""
    counts = [_count(line, delimiter) for line in texts]
    width = names or counts[0]
    if lvm:
        usual = Counter(counts).most_common(1)[0][0]
        last = _split(
            next(line for line, count in zip(texts, counts, strict=True) if count == usual), delimiter
        )
        while len(last) > 2 and not NUMBER.fullmatch(last[-1]):
            last.pop()
        width = len(last)
    if len(counts) > 1 and counts[-1] < width:  # the writer was stopped inside the last row
        notes.append(_cut(numbers.pop(), file))
        del texts[-1], counts[-1]
    remarks = 0
    for row, (line, count) in enumerate(zip(texts, counts, strict=True)):
        if count == width:
            continue
        cells = _split(line, delimiter)
        if count == width + 1 and not cells[-1] and delimiter != " ":
            texts[row] = line.rstrip(" ")[:-1]
        elif lvm and count > width and not NUMBER.fullmatch(cells[width]):
            texts[row] = delimiter.join(cells[:width])
            remarks += 1
        else:
            of = "the header" if names else f"line {numbers[0]}"
            why = f"has {count} cells where {of} has {width}"
            refuse(f"{why}; repair or remove the line, or give --delimiter", numbers[row])
    if remarks:
        notes.append(f"remarks behind {remarks} rows of '{file}' were left out")
    return width


def _of_labview(table: Table, heads: list[dict[str, list[str]]], refuse: Refuse) -> Table:
    """The table of an ``.lvm`` file: column 1 is time and the others are in volt, unless the heads say more.
    Where the time is blank it is what the heads give, X0 and Delta_X."""

    def of_head(head: dict[str, list[str]], name: str) -> list[float]:
        """One value a channel."""
        cells = [cell.replace(",", ".") for cell in head.get(name, []) if cell]
        return [float(cell) for cell in cells if NUMBER.fullmatch(cell)]

    frame, clock = table.frame, 0  # the first column
    bounds = [0, *table.breaks, len(table.lines)]
    steps = [of_head(head, "Delta_X") for head in heads]
    if len({step for each in steps for step in each}) > 1:
        refuse("its channels have several Delta_X, so no common clock; write a file a rate")
    blank = (frame[0].astype(str) == "").to_numpy()
    if blank.any() and not blank.all():
        table.refuse(
            "the time is missing; fill it in or leave the whole column blank", int(np.argmax(blank)), 0
        )
    if blank.all():
        frame = frame.drop(columns=0)
        if all(steps):
            times = [
                (of_head(head, "X0") or [0.0])[0] + step[0] * np.arange(last - first)
                for head, step, (first, last) in zip(heads, steps, pairwise(bounds), strict=True)
            ]
            frame.insert(0, 0, np.concatenate(times))
    unit = next((cell for cell in heads[0].get("Y_Unit_Label", []) if cell), "Volts")
    unit = "V" if unit.lower() in ("volts", "volt", "v") else unit
    names = table.names
    units = table.units or tuple("s" if column == 0 or (names and names[column].lower().startswith("x_value"))
                                 else unit for column in range(max(frame.columns) + 1))  # fmt: skip
    return replace(
        table, frame=frame, units=units, clock=clock if clock in frame else None, volts=unit == "V"
    )


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
    return sum(NUMBER.fullmatch(cell) is not None for cell in cells)


def _asked_delimiter(lines: list[str], asked: str, refuse: Refuse) -> str:
    asked = _SPOKEN.get(asked, asked)
    if len(asked) != 1 or asked.isalnum() or asked in '".-+\n\r\0':
        refuse(f"--delimiter {asked!r}: cannot separate numbers; give a comma, a semicolon, tab or blank")
    if max(_count(line, asked) for line in lines) < 2:
        called = DELIMITERS.get(asked, repr(asked))
        refuse(f"is one column when it is split at {called}; give another --delimiter, or leave it out", 1)
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


def _header(
    lines: list[str], delimiter: str, numbers: list[int], notes: list[str]
) -> tuple[tuple[str, ...], tuple[str, ...], int]:
    """Names and units of the columns, and how many lines say them."""
    first, *rest = (_split(line, delimiter) for line in lines[:3])
    if not _is_header(first, rest[0] if rest else first):
        return (), (), 0
    if not any(cell and not NUMBER.fullmatch(cell) for cell in first):
        notes.append(f"line {numbers[0]} numbers the columns and is their header")
    # a second line belongs to the header without a number, or, where the first does not tell the columns
    # apart, with an empty cell, which no frame has
    below = len(rest) == 2 and _numeric(rest[1]) and len(rest[0]) == len(first)
    if not below or (_numeric(rest[0]) and (len(set(first)) == len(first) or all(rest[0]))):
        return tuple(first), (), 1
    if len(set(first)) == len(first) and all(first[: len(rest[0])]):
        return tuple(first), tuple(rest[0]), 2
    filled: list[str] = []
    for cell in first:  # a blank cell means what stands left of it
        filled.append(cell or (filled[-1] if filled else ""))
    notes.append(f"lines {numbers[0]} and {numbers[1]} are one header")
    return tuple(" ".join(filter(None, pair)) for pair in zip(filled, rest[0], strict=True)), (), 2


def _is_header(first: list[str], second: list[str]) -> bool:
    """Whether the first line names the columns: by text, or by numbers that count from 0 or 1 and do not
    count on below; whole numbers beside text may be names of taxels."""
    filled = [cell for cell in first if cell]
    numbers = [cell for cell in filled if NUMBER.fullmatch(cell)]
    counts = len(numbers) > 2 and any(numbers == [str(n + k) for n in range(len(numbers))] for k in (0, 1))
    if len(numbers) == len(filled):
        return counts and not (
            second[0].isdecimal() and first[0].isdecimal() and second[0] == str(int(first[0]) + 1)
        )
    below = any(not NUMBER.fullmatch(a) and NUMBER.fullmatch(b) for a, b in zip(first, second, strict=False))
    return not numbers or counts or (below and all(map(str.isdecimal, numbers))) or len(filled) == 1


def _without_commas(
    numbers: list[int], lines: list[str], delimiter: str, said: list[str] | None, refuse: Refuse
) -> tuple[list[str], str]:
    """The lines with decimal points and without separators of thousands, and what was understood of their
    commas. said: what LabVIEW's head says separates decimals.

    Of a number such as 1,234 alone nobody knows which; that no number contradicts one of the two readings is
    no reason to take it.
    """
    text = "\n".join(lines)
    if "," not in text or (delimiter == "," and '"' not in text):
        return lines, ""
    scope = "\n".join(re.findall(r'"[^"]*"', text)) if delimiter == "," else text
    found = _WITH_COMMA.findall(scope)
    if not found:
        return lines, ""
    decimal = said == [","] or not all(map(_THOUSANDS.fullmatch, found))
    if not decimal and not any(number.count(",") > 1 for number in found) and not re.search(r"\d\.\d", scope):
        columns = [set(map(bool, map(_WITH_COMMA.fullmatch, filter(NUMBER.fullmatch, cells))))
                   for cells in zip(*(_split(line, delimiter) for line in lines), strict=False)]  # fmt: skip
        if {True, False} not in columns:
            at = next(number for number, line in zip(numbers, lines, strict=True) if found[0] in line)
            why = f"'{found[0]}' may be a decimal number or thousands"
            refuse(f"{why}; write a decimal point, or no separator of thousands", at)
    note = "" if decimal else "commas in numbers separate thousands"
    pattern, point = (r"(?<=\d),(?=\d)", ".") if decimal else (r"(?<=\d),(?=\d{3})", "")
    if delimiter == ",":
        return re.sub(r'"[^"]*"', lambda quoted: re.sub(pattern, point, quoted[0]), text).split("\n"), note
    return re.sub(pattern, point, text).split("\n"), note
