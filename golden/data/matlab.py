"""Recordings from MATLAB's .mat files (up to version 7): named arrays, as in an archive or as cells of arrays."""

from __future__ import annotations

import zlib
from itertools import pairwise
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.data.codes import place_of
from eskin.golden.data.recordings import Recordings
from eskin.golden.data.tables import Reading, assemble, natural

NAMES = {
    "samples": ("samples", "data", "X", "x", "recordings", "signals"),
    "offsets": ("offsets",),
    "labels": ("labels", "label", "y", "Y", "classes", "class", "target"),
    "class_names": ("class_names", "classNames", "classnames", "names"),
    "rate": ("sample_rate_hz", "fs", "Fs", "FS", "rate", "sample_rate", "sampleRate"),
}
"""What an array may be called, in the order of preference."""
MOST_BYTES = 2 << 30
DAMAGED = (
    zlib.error,
    ValueError,
    TypeError,
    LookupError,
    NotImplementedError,
    MemoryError,
    ArithmeticError,
    EOFError,
    AttributeError,
    OSError,
)
"""What scipy's reader raises of a file that is cut off or changed."""


def load_matlab(path: Path, reading: Reading, config: AcceleratorConfig | None) -> Recordings:
    """Recordings of a .mat file: samples as a cell array of (frames, taxels), as (recordings, frames, taxels), or one after the other with
    offsets; labels; class names; the rate. Every other array of one value a recording is a group.

    Raises
    ------
    InputError
        An array is missing or does not fit; the file is damaged, or of version 7.3.
    """

    def refuse(why: str, array: str = "") -> NoReturn:
        raise InputError(f"recordings '{path}'{f', array {array}' if array else ''}: {why}")

    arrays = _read(path, refuse)

    def find(what: str, asked: str | None = None, option: str = "") -> str:
        if asked is not None:
            if asked not in arrays:
                refuse(f"{option} {asked}: the file has no such array; it has {', '.join(arrays) or 'none'}")
            return asked
        return next((name for name in NAMES[what] if name in arrays), "")

    samples = find("samples", reading.samples, "--samples")
    if not samples:
        refuse(f"has no array of samples ({', '.join(NAMES['samples'][:3])}); it has {', '.join(arrays) or 'none'}: name it with --samples")
    labels = find("labels", reading.label, "--class")
    if not labels:
        refuse(f"has no array of classes ({', '.join(NAMES['labels'][:3])}); it has {', '.join(arrays)}: name it with --class")
    offsets = find("offsets")
    notes: list[str] = []
    parts = _parts(arrays[samples], arrays[offsets] if offsets else None, samples, notes, refuse)
    rate_name = find("rate")
    rate = reading.rate_hz if reading.rate_hz is not None else _rate(arrays[rate_name], rate_name, refuse) if rate_name else None
    if rate is None:
        if config is None:
            refuse("does not say its rate (sample_rate_hz, fs); write an archive with it, eskin convert SOURCE --rate HZ --out FILE.npz")
        rate = config.sensor.sample_rate_hz
        notes.append(f"there is no rate in the file; it is that of configuration '{config.name}'")
    named = find("class_names")
    codes, names = _classes(arrays[labels], arrays.get(named), len(parts), labels, named, notes, refuse)
    used = {samples, labels, offsets, rate_name, named}
    groups = {}
    for name, array in arrays.items():
        value = _column(array)
        if name not in used and value is not None and value.shape == (len(parts),) and (not reading.groups or name in reading.groups):
            groups[name] = value
    lost = [name for name in reading.groups if name not in groups]
    if lost:
        refuse(f"--group {lost[0]}: is no array of {len(parts)} values; the file has {', '.join(arrays)}")
    said = [f"array {samples} holds {len(parts)} recordings of {parts[0].shape[1]} taxels, array {labels} their classes", *notes]
    if groups:
        said.append(f"groups: {', '.join(groups)}")
    return assemble(parts, codes, names, rate, groups, str(path), reading.scale, config, said)


def _read(path: Path, refuse) -> dict[str, np.ndarray]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    if path.stat().st_size > MOST_BYTES:
        refuse(f"has more than {MOST_BYTES >> 30} GB; split it")
    with path.open("rb") as file:
        head = file.read(128)
    if head[:8] == b"\x89HDF\r\n\x1a\n" or b"MATLAB 7.3" in head:
        refuse("is of version 7.3 (HDF5); save it in MATLAB with save(..., '-v7')")
    try:
        found = loadmat(str(path), struct_as_record=True, squeeze_me=False, appendmat=False)
    except (MatReadError, *DAMAGED) as error:
        if isinstance(error, OSError) and error.errno:
            raise
        refuse("is damaged or no .mat file; save it again in MATLAB with save(..., '-v7')")
    return {name: array for name, array in found.items() if not name.startswith("__") and isinstance(array, np.ndarray)}


def _parts(samples: np.ndarray, offsets: np.ndarray | None, name: str, notes: list[str], refuse) -> list[np.ndarray]:
    """The recordings, (frames, taxels) float64 each, all finite."""
    if samples.dtype == object:
        parts = [np.asarray(cell) for cell in samples.reshape(-1)]
        if not parts:
            refuse("holds no recording", name)
        for number, part in enumerate(parts, 1):
            if part.ndim != 2 or part.dtype.kind not in "fiu" or not part.size:
                refuse(f"cell {number} is {part.dtype} of shape {part.shape}, not numbers (frames, taxels)", name)
        rows, columns = {part.shape[0] for part in parts}, {part.shape[1] for part in parts}
        if len(columns) > 1 and len(rows) == 1:
            parts = [part.T for part in parts]
            notes.append("cells stand as (taxels, frames) and were turned")
        elif len(columns) > 1:
            odd = next(number for number, part in enumerate(parts, 1) if part.shape[1] != parts[0].shape[1])
            refuse(
                f"cell {odd} has {parts[odd - 1].shape[1]} columns where cell 1 has {parts[0].shape[1]}; taxels are columns in all", name
            )
    elif samples.dtype.kind not in "fiu":
        refuse(f"holds {samples.dtype}, not numbers or cells of numbers", name)
    elif samples.ndim == 3 and samples.size:
        parts = list(samples)
        notes.append(f"array {name} was taken as (recordings, frames, taxels)")
    elif samples.ndim == 2 and samples.size:
        if offsets is None:
            refuse("is one table and there is no array offsets that says where recordings begin; make it a cell array of recordings", name)
        bounds = _column(offsets)
        if bounds is None or bounds.dtype.kind not in "fiu" or not np.isfinite(bounds).all():
            refuse("is no list of numbers", "offsets")
        bounds = bounds.astype(np.int64)
        if len(bounds) < 2 or bounds[0] != 0 or bounds[-1] != len(samples) or (np.diff(bounds) < 1).any():
            refuse(f"must rise from 0 to the {len(samples)} frames of samples", "offsets")
        parts = [samples[a:b] for a, b in pairwise(bounds)]
    else:
        refuse(f"has shape {samples.shape}; give a cell array of (frames, taxels), or (recordings, frames, taxels)", name)
    for number, part in enumerate(parts, 1):
        if part.dtype.kind == "f" and not np.isfinite(part).all():
            row, column = place_of(~np.isfinite(part))
            value = part[row, column]
            refuse(
                f"recording {number}, row {row + 1}, column {column + 1} holds {value}, not a finite number; repair or leave it out", name
            )
    return [np.asarray(part, dtype=np.float64) for part in parts]


def _classes(
    labels: np.ndarray, names: np.ndarray | None, count: int, label_name: str, names_name: str, notes: list[str], refuse
) -> tuple[list[int], list[str]]:
    """Class indices and names, of labels that are names, or numbers from 0 or, as MATLAB counts, from 1."""
    values = _column(labels)
    if values is None or values.shape != (count,):
        refuse(f"has shape {labels.shape}; give one value for each of the {count} recordings", label_name)
    listed = None if names is None else _column(names)
    if names is not None and (listed is None or listed.dtype.kind != "U"):
        refuse("is no cell array of text", names_name)
    if values.dtype.kind == "U":
        known = list(listed) if listed is not None else sorted(set(values.tolist()), key=natural)
        missing = next((value for value in values if value not in known), None)
        if missing is not None:
            refuse(f"holds '{missing}', which is not among the class names", label_name)
        return [known.index(value) for value in values], [str(name) for name in known]
    if values.dtype.kind not in "fiu" or not np.isfinite(values).all() or not np.array_equal(values, np.rint(values)):
        refuse("holds something else than whole numbers or names", label_name)
    if np.abs(values).max() > 1e9:
        refuse(f"holds {np.abs(values).max():g}, beyond any number of classes", label_name)
    whole = values.astype(np.int64)
    if listed is None:
        found = np.unique(whole)
        return np.searchsorted(found, whole).tolist(), [f"class{number}" for number in found]
    if whole.min() >= 1 and whole.max() <= len(listed):
        notes.append("classes are numbered from 1, as in MATLAB")
        whole = whole - 1
    if whole.min() < 0 or whole.max() >= len(listed):
        refuse(f"runs from {whole.min()} to {whole.max()} and there are {len(listed)} class names", label_name)
    return whole.tolist(), [str(name) for name in listed]


def _rate(array: np.ndarray, name: str, refuse) -> float:
    value: Any = array.reshape(-1)[0] if array.size == 1 and array.dtype.kind in "fiu" else None
    if value is None or not np.isfinite(value) or value <= 0:
        refuse("must be one number above 0, in hertz", name)
    return float(value)


def _column(array: np.ndarray) -> np.ndarray | None:
    """A vector of numbers or text, of a row, a column, a cell array of text or a matrix of letters; None: it is none."""
    if array.dtype == object:
        cells = [np.asarray(cell).reshape(-1) for cell in array.reshape(-1)]
        if cells and all(cell.size == 1 and cell.dtype.kind == "U" for cell in cells):
            return np.array([str(cell[0]).strip() for cell in cells])
        if cells and all(cell.size == 1 and cell.dtype.kind in "fiu" for cell in cells):
            return np.array([cell[0] for cell in cells])
        return None
    if array.dtype.kind == "U":
        return np.array([text.strip() for text in array.reshape(-1).tolist()])
    if array.dtype.kind in "fiub" and (array.ndim < 2 or sorted(array.shape)[:-1] == [1] * (array.ndim - 1)):
        values = array.reshape(-1)
        whole = values.dtype.kind == "f" and len(values) and np.isfinite(values).all() and np.array_equal(values, np.rint(values))
        return values.astype(np.int64) if whole and np.abs(values).max() < 2**62 else values
    return None
