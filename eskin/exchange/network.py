"""A network of another tool as its file says it, in a configuration."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, Self

import numpy as np

from eskin.golden.core import AcceleratorConfig, ArchiveError, Arrays, InputError, Record, read_arrays
from eskin.golden.model import FloatModel, network_shapes
from eskin.training.formats import with_network

NAMES = ("inputs", "outputs")
TOLERANCE = 1e-4
"""Between logits in single precision and those of what was read, of 1 + the largest logit."""


def differences(outputs: np.ndarray, logits: np.ndarray) -> dict[str, float]:
    """Largest difference of ``outputs`` from ``logits`` (n, K, C) of the ``last`` step and of ``every`` step, of
    1 + the largest logit; none where the number of values is another. Of a single step only ``every``."""
    found: dict[str, float] = {}
    references = [("every", logits), ("every", logits.swapaxes(0, 1))]
    if logits.shape[1] > 1:
        references.append(("last", logits[:, -1]))
    for shows, reference in references:
        if outputs.size == reference.size:
            difference = float(np.abs(outputs.ravel() - reference.ravel()).max(initial=0.0))
            relative = difference / (1 + float(np.abs(reference).max(initial=0.0)))
            found[shows] = min(found.get(shows, np.inf), relative)
    return found


def _read(path: Path, own: tuple[str, str]) -> tuple[np.ndarray, np.ndarray]:
    save = "save it with numpy.savez(FILE, inputs=.., outputs=..)"
    try:
        arrays = read_arrays(path)
    except (OSError, ArchiveError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"--check {path}: {why}; {save}") from None
    pair = next((pair for pair in (NAMES, own) if set(pair) <= set(arrays)), None)
    if pair is None:
        there = ", ".join(f"{name:.20}" for name in list(arrays)[:6]) or "none"
        raise InputError(f"--check {path}: arrays inputs and outputs are missing, there are {there}; {save}")
    for name in pair:
        array = arrays[name]
        if array.dtype.kind not in "fiu" or not array.size or not np.isfinite(array).all():
            raise InputError(f"--check {path}, array {name}: must hold only finite numbers; {save}")
    inputs, outputs = (arrays[name].astype(np.float64) for name in pair)
    return inputs, outputs


def check_reference(path: Path, model: FloatModel, own: tuple[str, str] = NAMES) -> Record:
    """Compare outputs that another tool computed with the model's logits of the same inputs.

    Parameters
    ----------
    path:
        An ``.npz`` with ``inputs`` as the network takes them, so normalised: (touches, steps, inputs), steps first,
        or of a linear cell its columns. And ``outputs``: logits of the last step (touches, classes) or of every step.
    own:
        Other names of the two arrays.

    Returns
    -------
    dict
        file, touches, difference (largest of a logit, of 1 + the largest logit), limit, passed, shows (``last``
        or ``every`` step's logits).

    Raises
    ------
    InputError
        The file cannot be read, or its arrays have no shape that the network has.
    """
    inputs, outputs = _read(path, own)
    config, wide, steps = model.config, model.config.inputs, model.config.windows.steps
    readings: list[np.ndarray] = []
    wanted = f"(touches, {steps} steps, {wide})"
    if inputs.ndim == 3 and inputs.shape[2] == wide:
        readings = [inputs, inputs.swapaxes(0, 1)]
    elif not config.recurrent and inputs.ndim == 2 and inputs.shape[1] % wide == 0:
        readings = [inputs.reshape(len(inputs), -1, wide)]
    readings = [features for features in readings if config.sets == 1 or features.shape[1] == steps]
    if not readings:
        raise InputError(f"--check {path}: its inputs have shape {inputs.shape}; they must be {wanted}")
    found = [
        (far, shows, len(features))
        for features in readings
        for shows, far in differences(outputs, model.forward(features)[1]).items()
    ]
    if not found:
        raise InputError(
            f"--check {path}: its outputs have shape {outputs.shape}; they must be logits, "
            f"({len(readings[0])}, {config.classes}) of the last step or of every step"
        )
    difference, shows, count = min(found)
    return {
        "file": str(path),
        "touches": count,
        "difference": difference,
        "limit": TOLERANCE,
        "passed": difference <= TOLERANCE,
        "shows": shows,
    }


ROLES = ("input", "recurrent", "bias", "second bias", "dense", "dense bias")
MOST_VALUES = 1 << 20
"""Most values of one array; the largest that the accelerator takes has 4 x 32 x 512."""


@dataclass(frozen=True)
class Network:
    """cell, reset (of a GRU), gate_activation, hidden, classes; columns: of the first weights; arrays: by the
    names of the specification, section 8 (a linear cell: V (C, columns), b_y); names: what they are called in
    the file; graph: of an ONNX file (`eskin.exchange.import_onnx`)."""

    path: Path
    cell: str
    reset: str
    gate_activation: str
    hidden: int
    classes: int
    columns: int
    arrays: Arrays
    names: dict[str, str]
    graph: Any = None

    @classmethod
    def of_layers(
        cls,
        path: Path,
        layers: Arrays,
        names: dict[str, str],
        orders: Mapping[int, Sequence[str]],
        *,
        reset: str,
        gate_activation: str = "sigmoid",
        **more: Any,
    ) -> Self:
        """The network of a recurrent layer and a dense one, whose shapes determine the cell.

        Parameters
        ----------
        layers:
            Of ROLES, rows = outputs, G gates stacked: ``input`` (G H, D), ``recurrent`` (G H, H), ``bias``,
            ``second bias`` (G H), ``dense`` (C, H), ``dense bias`` (C).
        names:
            What the file calls each role.
        orders:
            The gates in the order in which they are stacked, by their number: 3 of a GRU, 4 of an LSTM.
        more:
            Further fields.

        Raises
        ------
        InputError
            Shapes do not belong together, or values are not finite numbers.
        """

        def refuse(role: str, why: str) -> NoReturn:
            raise InputError(f"network '{path}', array {names.get(role, role)}: {why}")

        shape, dense = layers["recurrent"].shape, layers["dense"].shape
        number = shape[0] // max(1, shape[1]) if len(shape) == 2 else 0
        if number not in orders or shape[0] != number * shape[1]:
            kinds = "neither (3 x hidden, hidden) of a GRU nor (4 x hidden, hidden) of an LSTM"
            refuse("recurrent", f"has shape {shape}, {kinds}")
        rows, hidden = shape
        expected = {
            "input": (rows, *layers["input"].shape[1:2]),
            "bias": (rows,),
            "second bias": (rows,),
            "dense": (*dense[:1], hidden),
            "dense bias": dense[:1],
        }
        for role, array in layers.items():
            if array.shape != expected.get(role, shape) or not array.size:
                of = f"{'a GRU' if number == 3 else 'an LSTM'} of {hidden} units ({names['recurrent']})"
                refuse(
                    role,
                    f"has shape {array.shape}, which does not match {of} and {dense[0]} classes ({names['dense']}); "
                    "save the arrays of one network, whole and in one direction",
                )
            if not np.isfinite(array).all():
                refuse(role, "holds values that are not finite numbers; train the network again")
        cell = "gru" if number == 3 else "lstm"
        arrays = {"V": layers["dense"], "b_y": layers["dense bias"]}
        for index, gate in enumerate(orders[number]):
            part = slice(index * hidden, (index + 1) * hidden)
            first, second = layers["bias"][part], layers["second bias"][part]
            arrays |= {f"W_{gate}": layers["input"][part], f"U_{gate}": layers["recurrent"][part]}
            # the two rows are one where nothing stands between them
            two = cell == "gru" and reset == "after"
            arrays |= {f"b_{gate}": first, f"bh_{gate}": second} if two else {f"b_{gate}": first + second}
        sizes = hidden, dense[0], layers["input"].shape[1]
        return cls(path, cell, reset, gate_activation, *sizes, arrays, names, **more)


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
