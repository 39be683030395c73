"""Recordings of tables: this module alone decides which columns are time, class, group, taxel and unit, and where a
recording begins (docs/recordings.md).

Where a name says it, or an option, it is taken as said. Any other column whose course no taxel has (one value
in each recording, or steadily rising) is recognised and reported, or refused: as a taxel it would leak the
class or the time of recording. The interpretation is recorded in ``Recordings.notes``.
"""

import re
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise
from typing import Any

import numpy as np

from eskin.data.folds import no_group
from eskin.data.table import TIME, Reading, Table
from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.data.recordings import Recordings, natural, recordings_of

RATE_TOLERANCE = 0.02
LEAST_STEPS = 16
"""Fewest frames for which the course of a column shows what it holds."""

_SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_RECORDING = (
    "recording recording_id rec rec_id record series series_id sequence_id sample_id episode_index".split()
)
CLASS = "class label labels target class_name".split()
_CONSTANT = "is constant in each recording and was taken as a taxel"
_CLASS_TOO = "category material object texture surface gesture".split()
"""Column names that are the class if only one of them exists."""
_GROUPS = "person subject participant user session block trial run fold group day speed seq sequence".split()
_LETTERS = {"p": "person", "t": "trial", "s": "session"}
"""Group names for a letter before a number in a file's name."""
_CALLED_AS_GROUP = re.compile(rf"(?:{'|'.join((*_LETTERS, *_GROUPS))})[ _-]?\d+", re.I)
_LIKE_RATE = re.compile(r"(?:\b|_|sampl\w*?|frame)(?:rate|freq(?:uency)?|k?hz|fps|odr|fs)(?:\b|_)", re.I)
_LAST = r"^(?!.*(?<![\d.:])\d{1,2}(?::\d\d){1,2}(?:[.,]\d+)?(?:[-+]\d\d:?\d\d)?$).*?((?<!\d)[-+]?\d+(?:\.\d+)?|\d+)$"
"""A number at the end of a cell, which is no time of day."""
RATE = re.compile(
    r"fs|fps|odr|(?:sampl\w*?|frame)?[_ ]?(?:rate|(?<=.)freq\w*)(?:[_ (\[]*hz[)\]]?)?|sampl\w*?[_ (\[]*hz[)\]]?",
    re.I,
)
"""Patterns for the name of a rate: the first finds any candidate, the second a certain one."""
UNIT = ("unit", "units", "sample_unit")


def understand(
    tables: Sequence[Table],
    reading: Reading,
    config: AcceleratorConfig | None,
    source: str,
    *,
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
    of_one_file:
        Paths are groups inside a file, of which nobody said that the first level is the class.

    Raises
    ------
    InputError
        A column or a clock cannot be understood, or an option names a column that is not there; with the place and the
        option that settles it.
    """
    found = _Meaning(tables, reading)
    table = found.table
    class_is = found.part(of_one_file)
    found.groups_from_paths()
    taxels = found.taxels()
    rate, why = found.rate(config)
    values, scale = table.numbers(taxels), reading.scale
    if scale is None and config is not None and not np.array_equal(values, np.rint(values)):
        scale = config.sensor.volt_per_code or None
    names = [table.names[column] if table.names else str(column + 1) for column in taxels]
    stated = {str(value) for name in found.attributes if name in UNIT for value in found.fact(name)}
    units = [unit for unit in table.units_of(taxels) if unit]
    arrays = {
        "samples": values,
        "offsets": found.offsets,
        "labels": found.labels,
        "sample_rate_hz": np.array(rate),
        "unit": np.array(units or (stated.pop() if len(stated) == 1 else "")),
    }
    if table.grid and np.prod(table.grid) == len(taxels):
        arrays["grid_shape"] = np.array(table.grid)
        notes = [f"taxels are {' x '.join(map(str, table.grid))} rows and columns, row by row", *notes]
    if of_one_file and table.class_names:
        arrays["class_names"] = np.array(table.class_names)
    if table.names:
        arrays["channel_names"] = np.array(names)
    listed = f"columns {', '.join(names[:12])}{', ...' * (len(names) > 12)} are the {len(names)} taxels"
    all_notes = [f"{class_is}; {listed}", *notes, *table.notes, *found.notes, why]
    requested = reading.scale is not None
    return recordings_of(
        arrays, source, groups=found.groups, scale=scale, requested=requested, notes=all_notes
    )


def check_rate(tables: Sequence[Table], reading: Reading) -> None:
    """Raise InputError where the first file of many tells no rate, before the others are read."""
    found = _Meaning(tables[:1], reading)
    try:
        found.part(of_one_file=False)
        found.taxels()
    except InputError:
        return  # all files together may be understood
    if len(found.table.frame) > LEAST_STEPS:
        found.rate(None)


class _Meaning:
    """Interpretation of a table so far.

    chosen: the columns of --columns. time: the column of the clock. taken: the columns that say recording and
    class. starts: the first row of each recording. labels: the class of each. groups: what recordings have in
    common. series: how many names differ only by their numbers. rates: frames a second that columns and attributes
    say, and what says them. level: of the paths, the first that is not the class.
    """

    def __init__(self, tables: Sequence[Table], reading: Reading) -> None:
        self.tables, self.table, self.reading = tables, Table.joined(tables), reading
        self.notes: list[str] = []
        self.groups: dict[str, np.ndarray] = {}
        self.rates: list[tuple[float, str]] = []
        self.used: list[int] = []
        self.starts = self.labels = np.zeros(1, dtype=np.int64)
        self.paths = [table.path for table in tables]
        every = [table.attributes for table in tables]
        self.attributes = [name for name in every[0] if all(name in each for each in every)]
        self.on_path, self.level = all(len(path) > 1 for path in self.paths), 1
        self.series = Counter(re.sub(r"\d+", "#", name.lower()) for name in self.table.names)
        self.chosen = self._chosen()
        self.time = self._clock()

    @property
    def offsets(self) -> np.ndarray:
        """(recordings + 1) the first row of each recording, and the number of rows."""
        return np.append(self.starts, len(self.table.lines)).astype(np.int64)

    @property
    def sources(self) -> list[int]:
        """The number of the source of each recording."""
        return [self.table.part(row) for row in self.starts.tolist()]

    # ------------------------------------------------------------------ roles
    def _chosen(self) -> list[int]:
        """The columns of --columns, or those that the source says: each word a name, a number from 1, or a range of numbers such as 2-9."""
        table = self.table
        columns = [] if self.reading.columns else [*table.taxels]
        for word in self.reading.columns:
            match = re.fullmatch(r"(\d+)-(\d+)", word)
            if match and word not in table.names:
                first, last = (table.find(end, "--columns") for end in match.groups())
                if last < first:
                    table.refuse(f"--columns {word}: is in descending order; give the smaller number first")
                columns += [column for column in range(first, last + 1) if column in table.frame]
            else:
                columns.append(table.find(word, "--columns"))
        if table.clock in columns:  # a stamp in front of the samples is a column behind them
            table.refuse(
                f"--columns: {table.called(table.clock)} is time; the taxels are numbered without it"
            )
        return columns

    def _named(self, words: Sequence[str]) -> list[int]:
        """Columns that are called by one of ``words``, in the words' order, and are no chosen taxels."""
        names = [name.lower() for name in self.table.names]
        columns = [names.index(word) for word in words if word in names]
        return [column for column in columns if column in self.table.frame and column not in self.chosen]

    def _clock(self) -> int | None:
        """The time column by the source's form or by name; text such as 2026-05-01T12:00:00.25 becomes a
        date."""
        import pandas as pd

        table = self.table
        named = [column for column in table.frame if table.names and TIME.match(table.names[column])]
        clocks = (each for each in (table.clock, *named) if each is not None and each not in self.chosen)
        for time in clocks:
            if table.is_text(time):
                with suppress(ValueError, TypeError):  # refused with its place when its numbers are asked for
                    table.frame[time] = pd.to_datetime(table.frame[time], format="ISO8601")
            return time
        return None

    def _class(self) -> int | str | None:
        """Source of the class: a column, an attribute by its name, or None, the first level of the path."""
        table, wanted = self.table, self.reading.label
        there = ", ".join((*self.attributes, *table.names))[:300]
        there = there or f"no header: give the number of a column, 1 to {table.width}"
        if wanted is not None:
            if self.attributes and not wanted.isdecimal() and wanted not in (*self.attributes, *table.names):
                fields = f"of a struct or group name a field, as in {wanted[:40]}.label"
                table.refuse(
                    f"--class {wanted[:40]}: is not an attribute or column; there are {there}; {fields}"
                )
            return wanted if wanted in self.attributes else table.find(wanted, "--class")
        names = (*self.attributes, *(() if self.on_path else table.names))
        sure, maybe = (
            [name for word in words for name in names if name.lower() == word]
            for words in (CLASS, _CLASS_TOO)
        )
        if not sure and len(maybe) > 1:
            table.refuse(f"{' and '.join(maybe)} may name the class; choose one with --class")
        for name in (sure or maybe)[:1]:
            return name if name in self.attributes else table.find(name, "--class")
        if not self.on_path:
            why = f"has no column or attribute that names the class ({', '.join(CLASS[:2])}, ...)"
            table.refuse(f"{why}; it has {there}: name it with --class, of a log also with --labels")
        return None

    def _changes(self, column: int) -> np.ndarray:
        """The rows at which a column takes another value."""
        return np.flatnonzero(np.diff(_codes(self.table.frame[column]))) + 1

    def part(self, of_one_file: bool) -> str:
        """Find where recordings begin: with each source, where the columns of recording and class change, and
        at breaks over which the clock does not run on; and the class of each. Returns what says it, in words."""
        table, label, wanted = self.table, self._class(), self.reading.recording
        named = [each for each in self._named(_RECORDING) if each != label]
        named = named[:1] if wanted is None else [table.find(wanted, "--recording")]
        breaks = [] if named else self._breaks()
        self.used = [each for each in dict.fromkeys((*named, label)) if isinstance(each, int)]
        changes = [row for column in named for row in self._changes(column).tolist()]
        self.starts = np.array(sorted({*table.firsts, *breaks, *changes}))
        for column in self.used:
            if column in self.chosen:
                table.refuse(
                    f"--columns: {table.called(column)} says class or recording; leave it out of the taxels"
                )
            self._check_whole(column, "is the class")
        if breaks:
            self.notes.append(
                f"{len(breaks)} recordings begin after a blank line or a new header inside a file"
            )
        if named and named[0] != label:
            self.groups[wanted or "recording"] = self.fact(named[0])
        if label is None:
            return self._levels(of_one_file)
        self.level = 0
        classes = self.fact(label)
        if classes.dtype.kind == "i":
            classes = self._numbered(classes)
        self.labels = classes.astype(str)
        if isinstance(label, str):
            return f"attribute {label} is the class"
        by = table.called(named[0]) if named else "blank lines" if breaks else "the file"
        return f"{table.called(label)} gives the class, {by} the recording"

    def _numbered(self, numbers: np.ndarray) -> np.ndarray:
        """The names of classes by their numbers, if the sources agree on names; a number 0, or one of the last, tells where
        they begin."""
        table, names, last = self.table, self.table.class_names, len(self.table.class_names)
        if len({each.class_names for each in self.tables}) > 1 or not names:
            return numbers
        first = 0 if 0 in numbers else 1 if last in numbers else table.first_class
        low, high = numbers.min(), numbers.max()
        if low < first or high >= first + last:
            why = f"the class runs from {low} to {high} and there are {last} class names, numbered {first} to {first + last - 1}"
            table.refuse(f"{why}; leave other recordings out, or name their classes")
        doubt = f"; none is 0 or {last}, which would tell: give names as labels to be sure"
        self.notes.append(f"classes are numbered from {first}" + doubt * ({0, last}.isdisjoint(numbers)))
        return np.array(names)[numbers - first]

    def _levels(self, of_one_file: bool) -> str:
        """As ``part``, by the first level of the paths."""
        table = self.table
        self.labels = np.array([self.paths[source][0] for source in self.sources])
        classes = sorted(set(map(str, self.labels)), key=natural)
        some = ", ".join(classes[:6])
        if of_one_file and len(classes) == len(self.labels) > 1:
            why = f"its groups {some} would be as many classes as recordings; name what says the class with --class"
            table.refuse(f"{why}: there are the attributes {', '.join(self.attributes) or 'none'}")
        if all(len(path) > 2 for path in self.paths) and all(map(_CALLED_AS_GROUP.fullmatch, classes)):
            why = f"{some} stand above other folders and are called as groups are; put the folders of the classes first"
            table.refuse(f"{why}, or name the column or attribute of the class with --class")
        return f"{len(classes)} folders are classes, {len(self.tables)} files recordings"

    def _breaks(self) -> list[int]:
        """The breaks of the sources over which the clock does not run on."""
        table, breaks = self.table, [*self.table.breaks]
        if self.time is None or not breaks:
            return breaks
        steps = np.diff(table.parsed(self.time), prepend=np.nan)
        usual = float(np.nanmedian(steps))
        parting = [row for row in breaks if not abs(steps[row] - usual) <= 0.5 * abs(usual)]
        if len(parting) < len(breaks):
            over = f"{len(breaks) - len(parting)} blank lines or headers"
            self.notes.append(
                f"{table.called(self.time)} continues over {over}, so they separate no recordings"
            )
        return parting

    # ------------------------------------------------------------------ groups
    def fact(self, what: int | str) -> np.ndarray:
        """(recordings) what a column or an attribute says of each."""
        if isinstance(what, int):
            return whole(self.table.frame[what].iloc[self.starts])
        return whole([self.tables[source].attributes[what] for source in self.sources])

    def _group(self, name: str, values: np.ndarray, called: str, why: str = "") -> None:
        """Keep a group, which ``why`` says, or leave it out, since it is none."""
        if none := no_group(values, self.labels):
            self.notes.append(f"{called} {none} and was left out")
            return
        self.groups[name] = values
        self.notes += [f"{called} {why}"] if why else []

    def groups_from_paths(self) -> None:
        """Groups that attributes tell, and names of files and of the folders between: their parts of letters
        and a number that every one has, separated by ``_``, ``-``, ``.`` or a blank; of levels without such
        parts their names."""
        sources = self.sources
        for name in self.attributes:
            if name not in (*UNIT, self.reading.label, *CLASS[:2]) and not RATE.fullmatch(name):
                self._group(name, self.fact(name), f"attribute {name}")
        if not all(self.paths):
            return
        paths = [(*path[self.level : -1], re.sub(r"\.\w+$", "", path[-1])) for path in self.paths]
        tag = re.compile(r"(?:^|[_\-. ])([A-Za-z]+)(\d{1,18})(?=$|[_\-. ])")
        tags = [dict(tag.findall("_".join(path))) for path in paths]
        words = [word for word in tags[0] if all(word in each for each in tags)]
        for word in words:
            name = _LETTERS.get(word.lower(), word.lower())
            values = np.array([int(tags[source][word]) for source in sources])
            self._group(name, values, f"'{word}' in the names of files")
        for level, names in enumerate(zip(*(path[:-1] for path in paths), strict=False), 1):
            if not any(all(re.search(rf"{word}\d", name) for name in names) for word in words):
                values = np.array([names[source] for source in sources])
                self._group(f"folder{level}", values, f"level {level} of the folders")
        self.groups["source_file"] = np.array(["/".join(self.paths[source]) for source in sources])

    # ------------------------------------------------------------------ columns
    def taxels(self) -> list[int]:
        """The taxels. Every other column is time, a group or left out, which is said."""
        table, taxels, constant = self.table, [*self.chosen], list[int]()
        empty = [column for column in range(table.width) if column not in table.frame]
        for column in self._named(_GROUPS) if self.chosen else table.frame:
            if column == self.time or column in self.used:
                continue
            called, (role, why) = table.called(column), self._role(column)
            if role == "empty":
                empty.append(column)
            elif role == "refused":
                table.refuse(f"{called} {why}", 0)
            elif role == "time":
                self.time = column
            elif role == "left out":
                self.notes.append(f"{called} {why} and was left out")
            elif role == "taxel":
                taxels.append(column)
                constant += [column] if why else []
            elif not self.chosen:
                self._check_whole(column, "is a group")
                self._group(table.names[column], self.fact(column), called, why)
            elif not (self._inside(column).size or table.is_missing(column).any()):
                self._group(table.names[column], self.fact(column), called)
        found = {} if self.chosen else {_CONSTANT: constant, "is empty and was left out": empty}
        for why, columns in found.items():
            if columns:
                more = f" (and {len(columns) - 1} more)" * (len(columns) > 1)
                self.notes.append(f"{table.called(min(columns))} {why}{more}")
        if not taxels:
            table.refuse(
                "has no column left for taxels; choose them with --columns, or what separates them with --delimiter"
            )
        if {"recording", self.reading.recording} & {*self.groups}:
            columns = [*self.used, *self._named(_GROUPS)]
            cells = table.frame[columns].iloc[self.starts].assign(source=self.sources)
            again = cells.duplicated().to_numpy()
            if again.any():  # rows of one recording, class and groups with others between
                first = int(np.argmax(again))
                why = f"recording {cells[columns[0]].iloc[first]} goes on here after another one"
                table.refuse(f"{why}; sort the rows by recording", int(self.starts[first]))
        if self.time is not None:
            self.notes.insert(0, f"{table.called(self.time)} is time")
        return taxels

    def _role(self, column: int) -> tuple[str, str]:
        """Role of a column (group, taxel, time, left out, refused), by the first rule that fits, and the
        reason."""
        table = self.table
        names, name = table.names, table.names[column].lower() if table.names else ""
        if name in _GROUPS:
            return "group", ""
        if table.is_empty(column):
            return "empty", ""
        text = table.is_text(column)
        values = _codes(table.frame[column]) if text else table.parsed(column)
        course, same = _course(values, self.starts), not text and bool((values == values[0]).all())
        level, runs = course == "level", course in ("up", "down")
        known = name in (*_RECORDING, *CLASS, *_CLASS_TOO)
        series = re.sub(r"\d+", "#", name)
        in_series = series != name and self.series[series] > 1
        is_rate = level and not text and _LIKE_RATE.search(name)
        if is_rate and same and values[0] > 0 and RATE.fullmatch(name):
            self.rates.append((float(values[0]), "a column that is called like it"))
        is_clock = (
            runs and not names and column == 0 and self.time is None and np.median(np.diff(values)) != 1
        )
        choose = f"choose the taxels with --columns, or the class with --class {column + 1}"
        fix = "separate them, or choose the taxels with --columns"
        rules = (
            (runs and text and self._is_glued(column), "refused", f"holds a number behind a text; {fix}"),
            (TIME.match(name) or "header.stamp" in name, "left out", "is time, too,"),
            (known and level, "group", "describes a recording"),
            (known, "left out", "changes inside recordings, so is not a group"),
            (is_rate, "left out", "is called like a rate and has one value in each recording, so is not a taxel,"),
            (level and (in_series or same), "taxel", _CONSTANT),
            (in_series, "taxel", ""),
            (level and names, "group", "has one value in each recording and is a group"),
            (is_clock, "time", ""),
            (runs, "left out", "increases like a time or numbers the rows"),
            (level, "refused", f"has one value in each recording, so is not a taxel; {choose}"),
            (True, "taxel", ""),
        )  # fmt: skip
        return next((role, why) for fits, role, why in rules if fits)

    def _is_glued(self, column: int) -> bool:
        """True for texts that end in a number that does not rise as they do: a sample behind a stamp."""
        last = self.table.frame[column].str.extract(_LAST)[0].astype(float)
        return bool(last.notna().any()) and _course(last.to_numpy(), self.starts) not in ("up", "down")

    def _inside(self, column: int) -> np.ndarray:
        """The rows inside recordings at which a column takes another value."""
        return np.setdiff1d(self._changes(column), self.starts)

    def _check_whole(self, column: int, what: str) -> None:
        """Raise InputError for a column that has no value, or several values in a recording."""
        table = self.table
        table.check_filled(column)
        for row in self._inside(column).tolist():
            why = f"{table.called(column)} {what} and changes inside a recording; name what one is with --recording"
            table.refuse(
                f"{why} (the class, where each of its runs is one), or the taxels with --columns", row
            )

    # ------------------------------------------------------------------ rates
    def _called(self, recording: int) -> str:
        path = self.paths[self.table.part(self.starts[recording])]
        names = self.groups.get("recording")
        return "/".join(path) or f"recording {recording if names is None else names[recording]}"

    def _of_clock(self, time: int) -> list[tuple[float, str]]:
        """Frames a second of each recording of two frames or more, by its time column."""
        table, rates = self.table, []
        seconds, called = table.numbers([time])[:, 0], table.called(time)
        instead = "--rate HZ, or --clock header" if table.row_is == "message" else "--rate HZ"
        for number, (first, end) in enumerate(pairwise(self.offsets.tolist())):
            part = seconds[first:end]
            steps = np.diff(part)
            if not len(steps):
                continue
            middle = float(np.median(steps))
            wrong = (steps <= 0) | (np.abs(steps - middle) > 0.5 * middle)
            if wrong.any():
                row = int(np.argmax(wrong)) + 1
                why = "does not go up" if steps[row - 1] <= 0 else "jumps"
                how = f"from {part[row - 1]:g} to {part[row]:g} where others go by {middle:g} ({steps.mean():.3g} on average)"
                table.refuse(
                    f"{called} {why}, {how}; split the recording there, or give {instead}", first + row
                )
            source = self.tables[table.part(first)]
            match = TIME.match(source.names[time]) if source.names else None
            (unit,) = source.units_of([time]) or [(match and (match[1] or match[0])) or ""]
            dates = table.frame[time].dtype.kind == "M"
            second = 1.0 if dates else _SECONDS.get(unit.lower().replace("seconds", "s"), 0.0)
            rate = len(steps) / float(part[-1] - part[0]) / (second or 1.0)
            if not second and rate < 2:  # the unit is not said
                why = f"{called} goes by {middle:g}, which in seconds is {rate:.3g} frames a second"
                table.refuse(
                    f"{why}; name its unit in the header, as in time_ms, or give --rate HZ", first + 1
                )
            rates.append((float(f"{rate:.5g}"), self._called(number)))
        return rates

    def rate(self, config: AcceleratorConfig | None) -> tuple[float, str]:
        """One rate for all recordings, and where it comes from, in words."""
        table, wanted, rates = self.table, self.reading.rate_hz, [*self.rates]
        try:
            rates += [] if self.time is None else self._of_clock(self.time)
            for name in [name for name in self.attributes if RATE.fullmatch(name)][:1]:
                for number, value in enumerate(self.fact(name).tolist()):
                    if isinstance(value, str) or not 0 < value < np.inf:
                        why = f"{name} is {str(value)[:20]}; it must be one number above 0, in hertz"
                        table.refuse(f"{why}: give --rate HZ")
                    rates.append((float(value), f"{name} of {self._called(number)}"))
        except InputError:
            if wanted is None:
                raise
        middle = float(f"{np.median([rate for rate, _ in rates]):.5g}") if rates else wanted
        if wanted is not None:
            other = abs((middle or wanted) / wanted - 1) > RATE_TOLERANCE
            but = f", {wanted:g} Hz; but the recordings say {middle:g} Hz" if other else ""
            return wanted, f"the sample rate is the given one{but}"
        if middle is None and config is not None:
            why = f"there is no time column or rate; it is taken from the configuration '{config.name}'"
            return config.sensor.sample_rate_hz, why
        if middle is None:
            table.refuse("has neither a time column nor a rate; make an archive with eskin convert --rate HZ")
        (low, slow), (high, fast) = min(rates), max(rates)
        if high > (1 + RATE_TOLERANCE) * low:
            why = f"'{slow}' has {low:g} frames a second and '{fast}' {high:g}"
            table.refuse(f"{why}; give recordings of one rate, or the rate of all with --rate HZ")
        return middle, f"the sample rate is that of the {'files' if self.time is None else 'time columns'}"


def _course(values: np.ndarray, starts: np.ndarray) -> str:
    """Course of a column in every recording: "level", "up" or "down" as a time does; "" as signals do."""
    if len(values) - len(starts) < LEAST_STEPS or not np.isfinite(values).all():
        return ""
    courses = set()
    for part in np.split(values, starts[1:]):
        steps = np.diff(part)
        if len(steps):
            down = bool((steps < 0).all())
            up = (steps > 0).all() or (not down and _is_clock(part))
            courses.add("level" if not steps.any() else "down" if down else "up" if up else "")
    return courses.pop() if len(courses) == 1 else ""


def _is_clock(values: np.ndarray) -> bool:
    """True if values of one recording run evenly though not in every frame, as a coarse clock, or wrap as
    a counter of few bits."""
    steps = np.diff(values)
    middle = np.median(steps)
    if middle != 0 and (steps == middle).mean() > 0.9:
        return True
    line = np.linspace(values[0], values[-1], len(values))
    return bool(steps.min() >= 0 and (steps > 0).sum() >= 4 and np.abs(values - line).max() <= steps.max())


def _codes(cells: Any) -> np.ndarray:
    """(rows) a number for each value, in their order."""
    import pandas as pd

    return pd.factorize(cells, sort=True)[0].astype(np.float64)


def whole(values: Any) -> np.ndarray:
    """The values of a group, one a recording: whole numbers as integers, others as they are, all else as
    text."""
    array = np.asarray(values)
    if array.dtype.kind not in "iufb":
        return np.array([str(value) for value in values])
    numbers = array.astype(np.float64)
    whole = np.array_equal(numbers, np.rint(numbers)) and np.abs(numbers).max(initial=0) < 2**53
    return numbers.astype(np.int64) if whole else numbers
