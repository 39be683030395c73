"""Recordings from MATLAB's .mat files (up to version 7): named arrays, as in an archive or as cells of
arrays."""

import zlib
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, NoReturn

import numpy as np

from eskin.data.tables import assemble
from eskin.data.text import MOST_BYTES, Reading, check_unpacked, comes_back
from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.data.codes import place_of
from eskin.golden.data.recordings import Recordings, natural

Refuse = Callable[..., NoReturn]
NAMES = {
    "samples": ("samples", "data", "X", "x", "recordings", "signals"),
    "offsets": ("offsets",),
    "labels": ("labels", "label", "y", "Y", "classes", "class", "target"),
    "class_names": ("class_names", "classNames", "classnames", "names"),
    "rate": ("sample_rate_hz", "fs", "Fs", "FS", "rate", "sample_rate", "sampleRate"),
    "unit": ("unit", "units", "sample_unit"),
}
"""What an array may be called, in the order of preference."""
TRIAL = "import sys; from scipy.io.matlab import loadmat; loadmat(sys.argv[1], appendmat=False)"


def load_matlab(path: Path, reading: Reading, config: AcceleratorConfig | None) -> Recordings:
    """Recordings of a .mat file: samples as a cell array of (frames, taxels), as (recordings, frames,
    taxels), or one after the other with offsets; labels; class names; the rate. Every other array of one
    value a recording is a group.

    Raises
    ------
    InputError
        An array is missing or does not fit; the file is damaged, unpacks to far more than it holds, or is of
        version 7.3.
    """

    def refuse(why: str, array: str = "") -> NoReturn:
        raise InputError(f"recordings '{path}'{f', array {array}' if array else ''}: {why}")

    return recordings_of_arrays(_read(path, refuse), path, reading, config, refuse)


def recordings_of_arrays(
    arrays: dict[str, np.ndarray],
    path: Path,
    reading: Reading,
    config: AcceleratorConfig | None,
    refuse: Refuse,
    *,
    counts_from_one: bool = True,
) -> Recordings:
    """Recordings of arrays that are called as people call them (NAMES).

    Parameters
    ----------
    counts_from_one:
        Labels that are numbers from 1 to less than the number of class names count from 1, as in MATLAB.

    Raises
    ------
    InputError
        By ``refuse``: an array is missing or does not fit.
    """
    listed = ", ".join(arrays) or "none"

    def find(role: str, asked: str | None = None, option: str = "") -> str:
        """The array that an option names, or else the first of its usual names; only what an option can name
        must be there."""
        if asked is not None and asked not in arrays:
            refuse(f"{option} {asked}: the file has no such array; it has {listed}")
        name = asked or next((name for name in NAMES[role] if name in arrays), "")
        if option and not name:
            kind = "samples" if role == "samples" else "classes"
            refuse(
                f"has no array of {kind} ({', '.join(NAMES[role][:3])}); it has {listed}: name it with "
                f"{option}"
            )
        return name

    samples = find("samples", reading.samples, "--samples")
    labels = find("labels", reading.label, "--class")
    offsets, rate_name, names = find("offsets"), find("rate"), find("class_names")
    unit = find("unit")
    parts, notes = _parts(arrays[samples], arrays[offsets] if offsets else None, samples, refuse)
    rate = reading.rate_hz
    if rate is None and rate_name:
        value: Any = arrays[rate_name].reshape(-1)[0] if arrays[rate_name].size == 1 else None
        if arrays[rate_name].dtype.kind not in "fiu" or value is None or not np.isfinite(value) or value <= 0:
            refuse("must be one number above 0, in hertz", rate_name)
        rate = float(value)
    elif rate is None:
        if config is None:
            refuse(
                "does not say its rate (sample_rate_hz, fs); write an archive with it, eskin convert SOURCE "
                "--rate HZ --out FILE.npz"
            )
        rate = config.sensor.sample_rate_hz
        notes.append(f"there is no rate in the file; it is that of configuration '{config.name}'")
    codes, class_names = _classes(
        arrays[labels], arrays.get(names), len(parts), labels, names, notes, refuse, counts_from_one
    )
    assigned = (samples, labels, offsets, rate_name, names, unit)
    group_names = [name for name in arrays if name not in assigned and name in (reading.groups or arrays)]
    columns = {name: _column(arrays[name]) for name in group_names}
    groups = {
        name: values
        for name, values in columns.items()
        if values is not None and values.shape == (len(parts),)
    }
    lost = next((name for name in reading.groups if name not in groups), None)
    if lost:
        refuse(f"--group {lost}: is no array of {len(parts)} values; the file has {listed}")
    notes.insert(
        0,
        f"array {samples} holds {len(parts)} recordings of {parts[0].shape[1]} taxels, array {labels} their "
        "classes",
    )
    if groups:
        notes.append(f"groups: {', '.join(groups)}")
    ends = np.cumsum([0, *map(len, parts)])
    values = np.concatenate(parts)
    text = arrays[unit].ravel() if unit else np.array([])
    return assemble(values, ends, codes, class_names, rate, groups, str(path), reading.scale, config, notes,
                    str(text[0]) if text.dtype.kind == "U" and text.size == 1 else "")  # fmt: skip


def _read(path: Path, refuse) -> dict[str, np.ndarray]:
    from scipy.io import loadmat

    size = path.stat().st_size
    if size > MOST_BYTES:
        refuse(f"has more than {MOST_BYTES >> 30} GB; split it")
    raw = path.read_bytes()
    if raw[:8] == b"\x89HDF\r\n\x1a\n" or b"MATLAB 7.3" in raw[:128]:
        refuse("is of version 7.3 (HDF5); save it in MATLAB with save(..., '-v7')")
    check_unpacked(path, _unpacked_bytes(raw), "save it again with save(..., '-v6')", refuse)
    try:
        if not comes_back(TRIAL, path):
            raise ValueError
        loaded = loadmat(path, appendmat=False)
    except Exception as error:  # a damaged file can fail anywhere inside scipy's and zlib's readers
        if isinstance(error, OSError) and error.errno:
            raise
        refuse("is damaged or no .mat file; save it again in MATLAB with save(..., '-v7')")
    return {
        name: array
        for name, array in loaded.items()
        if not name.startswith("__") and isinstance(array, np.ndarray)
    }


def _unpacked_bytes(raw: bytes) -> int:
    """What the variables of a file of version 5 to 7 say they unpack to: each begins with its kind and its
    bytes, packed or not."""
    order: Literal["big", "little"] = "big" if raw[126:128] == b"MI" else "little"
    unpacked, place = 0, 128
    while raw[126:128] in (b"MI", b"IM") and place + 8 <= len(raw):
        kind, count = (int.from_bytes(raw[place + k : place + k + 4], order) for k in (0, 4))
        if kind == 15:  # packed
            try:
                head = zlib.decompressobj().decompress(raw[place + 8 : place + 8 + min(count, 256)], 8)
            except zlib.error:
                head = b""  # the reader says that it is damaged
            unpacked += int.from_bytes(head[4:8], order)
        place += 8 + count
    return unpacked


def _parts(
    samples: np.ndarray, offsets: np.ndarray | None, name: str, refuse: Callable[..., NoReturn]
) -> tuple[list[np.ndarray], list[str]]:
    """The recordings, (frames, taxels) finite numbers each, and notes."""
    notes: list[str] = []
    if samples.dtype == object:
        parts = [np.asarray(cell) for cell in samples.reshape(-1)]
        if not parts:
            refuse("holds no recording", name)
        for number, part in enumerate(parts, 1):
            if part.ndim != 2 or part.dtype.kind not in "fiu" or not part.size:
                refuse(
                    f"cell {number} is {part.dtype} of shape {part.shape}, not numbers (frames, taxels)", name
                )
        rows, columns = {part.shape[0] for part in parts}, {part.shape[1] for part in parts}
        if len(rows) == 1 and (len(columns) > 1 or max(columns) > max(rows)):
            parts = [part.T for part in parts]
            same = (
                ""
                if len(columns) > 1
                else ", since they are wider than high; were they not, give an array (recordings, frames, "
                "taxels)"
            )
            notes.append(f"cells stand as (taxels, frames) and were turned{same}")
        elif len(columns) > 1:
            odd = next(number for number, part in enumerate(parts, 1) if part.shape[1] != parts[0].shape[1])
            counts = f"{parts[odd - 1].shape[1]} columns where cell 1 has {parts[0].shape[1]}"
            refuse(f"cell {odd} has {counts}; taxels are columns in all", name)
    elif samples.dtype.kind not in "fiu":
        refuse(f"holds {samples.dtype}, not numbers or cells of numbers", name)
    elif samples.ndim == 3 and samples.size:
        parts = list(samples)
        notes.append(f"array {name} was taken as (recordings, frames, taxels)")
    elif samples.ndim == 2 and samples.size:
        if offsets is None:
            refuse(
                "is one table and there is no array offsets that says where recordings begin; add it, or "
                "give every recording a cell or dataset of its own",
                name,
            )
        bounds = _column(offsets)
        if bounds is None or bounds.dtype.kind not in "iu":
            refuse("is no list of whole numbers", "offsets")
        if (
            len(bounds) < 2
            or bounds[0] != 0
            or bounds[-1] != len(samples)
            or (bounds[1:] <= bounds[:-1]).any()
        ):
            refuse(f"must rise from 0 to the {len(samples)} frames of samples", "offsets")
        parts = [samples[a:b] for a, b in pairwise(bounds)]
    else:
        refuse(
            f"has shape {samples.shape}; give a cell array of (frames, taxels), or (recordings, frames, "
            "taxels)",
            name,
        )
    for number, part in enumerate(parts, 1):
        if not np.isfinite(part).all():
            row, column = place_of(~np.isfinite(part))
            where = f"recording {number}, row {row + 1}, column {column + 1}"
            refuse(f"{where} holds {part[row, column]}, not a finite number; repair or leave it out", name)
    return parts, notes


def _classes(
    labels: np.ndarray,
    names: np.ndarray | None,
    count: int,
    label_name: str,
    names_name: str,
    notes: list[str],
    refuse: Callable[..., NoReturn],
    counts_from_one: bool,
) -> tuple[list[int], list[str]]:
    """Class indices and names, of labels that are names, or numbers from 0 or, as MATLAB counts, from 1."""
    values = _column(labels)
    if values is None or values.shape != (count,):
        refuse(f"has shape {labels.shape}; give one value for each of the {count} recordings", label_name)
    listed = None if names is None else _column(names)
    if names is not None and (listed is None or listed.dtype.kind != "U"):
        refuse("is no cell array of text", names_name)
    if values.dtype.kind == "U":
        class_names = sorted(set(values.tolist()), key=natural) if listed is None else listed.tolist()
        missing = next((value for value in values if value not in class_names or not value), None)
        if missing is not None:
            refuse(f"holds '{missing}', which is not among the class names", label_name)
        return [class_names.index(value) for value in values], class_names
    if values.dtype.kind not in "iu":
        refuse("holds something else than whole numbers or names", label_name)
    if listed is None:
        numbers, codes = np.unique(values, return_inverse=True)
        return codes.tolist(), [f"class{number}" for number in numbers]
    if values.min() >= 1 and values.max() <= len(listed) and (counts_from_one or values.max() == len(listed)):
        notes.append("classes are numbered from 1")
        values = values - 1
    if values.min() < 0 or values.max() >= len(listed):
        refuse(
            f"runs from {values.min()} to {values.max()} and there are {len(listed)} class names", label_name
        )
    return values.tolist(), listed.tolist()


def _column(array: np.ndarray) -> np.ndarray | None:
    """A vector of numbers or text, of a row, a column, a cell array or a matrix of letters; None: it is none.
    Whole numbers are int64."""
    if array.dtype == object:
        cells = [np.asarray(cell).reshape(-1) for cell in array.reshape(-1)]
        kinds = {
            "U" if cell.dtype.kind == "U" else "n"
            for cell in cells
            if cell.size == 1 and cell.dtype.kind in "Ufiu"
        }
        if len(kinds) != 1 or any(cell.size != 1 for cell in cells):
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
