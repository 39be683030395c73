"""Parquet files, in which a column may hold lists, and data sets in LeRobot's form (version 3): a folder of them
with meta/info.json."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from eskin.data.table import Reading, Refuse, Table, check_regular, check_unpacked, table_of
from eskin.golden.core import InputError, Record
from eskin.golden.data.recordings import natural

INFO, TASKS = "meta/info.json", "meta/tasks.parquet"
EPISODE, TASK = "episode_index", "task"
"""Column that names the recording, and the column of the class where the user names none."""


def read_parquet(path: Path, reading: Reading, refuse: Refuse, **of_table: Any) -> Table:
    """The table of a file. A column of lists becomes a column for each place in its lists, which are the taxels;
    of several ``reading.samples`` names one, and the others are left out. of_table: fields of the table
    beside; ``names``: of the places; ``tasks``: text of each task_index.

    Raises
    ------
    InputError
        Several columns of lists and no name, lists of several lengths, or with a place that is empty.
    """
    import pyarrow as arrow
    from pyarrow import parquet

    with parquet.ParquetFile(path) as file:
        meta, schema = file.metadata, file.schema_arrow
        groups = [meta.row_group(number).total_byte_size for number in range(meta.num_row_groups)]
    check_unpacked(path, max(8 * meta.num_rows * meta.num_columns, sum(groups)), refuse)
    texts = [each.name for each in schema if str(each.type).removeprefix("large_") in ("string", "binary")]
    columns = parquet.read_table(path, read_dictionary=texts)
    for name in texts:  # a long text that a dictionary holds once
        for part in columns[name].chunks:
            longest = max(map(len, filter(None, part.dictionary.to_pylist())), default=0)
            check_unpacked(path, longest * len(part), refuse)
    lists = [each.name for each in columns.schema if _is_list(each.type)]
    chosen = reading.samples if reading.samples in columns.column_names else None
    if reading.samples and not chosen:
        refuse(f"--samples {reading.samples[:40]}: is no column; there are {', '.join(columns.column_names)}")
    if len(lists) > 1 and not chosen:
        refuse(f"has several columns of lists ({', '.join(lists)}); name the samples with --samples")
    chosen = chosen or next(iter(lists), None)
    frame = columns.drop_columns(lists).to_pandas().reset_index(drop=True)
    tasks, names = of_table.pop("tasks", {}), of_table.pop("names", ())
    if tasks and TASK not in frame:
        frame[TASK] = frame["task_index"].map(tasks)
    if chosen is not None and chosen in lists:
        parts = [getattr(part, "storage", part) for part in columns[chosen].chunks]
        values = _values(arrow.concat_arrays(parts), chosen, refuse)
        places = values.reshape(len(values), -1)
        if len(names) != places.shape[1]:
            names = [f"{chosen}.{place}" for place in range(places.shape[1])]
        first = frame.shape[1]
        for place, name in enumerate(names):
            frame.insert(first + place, name, places[:, place], allow_duplicates=True)
        grid = values.shape[1:] if values.ndim == 3 else ()
        of_table |= {"taxels": tuple(range(first, first + len(names))), "grid": grid}
    elif chosen:
        of_table["taxels"] = (list(frame.columns).index(chosen),)
    return table_of(frame, f"'{path}'", **of_table)


def _is_list(kind: Any) -> bool:
    return hasattr(getattr(kind, "storage_type", kind), "value_field") and "list" in str(
        getattr(kind, "storage_type", kind)
    )


def _values(lists: Any, name: str, refuse: Refuse) -> np.ndarray:
    """(rows, length) or (rows, rows of a grid, columns) of a column of lists."""
    shape = [len(lists)]
    while _is_list(lists.type):
        lengths = np.array(lists.value_lengths().to_pylist(), dtype=np.float64)
        other = np.flatnonzero(lengths != lengths[0])  # a missing list is NaN
        if len(other) or not lengths[0] >= 1:
            row = int(other[0] if len(other) else 0) // int(np.prod(shape[1:]))
            refuse(
                f"column '{name}' has lists of several lengths, or empty ones, from row {row + 1} on; give every row one"
            )
        shape.append(int(lengths[0]))
        lists = lists.flatten()
    return lists.to_numpy(zero_copy_only=False).astype(np.float64).reshape(shape)


def is_lerobot(folder: Path) -> bool:
    """The folder has the form of LeRobot's data sets."""
    return (folder / INFO).is_file()


def read_lerobot(folder: Path, reading: Reading) -> tuple[list[Table], Reading]:
    """The tables of a data set, and how they are to be read: episodes are recordings, tasks the classes, the
    samples the only stream of numbers, unless ``reading`` names others. info.json has the rate.

    Raises
    ------
    InputError
        Another version, several streams without a name, a stream of another rate, or files that are missing.
    """

    def refuse(why: str, array: str = "") -> NoReturn:
        raise InputError(f"recordings '{folder}', LeRobot's form: {why}")

    check_regular(folder / INFO, refuse)
    try:
        info = json.loads((folder / INFO).read_text())
        version, features, rate = str(info["codebase_version"]), dict(info["features"]), float(info["fps"])
        streams = {name: _stream(each, rate) for name, each in features.items()}
        frames = int(info["total_frames"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        refuse(f"{INFO} is damaged or lacks a field ({error}); write the data set again")
    if not version.startswith("v3"):
        refuse(f"is of version {version[:20]} and version 3 is read; convert it with lerobot's own script")
    name = _samples(streams, reading, refuse)
    own_rate, _, names = streams[name]
    if own_rate != rate and reading.rate_hz is None:
        refuse(
            f"stream {name} has {own_rate:g} frames a second and a row of the data set {rate:g}; write it as a data "
            "set by itself, or give the rate of the rows with --rate HZ"
        )
    tasks = _tasks(folder, refuse) if reading.label in (None, TASK) else {}
    if reading.label is None and len(tasks) == 1:
        refuse("has one task, so tasks are no classes; name the column of the class with --class")
    files = sorted((folder / "data").rglob("*.parquet"), key=lambda file: natural(str(file)))
    if not files:
        refuse("has no data/*/*.parquet; copy the whole folder")
    of_file = replace(reading, samples=name)
    more = {"attributes": {"fps": rate}, "names": names, "tasks": tasks}
    try:
        tables = [read_parquet(file, of_file, refuse, **more) for file in files]
    except (InputError, ModuleNotFoundError, MemoryError):
        raise
    except Exception as error:  # a damaged file can fail anywhere inside the libraries
        refuse(f"a file of data is damaged ({type(error).__name__}); copy the folder again")
    if sum(len(table.frame) for table in tables) != frames:
        refuse(f"{INFO} counts {frames} frames and the files hold others; copy the whole folder")
    label, recording = reading.label or TASK, reading.recording or EPISODE
    return tables, replace(reading, samples=None, label=label, recording=recording)


Stream = tuple[float, tuple[int, ...], tuple[str, ...]]
"""Frames a second, shape, and the names of its places; no shape: it is no numbers in these files."""


def _stream(feature: Record, rate: float) -> Stream:
    shape = tuple(map(int, feature["shape"]))
    names = feature.get("names")
    names = next(iter(names.values()), ()) if isinstance(names, dict) else names or ()
    is_numbers = str(feature["dtype"]).startswith(("float", "int", "uint"))
    places = tuple(map(str, names)) if len(shape) == 1 else ()
    return float(feature.get("fps", rate)), shape if is_numbers else (), places


def _samples(streams: dict[str, Stream], reading: Reading, refuse: Refuse) -> str:
    """Name of the stream that holds the samples."""
    wide = [name for name, (_, shape, _) in streams.items() if np.prod(shape) > 1]
    listed = ", ".join(
        f"{name} ({' x '.join(map(str, streams[name][1]))}, {streams[name][0]:g} Hz)" for name in wide
    )
    if reading.samples is None:
        if len(wide) != 1:
            refuse(
                f"has {len(wide)} streams of numbers ({listed or 'none'}); name the samples with --samples"
            )
        return wide[0]
    if reading.samples not in streams or not streams[reading.samples][1]:
        refuse(f"--samples {reading.samples[:60]}: is no stream of numbers; there are {listed or 'none'}")
    return reading.samples


def _tasks(folder: Path, refuse: Refuse) -> dict[int, str]:
    """Text of each task_index; the text is the table's index or its column ``task``."""
    from pyarrow import parquet

    path = folder / TASKS
    if not path.is_file():
        refuse(f"has no {TASKS}, which names the classes; name their column with --class")
    check_regular(path, refuse)
    try:
        table = parquet.read_table(path).to_pandas().reset_index()
        texts = next(name for name in table if name != "task_index" and table[name].map(type).eq(str).all())
        return dict(zip(table["task_index"].astype(int), table[texts].astype(str), strict=True))
    except MemoryError:
        raise
    except Exception as error:  # as above
        refuse(f"{TASKS} is damaged ({type(error).__name__}); copy the folder again")
