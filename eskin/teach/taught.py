"""A file of taught touches."""

from pathlib import Path

import numpy as np

from eskin.golden.core import ArchiveError, InputError, content_key, read_arrays, replacing
from eskin.golden.model import IntegerModel
from eskin.golden.model.prototypes import check_teachable

TAUGHT = ("taught", "taught_count")


def _untaught(model: IntegerModel) -> str:
    """Names a network and its formats, whatever it was taught and whatever lanes compute it."""
    config = model.config
    network = [(name, array) for name, array in sorted(model.arrays.items()) if name not in TAUGHT]
    rule = [
        config.trajectory_width,
        config.readout_rule.state_code_bits,
        config.readout_rule.state_code_shift,
    ]
    return content_key(rule, *(part for pair in network for part in pair))


def save_taught(model: IntegerModel, path: str | Path) -> None:
    """Write the taught touches of ``model`` to ``path``, an ``.npz``."""
    arrays = {name: model.arrays[name] for name in TAUGHT} | {"model": np.array(_untaught(model))}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def load_taught(model: IntegerModel, path: str | Path) -> IntegerModel:
    """``model`` with the taught touches that `save_taught` wrote to ``path`` instead of the model's.

    Raises
    ------
    InputError
        As `check_teachable`; no such file, or another model's.
    """
    check_teachable(model.config)
    try:
        arrays = read_arrays(path)
    except (ArchiveError, OSError) as error:
        raise InputError(f"{path}: {error}; name a file of 'eskin replay `save_taught`'") from None
    if str(arrays.get("model")) != _untaught(model) or not arrays.keys() >= set(TAUGHT):
        raise InputError(
            f"{path}: holds no touches taught to this model; name another file, or delete it to start again"
        )
    return IntegerModel(model.config, {**model.arrays, **{name: arrays[name] for name in TAUGHT}}, str(path))
