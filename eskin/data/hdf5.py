"""The groups, arrays and attributes of an HDF5 file."""

from pathlib import Path
from typing import Any

import numpy as np

from eskin.data.arrays import Group
from eskin.data.table import Refuse, check_unpacked

_OWN = ("IMAGE", "DIMENSION_SCALE", "GROUP", "ARRAY", "CARRAY", "EARRAY", "VLARRAY", "TABLE", "PALETTE")
"""What HDF5's libraries say in an attribute CLASS of their own."""


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

    def check(name: str, item: Any) -> None:
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
    fields = [item.dtype[name] for name in item.dtype.names or ()]
    numbers = fields and all(field.kind in "iufb" and not field.shape for field in fields)
    plain = item.dtype.kind in "iufb" or numbers
    return np.asarray(item[()]) if plain and item.shape is not None else None


def _attributes(item: Any) -> dict[str, Any]:
    """Attributes that are one number or text."""
    values: dict[str, Any] = {}
    for name, value in item.attrs.items():
        cells = np.asarray(value).reshape(-1).tolist()
        one = cells[0] if len(cells) == 1 else None
        one = one.decode("utf-8", "replace") if isinstance(one, bytes) else one
        if isinstance(one, str | int | float) and not (name == "CLASS" and one in _OWN):
            values[name] = one
    return values
