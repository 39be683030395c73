"""A network trained elsewhere, from a file into a model folder: a torch state_dict. ONNX, and with it linear
cells and forests, is `eskin.exchange.import_onnx`.

The shapes of a state_dict determine the cell; torch's GRU has its reset gate after the recurrent product.
The user's options must agree with it. Nothing in a file is ever run: torch files are read with
``weights_only``, archives without pickles.
"""

import hashlib
import math
import pickle
import warnings
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, Self

import numpy as np
import torch

from eskin.golden.core import AcceleratorConfig, ArchiveError, Arrays, InputError, Record, read_arrays
from eskin.golden.core.files import check_unpacked
from eskin.golden.data import Recordings
from eskin.golden.model import (
    FloatModel,
    check_model_target,
    constants_shape,
    find_touches,
    network_shapes,
    real_features,
)
from eskin.training.datasets import scaling
from eskin.training.formats import with_network
from eskin.training.trees import Trees, forest_arrays

NAMES = ("inputs", "outputs")
TOLERANCE = 1e-4
"""Between logits in single precision and the logits of the read network, of 1 + the largest logit."""


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


def shortfalls(scores: np.ndarray, logits: np.ndarray) -> np.ndarray:
    """By how much the score of the class that the logits decide is below the highest, touch by touch; both (n, C)."""
    return scores.max(axis=1) - scores[np.arange(len(scores)), logits.argmax(axis=1)]


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
    """Compare outputs that another tool computed with the model's logits of the same inputs; of a forest, whose leaves have
    one vote each, with its decisions.

    Parameters
    ----------
    path:
        An ``.npz`` with ``inputs`` as the network takes them, so normalised: (touches, steps, inputs), steps first,
        or of a linear cell or a forest its columns. And ``outputs``: logits of the last step (touches, classes) or of every
        step; of a forest the classes' shares (``predict_proba``).
    own:
        Other names of the two arrays.

    Returns
    -------
    dict
        file, touches, difference (largest of a logit, of 1 + the largest logit; of a forest, how far the share of a class
        that it decides is below the highest, at most), limit, passed, shows (``last`` or ``every`` step's logits).

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
    own_steps = config.sets == 1 and not config.is_forest
    readings = [features for features in readings if own_steps or features.shape[1] == steps]
    if not readings:
        raise InputError(f"--check {path}: its inputs have shape {inputs.shape}; they must be {wanted}")
    found: list[tuple[float, str, int]] = []
    for features in readings:
        logits = model.forward(features)[1]
        fars = {} if config.is_forest else differences(outputs, logits)
        if config.is_forest and outputs.shape == logits[:, -1].shape:
            fars = {"last": float(shortfalls(outputs, logits[:, -1]).max())}
        found += [(far, shows, len(features)) for shows, far in fars.items()]
    if not found:
        raise InputError(
            f"--check {path}: its outputs have shape {outputs.shape}; they must be logits or shares, "
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
    the file; graph: of an ONNX file (`eskin.exchange.import_onnx`); forest: of such a file; labels: names of the
    classes, or their indices."""

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
    forest: Trees | None = None
    labels: tuple[str, ...] = ()

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
    facts = [("cell", cell, network.cell), ("reset", reset, network.reset)]
    for name, value, expected in facts[: 1 + (network.cell == "gru")]:
        if value not in (None, expected):
            raise InputError(f"{where}: has {name} {expected}, not {value}; use --{name} {expected}")
    try:
        config = with_network(
            config.replace(cell=network.cell, gate_activation=network.gate_activation),
            cell=network.cell,
            reset=network.reset if network.cell == "gru" else None,
            hidden=network.hidden or None,
        )
        sets = {config.windows.steps * config.inputs: "window", config.inputs: "one"}
        if not recurrent:
            config = config.replace(weight_sets=sets.get(network.columns, config.network.weight_sets))
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    columns = {"linear": [*sets], "trees": [*sets][:1]}.get(network.cell, [config.inputs])
    for have, unit, field, sizes in (
        (network.columns, "inputs", "taxels" if config.kinds == 1 else "feature_kinds", columns),
        (network.classes, "classes", "class_names", [config.classes]),
    ):
        if have not in sizes:
            raise InputError(
                f"{where}: has {have} {unit} and configuration '{config.name}', field {field}, asks for "
                f"{' or '.join(map(str, sizes))}; use the configuration of the array and task it was trained on"
            )
    names = config.network.class_names
    if {*network.labels} == {*names}:
        config = config.replace(class_names=network.labels)  # recordings' classes are found by their names
    elif network.labels != tuple(map(str, range(len(network.labels)))):
        raise InputError(
            f"{where}: has classes {', '.join(network.labels):.80} and configuration '{config.name}', field class_names, "
            f"{', '.join(names):.80}; fit it with these as labels, or with 0 to {len(names) - 1}"
        )
    if network.forest:
        return forest_arrays(config, network.forest)
    arrays = dict(network.arrays)
    if not recurrent:
        arrays["V"] = arrays["V"].reshape(config.classes, config.sets, config.inputs).swapaxes(0, 1)
    shapes = network_shapes(config, real=True)
    return config, {name: np.array(arrays[name], dtype=np.float64) for name in shapes}


ONNX_SUFFIX = ".onnx"
BY_LAST_STEP = {
    "last": "the file gives the logits of the last step alone",
    "reference": "the outputs of --check are the logits of the last step alone",
}
SHOWS = BY_LAST_STEP | {
    "metadata": "so the file's metadata say",
    "every": "the file gives the logits of every step, which do not show how a touch is decided",
    "weights": "weights do not show how a touch is decided",
}
"""Evidence of how a touch is decided."""


# ---------------------------------------------------------------------- into a model
def measure_scaling(config: AcceleratorConfig, recordings: Recordings) -> tuple[float, float]:
    """(mu, sigma), codes, that training on ``recordings`` would normalise with.

    Raises
    ------
    InputError
        When no recording has a completed step.
    """
    touches = find_touches(config, recordings)
    first = touches.first_touch()
    touches = touches.take(first[first >= 0])
    touches = touches.take(touches.completed > 0)
    if not len(touches):
        raise InputError(
            f"recordings '{recordings.source}': hold no touch, so mean and deviation cannot be measured; give --mean and --std"
        )
    return scaling(
        config, real_features(config, touches.sums, touches.lengths), touches.completed, touches.faults
    )


def import_network(
    file: str | Path,
    config: AcceleratorConfig,
    *,
    out: str | Path,
    cell: str | None = None,
    reset: str | None = None,
    mean: float | None = None,
    std: float | None = None,
    recordings: Recordings | None = None,
    check: Path | None = None,
) -> Record:
    """Make a float model folder (config.json, float.npz, training.json) from a network that was trained
    elsewhere, ready to quantise.

    Parameters
    ----------
    file:
        A torch state_dict (``read_layers``); an ONNX file (`eskin.exchange.import_onnx`), which has cell and
        reset.
    config:
        Array, windows and classes that the network was trained for; cell and reset unless given. Its hidden
        size follows the file.
    out:
        A new folder, or a model folder, which is replaced.
    cell, reset:
        What the network is said to be, else as the configuration has it; checked against the file. ``reset`` is for
        a GRU and ignored with an LSTM.
    mean, std:
        The normalisation of its training, codes: feature = (window mean - mean) / std, one pair for all
        inputs; both or none.
    recordings:
        Without ``mean`` and ``std``: of the window means of these recordings, as training here takes
        them.
    check:
        Reference inputs and outputs (`check_reference`); where they disagree nothing is written.

    Returns
    -------
    The training record, as written to training.json: imported (file, sha256, kind, arrays, notes: sentences about
    what was taken), normalisation (mean, std, source), config, parameters, versions, and check, passed where asked
    for.

    Raises
    ------
    InputError
        Before anything is written: ``read_layers``, ``fitted``; a missing or impossible mean or std; a
        folder that must not be replaced.
    """
    check_model_target(out)
    if config.is_image:
        raise InputError(
            f"configuration '{config.name}': is a network for images, which this verb does not take; train it "
            "here with 'eskin train'"
        )
    if (mean is None) != (std is None):
        raise InputError(
            f"{'--mean' if mean is None else '--std'}: is missing; give both, or neither and --data to "
            "measure them on"
        )
    for name, value in (("mean", mean), ("std", std)):
        if value is not None and (not math.isfinite(value) or (name == "std" and value <= 0)):
            raise InputError(
                f"--{name} {value:g}: is not a {'spread above 0' if name == 'std' else 'finite number'}; give "
                "codes"
            )
    is_onnx = Path(file).suffix == ONNX_SUFFIX
    if is_onnx:
        from eskin.exchange import import_onnx

        network = import_onnx.read_onnx(file)
    else:
        cell, reset = cell or config.network.cell, reset or config.network.reset
        if cell in ("linear", "trees"):
            raise InputError(
                f"network '{file}': is to have cell {cell}, which is read from ONNX; export it as .onnx"
            )
        network = read_layers(file)
    config, arrays = fitted(network, config, cell, reset)
    shows, scale, ends = "weights", None, NAMES
    notes = ["reset gate after the recurrent product, as torch has it"] if network.cell == "gru" else []
    if is_onnx:
        config, shows, notes = import_onnx.shown(network, config, arrays)
        scale, ends = import_onnx.scale_of(network.graph, config), network.graph.ends
    if mean is not None:
        scale = {"mean": mean, "std": std, "source": "given"}
    elif recordings is not None:
        mu, sigma = measure_scaling(config, recordings)
        scale = {"mean": mu, "std": sigma, "source": str(recordings.source)}
    elif scale is None:
        raise InputError(
            f"network '{file}': weights alone do not define the normalisation; give --mean and --std "
            "(codes), or --data to measure them on"
        )
    arrays |= {
        name: np.broadcast_to(scale[key], constants_shape(config))
        for name, key in (("mu", "mean"), ("sigma", "std"))
    }
    scale |= {"mean": arrays["mu"].tolist(), "std": arrays["sigma"].tolist()}
    checked: Record = {}
    if check is not None:
        found = check_reference(check, FloatModel(config, arrays, str(file)), ends)
        checked = {"check": found, "passed": found["passed"]}
        if found["shows"] == "last" and shows in ("every", "weights"):
            shows = "reference"
    if shows in BY_LAST_STEP and config.network.decision == "vote":  # one that is early stays so
        config = config.replace(decision="last")
    decision = config.network.decision
    source = "" if shows == "metadata" or decision == "last" else ", the configuration's"
    notes = [f"decision {decision}{source}: {SHOWS[shows]}", *notes]
    record = {
        "imported": {
            "file": str(file),
            "sha256": hashlib.sha256(Path(file).read_bytes()).hexdigest(),
            "kind": "ONNX" if is_onnx else "torch state_dict",
            "arrays": network.names,
            "notes": notes,
        },
        "normalisation": scale,
        "config": config.to_dict(),
        "parameters": config.parameter_count,
        "versions": {"torch": torch.__version__, "numpy": np.__version__},
    } | checked
    if record.get("passed", True):
        FloatModel(config, arrays, str(file)).save(out, record)
    return record


ORDERS = {3: ("r", "z", "n"), 4: ("i", "f", "g", "o")}
"""Gates in the order in which torch stacks them, by their number."""


def read_layers(path: str | Path) -> Network:
    """The recurrent and the dense layer in a torch state_dict (``.pt``, ``.pth``). torch's GRU has its reset gate
    after the recurrent product.

    Raises
    ------
    InputError
        The file is missing, damaged, needs a pickle, or holds other arrays than one recurrent and one dense
        layer.
    """
    path = Path(path)
    if path.suffix not in (".pt", ".pth") or not path.is_file():
        raise InputError(
            f"network '{path}': is not a torch state_dict (.pt, .pth); save one, or export the network as .onnx, a forest of "
            "scikit-learn with skl2onnx.to_onnx"
        )
    state = _state(path)
    names = _names(path, {name: tuple(tensor.shape) for name, tensor in state.items()})
    layers = {role: _plain(path, name, state[name]) for role, name in names.items()}
    return Network.of_layers(path, layers, names, ORDERS, reset="after")


def _state(path: Path) -> dict[str, torch.Tensor]:
    """The tensors in the file's order; nothing in it is run."""
    why = "is damaged or no torch file"
    try:
        if zipfile.is_zipfile(path):  # torch itself does not look at the check sums
            with zipfile.ZipFile(path) as archive:
                check_unpacked(archive)
                if archive.testzip() is not None:
                    raise ValueError
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            state = torch.load(path, weights_only=True, map_location="cpu")
        if (
            state
            and isinstance(state, dict)
            and all(isinstance(each, torch.Tensor) for each in state.values())
        ):
            return {str(name): tensor for name, tensor in state.items()}
        why = "holds objects other than tensors"
    except OSError:
        raise
    except ArchiveError as error:
        why = str(error)
    except pickle.UnpicklingError as error:
        if "GLOBAL" in str(error) or "reduce" in str(error):  # else an opcode that no torch file has
            why = "holds pickled code, which is never run"
    except Exception:  # a damaged file can fail anywhere inside torch's reader
        pass
    raise InputError(f"network '{path}': {why}; save only the weights: torch.save(model.state_dict(), FILE)")


def _names(path: Path, shapes: Mapping[str, tuple[int, ...]]) -> dict[str, str]:
    """Names by role: ``weight_ih_l0`` and so on (``weight_ih`` of a cell) after any prefix, and the
    remaining pair, the Linear."""

    def refuse(why: str, array: str = "") -> NoReturn:
        raise InputError(f"network '{path}'{f', array {array}' if array else ''}: {why}")

    inputs = [name for name in shapes if name.rpartition(".")[2] in ("weight_ih_l0", "weight_ih")]
    if len(inputs) != 1:
        layers = "one torch.nn.GRU, LSTM, GRUCell or LSTMCell and one Linear"
        refuse(f"occurs {len(inputs)} times; save the state_dict of {layers}", "weight_ih_l0")
    prefix, _, last = inputs[0].rpartition("weight_ih")
    recurrent = [f"{prefix}{kind}{last}" for kind in ("weight_ih", "weight_hh", "bias_ih", "bias_hh")]
    others = [name for name in shapes if name not in recurrent]
    for name in others:
        if name.startswith((f"{prefix}weight_", f"{prefix}bias_")):
            why = "belongs to a second layer, a second direction or a projection"
            refuse(f"{why}; the accelerator has one recurrent layer in one direction", name)
    dense = [name for name in others if name.rpartition(".")[2] == "weight" and len(shapes[name]) == 2]
    if len(dense) != 1:
        refuse(f"has {len(dense)} dense layers beside the recurrent one; the accelerator has one Linear")
    names = [*recurrent, *dense, f"{dense[0].removesuffix('weight')}bias"]
    for name in sorted({*names} ^ {*shapes}):
        missing = "is missing; save the whole state_dict of layers made with bias=True"
        foreign = "belongs to neither the recurrent layer nor the Linear; leave that layer out"
        refuse(foreign if name in shapes else missing, name)
    return dict(zip(ROLES, names, strict=True))


def _plain(path: Path, name: str, tensor: torch.Tensor) -> np.ndarray:
    """A tensor of a state_dict as float64."""
    why = "is not a plain array of numbers; save it dense and not quantised"
    if tensor.numel() > MOST_VALUES:  # a view can show one stored number as often as it likes
        why = f"has shape {tuple(tensor.shape)}, beyond any network that the accelerator takes"
    else:
        try:
            return tensor.detach().to(torch.float64).numpy()
        except (RuntimeError, TypeError, NotImplementedError):
            pass
    raise InputError(f"network '{path}', array {name}: {why}")
