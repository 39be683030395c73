"""Recordings from a folder of ``.lvm`` text files, one sub-folder a class."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.data.recordings import Recordings

_HEADER_WORDS = {
    "channels",
    "samples",
    "date",
    "time",
    "y_unit_label",
    "x_dimension",
    "x0",
    "delta_x",
    "x_value",
    "notes",
    "y_dimension",
    "test_name",
    "test_numbers",
    "test_series",
    "uut_name",
    "uut_m/n",
    "uut_s/n",
    "model_number",
    "serial_number",
}
"""First words of the channel block that LabVIEW writes again at each segment."""


def load_lvm_folder(folder: Path, config: AcceleratorConfig) -> Recordings:
    """One recording a file; class_names are the sub-folders in alphabetical order; groups: source_file and what names tell.

    A file name's parts of letters and a number (``p07_brush_t2``, ``Seq1_Sp300_t1``), separated by ``_`` or ``-``, become groups when
    every file has them: ``p`` is called person, ``t`` trial, others keep their letters.
    """
    if config.sensor.volt_per_code <= 0:
        raise InputError(f"recordings '{folder}': .lvm files hold volts; give a configuration whose field volt_per_code is above 0")
    class_folders = sorted(entry for entry in folder.iterdir() if entry.is_dir() and not entry.name.startswith("."))
    if not class_folders:
        raise InputError(f"recordings '{folder}': has no sub-folder; put each class's .lvm files into a folder named after the class")
    parts, labels, names, rates = [], [], [], []
    for label, class_folder in enumerate(class_folders):
        files = sorted(entry for entry in class_folder.iterdir() if entry.suffix.lower() == ".lvm" and not entry.name.startswith("."))
        if not files:
            raise InputError(f"recordings '{class_folder}': has no .lvm file; add the class's recordings or remove the folder")
        for file in files:
            time, volts, lines = _read_lvm(file)
            if parts and volts.shape[1] != parts[0].shape[1]:
                raise InputError(
                    f"recordings '{file}': has {volts.shape[1]} taxels where '{names[0]}' has {parts[0].shape[1]}; all files must agree"
                )
            codes = np.rint(volts / config.sensor.volt_per_code)
            fmt = config.sample_format
            wrong = (codes < fmt.min_code) | (codes > fmt.max_code)
            if wrong.any():
                row, taxel = np.argwhere(wrong)[0]
                raise InputError(
                    f"recordings '{file}', line {lines[row]}, column {taxel + 2}: {volts[row, taxel]:g} V is outside the converter's "
                    f"{fmt.min_code * config.sensor.volt_per_code:g} to {fmt.max_code * config.sensor.volt_per_code:g} V; "
                    "set sample_bits, sample_signed "
                    "and volt_per_code of the configuration"
                )
            parts.append(codes.astype(np.int32))
            labels.append(label)
            names.append(f"{class_folder.name}/{file.name}")
            rates.append(_rate_of(time))
    if all(rate is not None for rate in rates) and max(rates) <= 1.005 * min(rates):
        rate, note = float(f"{np.median(rates):.5g}"), "the sample rate is that of the time columns"
    else:
        rate, note = config.sensor.sample_rate_hz, f"the time columns give no steady rate; taken from the configuration '{config.name}'"
    return Recordings(
        samples=np.concatenate(parts),
        offsets=np.concatenate([[0], np.cumsum([len(part) for part in parts])]).astype(np.int64),
        labels=np.array(labels, dtype=np.int64),
        class_names=tuple(entry.name for entry in class_folders),
        sample_rate_hz=rate,
        groups={"source_file": np.array(names)} | groups_of_names([Path(name).stem for name in names]),
        source=str(folder),
        volt_per_code=config.sensor.volt_per_code,
        sample_bits=config.sensor.sample_bits,
        sample_signed=config.sensor.sample_signed,
        notes=(note, f"volts became codes of {config.sensor.volt_per_code:g} V"),
    )


def groups_of_names(stems: list[str]) -> dict[str, np.ndarray]:
    """Groups that file names tell: parts of letters and a number that every name has."""
    tokens = [dict(re.findall(r"(?:^|[_\-. ])([A-Za-z]+)(\d+)(?=$|[_\-. ])", stem)) for stem in stems]
    everywhere = [word for word in tokens[0] if all(word in found for found in tokens)]
    called = {"p": "person", "t": "trial"}
    return {called.get(word.lower(), word.lower()): np.array([int(found[word]) for found in tokens]) for word in everywhere}


def _rate_of(time: np.ndarray | None) -> float | None:
    """Frames a second of a time column (seconds), or None unless its steps agree within 1 % and the last printed digit (1 us)."""
    if time is None or len(time) < 2:
        return None
    period = (time[-1] - time[0]) / (len(time) - 1)
    if not np.isfinite(period) or period <= 0 or np.abs(np.diff(time) - period).max() > 0.01 * period + 1.5e-6:
        return None
    return 1.0 / period


def _read_lvm(file: Path) -> tuple[np.ndarray | None, np.ndarray, list[int]]:
    """Time (s; None when the column is blank), volts (frames, taxels) and the line number (from 1) of each frame."""
    if not file.is_file():
        raise InputError(f"recordings '{file}': is no regular file; remove it or record it again")
    raw = file.read_bytes()
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    lines = text.splitlines()
    start = _after_headers(lines)
    separator, decimal_comma = _separator(lines[start:], file)
    plain = _read_plain(lines, start, separator, decimal_comma)
    if plain is not None:
        return plain

    rows: list[tuple[int, list[str]]] = []
    for number, line in enumerate(lines[start:], start + 1):
        if not line.strip(" \t;,"):
            continue
        line = line.strip(" \r") if separator.pattern in (" +", ", +") else line.rstrip()
        cells = [cell.strip() for cell in separator.split(line)]
        while cells and not cells[-1]:
            cells.pop()
        first = cells[0].lower()
        if first.startswith("***") or first in _HEADER_WORDS:
            continue
        if not rows and _number(cells[0], decimal_comma) is None and cells[0] and not any(_is_decimal(c, decimal_comma) for c in cells):
            continue  # column titles or units: text above the first frame
        rows.append((number, cells))
    if not rows:
        raise InputError(f"recordings '{file}': holds no frame; leave the file out or record it again")

    parsed = [(number, cells, [_number(cell, decimal_comma) for cell in cells]) for number, cells in rows]
    columns = Counter(_numeric_prefix(cells, values) for _, cells, values in parsed).most_common(1)[0][0]
    if columns < 2:
        raise InputError(f"recordings '{file}', line {rows[0][0]}: has no taxel column; column 1 is time, columns 2.. are taxels in volt")
    if len(parsed[-1][1]) < columns and len(parsed) > 1:
        parsed.pop()  # the writer was stopped inside the last row
    for number, cells, values in parsed:
        where = f"recordings '{file}', line {number}"
        if len(cells) < columns or (len(values) > columns and values[columns] is not None):
            count = min(len(cells), _numeric_prefix(cells, values)) if len(cells) > columns else len(cells)
            raise InputError(f"{where}: has {count} columns where the file has {columns}; repair or remove the line")
        for column in range(columns):
            if cells[column] == "" and column == 0:
                continue
            if values[column] is None:
                raise InputError(f"{where}, column {column + 1}: '{cells[column][:20]}' is no number; repair or remove the line")
            if not np.isfinite(values[column]):
                raise InputError(f"{where}, column {column + 1}: {cells[column]} is not a finite number; repair or remove the line")
    volts = np.array([values[1:columns] for _, _, values in parsed], dtype=np.float64)
    times = [values[0] for _, _, values in parsed]
    if any(time is None for time in times) and any(time is not None for time in times):
        number = parsed[next(i for i, time in enumerate(times) if time is None)][0]
        raise InputError(f"recordings '{file}', line {number}, column 1: the time is missing; fill it in or leave the whole column blank")
    return (None if times[0] is None else np.array(times)), volts, [number for number, _, _ in parsed]


def _read_plain(
    lines: list[str], start: int, separator: re.Pattern[str], decimal_comma: bool
) -> tuple[np.ndarray, np.ndarray, list[int]] | None:
    """The same quickly for a file that holds nothing but full rows of finite numbers from ``start`` on (a title apart); else None."""
    blank = None if separator.pattern != "\t" else "\r"
    numbered = [(number, line.rstrip().lstrip(blank)) for number, line in enumerate(lines[start:], start + 1) if line.strip()]
    if numbered and not re.search(r"^\s*[-+]?\d|\d[.,]\d", numbered[0][1]):
        numbered = numbered[1:]
    if not numbered or separator.pattern == ", +":
        return None
    rows = [line.replace(",", ".") if decimal_comma else line for _, line in numbered]
    try:
        values = np.loadtxt(rows, delimiter=None if separator.pattern == " +" else separator.pattern, comments=None, ndmin=2)
    except ValueError:
        return None
    if values.shape[1] < 2 or not np.isfinite(values).all():
        return None
    return values[:, 0], values[:, 1:], [number for number, _ in numbered]


def _after_headers(lines: list[str]) -> int:
    """Index of the line after the headers at the top: LabVIEW ends each (file, then channels) with a marker line."""
    start = 0
    for index, line in enumerate(lines):
        if line.strip().startswith("***End_of_Header***"):
            start = index + 1
        elif re.match(r"\s*[-+]?[\d.,]+[\t; ,]", line):
            break
    return start


def _separator(lines: list[str], file: Path) -> tuple[re.Pattern[str], bool]:
    """What separates this file's columns, and whether a comma is the decimal point.

    Tab before semicolon before comma-and-blank before blanks before comma. Only-commas rows without a single point are ambiguous.
    """
    body = [line.strip() for line in lines if re.match(r"\s*[-+]?[\d.,]", line)]
    sample = "\n".join(body[:200])
    for mark in ("\t", ";"):
        if mark in sample:
            return re.compile(mark), _uses_decimal_comma(sample, mark)
    if re.search(r", +", sample):
        return re.compile(r", +"), _uses_decimal_comma(re.sub(r", +", " ", sample), " ")
    if " " in sample:
        return re.compile(r" +"), _uses_decimal_comma(sample, " ")
    if "," in sample and "." not in sample:
        raise InputError(f"recordings '{file}': commas may be decimal points or separators; separate the columns by tabs or semicolons")
    return re.compile(","), False


def _uses_decimal_comma(sample: str, mark: str) -> bool:
    return re.search(r"\d,\d", sample.replace(mark, " ")) is not None


def _number(cell: str, decimal_comma: bool) -> float | None:
    """The cell's number (NaN and infinities included), or None."""
    try:
        return float(cell.replace(",", ".") if decimal_comma else cell)
    except ValueError:
        return None


def _is_decimal(cell: str, decimal_comma: bool) -> bool:
    return ("." in cell or "," in cell) and _number(cell, decimal_comma) is not None


def _numeric_prefix(cells: list[str], values: list[float | None]) -> int:
    """Leading cells that are numbers; a blank time cell counts as one."""
    for index, value in enumerate(values):
        if value is None and not (index == 0 and cells[0] == ""):
            return index
    return len(values)
