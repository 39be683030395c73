"""The variables of a MATLAB file, up to version 7."""

import zlib
from pathlib import Path
from typing import Literal

import numpy as np

from eskin.data.arrays import Group
from eskin.data.table import Refuse, check_unpacked

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
    order: Literal["big", "little"] = "big" if raw[126:128] == b"MI" else "little"
    if raw[126:128] in (b"MI", b"IM"):
        _check(path, memoryview(raw)[128:], order, refuse)
    root = Group()
    loaded = loadmat(path, appendmat=False)
    for name, array in loaded.items():
        if not name.startswith("__") and isinstance(array, np.ndarray):
            _take(root, name, array)
    return root


def _check(path: Path, data: memoryview, order: Literal["big", "little"], refuse: Refuse) -> None:
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
