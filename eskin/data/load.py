"""The recordings that ``--data`` names, in any form: a reader per kind of file makes tables, and
``eskin.data.meaning`` turns these into recordings."""

import re
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

from eskin.data.archive import load_archive
from eskin.data.arrays import ARRAYS, tables_of
from eskin.data.logs import is_log, read_log
from eskin.data.meaning import CLASS, check_rate, understand
from eskin.data.parquet import is_lerobot, read_lerobot, read_parquet
from eskin.data.table import DataFrame, Reading, Table, check_regular, table_of
from eskin.data.text import read_text
from eskin.data.turns import scene_of, turn_recordings
from eskin.extras import without_extra
from eskin.golden.core import AcceleratorConfig, InputError, Progress
from eskin.golden.core.groups import MOST_CLASSES
from eskin.golden.data.recordings import Recordings, natural

TEXT = (".csv", ".tsv", ".txt", ".lvm")
KINDS = dict.fromkeys((*TEXT, ".parquet"), "text") | dict.fromkeys(ARRAYS, "arrays")
"""Endings of recording files, and their kinds; logs are of text's kind, since they are tables too."""
FORMS = (
    "an .npz archive, a folder with sub-folders by class (.csv, .lvm, .parquet, .mat, .h5, .npy or logs), "
    "a long .csv or .parquet table, a .mat or .h5 file, a log (.mcap, ROS bag), a folder of LeRobot or the word synthetic"
)
OTHERS = dict.fromkeys(
    (".json", ".cbor"),
    "files like those of Edge Impulse are not read; write each recording as CSV, a line of names and a row a frame, in "
    "sub-folders by class, and give --rate 1000 / interval_ms",
)
"""What to do with endings of other tools."""

SCENE = "synthetic"
"""The word for a made-up scene."""


def load_recordings(
    data: str | Path | DataFrame,
    *,
    config: AcceleratorConfig | None = None,
    reading: Reading | None = None,
    progress: Progress | None = None,
) -> Recordings:
    """The recordings that ``--data`` names (docs/recordings.md), or the word SCENE.

    Parameters
    ----------
    data:
        Path or the word; in Python also one long table as a pandas DataFrame.
    config:
        What one code of real samples is worth, and a rate that is not said; scene, array and rate of
        ``synthetic`` (`eskin.data.turns`).
    reading:
        Facts about tables and arrays from the user; None: everything is found out.
    progress:
        Called with (what, done, total) while files of a folder are read.

    Raises
    ------
    InputError
        The data break a rule; the sentence names file, array or line, and the fix.
    """
    reading = reading or Reading()
    if type(data).__name__ == "DataFrame":  # by name: pandas need not be installed
        return understand([table_of(data, "'DataFrame'")], reading, config, "DataFrame")
    if not isinstance(data, str | Path):
        raise InputError(
            f"recordings: are of type {type(data).__name__}; give {FORMS}, or a pandas DataFrame"
        )
    if str(data) == SCENE:
        return turn_recordings() if config is None else scene_of(config)
    path = Path(data)
    option = "--clock" if reading.clock != "log" else "--labels" if reading.labels else ""
    if option and not is_log(path):
        raise InputError(
            f"recordings '{path}': {option} is for one log, a .mcap file or a ROS bag; leave it out"
        )
    try:
        return _load(path, reading, config, progress)
    except ModuleNotFoundError as error:
        raise InputError(f"recordings '{path}': {without_extra(error)}") from None
    except OSError as error:
        why = f"cannot be read ({error.strerror or error}); check the path and its permissions"
        raise InputError(f"recordings '{path}': {why}") from None


def _load(
    path: Path, reading: Reading, config: AcceleratorConfig | None, progress: Progress | None
) -> Recordings:
    if not path.exists():
        raise InputError(f"recordings '{path}': is not there; give {FORMS}")
    if path.is_dir() and is_lerobot(path):
        tables, reading = read_lerobot(path, reading)
        return understand(tables, reading, config, str(path), of_one_file=True)
    if path.is_dir() and not is_log(path):
        return _folder(path, reading, config, progress)
    if path.suffix == ".npz":
        worth = config.sensor.volt_per_code or None if config else None
        return load_archive(path, reading.scale or worth, requested=reading.scale is not None)
    if _kind(path) is None:
        fix = OTHERS.get(path.suffix.lower(), f"give {FORMS}")
        raise InputError(
            f"recordings '{path}': ends in '{path.suffix}', which is not a format of recordings; {fix}"
        )
    tables = open_file(path, reading, single=True)
    if is_log(path):
        reading = replace(reading, label=None, recording=None)
    return understand(tables, reading, config, str(path), of_one_file=True)


def _kind(path: Path) -> str | None:
    return "text" if is_log(path) else KINDS.get(path.suffix.lower())


def open_file(path: Path, reading: Reading, *, single: bool = False) -> list[Table]:
    """The tables of one file. single: it is the whole source.

    Raises
    ------
    InputError
        It is damaged, or what it holds cannot be understood.
    """

    def refuse(why: str, array: str = "") -> NoReturn:
        raise InputError(f"recordings '{path}'{f', array {array}' if array else ''}: {why}")

    suffix = path.suffix.lower()
    if suffix in TEXT:
        return [read_text(path, reading)]
    if not is_log(path):
        check_regular(path, refuse)
    try:
        if is_log(path):
            return [read_log(path, reading, refuse)]
        if suffix == ".parquet":
            return [read_parquet(path, reading, refuse)]
        root = ARRAYS[suffix](path, refuse)
    except (InputError, ModuleNotFoundError):
        raise
    except Exception as error:  # a damaged file can fail anywhere inside the libraries
        if isinstance(error, OSError) and error.errno and not isinstance(error, BlockingIOError):
            raise
        refuse(
            f"is damaged or no {suffix or 'log'} file ({type(error).__name__}); write it again, or try its own tools"
        )
    return tables_of(root, path, reading, refuse, single=single)


# ---------------------------------------------------------------------- folders
def _visible(folder: Path) -> list[Path]:
    entries = (entry for entry in folder.iterdir() if not entry.name.startswith("."))
    return sorted(entries, key=lambda entry: natural(entry.name))


def _files(folder: Path, levels: int = 8) -> list[Path]:
    """Every file below a folder, down to ``levels`` levels; the folder of a ROS 2 bag counts as a file."""
    files = []
    for entry in _visible(folder):
        inner = entry.is_dir() and not is_log(entry)
        files += (_files(entry, levels - 1) if levels else []) if inner else [entry]
    return files


def _folder(
    folder: Path, reading: Reading, config: AcceleratorConfig | None, progress: Progress | None
) -> Recordings:
    """A folder with a sub-folder a class, or with files whose names begin with it: a file is a recording, or parts itself
    into some; the levels between are groups.

    Raises
    ------
    InputError
        There is no such folder or file, or files of several kinds; the message lists them.
    """

    def refuse(where: Path, why: str) -> NoReturn:
        others = [OTHERS[file.suffix.lower()] for file in files if file.suffix.lower() in OTHERS]
        raise InputError(f"recordings '{where}': {why}; {others[0] if others else f'give {FORMS}'}")

    def found(files: list[Path]) -> str:
        counts = Counter(file.suffix.lower() or file.name for file in files)
        return ", ".join(f"{count} {suffix}" for suffix, count in counts.most_common(6)) or "nothing"

    files = _files(folder)
    class_folders = [entry for entry in _visible(folder) if entry.is_dir() and not is_log(entry)]
    if len(class_folders) > MOST_CLASSES and reading.label is None:
        refuse(
            folder,
            f"has {len(class_folders)} sub-folders, one per class; a classifier has 2 to {MOST_CLASSES}",
        )
    members = [file for file in files if _kind(file) and not (class_folders and file.parent == folder)]
    if not members:
        refuse(folder, f"has no file of recordings (it holds {found(files)})")
    begun = [re.split(r"[\W_]+[A-Za-z]?\d|\d", file.name)[0] for file in members]
    by_name = not class_folders and 1 < len({*begun}) <= MOST_CLASSES and min(Counter(begun).values()) > 1
    holding = {file.relative_to(folder).parts[0] for file in members}
    for each in class_folders:
        if each.name not in holding:
            refuse(each, f"has no file of recordings (it holds {found(_files(each))})")
    if len(set(map(_kind, members))) > 1:
        refuse(folder, f"holds files of several kinds ({found(members)}); leave one kind in it")
    tables = []
    for done, (file, name) in enumerate(zip(members, begun, strict=True)):
        if progress is not None:
            progress("files read", done, len(members))
        tables_of_file, parts = open_file(file, reading), file.relative_to(folder).parts
        by_name &= {*CLASS}.isdisjoint(map(str.lower, tables_of_file[0].names))
        parts = (name, *parts) if by_name else parts
        for table in tables_of_file:
            inner = table.path if len(tables_of_file) > 1 else ()
            tables.append(replace(table, path=(*parts, *inner)))
        if not done and config is None:
            check_rate(tables, reading)
    left = len(files) - len(members)
    notes = [f"{left} files that are not recordings were left out"] if left else []
    notes += ["the text before the number in a file's name is its folder, since it is in none"] * by_name
    return understand(tables, reading, config, str(folder), notes=notes)
