"""Named arrays in groups, as HDF5, ``.mat`` and ``.npy`` files hold them, as tables (docs/recordings.md)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from eskin.data.meaning import CLASS
from eskin.data.table import TIME, Reading, Refuse, Table
from eskin.golden.data.recordings import natural

NAMES = {
    "samples": ("samples", "data", "X", "x", "recordings", "signals"),
    "offsets": ("offsets",),
    "labels": ("labels", "label", "y", "Y", "classes", "class", "target"),
    "class_names": ("class_names", "classNames", "classnames", "names"),
}
"""What an array may be called, in the order of preference."""


@dataclass
class Group:
    """A group of HDF5, a struct or a whole file: arrays (numbers or text; cells as arrays of objects), groups
    below, and attributes: single numbers and texts, of the group and of each array."""

    arrays: dict[str, np.ndarray] = field(default_factory=dict)
    groups: dict[str, Group] = field(default_factory=dict)
    attributes: dict[str, Any] = field(default_factory=dict)
    of_arrays: dict[str, dict[str, Any]] = field(default_factory=dict)

    def take(self, name: str, array: np.ndarray) -> None:
        """An array under its name; a single value is an attribute, too, and fields are a group."""
        if array.dtype.names:
            self.groups[name] = Group({each: array[each] for each in array.dtype.names})
            return
        self.arrays[name] = array
        if array.size == 1 and array.dtype.kind in "iufbU":
            self.attributes[name] = array.reshape(-1)[0].item()


class Opened(NamedTuple):
    """Tables of a file, and the classes in order where it lists them."""

    tables: list[Table]
    class_names: list[str]


def tables_of(
    root: Group, path: Path, reading: Reading, refuse: Refuse, *, alone: bool, from_one: bool
) -> Opened:
    """The recordings of a file: samples in one array or in cells, with labels; or every array of samples one.

    Parameters
    ----------
    alone:
        The file is the whole source, no recording of a folder by class.
    from_one:
        Labels that are numbers from 1 to less than the number of class names count from 1, as in MATLAB.

    Raises
    ------
    InputError
        An array is missing or does not fit.
    """
    named = reading.samples or next((name for name in NAMES["samples"] if name in root.arrays), "")
    array = root.arrays.get(named)
    if array is not None and (alone or array.dtype == object or array.ndim == 3):
        return _set(root, named, path, reading, refuse, from_one)
    if alone and array is None and any(each in root.arrays for each in NAMES["labels"]):
        asked = (
            f"--samples {reading.samples}: is not there"
            if reading.samples
            else "has no array of samples (samples, data, X)"
        )
        refuse(f"{asked}; it has {', '.join(_leaves(root)[:12])}: name it with --samples")
    known = dict(_walk(root))
    if reading.label in known and reading.label:
        fields = ", ".join((*known[reading.label].arrays, *known[reading.label].groups))
        why = f"--class {reading.label}: is a group or struct with the fields {fields}"
        refuse(f"{why}; name one of them, as in {reading.label}.label")
    tables = list(_trials(root, (), {}, path, reading, refuse))
    if not tables:
        there = ", ".join(_leaves(root)[:12]) or "none"
        asked = (
            f"--samples {reading.samples}: is no array of samples"
            if reading.samples
            else "holds no array of samples"
        )
        refuse(
            f"{asked} ({', '.join(NAMES['samples'][:3])}, or a table (frames, taxels) a recording); there are {there}"
        )
    shapes = [table.frame.shape for table in tables]
    if not reading.columns and all(columns > rows for rows, columns in shapes):
        rows, columns = shapes[0]
        refuse(
            f"{', '.join(_leaves(root)[:6])}: have more taxels than frames ({rows} x {columns}); frames are rows: turn "
            "them, or say with --columns that columns are taxels"
        )
    return Opened(tables, [])


def _walk(group: Group, above: str = "") -> Iterator[tuple[str, Group]]:
    """Every group below, with its path."""
    for name, inner in group.groups.items():
        yield f"{above}{re.sub(r'[(][0-9]+[)]$', '', name)}", inner
        yield from _walk(inner, f"{above}{name}/")


def _leaves(group: Group, above: str = "") -> list[str]:
    """What arrays of numbers there are, with their shapes."""
    own = [
        f"{above}{name} {' x '.join(map(str, array.shape))}"
        for name, array in group.arrays.items()
        if array.size > 1
    ]
    return own + [leaf for name, inner in group.groups.items() for leaf in _leaves(inner, f"{above}{name}/")]


# ---------------------------------------------------------------------- an array of all recordings
def _set(root: Group, name: str, path: Path, reading: Reading, refuse: Refuse, from_one: bool) -> Opened:
    """Samples as cells of (frames, taxels), as (recordings, frames, taxels), or one after the other with
    offsets; labels; class names. Every other array of one value a recording is an attribute."""
    arrays = root.arrays
    there = ", ".join((*arrays, *root.groups))
    label = reading.label or next((each for each in NAMES["labels"] if each in arrays), "")
    if label not in arrays:
        asked = (
            f"--class {label}: the file has no such array"
            if label
            else "has no array of classes (labels, label, y)"
        )
        refuse(f"{asked}; it has {there}: name it with --class")
    offsets, names = (next((arrays[each] for each in NAMES[role] if each in arrays), None)
                      for role in ("offsets", "class_names"))  # fmt: skip
    parts, notes = _parts(arrays[name], offsets, name, reading, refuse)
    classes, class_names = _classes(arrays[label], names, len(parts), label, notes, refuse, from_one)
    assigned = {name, label, *NAMES["offsets"], *NAMES["class_names"]}
    vectors = ((each, column(array)) for each, array in arrays.items() if each not in assigned)
    columns = {
        each: values for each, values in vectors if values is not None and len(values) == len(parts) > 1
    }
    shared = {**root.attributes, **root.of_arrays.get(name, {})}
    notes.insert(0, f"array {name} holds {len(parts)} recordings, array {label} their classes")
    tables = []
    for number, part in enumerate(parts):
        own = {each: values[number].item() for each, values in columns.items()}
        where = f"'{path}', array {name}, recording {number + 1}"
        attributes = {**shared, **own, reading.label or "class": classes[number]}
        tables.append(_table(part, where, attributes=(attributes,), notes=tuple(notes)))
    return Opened(tables, class_names)


def _table(part: np.ndarray, where: str, **more: Any) -> Table:
    frame = pd.DataFrame(part.reshape(len(part), -1))
    return Table(frame, (), np.arange(1, len(part) + 1), (where,), row_is="row", **more)


def _parts(
    samples: np.ndarray, offsets: np.ndarray | None, name: str, reading: Reading, refuse: Refuse
) -> tuple[list[np.ndarray], list[str]]:
    """The recordings, numbers (frames, taxels) each, and notes."""
    notes: list[str] = []
    if samples.dtype == object:
        parts = [np.asarray(cell) for cell in samples.reshape(-1)]
        for number, part in enumerate(parts, 1):
            if part.ndim != 2 or part.dtype.kind not in "fiu" or not part.size:
                refuse(
                    f"cell {number} is {part.dtype} of shape {part.shape}, not numbers (frames, taxels)", name
                )
        rows, columns = ({part.shape[axis] for part in parts} for axis in (0, 1))
        if len(rows) == 1 and len(columns) > 1 and min(columns) > max(rows):
            parts = [part.T for part in parts]
            notes.append("cells stand as (taxels, frames) and were turned")
        elif len(columns) > 1:
            odd = next(number for number, part in enumerate(parts, 1) if part.shape[1] != parts[0].shape[1])
            counts = f"{parts[odd - 1].shape[1]} columns where cell 1 has {parts[0].shape[1]}"
            refuse(f"cell {odd} has {counts}; taxels are columns in all", name)
    elif samples.dtype.kind not in "fiu":
        refuse(f"holds {samples.dtype}, not numbers or cells of numbers", name)
    elif samples.ndim == 3:
        parts = list(samples)
        notes.append(f"array {name} was taken as (recordings, frames, taxels)")
    elif samples.ndim == 2 and offsets is None:
        why = "is one table and there is no array offsets that says where recordings begin"
        refuse(f"{why}; add it, or give every recording a cell or dataset of its own", name)
    elif samples.ndim == 2 and offsets is not None:
        bounds = column(offsets)
        if bounds is None or bounds.dtype.kind not in "iu":
            refuse("is no list of whole numbers", "offsets")
        rising = len(bounds) > 1 and bounds[0] == 0 and (bounds[1:] > bounds[:-1]).all()
        if not rising or bounds[-1] != len(samples):
            refuse(f"must rise from 0 to the {len(samples)} frames of samples", "offsets")
        parts = [samples[first:end] for first, end in pairwise(bounds)]
    else:
        why = f"has shape {samples.shape}; give a cell array of (frames, taxels), or (recordings, frames, taxels)"
        refuse(why, name)
    if not parts or not all(part.size for part in parts):
        refuse("holds no recording, or one without a frame", name)
    if not reading.columns and all(part.shape[1] > len(part) for part in parts):
        shape = " x ".join(map(str, parts[0].shape))
        why = f"has more taxels than frames ({shape} in recording 1); frames are rows: turn it"
        refuse(f"{why}, or say with --columns that columns are taxels", name)
    return parts, notes


def _classes(labels: np.ndarray, names: np.ndarray | None, count: int, label: str, notes: list[str], refuse: Refuse,
             from_one: bool) -> tuple[list[str], list[str]]:  # fmt: skip
    """The class of each recording and all classes, of labels that are names, or numbers from 0 or, as MATLAB
    counts, from 1."""
    values = column(labels)
    if values is None or values.shape != (count,):
        refuse(f"has shape {labels.shape}; give one value for each of the {count} recordings", label)
    listed = None if names is None else column(names)
    if names is not None and (listed is None or listed.dtype.kind != "U"):
        refuse("is no cell array of text", "class_names")
    if values.dtype.kind == "U":
        class_names = sorted(set(values.tolist()), key=natural) if listed is None else listed.tolist()
        missing = next((value for value in values.tolist() if value not in class_names or not value), None)
        if missing is not None:
            refuse(f"holds '{missing}', which is not among the class names", label)
        return values.tolist(), class_names
    if values.dtype.kind not in "iu":
        refuse("holds something else than whole numbers or names", label)
    if listed is None:
        return [f"class{value}" for value in values], [f"class{value}" for value in np.unique(values)]
    if values.min() >= 1 and values.max() <= len(listed) and (from_one or values.max() == len(listed)):
        notes.append("classes are numbered from 1")
        values = values - 1
    if values.min() < 0 or values.max() >= len(listed):
        refuse(f"runs from {values.min()} to {values.max()} and there are {len(listed)} class names", label)
    return listed[values].tolist(), listed.tolist()


def column(array: np.ndarray) -> np.ndarray | None:
    """A vector of numbers or text, of a row, a column, a cell array or a matrix of letters; None: it is none.
    Whole numbers are int64."""
    if array.dtype == object:
        cells = [np.asarray(cell).reshape(-1) for cell in array.reshape(-1)]
        kinds = {
            "U" if cell.dtype.kind == "U" else cell.dtype.kind in "fiu" for cell in cells if cell.size == 1
        }
        if len(kinds) != 1 or False in kinds or any(cell.size != 1 for cell in cells):
            return None
        array = np.concatenate(cells)
    if array.dtype.kind == "U":
        return np.char.strip(array.reshape(-1))
    if array.dtype.kind not in "fiub" or array.size != max(array.shape, default=1):
        return None
    values = array.reshape(-1)
    whole = values.dtype.kind in "iub" or (
        len(values) and (values == np.rint(values)).all() and np.abs(values).max() < 2**62
    )
    return values.astype(np.int64) if whole else values


# ---------------------------------------------------------------------- an array a recording
def _trials(group: Group, above: tuple[str, ...], known: dict[str, Any], path: Path, reading: Reading,
            refuse: Refuse) -> Iterator[Table]:  # fmt: skip
    """Every table (frames, taxels) of a group and below as a recording, with the attributes of all above it;
    a clock beside it is its time."""
    known = known | group.attributes
    label = (reading.label or "").replace(".", "/").rpartition("/")[2]
    if reading.label and label != reading.label and label in group.attributes:
        known[reading.label] = group.attributes[label]
    vectors, tables = {}, {}
    for name in sorted(group.arrays, key=natural):
        array = group.arrays[name]
        if array.dtype.kind in "iufb" and array.size > 1 and array.ndim <= 2:
            if array.size == max(array.shape):
                vectors[name] = array.reshape(-1)
            elif _asked("/".join((*above, name)), reading.samples):
                tables[name] = array
    if not tables and len({len(vector) for vector in vectors.values()}) == 1:
        yield from _of_vectors(vectors, above, known, path, reading)
    elif tables:
        clock = _clock(tables, vectors, group, above, reading, refuse)
        for name, array in tables.items():
            where = f"'{path}', dataset {'/'.join((*above, name))}"
            attributes = ({**known, **group.of_arrays.get(name, {})},)
            if clock is None:
                yield _table(array, where, paths=((*above, name),), attributes=attributes)
            else:
                timed = (
                    pd.DataFrame(array).assign(**{"clock": clock}).set_axis(range(array.shape[1] + 1), axis=1)
                )
                lines = np.arange(1, len(array) + 1)
                yield Table(timed, (), lines, (where,), paths=((*above, name),), attributes=attributes,
                            clock=array.shape[1], row_is="row")  # fmt: skip
    for name in sorted(group.groups, key=natural):
        yield from _trials(group.groups[name], (*above, name), known, path, reading, refuse)


def _asked(full: str, samples: str | None) -> bool:
    """Whether --samples names an array: by its name, its path, or the group that it stands in."""
    plain = re.sub(r"[(][0-9]+[)]", "", full)
    asked = (samples or "").replace(".", "/").strip("/")
    if "*" in asked:
        return fnmatchcase(plain, asked) or fnmatchcase(plain.rpartition("/")[2], asked)
    return not asked or asked in (plain, full) or plain.endswith(f"/{asked}") or plain.startswith(f"{asked}/")


def _of_vectors(vectors: dict[str, np.ndarray], above: tuple[str, ...], known: dict[str, Any], path: Path,
                reading: Reading) -> Iterator[Table]:  # fmt: skip
    """Vectors of one length as the columns of one table."""
    wanted = [
        name for name in vectors if TIME.match(name) or _asked("/".join((*above, name)), reading.samples)
    ]
    if any(not TIME.match(name) for name in wanted):
        frame = pd.DataFrame({number: vectors[name] for number, name in enumerate(wanted)})
        where = f"'{path}'" + (f", dataset {'/'.join(above)}" if above else "")
        yield Table(frame, tuple(wanted), np.arange(1, len(frame) + 1), (where,), paths=(above,), attributes=(known,),
                    row_is="row")  # fmt: skip


def _clock(tables: dict[str, np.ndarray], vectors: dict[str, np.ndarray], group: Group, above: tuple[str, ...],
           reading: Reading, refuse: Refuse) -> np.ndarray | None:  # fmt: skip
    """The time of a group's tables, where a vector is called like it. Several sensors are refused: tables of
    one length that are not called alike, or a vector beside a table that is no clock."""
    shown = ", ".join(_leaves(group, "".join(f"{name}/" for name in above)))
    lengths = {len(array) for array in tables.values()}
    alike = len({re.sub(r"\d+", "#", name) for name in tables}) == 1
    described = all(
        {*map(str.lower, group.of_arrays.get(name, ()))} & {*CLASS, str(reading.label).lower()}
        for name in tables
    )
    widths = {array.shape[1] for array in tables.values()}
    named = [name for name in vectors if TIME.match(name)]
    beside = [name for name, vector in vectors.items() if name not in named and len(vector) in lengths
              and (vector != vector[0]).any()]  # fmt: skip
    of_one = len(lengths) == 1 and not described and (not alike or len(above) > 1)
    several = len(tables) > 1 and "*" not in (reading.samples or "") and (named or of_one or len(widths) > 1)
    if several or (beside and reading.samples is None):
        why = f"holds several arrays where one is a recording: {shown}"
        refuse(f"{why}; name that of the samples with --samples, or all, where each is a recording, with a *")
    clock = next((vectors[name] for name in named if {len(vectors[name])} == lengths), None)
    if named and clock is None:
        refuse(f"its time has another length than its samples: {shown}; write it again, or give --rate HZ")
    return clock
