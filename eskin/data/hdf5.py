"""Recordings from HDF5: the arrays of an archive as datasets, or one dataset a recording, its class and
groups in attributes or in the name of the group above (docs/other_tools.md)."""

from itertools import chain
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from eskin.data.matlab import NAMES, recordings_of_arrays
from eskin.data.text import Reading, check_unpacked, comes_back
from eskin.golden.core import AcceleratorConfig, InputError, Record
from eskin.golden.data.recordings import ARCHIVE_ARRAYS, Recordings, natural, recordings_of

SUFFIXES = (".h5", ".hdf5")
TRIAL = "import sys, h5py; h5py.File(sys.argv[1]).visititems(lambda name, item: hasattr(item, 'shape') and item[()])"


def load_hdf5(path: Path, reading: Reading, config: AcceleratorConfig | None) -> Recordings:
    """Recordings of an HDF5 file.

    Raises
    ------
    InputError
        The file is damaged or unpacks to far more than it holds, or an array is missing or does not fit.
    """
    import h5py

    def refuse(why: str, array: str = "") -> NoReturn:
        raise InputError(f"recordings '{path}'{f', dataset {array}' if array else ''}: {why}")

    damaged = "is damaged or no HDF5 file; write it again"
    try:
        with h5py.File(path) as file:
            arrays_by_name: Record = {}
            file.visititems(
                lambda name, item: arrays_by_name.update(
                    {name: item} if isinstance(item, h5py.Dataset) else {}
                )
            )
            unpacked = sum(item.size * item.dtype.itemsize for item in arrays_by_name.values() if item.size)
            check_unpacked(path, unpacked, "write it again without the fill values", refuse)
            if not comes_back(TRIAL, path):
                refuse(damaged)
            arrays = {name: _plain(item) for name, item in arrays_by_name.items()}
            notes = {name: _attributes(item) for name, item in (*arrays_by_name.items(), ("", file))}
    except InputError:
        raise
    except Exception as error:  # a damaged file can fail anywhere inside the library
        if isinstance(error, OSError) and error.errno and not isinstance(error, BlockingIOError):
            raise
        refuse(damaged)
    top = {name: array for name, array in arrays.items() if "/" not in name and array is not None}
    described = notes[""] | {name: value for name, value in top.items() if name not in notes[""]}
    named = reading.samples or next((name for name in NAMES["samples"] if name in top), None)
    if named is not None and named not in top:
        refuse(
            f"--samples {named}: the file has no such dataset; it has {', '.join(top) or 'none at its top'}"
        )
    if named is not None:
        described = {
            name: value for name, value in notes[named].items() if name in chain(*NAMES.values())
        } | described
        for word_of, name in (("rate", "sample_rate_hz"), ("unit", "unit")):
            spoken = [described.pop(word) for word in NAMES[word_of] if word in described]
            described |= dict.fromkeys([name], spoken[0]) if spoken else {}
        archive = described | (
            {} if reading.rate_hz is None else {"sample_rate_hz": np.array(reading.rate_hz)}
        )
        if reading == Reading(rate_hz=reading.rate_hz, scale=reading.scale) and all(
            name in archive for name in ARCHIVE_ARRAYS if name != "class_names"
        ):
            return recordings_of(archive, str(path), scale=reading.scale)
    else:
        described |= _by_dataset(arrays, notes, reading, refuse)
    return recordings_of_arrays(described, path, reading, config, refuse, counts_from_one=False)


def _by_dataset(arrays: Record, notes: Record, reading: Reading, refuse) -> Record:
    """Every table of numbers as a recording, with classes, rate, unit and groups of their attributes, or of
    the group that holds them."""
    names = sorted(
        (
            name
            for name, array in arrays.items()
            if array is not None and array.ndim == 2 and array.dtype.kind in "iuf"
        ),
        key=natural,
    )
    if not names:
        refuse("holds no dataset of samples: neither samples nor one table (frames, taxels) a recording")
    cells = np.empty(len(names), dtype=object)
    cells[:] = [arrays[name] for name in names]
    attributes = {key: [notes[name].get(key) for name in names] for key in notes[names[0]]}
    everywhere = {key: np.array([value[()] for value in values]) for key, values in attributes.items()
                  if all(value is not None and value.ndim == 0 for value in values)}  # fmt: skip
    above = [name.rpartition("/")[0].rpartition("/")[2] for name in names]
    collected: Record = {"samples": cells, "source_dataset": np.array(names)}
    for key, values in everywhere.items():
        one_of_all = any(key in NAMES[what] for what in ("rate", "unit"))
        if one_of_all and len(set(values.tolist())) > 1:
            odd = next(name for name, value in zip(names, values, strict=True) if value != values[0])
            refuse(f"attribute {key} is {notes[odd][key]} and {values[0]} in {names[0]}; all must agree", odd)
        collected[key] = values[0] if one_of_all else values
    class_key = reading.label or next((word for word in NAMES["labels"] if word in collected), None)
    if class_key is None and all(above):
        collected["labels"] = np.array(above)
    return collected


def _plain(item: Any) -> np.ndarray | None:
    """Numbers or text of a dataset; None: it holds something else."""
    import h5py

    if h5py.check_string_dtype(item.dtype):
        return np.array(item.asstr()[()], dtype=np.str_)
    return np.asarray(item[()]) if item.dtype.kind in "iufb" and item.shape is not None else None


def _attributes(item: Any) -> dict[str, np.ndarray]:
    """Attributes that are numbers or text; a list of one value is that value."""
    values: dict[str, np.ndarray] = {}
    for name in item.attrs:
        value = np.asarray(item.attrs[name])
        if value.dtype.kind == "S":
            value = np.char.decode(value, "utf-8", "replace")
        if value.dtype.kind == "O" and all(isinstance(each, str) for each in value.ravel()):
            value = value.astype(np.str_)
        if value.dtype.kind in "iufbU":
            values[name] = value.reshape(()) if value.size == 1 else value
    return values
