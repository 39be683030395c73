"""Recordings from tables of text and pandas DataFrames: what a column means (docs/recordings.md).

Where a name says it, or --columns, it is taken as said. Any other column whose course no taxel has (one value
in each recording, or steadily rising) is understood and said, or refused: as a taxel it would tell the
network the class or the hour. What was understood stands in ``Recordings.notes``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, NoReturn

import numpy as np

from eskin.data.logs import is_log, read_log
from eskin.data.text import Reading, Table, check_unpacked, read_table
from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.data.codes import place_of, to_codes
from eskin.golden.data.recordings import Recordings, natural, recordings_of

if TYPE_CHECKING:
    import pandas as pd

SUFFIXES = (".csv", ".tsv", ".txt")
PARQUET = ".parquet"
RATE_TOLERANCE = 0.02
LEAST_STEPS = 16
"""From so many frames on a column's course says something about what it is."""

_UNITS = {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_TIME = re.compile(
    r"^(?:time|t|timestamp|elapsed|seconds|zeit|x_value)(?:[ "
    r"_]*[(\[]?(s|sec|seconds|ms|msec|us|µs|ns)[)\]]?)?$",
    re.I,
)
_INDEX = ("", "index", "frame", "sample", "n", "no", "number", "row", "counter", "unnamed: 0")
_RECORDING = tuple(
    "recording recording_id rec rec_id record series series_id sequence_id sample_id measurement id".split()
)
_CLASS = tuple("class label target class_name category material object texture surface gesture".split())
_GROUPS = tuple(
    "person subject participant user session block trial run fold group day speed seq sequence".split()
)
_MISSING = ("", "nan", "n/a", "<na>", "null")


class _Meaning(NamedTuple):
    """Columns of a table that are taxels, time (None) and groups, and sentences about them."""

    taxels: list[int]
    time: int | None
    groups: list[int]
    notes: list[str]


# ---------------------------------------------------------------------- columns
def _time_of(table: Table, reading: Reading, chosen: Sequence[int]) -> int | None:
    """The time column by option or name; text such as 2026-05-01T12:00:00.25 becomes a date."""
    import pandas as pd

    named = (column for column, name in enumerate(table.names) if column not in chosen and _TIME.match(name))
    time = next(named, None) if reading.time is None else table.find(reading.time, "--time")
    if time is not None and table.is_text(time):
        with suppress(ValueError, TypeError):  # refused with its place when its numbers are asked for
            table.frame[time] = pd.to_datetime(table.frame[time], format="ISO8601")
    return time


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


def _meaning(
    table: Table, time: int | None, taken: Sequence[int], labels: np.ndarray, chosen: Sequence[int]
) -> _Meaning:
    """What the columns are: ``chosen``, where there are any, are the taxels; ``taken`` are something else
    already."""
    names = [name.lower() for name in table.names]
    series = [re.sub(r"\d+", "#", name) for name in names]
    taxels: list[int] = []
    groups: list[int] = []
    notes: list[str] = []

    def leave_out(column: int, why: str) -> None:
        notes.append(f"{table.called(column)} {why} and was left out")

    for column in chosen or table.frame:
        if chosen or column == time or column in taken:
            taxels += [column] if chosen else []
            continue
        means_other = bool(names) and names[column] in (*_RECORDING, *_CLASS, *_GROUPS)
        is_taxel = (
            bool(names) and not means_other and "#" in series[column] and series.count(series[column]) > 1
        )
        text = table.is_text(column)
        values = (
            np.unique(table.frame[column].astype(str), return_inverse=True)[1].astype(float)
            if text
            else table.parsed(column)
        )
        course = _course(values, table.starts)
        if is_taxel or (course == "level" and not text and not means_other and (values == values[0]).all()):
            taxels.append(column)
            if course == "level":
                notes.append(
                    f"{table.called(column)} keeps its value in each recording and was taken as a taxel"
                )
        elif text and not any(table.frame[column]):
            leave_out(column, "is empty")
        elif names and _TIME.match(names[column]):
            leave_out(column, "is time, too,")
        elif course == "level" and not names:
            table.refuse(
                f"{table.called(column)} has one value in each recording, so is no taxel; choose the taxels "
                "with --columns",
                0,
            )
        elif course == "level" and _same_split(values[table.starts], labels):
            leave_out(column, "tells the class, too,")
        elif course == "level" and not means_other and _all_differ(values[table.starts]):
            leave_out(column, "has another value in each recording, so is no group,")
        elif course == "level":
            groups.append(column)
            if not means_other:
                notes.append(f"{table.called(column)} has one value in each recording and is a group")
        elif means_other:
            leave_out(column, "changes inside recordings, is no group")
        elif course == "counts" and (names[column] in _INDEX if names else column == 0):
            leave_out(column, "numbers the rows")
        elif course in ("rises", "counts") and not names and column == 0 and time is None:
            time = column
        elif course in ("rises", "counts"):
            leave_out(column, "runs on like a time")
        elif course == "either":
            table.refuse(
                f"{table.called(column)} is level in some recordings and runs on like a time in others, so "
                "is no taxel; "
                "choose the taxels with --columns",
                0,
            )
        else:
            taxels.append(column)
    if not taxels:
        table.refuse("has no column left for taxels; choose them with --columns")
    if time is not None:
        notes.insert(
            0, f"{table.called(time)} is time" if names else f"{table.called(time)} goes up and is time"
        )
    return _Meaning(taxels, time, groups, notes)


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


def _all_differ(values: np.ndarray) -> bool:
    """Whether every recording has a value of its own, so that nothing is left out with any."""
    return len(np.unique(values)) == len(values) > 1


def _same_split(values: np.ndarray, labels: np.ndarray) -> bool:
    """Whether values part recordings as the classes do."""
    pairs = set(zip(values.tolist(), labels.tolist(), strict=True))
    return len(pairs) == len(set(values.tolist())) == len(set(labels.tolist())) > 1


# ---------------------------------------------------------------------- rates
def _unit(table: Table, time: int | None) -> float:
    """Seconds of one of the time column: by the unit in its name; 0: it does not say."""
    if time is None or not table.names:
        return 0.0
    if table.frame[time].dtype.kind == "M":
        return 1.0
    if table.units and table.unit([time]).lower() in _UNITS:
        return _UNITS[table.unit([time]).lower()]
    match = _TIME.match(table.names[time])
    return (
        1.0
        if table.names[time].lower() == "seconds"
        else _UNITS.get((match[1] or "").lower(), 0.0)
        if match
        else 0.0
    )


def _rate(table: Table, time: int, seconds: np.ndarray, rows: slice, unit: float) -> float | None:
    """Frames a second of ``seconds``, the time column over ``rows``; None with fewer than two. unit: s; 0:
    not said."""
    if len(seconds) < 2:
        return None
    steps = np.diff(seconds)
    middle = float(np.median(steps))
    far = np.abs(steps - middle)
    called = table.called(time)
    if steps.min() <= 0:
        row = int(np.argmax(steps <= 0)) + 1
        table.refuse(
            f"{called} does not go up, from {seconds[row - 1]:g} to {seconds[row]:g}; give --rate HZ",
            rows.start + row,
        )
    if far.max() > 0.5 * middle:
        row = int(np.argmax(far)) + 1
        why = f"{called} jumps by {steps[row - 1]:g} where others go by {middle:g}"
        table.refuse(
            f"{why}; split the recording there, sample it evenly, or give --rate HZ", rows.start + row
        )
    rate = (len(seconds) - 1) / float(seconds[-1] - seconds[0]) / (unit or 1.0)
    if not unit and rate < 2:
        why = f"{called} goes by {middle:g}, which in seconds is {rate:.3g} frames a second"
        table.refuse(f"{why}; name its unit in the header, time_ms say, or give --rate HZ", rows.start + 1)
    return float(f"{rate:.5g}")


def _common_rate(
    table: Table,
    time: int | None,
    units: Sequence[float],
    names: Sequence[str],
    reading: Reading,
    config: AcceleratorConfig | None,
) -> tuple[float, str]:
    """One rate for all recordings, and where it comes from, in words. units: of the time column in each
    recording, s (0: not said)."""
    rates: list[tuple[float, str]] = []
    if time is not None:
        try:
            seconds = table.numbers([time])[:, 0]
            for rows, unit, name in zip(table.spans, units, names, strict=True):
                rate = _rate(table, time, seconds[rows], rows, unit)
                rates += [] if rate is None else [(rate, name)]
        except InputError:
            if reading.rate_hz is None:
                raise
    middle = float(f"{np.median([rate for rate, _ in rates]):.5g}") if rates else 0.0
    if reading.rate_hz is not None:
        if not rates or abs(middle / reading.rate_hz - 1) <= RATE_TOLERANCE:
            return reading.rate_hz, "the sample rate is as asked for"
        return (
            reading.rate_hz,
            f"the sample rate is as asked for, {reading.rate_hz:g} Hz; but the time columns say {middle:g} "
            "Hz",
        )
    if not rates and config is not None:
        return (
            config.sensor.sample_rate_hz,
            f"there is no time column; the rate is that of configuration '{config.name}'",
        )
    if not rates:
        why = "have no time column, so their rate is not known"
        raise InputError(
            f"recordings '{table.place(0)}': {why}; write an archive with it, eskin convert SOURCE --rate "
            "HZ --out FILE.npz"
        )
    (low, slow), (high, fast) = min(rates), max(rates)
    if high > (1 + RATE_TOLERANCE) * low:
        why = f"'{slow}' has {low:g} frames a second and '{fast}' {high:g}"
        raise InputError(
            f"recordings '{table.place(0)}': {why}; give recordings of one rate, or the rate of all with "
            "--rate HZ"
        )
    return middle, "the sample rate is that of the time columns"


# ---------------------------------------------------------------------- sets of recordings
def assemble(
    values: np.ndarray,
    offsets: np.ndarray,
    labels: Sequence[int] | np.ndarray,
    class_names: Sequence[str],
    rate: float,
    groups: dict[str, np.ndarray],
    source: str,
    scale: float | None,
    config: AcceleratorConfig | None,
    notes: Sequence[str],
    unit: str = "",
) -> Recordings:
    """Recordings of finite samples (frames, taxels), in ``unit``: real ones become codes, by the
    configuration's ``volt_per_code`` where it has one."""
    of_config = config.sensor.volt_per_code if config is not None and scale is None else 0.0
    if of_config > 0 and values.dtype.kind == "f" and not np.array_equal(values, np.rint(values)):
        scale = of_config
    codes, step, sentences = to_codes(values, f"recordings '{source}'", scale)
    arrays = {
        "samples": codes,
        "offsets": offsets,
        "labels": np.array(labels, dtype=np.int64),
        "class_names": np.array(class_names, dtype=np.str_),
        "sample_rate_hz": np.array(rate),
        **({"lsb_volt": np.array(step)} if step else {}),
        "unit": np.array(unit),
    }
    return recordings_of(arrays, source, groups=groups, notes=(*notes, *sentences))


def _is_recording(path: Path) -> bool:
    """Whether a file, or the folder of a bag, is a table of one recording in a folder by class."""
    return path.suffix.lower() in (*SUFFIXES, PARQUET) or is_log(path)


def is_table_folder(folder: Path) -> bool:
    """Whether any sub-folder holds a table of text or Parquet, or a log."""
    return any(
        _is_recording(file) for entry in _visible(folder) if entry.is_dir() for file in _visible(entry)
    )


def load_folder(
    folder: Path, reading: Reading, config: AcceleratorConfig | None, lvm: bool = False
) -> Recordings:
    """One recording a file, one class a sub-folder; groups: source_file, what file names tell, and columns
    with one value a file.

    A file name's parts of letters and a number (``p07_brush_t2``, ``Seq1_Sp300_t1``), separated by ``_`` or
    ``-``, become groups when every file has them: ``p`` is called person, ``t`` trial, others keep their
    letters.

    Parameters
    ----------
    lvm:
        The files are LabVIEW's: column 1 is time, columns 2.. are taxels in volt, which become codes of the
        configuration's ``volt_per_code``; where the time columns give no steady rate, it is the
        configuration's.

    Raises
    ------
    InputError
        Files that cannot be read, or that are not of one array and rate.
    """
    for option, value in (
        ("--recording", reading.recording),
        ("--class", reading.label),
        ("--group", reading.groups),
    ):
        if value and not lvm:
            why = f"{option} is for one long table; in a folder a file is a recording, a sub-folder a class"
            raise InputError(f"recordings '{folder}': {why}")
    if lvm and (config is None or config.sensor.volt_per_code <= 0):
        raise InputError(
            f"recordings '{folder}': .lvm files hold volts; give a configuration whose field volt_per_code "
            "is above 0"
        )
    class_folders = sorted(
        (entry for entry in _visible(folder) if entry.is_dir()), key=lambda entry: natural(entry.name)
    )
    if not class_folders:
        raise InputError(
            f"recordings '{folder}': has no sub-folder; put each class's {'.lvm' if lvm else '.csv'} files into "
            "a folder named after the class"
        )
    tables: list[Table] = []
    labels, names, units, skipped = [], [], [], 0
    for label, class_folder in enumerate(class_folders):
        entries = sorted(_visible(class_folder), key=lambda entry: natural(entry.name))
        files = [
            entry for entry in entries if (entry.suffix.lower() == ".lvm" if lvm else _is_recording(entry))
        ]
        skipped += len(entries) - len(files)
        if not files:
            kinds = ".lvm file" if lvm else ".csv, .tsv, .txt or .parquet file, or log"
            raise InputError(
                f"recordings '{class_folder}': has no {kinds}; add the class's recordings or remove the "
                "folder"
            )
        for file in files:
            table = read_any(file, reading, lvm)
            chosen = _chosen(table, reading)
            time = 0 if lvm else _time_of(table, reading, chosen)
            units.append(1.0 if lvm else _unit(table, time))
            if chosen:
                table = table.only([*chosen, *([] if time is None else [time])])
                time = None if time is None else len(chosen)
            labels.append(label)
            names.append(f"{class_folder.name}/{file.name}")
            tables.append(table)
            _check_alike(tables[0], table, names[0], lvm)
    table = Table.joined(tables)
    groups = {"source_file": np.array(names)} | _groups_of_names([Path(name).stem for name in names])
    if lvm and config is not None:
        return _volts_as_codes(
            table, np.array(labels), [entry.name for entry in class_folders], groups, str(folder), config
        )
    meaning = _meaning(table, time, (), np.array(labels), [*range(len(chosen))] if chosen else [])
    rate, why = _common_rate(table, meaning.time, units, names, reading, config)
    notes = [
        f"{len(class_folders)} folders are classes, {len(names)} files recordings; "
        f"{_listed(table, meaning.taxels)}",
        *dict.fromkeys(note for each in tables for note in each.notes),
        *meaning.notes,
        why,
    ]
    if skipped:
        notes.append(f"{skipped} files that are no tables were left out")
    groups |= {table.names[column]: _whole(table, column) for column in meaning.groups}
    values = table.numbers(meaning.taxels)
    return assemble(
        values,
        table.offsets,
        labels,
        [entry.name for entry in class_folders],
        rate,
        groups,
        str(folder),
        reading.scale,
        config,
        notes,
        table.unit(meaning.taxels),
    )


def _check_alike(first: Table, table: Table, first_name: str, lvm: bool) -> None:
    """Refuse a file whose columns are not those of the first; how they call time may differ."""
    columns, first_columns = ([_TIME.sub("time", name) for name in each.names] for each in (table, first))
    count, first_count = (
        each.frame.shape[1] - (1 if lvm else sum(map(bool, map(_TIME.match, each.names))))
        for each in (table, first)
    )
    if count != first_count:
        table.refuse(f"has {count} taxels where '{first_name}' has {first_count}; all files must agree")
    if columns != first_columns:
        table.refuse(f"its columns are not called as those of '{first_name}'; give all files one header")


def _volts_as_codes(
    table: Table,
    labels: np.ndarray,
    class_names: Sequence[str],
    groups: dict[str, np.ndarray],
    source: str,
    config: AcceleratorConfig,
) -> Recordings:
    sensor, fmt = config.sensor, config.sample_format
    volts = table.numbers([*table.frame][1:])
    codes = np.rint(volts / sensor.volt_per_code)
    wrong = (codes < fmt.min_code) | (codes > fmt.max_code)
    if wrong.any():
        row, taxel = place_of(wrong)
        span = f"{fmt.min_code * sensor.volt_per_code:g} to {fmt.max_code * sensor.volt_per_code:g} V"
        why = f"{volts[row, taxel]:g} V is outside the converter's {span}"
        table.refuse(
            f"{why}; set sample_bits, sample_signed and volt_per_code of the configuration", row, taxel + 1
        )
    try:
        rate, note = _common_rate(
            table, 0, [1.0] * len(labels), groups["source_file"].tolist(), Reading(), None
        )
    except InputError:
        rate = sensor.sample_rate_hz
        note = f"the time columns give no steady rate; taken from the configuration '{config.name}'"
    return Recordings(
        samples=codes.astype(np.int32),
        offsets=table.offsets,
        labels=labels,
        class_names=tuple(class_names),
        sample_rate_hz=rate,
        groups=groups,
        source=source,
        volt_per_code=sensor.volt_per_code,
        unit="V",
        sample_bits=sensor.sample_bits,
        sample_signed=sensor.sample_signed,
        notes=(note, f"volts became codes of {sensor.volt_per_code:g} V"),
    )


def load_long_table(
    data: Path | pd.DataFrame, reading: Reading, config: AcceleratorConfig | None
) -> Recordings:
    """One table of all recordings, a file or a DataFrame: columns for recording, class, groups, time and
    taxels, one row a frame.

    A recording is a run of rows with one value of recording and class.

    Raises
    ------
    InputError
        There is no header, no class or recording column, a value of them is missing, a group changes inside a
        recording, or rows of a recording do not stand together.
    """
    table = read_any(data, reading) if isinstance(data, Path) else _of_frame(data, "DataFrame")
    if isinstance(data, Path) and is_log(data):
        if reading.label is None and reading.labels is None:
            why = "says no classes; write an archive with them, eskin convert SOURCE --out FILE.npz with --class TOPIC"
            table.refuse(
                f"{why} or --labels TABLE.csv, or put each class's logs into a folder named after the class"
            )
        reading = replace(reading, label=None, recording=None)
    if not table.names:
        table.refuse(
            "has no header, so its columns have no names; add one, or make it a folder with a sub-folder a "
            "class",
            0,
        )
    lower = [name.lower() for name in table.names]

    def column_of(asked: str | None, words: Sequence[str], option: str, role: str) -> int:
        named = (
            [table.find(asked, option)]
            if asked is not None
            else [lower.index(word) for word in words if word in lower]
        )
        if not named:
            table.refuse(
                f"has no column that says the {role} ({', '.join(words[:4])}, ...); name it with {option}", 0
            )
        table.check_filled(named[0], _MISSING)
        return named[0]

    label = column_of(reading.label, _CLASS, "--class", "class of a row")
    recording = column_of(
        reading.recording,
        [word for word in _RECORDING if word != lower[label]],
        "--recording",
        "recording of a row",
    )
    keys = {
        column: np.unique(table.frame[column].astype(str), return_inverse=True)[1]
        for column in (recording, label)
    }
    # a recording begins where its name or its class changes from one row to the next
    changes = {column: np.flatnonzero(np.diff(key)) + 1 for column, key in keys.items()}
    starts = np.unique(np.concatenate([[0], *changes.values()]))
    table = replace(table, starts=starts)
    notes = [f"{table.called(label)} is the class, {table.called(recording)} the recording"]
    cut = np.setdiff1d(changes[label], changes[recording])
    if len(cut):
        notes.append(
            f"{table.called(label)} changes inside recordings, {len(cut)} times, first in line "
            f"{table.lines[cut[0]]}: they were cut there"
        )
    chosen = _chosen(table, reading)
    asked = [table.find(name, "--group") for name in reading.groups]
    groups = []
    for column in asked or [
        number for number, name in enumerate(lower) if name in _GROUPS and number not in (label, recording)
    ]:
        key = np.unique(table.frame[column].astype(str), return_inverse=True)[1]
        inside = np.setdiff1d(np.flatnonzero(np.diff(key)) + 1, starts)
        if not len(inside):
            if chosen and not asked and table.is_missing(column, _MISSING).any():
                continue
            table.check_filled(column, _MISSING)
            groups.append(column)
            keys[column] = key
        elif asked or not chosen:
            name = _shown(table.frame[recording].iloc[inside[0]])
            why = f"{table.called(column)} is a group and changes inside recording {name}"
            table.refuse(f"{why}; name the groups with --group, or the taxels with --columns", int(inside[0]))
    # the same recording, class and groups twice, with others between: rows that are not sorted
    first_rows: dict[tuple[int, ...], int] = {}
    for start in starts.tolist():
        before = first_rows.setdefault(tuple(int(key[start]) for key in keys.values()), start)
        if before != start:
            name = _shown(table.frame[recording].iloc[start])
            why = f"recording {name} of line {table.lines[before]} goes on here after another one"
            table.refuse(f"{why}; sort the rows by recording", start)
    shown = [_shown(value) for value in table.frame[label].iloc[starts]]
    class_names = sorted(set(shown), key=natural)
    labels = np.array([class_names.index(name) for name in shown])
    meaning = _meaning(table, _time_of(table, reading, chosen), (label, recording, *groups), labels, chosen)
    groups += [] if asked else meaning.groups
    units = [_unit(table, meaning.time)] * len(starts)
    names = [f"recording {_shown(value)}" for value in table.frame[recording].iloc[starts]]
    rate, why = _common_rate(table, meaning.time, units, names, reading, config)
    notes = [f"{notes[0]}; {_listed(table, meaning.taxels)}", *notes[1:], *table.notes, *meaning.notes, why]
    if groups:
        notes.append(f"groups: {', '.join(table.names[column] for column in groups)}")
    of_group = {table.names[column]: _whole(table, column) for column in (*groups, recording)}
    values = table.numbers(meaning.taxels)
    return assemble(
        values,
        table.offsets,
        labels,
        class_names,
        rate,
        of_group,
        table.sources[0],
        reading.scale,
        config,
        notes,
        table.unit(meaning.taxels),
    )


def read_any(path: Path, reading: Reading, lvm: bool = False) -> Table:
    """The table of a file: text, Parquet or a log."""
    if is_log(path):
        return _of_frame(read_log(path, reading), str(path))
    if path.suffix.lower() != PARQUET:
        return read_table(path, reading, lvm)
    from pyarrow import parquet

    def refuse(why: str) -> NoReturn:
        raise InputError(f"recordings '{path}': {why}")

    import pandas as pd

    try:
        with parquet.ParquetFile(path) as file:
            cells = file.metadata.num_rows * file.metadata.num_columns
        check_unpacked(path, 8 * cells, "write it again, a row a frame", refuse)
        return _of_frame(pd.read_parquet(path), str(path))
    except InputError:
        raise
    except Exception as error:  # a damaged file can fail anywhere inside the library
        if isinstance(error, OSError) and error.errno:
            raise
        refuse("is damaged or no Parquet file; write it again")


def _of_frame(frame: pd.DataFrame, source: str) -> Table:
    """A table of a DataFrame; an index that has a name is columns, too. ``attrs["units"]``: the unit of all,
    or of each column by its name."""
    if not len(frame) or not frame.shape[1]:
        raise InputError(f"recordings '{source}': holds no row or no column; give one row a frame")
    units_of = frame.attrs.get("units", "")
    frame = frame.reset_index() if any(name is not None for name in frame.index.names) else frame
    names = tuple(str(name) for name in frame.columns)
    frame = frame.set_axis(range(frame.shape[1]), axis=1).reset_index(drop=True)
    for column in frame.columns[frame.dtypes.map(lambda kind: kind.kind not in "iufM")]:
        frame[column] = frame[column].astype(object).where(frame[column].notna(), "").astype(str)
    units = [
        str(units_of.get(name, "")) if isinstance(units_of, Mapping) else str(units_of) for name in names
    ]
    lines = np.arange(1, len(frame) + 1)
    return Table(frame, names, lines, (source,), np.array([0]), units=tuple(units) if any(units) else ())


def _groups_of_names(stems: list[str]) -> dict[str, np.ndarray]:
    """Groups that file names tell: parts of letters and a number that every name has, unless they number the
    files."""
    tokens = [dict(re.findall(r"(?:^|[_\-. ])([A-Za-z]+)(\d{1,18})(?=$|[_\-. ])", stem)) for stem in stems]
    everywhere = [word for word in tokens[0] if all(word in tags for tags in tokens)]
    called = {"p": "person", "t": "trial"}
    groups = {
        called.get(word.lower(), word.lower()): np.array([int(words[word]) for words in tokens])
        for word in everywhere
    }
    return {name: values for name, values in groups.items() if name in _GROUPS or not _all_differ(values)}


def _listed(table: Table, taxels: Sequence[int]) -> str:
    """The taxels in words: names that differ by a number alone as one, all others."""
    runs: dict[str, list[str]] = {}
    for column in taxels:
        name = table.names[column] if table.names else str(column + 1)
        runs.setdefault(re.sub(r"\d+", "#", name), []).append(name)
    named = [part for run in runs.values() for part in ([f"{run[0]} to {run[-1]}"] if len(run) > 2 else run)]
    return f"columns {', '.join(named)} are the {len(taxels)} taxels"


def _visible(folder: Path) -> list[Path]:
    return [entry for entry in folder.iterdir() if not entry.name.startswith(".")]


def _shown(value) -> str:
    return str(int(value)) if isinstance(value, float) and value.is_integer() else str(value)


def _whole(table: Table, column: int) -> np.ndarray:
    """The values of a group, one a recording: whole numbers as integers, others as they are, all else as
    text."""
    values = table.frame[column].iloc[table.starts]
    if values.dtype.kind not in "iuf":
        return np.array([str(value) for value in values])
    numbers = values.to_numpy(dtype=np.float64)
    return (
        numbers.astype(np.int64)
        if np.array_equal(numbers, np.rint(numbers)) and np.abs(numbers).max() < 2**53
        else numbers
    )
