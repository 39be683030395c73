"""A network of another tool as its file says it, in a configuration."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eskin.golden.core import AcceleratorConfig, Arrays, InputError
from eskin.golden.model import network_shapes
from eskin.training.formats import with_network


@dataclass(frozen=True)
class Network:
    """cell, reset (of a GRU), gate_activation, hidden, classes; columns: of the first weights; arrays: by the
    names of the specification, section 8 (a linear cell: V (C, columns), b_y); names: what they are called in
    the file."""

    path: Path
    cell: str
    reset: str
    gate_activation: str
    hidden: int
    classes: int
    columns: int
    arrays: Arrays
    names: dict[str, str]


def fitted(
    network: Network, config: AcceleratorConfig, cell: str | None, reset: str | None
) -> tuple[AcceleratorConfig, dict[str, np.ndarray]]:
    """``config`` with cell and sizes of the file, and the float network's arrays. ``cell`` and ``reset``: what the
    network is said to be, held against the file.

    Raises
    ------
    InputError
        It is another network than said, or of another array or task.
    """
    where, recurrent = f"network '{network.path}'", network.cell != "linear"
    said = [("cell", cell, network.cell), ("reset", reset, network.reset)]
    for name, value, held in said[: 1 + (network.cell == "gru")]:
        if value not in (None, held):
            raise InputError(f"{where}: has {name} {held}, not {value}; use --{name} {held}")
    try:
        config = with_network(
            config.replace(gate_activation=network.gate_activation),
            cell=network.cell,
            reset=network.reset if network.cell == "gru" else None,
            hidden=network.hidden or None,
        )
        sets = {config.windows.steps * config.inputs: "window", config.inputs: "one"}
        if not recurrent:
            config = config.replace(weight_sets=sets.get(network.columns, config.network.weight_sets))
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    for have, unit, field, sizes in (
        (network.columns, "inputs", "taxels" if config.kinds == 1 else "feature_kinds", [*sets][-recurrent:]),
        (network.classes, "classes", "class_names", [config.classes]),
    ):
        if have not in sizes:
            raise InputError(
                f"{where}: has {have} {unit} and configuration '{config.name}', field {field}, asks for "
                f"{' or '.join(map(str, sizes))}; use the configuration of the array and task it was trained on"
            )
    arrays = dict(network.arrays)
    if not recurrent:
        arrays["V"] = arrays["V"].reshape(config.classes, config.sets, config.inputs).swapaxes(0, 1)
    names = network_shapes(config, real=True)
    return config, {name: np.array(arrays[name], dtype=np.float64) for name in names}
