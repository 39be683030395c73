"""Files of arrays: HDF5, MATLAB's up to version 7, and NumPy's."""

import zlib
from pathlib import Path
from typing import Any, Literal

import numpy as np

from eskin.data.arrays import Group
from eskin.data.table import Refuse, check_unpacked

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
        one = cells[0] if len(cells) == 1 else None
        one = one.decode("utf-8", "replace") if isinstance(one, bytes) else one
        if isinstance(one, str | int | float) and not (name == "CLASS" and one in _OWN):
            values[name] = one
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
    """The array of a file, called as it."""
    root = Group()
    root.take(path.stem, np.load(path, allow_pickle=False))
    return root


ARRAYS = {".mat": read_matlab, ".h5": read_hdf5, ".hdf5": read_hdf5, ".npy": read_npy}
