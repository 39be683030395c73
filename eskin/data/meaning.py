"""Recordings of tables: the one place that decides what is time, class, group, taxel and unit, and where a
recording begins (docs/recordings.md).

Where a name says it, or an option, it is taken as said. Any other column whose course no taxel has (one value
in each recording, or steadily rising) is understood and said, or refused: as a taxel it would tell the
network the class or the hour. What was understood stands in ``Recordings.notes``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from eskin.data.table import TIME, Reading, Table
from eskin.golden.core import PRESETS, AcceleratorConfig, InputError
from eskin.golden.data import no_group
from eskin.golden.data.codes import to_codes
from eskin.golden.data.recordings import Recordings, natural, recordings_of

RATE_TOLERANCE = 0.02
LEAST_STEPS = 16
"""From so many frames on a column's course says something about what it is."""

_SECONDS = {
    "s": 1.0,
    "sec": 1.0,
    "seconds": 1.0,
    "ms": 1e-3,
    "msec": 1e-3,
    "us": 1e-6,
    "µs": 1e-6,
    "ns": 1e-9,
}
_INDEX = ("", "index", "frame", "sample", "n", "no", "number", "row", "counter", "unnamed: 0")
_RECORDING = tuple(
    "recording recording_id rec rec_id record series series_id sequence_id sample_id measurement id".split()
)
CLASS = tuple("class label labels target class_name".split())
_CLASS_TOO = tuple("category material object texture surface gesture".split())
"""What says the class where only one of them is there."""
_GROUPS = tuple(
    "person subject participant user session block trial run fold group day speed seq sequence".split()
)
_LETTERS = {"p": "person", "t": "trial", "s": "session"}
"""What a letter before a number means in a file's name."""
_CALLED_AS_GROUP = re.compile(rf"(?:{'|'.join((*_LETTERS, *_GROUPS))})[ _-]?\d+", re.I)
_LIKE_RATE = re.compile(r"(?:\b|_|sampl\w*?|frame)(?:rate|freq(?:uency)?|k?hz|fps|odr|fs)(?:\b|_)", re.I)
RATE = re.compile(
    r"fs|fps|odr|(?:sampl\w*?|frame)?[_ ]?(?:rate|(?<=.)freq\w*)(?:[_ (\[]*hz[)\]]?)?|sampl\w*?[_ (\[]*hz[)\]]?",
    re.I,
)
"""How a rate is called: the first finds any that may be one, the second one that is."""
UNIT = ("unit", "units", "sample_unit")


@dataclass
class _Found:
    """What is understood so far. starts: the first row of each recording. labels: the class of each. values:
    what recordings have in common, by name. rate_hz: by a column; 0: none."""

    table: Table
    reading: Reading
    chosen: list[int]
    notes: list[str] = field(default_factory=list)
    starts: np.ndarray = field(default_factory=lambda: np.array([0]))
    labels: np.ndarray = field(default_factory=lambda: np.array([0]))
    groups: dict[str, np.ndarray] = field(default_factory=dict)
    rate_hz: float = 0.0
    class_is: str = ""

    @property
    def offsets(self) -> np.ndarray:
        """(recordings + 1) the first row of each recording, and the number of rows."""
        return np.append(self.starts, len(self.table.lines)).astype(np.int64)

    @property
    def sources(self) -> list[int]:
        """The source of each recording, by its number."""
        return [self.table.source(row) for row in self.starts.tolist()]


def understand(
    tables: Sequence[Table],
    reading: Reading,
    config: AcceleratorConfig | None,
    source: str,
    *,
    class_names: Sequence[str] = (),
    notes: Sequence[str] = (),
    of_one_file: bool = False,
) -> Recordings:
    """The recordings of tables.

    Parameters
    ----------
    config:
        Says what one code of real samples is worth, and the rate where nothing else does.
    source:
        What all of them are called in messages.
    class_names:
        The classes in order, where the source lists them.
    of_one_file:
        Paths are groups inside a file, of which nobody said that the first level is the class.

    Raises
    ------
    InputError
        A column or a clock cannot be understood, or an option names what is not there; with the place and the
        option that settles it.
    """
    chosen = [_chosen(table, reading) for table in tables]
    if reading.columns:
        tables = [
            table.only([*own, *_beside(table, reading)]) for table, own in zip(tables, chosen, strict=True)
        ]
    found = _Found(Table.joined(tables), reading, chosen[0])
    table = found.table
    time = _time_of(found)
    place = None if time is None else [*table.frame].index(time)
    label = _class_of(found)
    taken = _recordings(found, time, label)
    names = _labels(found, label, class_names, of_one_file)
    taken += _groups(found, label, taken)
    if not names:
        table.refuse("holds no recording")
    taxels, time = _taxels(found, time, taken)
    units = [0.0 if place is None else _second(each, [*each.frame][place]) for each in tables]
    rate, why = _rate(found, time, units, config)
    values = table.numbers(taxels)
    values = (
        values.astype(np.int64) if table.frame[taxels].dtypes.map(lambda k: k.kind in "iu").all() else values
    )
    scale = reading.scale
    whole = np.array_equal(values, np.rint(values))
    if scale is None and config is not None and (table.volts or not whole):
        scale = config.sensor.volt_per_code or None
    elif scale is None and table.volts:
        worth = PRESETS["thesis"].sensor.volt_per_code
        scale = worth if values.min() >= 0 and values.max() <= 65535 * worth else None
    unit = table.unit(taxels) or _common(found, UNIT)
    codes, step, sentences = to_codes(values, f"recordings '{source}'", scale)
    arrays = {
        "samples": codes,
        "offsets": found.offsets,
        "labels": found.labels,
        "class_names": np.array(names, dtype=np.str_),
        "sample_rate_hz": np.array(rate),
        "unit": np.array(unit),
        **({"lsb_volt": np.array(step)} if step else {}),
    }
    said = [
        f"{found.class_is}; {_listed(table, taxels)}",
        *notes,
        *table.notes,
        *found.notes,
        why,
        *sentences,
    ]
    return recordings_of(arrays, source, groups=found.groups, notes=said)


# ---------------------------------------------------------------------- roles
def _chosen(table: Table, reading: Reading) -> list[int]:
    """The columns of --columns: each word a name, a number from 1, or a range of numbers such as 2-9."""
    columns: list[int] = []
    for word in reading.columns:
        match = re.fullmatch(r"(\d+)-(\d+)", word)
        if match and word not in table.names:
            first, last = table.find(match[1], "--columns"), table.find(match[2], "--columns")
            if last < first:
                table.refuse(f"--columns {word}: runs backwards; give the smaller number first")
            columns += range(first, last + 1)
        else:
            columns.append(table.find(word, "--columns"))
    return columns


def _named(table: Table, words: Sequence[str]) -> list[int]:
    """Columns that are called by one of ``words``, in the words' order."""
    lower = {table.names[column].lower(): column for column in reversed(list(table.frame)) if table.names}
    return [lower[word] for word in words if word in lower]


def _beside(table: Table, reading: Reading) -> list[int]:
    """The columns that count beside those of --columns: what options name, time, recording, class, groups."""
    asked = [reading.time, reading.recording, reading.label, *reading.groups]
    columns = [table.find(name, "--columns") for name in asked if name in table.names]
    columns += [int(name) - 1 for name in asked if name and name.isdecimal() and int(name) - 1 in table.frame]
    columns += [column for column in table.frame if table.names and TIME.match(table.names[column])]
    columns += [] if table.clock is None else [table.clock]
    return [*columns, *_named(table, (*_RECORDING, *CLASS, *_CLASS_TOO, *_GROUPS))]


def _time_of(found: _Found) -> int | None:
    """The time column by option, form or name; text such as 2026-05-01T12:00:00.25 becomes a date."""
    import pandas as pd

    table, reading = found.table, found.reading
    free = [column for column in table.frame if column not in found.chosen]
    named = (column for column in free if table.names and TIME.match(table.names[column]))
    time = next(named, None) if table.clock is None or table.clock not in free else table.clock
    if reading.time is not None:
        time = table.find(reading.time, "--time")
    if time is not None and table.is_text(time):
        with suppress(ValueError, TypeError):  # refused with its place when its numbers are asked for
            table.frame[time] = pd.to_datetime(table.frame[time], format="ISO8601")
    return time


def _attributes(found: _Found) -> list[str]:
    """The attributes that every source has."""
    every = found.table.attributes
    return [name for name in every[0] if all(name in each for each in every)]


def _common(found: _Found, words: Sequence[str]) -> str:
    """The one text that an attribute of all sources says."""
    values = {str(each[name]) for name in _attributes(found) if name.lower() in words
              for each in found.table.attributes}  # fmt: skip
    return values.pop() if len(values) == 1 else ""


def _class_of(found: _Found) -> int | str | None:
    """What says the class: a column, an attribute by its name, or None, the first level of the path."""
    table, asked = found.table, found.reading.label
    known = _attributes(found)
    if asked is not None:
        if asked in known:
            return asked
        if known and asked not in table.names:
            there = ", ".join((*known, *table.names))
            table.refuse(f"--class {asked[:40]}: is no attribute or column; there are {there}")
        return table.find(asked, "--class")
    for words in (CLASS, _CLASS_TOO):
        attributes = [name for word in words for name in known if name.lower() == word]
        columns = [] if all(len(path) > 1 for path in table.paths) else _named(table, words)
        called = [*attributes, *(table.names[each] for each in columns)]
        if len(called) > 1 and words is _CLASS_TOO:
            table.refuse(f"{' and '.join(called)} may say the class; name it with --class")
        if called:
            return attributes[0] if attributes else columns[0]
    if all(len(path) > 1 for path in table.paths):
        return None
    there = ", ".join((*known, *table.names)) or "no header, so no names"
    usual = ", ".join(CLASS[:3])
    table.refuse(f"has no column or attribute that says the class ({usual}, ...); it has {there[:300]}: name "
                 "it with --class")  # fmt: skip


def _changes(table: Table, column: int) -> np.ndarray:
    """The rows at which a column takes another value."""
    key = np.unique(table.frame[column].astype(str), return_inverse=True)[1]
    return np.flatnonzero(np.diff(key)) + 1


def _recordings(found: _Found, time: int | None, label: int | str | None) -> list[int]:
    """Where recordings begin: with each source, where the columns of recording and class change, and at
    breaks over which the clock does not run on. Returns the columns that say it."""
    table, reading = found.table, found.reading
    starts, rows = {*table.firsts}, len(table.lines)
    alone = len(table.sources) == 1 and len(table.paths[0]) < 2
    column = next((each for each in _named(table, _RECORDING) if each not in (label, *found.chosen)), None)
    if column is not None and rows > 2 and len(_changes(table, column)) > rows / 2:
        column = None  # it numbers the rows
    if reading.recording is not None:
        column = table.find(reading.recording, "--recording")
    breaks = _breaks(found, time)
    if column is None and alone and not breaks and not isinstance(label, str):
        why = f"has no column that says the recording of a row ({', '.join(_RECORDING[:4])}, ...)"
        table.refuse(f"{why}; name it with --recording", None if table.names else 0)
    taken = [each for each in (column, label) if isinstance(each, int)]
    for each in taken:
        table.check_filled(each)
        starts |= {*_changes(table, each).tolist()}
    if column is None:
        starts |= {*breaks}
    if isinstance(label, int):
        parted = {*table.firsts, *(breaks if column is None else _changes(table, column).tolist())}
        cut = sorted({*_changes(table, label).tolist()} - parted)
        if cut:
            found.notes.append(
                f"{table.called(label)} changes inside recordings, {len(cut)} times, first in line "
                f"{table.lines[cut[0]]}: they were cut there"
            )
        by = "what blank lines part" if column is None else table.called(column)
        found.class_is = f"{table.called(label)} is the class, {by} the recording"
    found.starts = np.array(sorted(starts))
    if breaks and column is None:
        found.notes.append(f"{len(breaks)} recordings begin behind a blank line or a new head inside a file")
    if column is not None:
        found.groups["recording" if reading.recording is None else table.names[column] or "recording"] = (
            _whole(table.frame[column].iloc[found.starts])
        )
    return taken


def _breaks(found: _Found, time: int | None) -> list[int]:
    """The breaks of the sources over which the clock does not run on."""
    table = found.table
    if time is None or not table.breaks:
        return [*table.breaks]
    steps = np.diff(table.parsed(time), prepend=np.nan)
    usual = float(np.nanmedian(steps)) if len(steps) > 1 else 0.0
    parting = [row for row in table.breaks if not abs(steps[row] - usual) <= 0.5 * abs(usual)]
    if len(parting) < len(table.breaks):
        over = f"{len(table.breaks) - len(parting)} blank lines or heads"
        found.notes.append(f"{table.called(time)} runs on over {over}, so they part no recordings")
    return parting


def _labels(
    found: _Found, label: int | str | None, class_names: Sequence[str], of_one_file: bool
) -> list[str]:
    """The class of each recording; returns their names."""
    table = found.table
    if isinstance(label, int):
        shown = [_shown(value) for value in table.frame[label].iloc[found.starts]]
    elif label is not None:
        shown = [_shown(table.attributes[source][label]) for source in found.sources]
        found.class_is = f"attribute {label} is the class"
    else:
        shown = [table.paths[source][0] for source in found.sources]
        folders, files = len(set(shown)), len(table.sources)
        if of_one_file and folders == len(shown) > 1:
            there = ", ".join(_attributes(found)) or "none"
            table.refuse(
                f"its groups {', '.join(sorted(set(shown), key=natural)[:6])} would be as many classes as recordings; "
                f"name what says the class with --class: there are the attributes {there}"
            )
        between = all(len(path) > 2 for path in table.paths)
        if between and all(_CALLED_AS_GROUP.fullmatch(name) for name in shown):
            table.refuse(
                f"{', '.join(sorted(set(shown), key=natural)[:6])} stand above other folders and are called as groups "
                "are; put the folders of the classes first, or name what says the class with --class"
            )
        found.class_is = f"{folders} folders are classes, {files} files recordings"
    names = [*class_names] or sorted(set(shown), key=natural)
    found.labels = np.array([names.index(name) for name in shown])
    return names


def _groups(found: _Found, label: int | str | None, taken: Sequence[int]) -> list[int]:
    """What recordings have in common, by columns, attributes and paths; returns the columns."""
    table, reading = found.table, found.reading
    known = {name: found.table.attributes for name in _attributes(found)}
    attributes = [
        name for name in known if name.lower() not in UNIT and name != label and not RATE.fullmatch(name)
    ]
    asked = [name for name in reading.groups if name not in attributes]
    columns = [table.find(name, "--group") for name in asked]
    for column in columns or [each for each in _named(table, _GROUPS) if each not in (*taken, *found.chosen)]:
        inside = np.setdiff1d(_changes(table, column), found.starts)
        if found.chosen and not asked and (len(inside) or table.is_missing(column).any()):
            continue
        if len(inside):
            row = int(inside[0])
            at = table.source(row)
            name = f"recording {_shown(table.frame[taken[0]].iloc[row])}" if taken else table.sources[at]
            why = f"{table.called(column)} is a group and changes inside {name}; name the groups with --group"
            table.refuse(f"{why}, what a recording is with --recording, or the taxels with --columns", row)
        table.check_filled(column)
        columns += [] if column in columns else [column]
    _check_sorted(found, [*taken, *columns])
    for column in columns:
        _add_group(found, table.names[column] or f"column {column + 1}", _whole(table.frame[column].iloc[found.starts]),
                   table.called(column), bool(asked))  # fmt: skip
    sources = found.sources
    for name in attributes:
        if not reading.groups or name in reading.groups:
            values = _whole([table.attributes[source][name] for source in sources])
            _add_group(found, name, values, f"attribute {name}", name in reading.groups)
    if all(len(path) > 1 for path in table.paths):
        for name, tokens in _of_paths(table.paths).items():
            if not reading.groups or name in reading.groups:
                _add_group(
                    found, name, tokens[sources], f"'{name}' in the names of files", name in reading.groups
                )
        found.groups["source_file"] = np.array(["/".join(table.paths[source]) for source in sources])
    if len(found.groups) > ("source_file" in found.groups):
        named = [name for name in found.groups if name not in ("source_file", "recording")]
        found.notes += [f"groups: {', '.join(named)}"] if named else []
    return columns


def _add_group(found: _Found, name: str, values: np.ndarray, called: str, asked: bool) -> None:
    """Keep a group, or say why it is none."""
    why = "" if asked else no_group(values, found.labels)
    if why:
        found.notes.append(f"{called} {why} and was left out")
    else:
        found.groups[name] = values


def _check_sorted(found: _Found, columns: Sequence[int]) -> None:
    """Refuse rows of one recording, class and groups with others between: they are not sorted."""
    table = found.table
    if not columns or (found.reading.recording is None and not _named(table, _RECORDING)):
        return
    first_rows: dict[tuple[Any, ...], int] = {}
    cells = [table.frame[column].astype(str).iloc[found.starts].tolist() for column in columns]
    for row, *key in zip(found.starts.tolist(), *cells, strict=True):
        before = first_rows.setdefault((table.source(row), *key), row)
        if before != row:
            name = _shown(table.frame[columns[0]].iloc[row])
            why = f"recording {name} of line {table.lines[before]} goes on here after another one"
            table.refuse(f"{why}; sort the rows by recording", row)


def _of_paths(paths: Sequence[tuple[str, ...]]) -> dict[str, np.ndarray]:
    """Groups that names of files and the folders between tell: parts of letters and a number that every one
    has, separated by ``_``, ``-``, ``.`` or a blank; of levels without such parts their names."""
    between = [path[1:-1] for path in paths]
    stems = [
        "_".join((*levels, re.sub(r"\.\w+$", "", path[-1])))
        for levels, path in zip(between, paths, strict=True)
    ]
    tokens = [dict(re.findall(r"(?:^|[_\-. ])([A-Za-z]+)(\d{1,18})(?=$|[_\-. ])", stem)) for stem in stems]
    everywhere = [word for word in tokens[0] if all(word in tags for tags in tokens)]
    groups = {
        _LETTERS.get(word.lower(), word.lower()): np.array([int(tags[word]) for tags in tokens])
        for word in everywhere
    }
    if len({len(levels) for levels in between}) == 1:
        for level, names in enumerate(zip(*between, strict=True), 1):
            told = any(
                all(re.search(rf"(?:^|[_\-. ]){word}\d", name) for name in names) for word in everywhere
            )
            groups |= {} if told else {f"folder{level}": np.array(names)}
    return groups


# ---------------------------------------------------------------------- columns
def _taxels(found: _Found, time: int | None, taken: Sequence[int]) -> tuple[list[int], int | None]:
    """The taxels, and the time column. Every other column is a group or left out, which is said."""
    table, names = found.table, [name.lower() for name in found.table.names]
    series = [re.sub(r"\d+", "#", name) for name in names]
    taxels: list[int] = []

    def leave_out(column: int, why: str) -> None:
        found.notes.append(f"{table.called(column)} {why} and was left out")

    for column in found.chosen or table.frame:
        if found.chosen or column == time or column in taken:
            taxels += [column] if found.chosen else []
            continue
        name = names[column] if names else ""
        means_other = bool(name) and name in (*_RECORDING, *CLASS, *_CLASS_TOO, *_GROUPS)
        is_taxel = (
            bool(name) and not means_other and "#" in series[column] and series.count(series[column]) > 1
        )
        text = table.is_text(column)
        cells = table.frame[column]
        values = (
            np.unique(cells.astype(str), return_inverse=True)[1].astype(float)
            if text
            else table.parsed(column)
        )
        course = _course(values, found.starts)
        level = course == "level"
        if text and not any(cells):
            leave_out(column, "is empty")
        elif name and TIME.match(name):
            leave_out(column, "is time, too,")
        elif level and not text and _LIKE_RATE.search(name):
            leave_out(column, "is called like a rate and has one value in each recording, so is no taxel,")
            if RATE.fullmatch(name) and (values == values[0]).all() and values[0] > 0:
                found.rate_hz = float(values[0])
        elif is_taxel or (level and not text and not means_other and (values == values[0]).all()):
            taxels.append(column)
            if level:
                found.notes.append(
                    f"{table.called(column)} keeps its value in each recording and was taken as a taxel"
                )
        elif level and not names:
            why = f"{table.called(column)} has one value in each recording, so is no taxel"
            table.refuse(f"{why}; choose the taxels with --columns", 0)
        elif level:
            told = table.called(column)
            _add_group(found, table.names[column], _whole(cells.iloc[found.starts]), told, False)
            if table.names[column] in found.groups and not means_other:
                found.notes.append(f"{told} has one value in each recording and is a group")
        elif means_other:
            leave_out(column, "changes inside recordings, is no group")
        elif course == "counts" and (name in _INDEX if names else column == 0):
            leave_out(column, "numbers the rows")
        elif course in ("rises", "counts") and not names and column == 0 and time is None:
            time = column
        elif course in ("rises", "counts"):
            leave_out(column, "runs on like a time")
        elif course == "either":
            why = "is level in some recordings and runs on like a time in others, so is no taxel"
            table.refuse(f"{table.called(column)} {why}; choose the taxels with --columns", 0)
        else:
            taxels.append(column)
    if not taxels:
        table.refuse("has no column left for taxels; choose them with --columns")
    if time is not None:
        found.notes.insert(
            0, f"{table.called(time)} is time" if names else f"{table.called(time)} goes up and is time"
        )
    return taxels, time


def _course(values: np.ndarray, starts: np.ndarray) -> str:
    """How a column goes, in every recording: "level", "counts" (in ones), "rises" (or falls, as a time does),
    "either" level or rising; "" as signals do."""
    steps = np.diff(values)
    steps[starts[1:] - 1] = np.nan
    if np.isfinite(steps).sum() < LEAST_STEPS or not np.isfinite(values).all():
        return ""
    inside = starts[starts < len(steps)]
    low, high = np.fmin.reduceat(steps, inside), np.fmax.reduceat(steps, inside)
    level, rising, falling = (low == 0) & (high == 0), low > 0, high < 0
    alone = np.isnan(low)  # recordings of one frame
    if (level | alone).all():
        return "level"
    ends = np.append(starts[1:], len(values))
    for recording in np.flatnonzero(~(level | rising | falling | alone)):
        if not _is_clock(values[starts[recording] : ends[recording]]):
            return ""
        rising[recording] = True
    if (rising & ~alone).any() and falling.any():
        return ""
    if level.any():
        return "either"
    return "counts" if (steps[np.isfinite(steps)] == 1).all() else "rises"


def _is_clock(values: np.ndarray) -> bool:
    """Whether values of one recording run evenly though not in every frame, as a coarse clock, or wrap as a
    counter of few bits."""
    steps = np.diff(values)
    middle = np.median(steps)
    if middle != 0 and (steps == middle).mean() > 0.9:
        return True
    line = np.linspace(values[0], values[-1], len(values))
    return bool(steps.min() >= 0 and (steps > 0).sum() >= 4 and np.abs(values - line).max() <= steps.max())


# ---------------------------------------------------------------------- rates
def _second(table: Table, time: int) -> float:
    """Seconds of one of the time column: by the unit in its name; 0: it does not say."""
    if table.frame[time].dtype.kind == "M":
        return 1.0
    unit = table.unit([time]).lower()
    if table.units and unit in _SECONDS:
        return _SECONDS[unit]
    match = TIME.match(table.names[time]) if table.names else None
    if match and table.names[time].lower() == "seconds":
        return 1.0
    return _SECONDS.get((match[1] or "").lower(), 0.0) if match else 0.0


def _own_rate(found: _Found, time: int, seconds: np.ndarray, rows: slice, unit: float) -> float | None:
    """Frames a second of ``seconds``, the time column over ``rows``; None with fewer than two. unit: s; 0:
    not said."""
    if len(seconds) < 2:
        return None
    table, steps = found.table, np.diff(seconds)
    middle = float(np.median(steps))
    far = np.abs(steps - middle)
    called = table.called(time)
    instead = "give --rate HZ" + (", or --clock header" if table.row_is == "message" else "")
    if steps.min() <= 0:
        row = int(np.argmax(steps <= 0)) + 1
        why = f"{called} does not go up, from {seconds[row - 1]:g} to {seconds[row]:g}"
        table.refuse(f"{why}; {instead}", rows.start + row)
    if far.max() > 0.5 * middle:
        row = int(np.argmax(far)) + 1
        why = f"{called} jumps by {steps[row - 1]:g} where others go by {middle:g}"
        table.refuse(f"{why}; split the recording there, sample it evenly, or {instead}", rows.start + row)
    rate = (len(seconds) - 1) / float(seconds[-1] - seconds[0]) / (unit or 1.0)
    if not unit and rate < 2:
        why = f"{called} goes by {middle:g}, which in seconds is {rate:.3g} frames a second"
        table.refuse(f"{why}; name its unit in the header, time_ms say, or give --rate HZ", rows.start + 1)
    return float(f"{rate:.5g}")


def _rate(
    found: _Found, time: int | None, units: Sequence[float], config: AcceleratorConfig | None
) -> tuple[float, str]:
    """One rate for all recordings, and where it comes from, in words. units: of the time column in each
    source, s (0: not said)."""
    table, asked = found.table, found.reading.rate_hz
    where = table.sources[0]
    rates: list[tuple[float, str]] = []
    if time is not None:
        dated = table.frame[time].dtype.kind == "M"
        try:
            seconds = table.numbers([time])[:, 0]
            for (first, end), source in zip(pairwise(found.offsets.tolist()), found.sources, strict=True):
                unit = 1.0 if dated else units[source]
                rate = _own_rate(found, time, seconds[first:end], slice(first, end), unit)
                rates += [] if rate is None else [(rate, _called(found, source, first))]
        except InputError:
            if asked is None:
                raise
    key = next((name for name in _attributes(found) if RATE.fullmatch(name)), None)
    if key is not None and asked is None:
        for number in found.sources:
            value = table.attributes[number][key]
            if not isinstance(value, int | float) or not np.isfinite(value) or value <= 0:
                table.refuse(
                    f"{key} is {str(value)[:20]}; it must be one number above 0, in hertz: give --rate HZ"
                )
            rates.append((float(value), f"{key} of {_called(found, number, table.firsts[number])}"))
    if found.rate_hz and asked is None:
        rates.append((found.rate_hz, "a column that is called like it"))
    middle = float(f"{np.median([rate for rate, _ in rates]):.5g}") if rates else 0.0
    if asked is not None:
        said = "the sample rate is as asked for"
        agrees = not rates or abs(middle / asked - 1) <= RATE_TOLERANCE
        return asked, said if agrees else f"{said}, {asked:g} Hz; but the time columns say {middle:g} Hz"
    if not rates and config is not None:
        return config.sensor.sample_rate_hz, (
            f"there is no time column or rate; the rate is taken from the configuration '{config.name}'"
        )
    if not rates:
        why = "have no time column and do not say a rate"
        raise InputError(
            f"recordings {where}: {why}; write an archive with it, eskin convert SOURCE --rate HZ --out FILE.npz"
        )
    (low, slow), (high, fast) = min(rates), max(rates)
    if high > (1 + RATE_TOLERANCE) * low:
        raise InputError(
            f"recordings {where}: '{slow}' has {low:g} frames a second and '{fast}' {high:g}; give recordings of one "
            "rate, or the rate of all with --rate HZ"
        )
    return middle, "the sample rate is that of the " + ("time columns" if time is not None else "files")


def _called(found: _Found, source: int, row: int) -> str:
    """A recording in words."""
    path = found.table.paths[source]
    if path:
        return "/".join(path)
    names = found.groups.get("recording")
    number = int(np.searchsorted(found.starts, row, side="right")) - 1
    return f"recording {number + 1 if names is None else names[number]}"


# ---------------------------------------------------------------------- words
def _listed(table: Table, taxels: Sequence[int]) -> str:
    """The taxels in words: names that differ by a number alone as one, all others."""
    runs: dict[str, list[str]] = {}
    for column in taxels:
        name = table.names[column] if table.names else str(column + 1)
        runs.setdefault(re.sub(r"\d+", "#", name), []).append(name)
    named = [part for run in runs.values() for part in ([f"{run[0]} to {run[-1]}"] if len(run) > 2 else run)]
    return f"columns {', '.join(named)} are the {len(taxels)} taxels"


def _shown(value: Any) -> str:
    return str(int(value)) if isinstance(value, float) and value.is_integer() else str(value)


def _whole(values: Any) -> np.ndarray:
    """The values of a group, one a recording: whole numbers as integers, others as they are, all else as
    text."""
    array = np.asarray(values)
    if array.dtype.kind not in "iufb":
        return np.array([str(value) for value in values])
    numbers = array.astype(np.float64)
    whole = np.array_equal(numbers, np.rint(numbers)) and np.abs(numbers).max(initial=0) < 2**53
    return numbers.astype(np.int64) if whole else numbers
