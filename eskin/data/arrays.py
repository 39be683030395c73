"""Named arrays in groups, as HDF5, ``.mat`` and ``.npy`` files hold them, as tables (docs/recordings.md)."""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Literal

import numpy as np

from eskin.data.meaning import CLASS, whole
from eskin.data.table import TIME, Names, Reading, Refuse, Table, check_unpacked, table_of
from eskin.golden.core import Arrays, Record
from eskin.golden.data.recordings import check_offsets, natural

SAMPLES = ("samples", "data", "X", "x", "recordings", "signals")
LABELS = ("labels", "label", "y", "Y", "classes", "class", "target")
CLASS_NAMES = ("class_names", "classNames", "classnames", "label_names", "names")
"""Names of the array of class names, in the order of preference; beside many arrays the last may name anything."""
MOST_SIDE, MOST_TAXELS = 32, 256
"""Rows or columns of a grid at most, which the frames of a recording exceed, and its taxels."""


@dataclass
class Group:
    """A group of HDF5, a struct or a whole file: arrays (numbers or text; cells as arrays of objects), groups
    below, and attributes: single numbers and texts, of the group and of each array."""

    arrays: dict[str, np.ndarray] = field(default_factory=dict)
    groups: dict[str, Group] = field(default_factory=dict)
    attributes: Record = field(default_factory=dict)
    of_arrays: dict[str, Record] = field(default_factory=dict)

    def take(self, name: str, array: np.ndarray) -> None:
        """An array by its name. A single number or text is also an attribute; an array with fields
        is a group."""
        if array.dtype.names:
            self.groups[name] = Group({each: array[each] for each in array.dtype.names})
            return
        self.arrays[name] = array
        if array.size == 1 and array.dtype.kind in "iufbU":
            self.attributes[name] = array.reshape(-1)[0].item()

    def shapes(self, above: str = "") -> Iterator[str]:
        """Name and shape of each array, and of those in groups below."""
        for name, array in self.arrays.items():
            yield f"{above}{name} {' x '.join(map(str, array.shape))}".strip()
        for name, inner in self.groups.items():
            yield from inner.shapes(f"{above}{name}/")

    def listed(self) -> str:
        """List of the arrays with their shapes."""
        return ", ".join([*self.shapes()][:12]) or "none"


def tables_of(root: Group, path: Path, reading: Reading, refuse: Refuse, *, single: bool) -> list[Table]:
    """The recordings of a file: samples in one array or in cells, with labels; or every array of samples one.

    Parameters
    ----------
    single:
        The file is the whole source, no recording of a folder by class.

    Raises
    ------
    InputError
        An array is missing or does not fit.
    """
    found = _Arrays(root, path, reading, refuse)
    named = reading.samples or next((name for name in SAMPLES if name in root.arrays), "")
    label = reading.label or next((name for name in LABELS if name in root.arrays), "")
    words: Names = CLASS_NAMES
    first = int(path.suffix.lower() == ".mat")  # MATLAB counts from 1
    if single and named in root.arrays and not label.isdecimal():  # the number of a table's column
        tables = found.array_tables(named, label)
    else:
        words = words[:-1] if re.search("class|label", reading.label or "class", re.I) else ()
        tables = [] if single and label in root.arrays else [*found.group_tables(root, (), {})]
    if not tables:
        problem = f"has no array of samples ({', '.join(SAMPLES[:3])}, or a table (frames, taxels) or (frames, rows, columns) a recording)"
        if reading.samples:
            problem = f"--samples {reading.samples}: names no array of samples"
        refuse(f"{problem}; it has {root.listed()}: name it with --samples")
    shapes = [table.frame.shape for table in tables]
    if not reading.columns and all(columns > rows for rows, columns in shapes):
        shape = f"{shapes[0][0]} x {shapes[0][1]}"
        why = f"has more taxels than frames ({shape} in recording 0) in {root.listed()}"
        refuse(f"{why}; frames must be rows; transpose the table, or name the taxels with --columns")
    word = next((word for word in words if word in root.arrays), "")
    if word:
        texts = _vector(root.arrays[word])
        if texts is None or texts.dtype.kind != "U":
            refuse("is not a list of text", word)
        tables = [replace(each, class_names=tuple(texts.tolist()), first_class=first) for each in tables]
    return tables


@dataclass
class _Arrays:
    """A file's arrays, and the facts about them."""

    root: Group
    path: Path
    reading: Reading
    refuse: Refuse

    def table(self, part: np.ndarray, where: str, above: Names, attributes: Record,
              clock: tuple[str, np.ndarray] | None = None, **more: Any) -> Table:  # fmt: skip
        """A table of an array (frames, taxels) or (frames, rows, columns), and of its clock, if it has one, behind
        them."""
        import pandas as pd

        frame = pd.DataFrame(part.reshape(len(part), -1))
        taxels = frame.shape[1]
        units: Names = ()
        if clock is not None:
            name, frame[taxels] = clock
            of_name = TIME.match(name)
            units = (*[""] * taxels, (of_name and of_name[1]) or ("s" if name.lower() == "seconds" else ""))
        frame.index += 1
        grid = part.shape[1:] if part.ndim == 3 else ()
        if grid and (max(grid) > MOST_SIDE or taxels > MOST_TAXELS):
            shape, size = (
                " x ".join(map(str, part.shape)),
                f"of up to {MOST_SIDE}, {MOST_TAXELS} taxels in all",
            )
            why = f"has shape {shape}; of three dimensions the first is the frames, then come rows and columns {size}"
            fix = "put its axes in this order, and each recording in a file or array of its own"
            self.refuse(f"{why}: {fix}", where)
        return Table(frame, (), f"'{self.path}', {where}", path=above, attributes=attributes, grid=grid,
                     units=units, clock=taxels if clock else None, row_is="row", **more)  # fmt: skip

    # ------------------------------------------------------------------ an array of all recordings
    def array_tables(self, name: str, label: str) -> list[Table]:
        """Samples as cells of (frames, taxels), as (recordings, frames, taxels), or one after the other with
        offsets, each also of rows and columns for taxels; labels; class names. Every other array of one value a recording is an attribute."""
        arrays, parts = self.root.arrays, self.parts(self.root.arrays[name], name)
        if label not in arrays:
            problem = (
                f"--class {label}: is not an array" if label else "has no array of classes (labels, label, y)"
            )
            self.refuse(f"{problem}; it has {self.root.listed()}: name it with --class")
        vectors = {each: _vector(array) for each, array in arrays.items() if each != name}
        own = {
            each: vector
            for each, vector in vectors.items()
            if vector is not None and len(vector) == len(parts)
        }
        if label not in own or own[label].dtype.kind == "f":
            why = f"give one name or whole number for each of the {len(parts)} recordings"
            shape = f"has shape {arrays[label].shape}"
            odd = next((f"holds {each}" for each in own.get(label, ()) if each % 1 != 0), shape)
            self.refuse(f"{odd}; {why}", label)
        values = own.pop(label)
        own.pop(next((each for each in CLASS_NAMES if each in arrays), ""), None)
        notes = [f"array {name} holds {len(parts)} recordings, array {label} their classes"]
        shared = {**self.root.attributes, **self.root.of_arrays.get(name, {})}
        tables = []
        for number, part in enumerate(parts):
            attributes = {**shared, **{each: vector[number].item() for each, vector in own.items()}}
            attributes |= {self.reading.label or "class": values[number].item()}
            where = f"array {name}, recording {number}"
            tables.append(self.table(part, where, (), attributes, notes=tuple(notes)))
        return tables

    def parts(self, samples: np.ndarray, name: str) -> list[np.ndarray]:
        """The recordings, numbers (frames, taxels) each."""
        offsets = _vector(self.root.arrays.get("offsets", np.array(None)))
        if samples.dtype == object:
            parts = [np.asarray(part) for part in samples.reshape(-1)]
        elif samples.ndim in (1, 2, 3) and offsets is not None:
            check_offsets(offsets, len(samples), lambda array, why: self.refuse(why, array))
            parts = np.split(samples, offsets[1:-1])
        elif samples.ndim in (3, 4):
            parts = [*samples]
        else:
            why = f"holds {samples.dtype} of shape {samples.shape}; give a cell array of (frames, taxels), numbers (recordings"
            other = "one table and an array offsets that says where recordings begin"
            self.refuse(f"{why}, frames, taxels), of one taxel (recordings, frames, 1), or {other}", name)
        if all(part.size == max(part.shape, default=0) for part in parts):
            parts = [part.reshape(-1, 1) for part in parts]  # of one taxel
        for number, part in enumerate(parts):
            if part.ndim not in (2, 3) or part.dtype.kind not in "fiu" or not part.size:
                why = (
                    f"recording {number} is {part.dtype} of shape {part.shape}, not numbers (frames, taxels)"
                )
                self.refuse(why, name)
        return parts

    # ------------------------------------------------------------------ an array a recording
    def group_tables(self, group: Group, above: Names, known: Record) -> Iterator[Table]:
        """Every table (frames, taxels) of a group and below as a recording, with the attributes of all above
        it; a clock beside it is its time. Vectors of one length, where there is no table, are one's columns."""
        import pandas as pd

        known = known | group.attributes
        wanted = (self.reading.label or "").replace(".", "/").rpartition("/")[2]
        if wanted in group.attributes:
            known[str(self.reading.label)] = known[wanted]
        arrays = {
            name: group.arrays[name]
            for name in sorted(group.arrays, key=natural)
            if group.arrays[name].dtype.kind in "iufb" and group.arrays[name].size > 1
        }
        vectors = {
            name: array.reshape(-1) for name, array in arrays.items() if array.size == max(array.shape)
        }
        chosen = [name for name in arrays if TIME.match(name) or self.is_wanted("/".join((*above, name)))]
        tables = {
            name: arrays[name] for name in chosen if name not in vectors and arrays[name].ndim in (2, 3)
        }
        clock = self.clock(tables, vectors, group, above) if tables else None
        for name, array in tables.items():
            path = (*above, name)
            own = known | group.of_arrays.get(name, {})
            yield self.table(array, f"dataset {'/'.join(path)}", path, own, clock)
        columns = {name: vectors[name] for name in chosen if name in vectors}
        alike = len(set(map(len, columns.values()))) == 1
        if not tables and alike and not all(map(TIME.match, columns)):
            where = f"'{self.path}', dataset {'/'.join(above)}"
            frame = pd.DataFrame(columns)
            yield table_of(frame, where, path=above, attributes=known, row_is="row")
        for name in sorted(group.groups, key=natural):
            yield from self.group_tables(group.groups[name], (*above, name), known)

    def is_wanted(self, full: str) -> bool:
        """True if --samples names an array: by its name, its path, its group, or a pattern with a *."""
        plain = re.sub(r"[(]\d+[)]", "", full)  # without the numbers of structs
        pattern = (self.reading.samples or "*").replace(".", "/").strip("/")
        ends = (plain, full, plain.rpartition("/")[2])
        return any(fnmatchcase(each, pattern) for each in ends) or f"/{pattern}/" in f"/{plain}/"

    def clock(self, tables: Arrays, vectors: Arrays, group: Group,
              above: Names) -> tuple[str, np.ndarray] | None:  # fmt: skip
        """The time of a group's tables, where a vector is called like it. Several sensors are refused: tables
        of one length that are not called alike, or a vector beside a table that is no clock."""
        lengths, widths = ({array.shape[part] for array in tables.values()} for part in (0, slice(1, None)))
        of_class = {*CLASS, str(self.reading.label).lower()}
        described = all(of_class & {*map(str.lower, group.of_arrays.get(name, ()))} for name in tables)
        alike = len({re.sub(r"\d+", "#", name) for name in tables}) == 1 and len(above) < 2
        clocks = [name for name in vectors if TIME.match(name)]
        beside = [name for name, vector in vectors.items() if name not in clocks and len(vector) in lengths
                  and (vector != vector[0]).any()]  # fmt: skip
        at_once = clocks or len(widths) > 1 or (len(lengths) == 1 and not described and not alike)
        several = len(tables) > 1 and at_once and "*" not in (self.reading.samples or "")
        where, listed = f"group {'/'.join(above) or '/'} holds", group.listed()
        if several or (beside and self.reading.samples is None):
            why = f"{where} several arrays where one is a recording: {listed}; name that of the samples with --samples"
            self.refuse(f"{why}, or all, where each is one, by a pattern with *")
        fitting = [name for name in clocks if {len(vectors[name])} == lengths]
        if clocks and not fitting:
            self.refuse(
                f"{where} a time whose length differs from that of the samples: {listed}; write it again"
            )
        return (fitting[0], vectors[fitting[0]]) if fitting else None


def _vector(array: np.ndarray) -> np.ndarray | None:
    """A vector of numbers (whole ones as int64) or text, of a row, a column, or a cell array; None: it is
    none."""
    if array.dtype == object:
        cells = [np.asarray(cell).reshape(-1) for cell in array.reshape(-1)]
        if not cells or any(cell.size != 1 or cell.dtype.kind not in "Uiuf" for cell in cells):
            return None
        array = np.concatenate(cells)
    if array.dtype.kind == "U":
        return np.char.strip(array.reshape(-1))
    flat = array.dtype.kind in "fiub" and array.size == max(array.shape, default=1)
    return whole(array.reshape(-1)) if flat else None


_OWN = ("IMAGE", "DIMENSION_SCALE", "GROUP", "ARRAY", "CARRAY", "EARRAY", "VLARRAY", "TABLE", "PALETTE")
"""Values of the attribute CLASS that HDF5's libraries write themselves."""


def read_hdf5(path: Path, refuse: Refuse) -> Group:
    """Everything in a file that is numbers or text.

    Raises
    ------
    InputError
        The file unpacks to far more than it holds; a dataset's samples stand in another file,
        which a hostile one could have chosen.
    """
    import h5py

    root = Group()

    def check(name: str | bytes, item: Any) -> None:
        if isinstance(name, bytes):
            refuse(f"has an object whose name is not UTF-8 ({name!r}); rename it")
        if not isinstance(item, h5py.Dataset):
            return
        if item.external or item.is_virtual:
            refuse("has its samples in other files (external or virtual); write them into this one", name)
        datasets[name] = item

    datasets: dict[str, Any] = {}
    with h5py.File(path) as file:
        file.visititems(check)
        check_unpacked(path, sum(item.nbytes for item in datasets.values()), refuse)
        root.attributes |= _attributes(file)
        for name, item in datasets.items():
            *above, leaf = name.split("/")
            group, holder = root, file
            for level in above:
                group, holder = group.groups.setdefault(level, Group()), holder[level]
                group.attributes |= _attributes(holder)
            group.of_arrays[leaf] = _attributes(item)
            values = _values(item)
            if values is not None:
                group.take(leaf, values)
    return root


def _values(item: Any) -> np.ndarray | None:
    """Numbers or text of a dataset, or its fields; None: it holds something else."""
    import h5py

    if h5py.check_string_dtype(item.dtype):
        return np.array(item.asstr()[()], dtype=np.str_)
    parts = [item.dtype[name] for name in item.dtype.names or ()] or [item.dtype]
    plain = all(part.kind in "iufb" and not part.shape for part in parts)
    return np.asarray(item[()]) if plain and item.shape is not None else None


def _attributes(item: Any) -> dict[str, Any]:
    """Attributes that are one number or text."""
    values: dict[str, Any] = {}
    for key, value in item.attrs.items():
        name = key.decode("utf-8", "replace") if isinstance(key, bytes) else key
        cells = np.asarray(value).reshape(-1).tolist()
        cell = cells[0] if len(cells) == 1 else None
        cell = cell.decode("utf-8", "replace") if isinstance(cell, bytes) else cell
        if isinstance(cell, str | int | float) and not (name == "CLASS" and cell in _OWN):
            values[name] = cell
    return values


# ---------------------------------------------------------------------- .mat
Order = Literal["big", "little"]
_KINDS = (*range(1, 8), 9, 12, 13, 14, 15, 16, 17, 18)
"""The kinds of data elements that there are; scipy's reader ends its process on others."""
_PACKED, _MATRIX = 15, 14


def read_matlab(path: Path, refuse: Refuse) -> Group:
    """Everything in a file that is numbers, text, cells or structs.

    Raises
    ------
    InputError
        The file unpacks to far more than it holds, or is of version 7.3.
    """
    from scipy.io import loadmat

    raw = path.read_bytes()
    if raw[:8] == b"\x89HDF\r\n\x1a\n" or b"MATLAB 7.3" in raw[:128]:
        refuse("is of version 7.3 (HDF5); save it in MATLAB with save(..., '-v7')")
    order: Order = "big" if raw[126:128] == b"MI" else "little"
    if raw[126:128] in (b"MI", b"IM"):
        _check(path, memoryview(raw)[128:], order, refuse)
    root = Group()
    loaded = loadmat(path, appendmat=False)
    for name, array in loaded.items():
        if not name.startswith("__") and isinstance(array, np.ndarray):
            _take(root, name, array)
    return root


def _check(path: Path, data: memoryview, order: Order, refuse: Refuse) -> None:
    """Refuse elements of a kind that there is not, and packed ones that unpack to far more than the file."""
    unpacked, places = 0, [data]
    while places:
        data, place = places.pop(), 0
        while place + 8 <= len(data):
            kind, count = (int.from_bytes(data[place + k : place + k + 4], order) for k in (0, 4))
            small = kind >> 16  # a small element: its bytes stand behind its kind
            if (kind & 0xFFFF if small else kind) not in _KINDS:
                raise ValueError
            body = data[place + 8 : place + 8 + count]
            if kind == _PACKED:
                unpacking = zlib.decompressobj()
                head = unpacking.decompress(body, 8)
                unpacked += int.from_bytes(head[4:8], order)
                check_unpacked(path, unpacked, refuse)
                places.append(memoryview(head + unpacking.decompress(unpacking.unconsumed_tail, unpacked)))
            elif kind == _MATRIX:
                places.append(body)
            place += 8 if small else 8 + (count if kind == _PACKED else -(-count // 8) * 8)


def _take(group: Group, name: str, array: np.ndarray) -> None:
    """A variable, a struct as a group, an array of structs as a group each."""
    if array.dtype.names:
        for number, each in enumerate(array.reshape(-1), 1):
            called = name if array.size == 1 else f"{name}({number})"
            inner = group.groups.setdefault(called, Group())
            for field in array.dtype.names:
                _take(inner, field, np.asarray(each[field]))
    elif array.dtype.kind in "iufbUO" and array.size:
        group.take(name, array)


# ---------------------------------------------------------------------- .npy
def read_npy(path: Path, refuse: Refuse) -> Group:
    """The array of a file."""
    root = Group()
    root.take("array", np.load(path, allow_pickle=False))
    return root


ARRAYS = {".mat": read_matlab, ".h5": read_hdf5, ".hdf5": read_hdf5, ".npy": read_npy}
