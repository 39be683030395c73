"""Named arrays in groups, as HDF5, ``.mat`` and ``.npy`` files hold them, as tables (docs/recordings.md)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from eskin.data.meaning import CLASS, whole
from eskin.data.table import TIME, Reading, Refuse, Table, table_of
from eskin.golden.data.recordings import check_offsets, natural

SAMPLES = ("samples", "data", "X", "x", "recordings", "signals")
LABELS = ("labels", "label", "y", "Y", "classes", "class", "target")
CLASS_NAMES = ("class_names", "classNames", "classnames", "names")
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

    def below(self, above: str = "") -> Iterator[tuple[str, Group]]:
        """This group and all below it, with the paths of each."""
        yield above, self
        for name, inner in self.groups.items():
            yield from inner.below(f"{above}{name}/")

    def listed(self) -> str:
        """What arrays there are, with their shapes."""
        arrays = [
            f"{above}{name} {' x '.join(map(str, array.shape))}".strip()
            for above, group in self.below()
            for name, array in group.arrays.items()
        ]
        return ", ".join(arrays[:12]) or "none"


def tables_of(
    root: Group, path: Path, reading: Reading, refuse: Refuse, *, alone: bool, from_one: bool
) -> list[Table]:
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
    found = _Arrays(root, path, reading, refuse)
    named = reading.samples or next((name for name in SAMPLES if name in root.arrays), "")
    array = root.arrays.get(named)
    label = next((name for name in LABELS if name in root.arrays), "")
    if array is not None and (alone or array.dtype == object or array.ndim == 3):
        tables = found.of_one_array(named, reading.label or label, from_one)
    else:
        for above, group in root.below():
            if above and _plain(above[:-1]) == reading.label:
                fields = ", ".join((*group.arrays, *group.groups))
                why = f"--class {reading.label}: is a group or struct with the fields {fields}"
                refuse(f"{why}; name one of them, as in {reading.label}.label")
        beside = label and alone and array is None
        tables = [] if beside else [*found.of_group(root, (), {})]
    if not tables:
        asked = f"has no array of samples ({', '.join(SAMPLES[:3])}, or a table (frames, taxels) a recording)"
        if reading.samples:
            asked = f"--samples {reading.samples}: names no array of samples"
        refuse(f"{asked}; it has {root.listed()}: name it with --samples")
    shapes = [table.frame.shape for table in tables]
    if not reading.columns and all(columns > rows for rows, columns in shapes):
        shape = f"{shapes[0][0]} x {shapes[0][1]}"
        why = f"has more taxels than frames ({shape} in recording 1) in {root.listed()}"
        refuse(f"{why}; frames are rows: turn them, or say with --columns that columns are taxels")
    return tables


@dataclass
class _Arrays:
    """A file's arrays, and what is said of them."""

    root: Group
    path: Path
    reading: Reading
    refuse: Refuse

    def table(self, part: np.ndarray, where: str, above: tuple[str, ...], attributes: dict[str, Any],
              clocks: Mapping[str, np.ndarray] = {}, **more: Any) -> Table:  # fmt: skip
        """A table of an array (frames, taxels), and of its clock, if it has one, behind them."""
        import pandas as pd

        frame = pd.DataFrame(part.reshape(len(part), -1))
        taxels = frame.shape[1]
        units: tuple[str, ...] = ()
        for name, clock in clocks.items():
            frame[taxels] = clock
            of_name = TIME.match(name)
            units = (*[""] * taxels, (of_name and of_name[1]) or ("s" if name.lower() == "seconds" else ""))
        frame.index += 1
        return Table(frame, (), (f"'{self.path}', {where}",), paths=(above,), attributes=(attributes,),
                     units=units, clock=taxels if clocks else None, row_is="row", **more)  # fmt: skip

    # ------------------------------------------------------------------ an array of all recordings
    def of_one_array(self, name: str, label: str, from_one: bool) -> list[Table]:
        """Samples as cells of (frames, taxels), as (recordings, frames, taxels), or one after the other with
        offsets; labels; class names. Every other array of one value a recording is an attribute."""
        arrays, refuse = self.root.arrays, self.refuse
        if label not in arrays:
            asked = f"--class {label}: is no array" if label else "has no array of classes (labels, label, y)"
            refuse(f"{asked}; it has {self.root.listed()}: name it with --class")
        parts, note = self.parts(arrays[name], name)
        vectors: dict[str, Any] = {each: _vector(array) for each, array in arrays.items()}
        values = vectors[label]
        if values is None or len(values) != len(parts):
            why = f"has shape {arrays[label].shape}; give one value for each of the {len(parts)} recordings"
            refuse(why, label)
        if values.dtype.kind == "f":
            refuse("holds something else than whole numbers or names", label)
        named = next((each for each in CLASS_NAMES if each in arrays), "")
        names: Any = vectors[named] if named else ()
        if names is None:
            refuse("is no list of text", named)
        counted = ""
        if values.dtype.kind != "U" and not named:
            values = [f"class{each}" for each in values]
        elif values.dtype.kind != "U":
            low, high, count = values.min(), values.max(), len(names)
            first = int(low >= 1 and high <= count and (from_one or high == count))
            if low < first or high >= count + first:
                refuse(f"runs from {low} to {high} and there are {count} class names", label)
            counted, values = f"classes are numbered from {first}", names[values - first]
        own = {
            each: vector
            for each, vector in vectors.items()
            if vector is not None and len(vector) == len(parts) > 1 and each not in (name, label, named)
        }
        shared = {**self.root.attributes, **self.root.of_arrays.get(name, {})}
        notes = (f"array {name} holds {len(parts)} recordings, array {label} their classes", note, counted)
        more: dict[str, Any] = {"notes": tuple(filter(None, notes)), "class_names": tuple(names)}
        tables = []
        for number, part in enumerate(parts):
            attributes = {**shared, **{each: vector[number].item() for each, vector in own.items()}}
            attributes |= {self.reading.label or "class": str(values[number])}
            where = f"array {name}, recording {number + 1}"
            tables.append(self.table(part, where, (), attributes, **more))
        return tables

    def parts(self, samples: np.ndarray, name: str) -> tuple[list[np.ndarray], str]:
        """The recordings, numbers (frames, taxels) each, and a note."""
        refuse, offsets = self.refuse, self.root.arrays.get("offsets")
        if samples.dtype == object:
            parts = [np.asarray(cell) for cell in samples.reshape(-1)]
            for number, part in enumerate(parts, 1):
                if part.ndim != 2 or part.dtype.kind not in "fiu" or not part.size:
                    why = f"cell {number} is {part.dtype} of shape {part.shape}, not numbers (frames, taxels)"
                    refuse(why, name)
            rows, columns = ({part.shape[axis] for part in parts} for axis in (0, 1))
            if len(rows) == 1 and len(columns) > 1 and min(columns) > max(rows):
                return [part.T for part in parts], "cells stand as (taxels, frames) and were turned"
            for number, part in enumerate(parts, 1):
                if part.shape[1] != parts[0].shape[1]:
                    counts = f"{part.shape[1]} columns where cell 1 has {parts[0].shape[1]}"
                    refuse(f"cell {number} has {counts}; taxels are columns in all", name)
            return parts, ""
        if samples.dtype.kind not in "fiu" or samples.ndim not in (2, 3) or not samples.size:
            why = f"holds {samples.dtype} of shape {samples.shape}"
            refuse(
                f"{why}; give a cell array of (frames, taxels), or numbers (recordings, frames, taxels)", name
            )
        if samples.ndim == 3:
            return [*samples], f"array {name} was taken as (recordings, frames, taxels)"
        if offsets is None:
            why = "is one table and there is no array offsets that says where recordings begin"
            refuse(f"{why}; add it, or give every recording a cell or dataset of its own", name)
        bounds: Any = _vector(offsets)
        if bounds is None:
            refuse("must be whole numbers", "offsets")
        check_offsets(bounds, len(samples), lambda array, why: refuse(why, array))
        return [samples[first:end] for first, end in pairwise(bounds)], ""

    # ------------------------------------------------------------------ an array a recording
    def of_group(self, group: Group, above: tuple[str, ...], known: dict[str, Any]) -> Iterator[Table]:
        """Every table (frames, taxels) of a group and below as a recording, with the attributes of all above
        it; a clock beside it is its time. Vectors of one length, where there is no table, are one's columns."""
        import pandas as pd

        known = known | group.attributes
        asked = (self.reading.label or "").replace(".", "/").rpartition("/")[2]
        known |= {str(self.reading.label): known[asked]} if asked in group.attributes else {}
        arrays = {
            name: group.arrays[name]
            for name in sorted(group.arrays, key=natural)
            if group.arrays[name].dtype.kind in "iufb" and group.arrays[name].size > 1
        }
        vectors = {
            name: array.reshape(-1) for name, array in arrays.items() if array.size == max(array.shape)
        }
        chosen = [name for name in arrays if TIME.match(name) or self.asked("/".join((*above, name)))]
        tables = {name: arrays[name] for name in chosen if name not in vectors and arrays[name].ndim == 2}
        clocks = self.clock(tables, vectors, group, above) if tables else {}
        for name, array in tables.items():
            path = (*above, name)
            own = known | group.of_arrays.get(name, {})
            yield self.table(array, f"dataset {'/'.join(path)}", path, own, clocks)
        columns = {name: vectors[name] for name in chosen if name in vectors}
        alike = len(set(map(len, columns.values()))) == 1
        if not tables and alike and not all(map(TIME.match, columns)):
            where = f"'{self.path}', dataset {'/'.join(above)}"
            frame = pd.DataFrame(columns)
            yield table_of(frame, where, paths=(above,), attributes=(known,), row_is="row")
        for name in sorted(group.groups, key=natural):
            yield from self.of_group(group.groups[name], (*above, name), known)

    def asked(self, full: str) -> bool:
        """Whether --samples names an array: by its name, its path, the group that it stands in, or a pattern
        with a *."""
        plain = _plain(full)
        asked = (self.reading.samples or "*").replace(".", "/").strip("/")
        ends = (plain, full, plain.rpartition("/")[2])
        return any(fnmatchcase(each, asked) for each in ends) or f"/{asked}/" in f"/{plain}/"

    def clock(self, tables: dict[str, np.ndarray], vectors: dict[str, np.ndarray], group: Group,
              above: tuple[str, ...]) -> dict[str, np.ndarray]:  # fmt: skip
        """The time of a group's tables, where a vector is called like it. Several sensors are refused: tables
        of one length that are not called alike, or a vector beside a table that is no clock."""
        lengths, widths = ({array.shape[axis] for array in tables.values()} for axis in (0, 1))
        alike = len({re.sub(r"\d+", "#", name) for name in tables}) == 1
        of_class = {*CLASS, str(self.reading.label).lower()}
        described = all(of_class & {*map(str.lower, group.of_arrays.get(name, ()))} for name in tables)
        clocks = [name for name in vectors if TIME.match(name)]
        beside = [name for name, vector in vectors.items() if name not in clocks and len(vector) in lengths
                  and (vector != vector[0]).any()]  # fmt: skip
        at_once = len(lengths) == 1 and not described and (not alike or len(above) > 1)
        several = len(tables) > 1 and "*" not in (self.reading.samples or "")
        several = several and bool(clocks or len(widths) > 1 or at_once)
        where, listed = f"group {'/'.join(above) or '/'} holds", group.listed()
        if several or (beside and self.reading.samples is None):
            why = f"{where} several arrays where one is a recording: {listed}; name that of the samples with --samples"
            self.refuse(f"{why}, or all, where each is one, by a pattern with *")
        fitting = [name for name in clocks if {len(vectors[name])} == lengths]
        if clocks and not fitting:
            self.refuse(f"{where} a time of another length than the samples: {listed}; write it again")
        return {name: vectors[name] for name in fitting[:1]}


def _plain(path: str) -> str:
    """A path without the numbers of structs."""
    return re.sub(r"[(]\d+[)]", "", path)


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
