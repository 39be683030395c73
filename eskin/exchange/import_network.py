"""A network trained elsewhere, from a file into a model folder: a torch state_dict. ONNX, and with it linear
cells, is `eskin.exchange.import_onnx`.

The shapes of a state_dict determine the cell; torch's GRU has its reset gate after the recurrent product.
The user's options must agree with it. Nothing in a file is ever run: torch files are read with
``weights_only``, archives without pickles.
"""

import hashlib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import NoReturn

import numpy as np
import torch

from eskin.exchange.network import Network, fitted
from eskin.exchange.reference import NAMES, check_reference
from eskin.exchange.torch_files import TORCH_SUFFIXES, check_readable, plain_array, read_state
from eskin.golden.core import AcceleratorConfig, Arrays, InputError, Record
from eskin.golden.data import Recordings
from eskin.golden.model import FloatModel, check_model_target, constants_shape, find_touches, real_features
from eskin.training.datasets import scaling

ONNX_SUFFIX = ".onnx"
ORDERS = {3: ("r", "z", "n"), 4: ("i", "f", "g", "o")}
"""Gates in the order in which torch stacks them, by their number."""

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


# ---------------------------------------------------------------------- reading files
def read_layers(path: str | Path) -> Network:
    """The recurrent and the dense layer in a torch state_dict (``.pt``, ``.pth``): rows = outputs, G gates
    stacked, of six roles: ``input`` (G H, D), ``recurrent`` (G H, H), ``bias``, ``second bias`` (G H), ``dense``
    (C, H), ``dense bias`` (C).

    Raises
    ------
    InputError
        The file is missing, damaged, needs a pickle, or holds other arrays than one recurrent and one dense
        layer.
    """
    path = Path(path)
    if path.suffix not in TORCH_SUFFIXES or not path.is_file():
        raise InputError(
            f"network '{path}': is not a torch state_dict (.pt, .pth); save one, or export the network as .onnx"
        )
    check_readable(path)
    state = read_state(path)
    names = _torch_names(path, {name: tuple(tensor.shape) for name, tensor in state.items()})
    layers = {role: plain_array(path, name, state[name]) for role, name in names.items()}
    _check_shapes(path, layers, names)
    rows, hidden = layers["recurrent"].shape
    lstm = rows == 4 * hidden
    arrays = {"V": layers["dense"], "b_y": layers["dense bias"]}
    for index, gate in enumerate(ORDERS[rows // hidden]):
        part = slice(index * hidden, (index + 1) * hidden)
        first, second = layers["bias"][part], layers["second bias"][part]
        arrays |= {f"W_{gate}": layers["input"][part], f"U_{gate}": layers["recurrent"][part]}
        # nothing stands between an LSTM's two rows, so they are one
        arrays |= {f"b_{gate}": first + second} if lstm else {f"b_{gate}": first, f"bh_{gate}": second}
    sizes = hidden, len(layers["dense"]), layers["input"].shape[1]
    return Network(path, "lstm" if lstm else "gru", "after", "sigmoid", *sizes, arrays, names)


def _torch_names(path: Path, shapes: Mapping[str, tuple[int, ...]]) -> dict[str, str]:
    """Names by role: ``weight_ih_l0`` and so on (``weight_ih`` of a cell) after any prefix, and the one
    remaining pair, the Linear."""

    def refuse(why: str, array: str = "") -> NoReturn:
        raise InputError(f"network '{path}'{f', array {array}' if array else ''}: {why}")

    inputs = [name for name in shapes if name.rpartition(".")[2] in ("weight_ih_l0", "weight_ih")]
    if len(inputs) != 1:
        layers = "one torch.nn.GRU, LSTM, GRUCell or LSTMCell and one Linear"
        refuse(f"occurs {len(inputs)} times; save the state_dict of {layers}", "weight_ih_l0")
    prefix, _, last = inputs[0].rpartition("weight_ih")
    recurrent = [f"{prefix}{role}{last}" for role in ("weight_ih", "weight_hh", "bias_ih", "bias_hh")]
    remaining = [name for name in shapes if name not in recurrent]
    dense = [name.removesuffix("weight") for name in remaining
             if name.rpartition(".")[2] == "weight" and len(shapes[name]) == 2]  # fmt: skip
    for name in remaining:
        if name.startswith(prefix) and name.removeprefix(prefix).startswith(("weight_", "bias_")):
            why = "belongs to a second layer, a second direction or a projection"
            refuse(f"{why}; the accelerator has one recurrent layer in one direction", name)
    if len(dense) != 1:
        refuse(f"has {len(dense)} dense layers beside the recurrent one; the accelerator has one Linear")
    linear = [f"{dense[0]}weight", f"{dense[0]}bias"]
    for name in (*recurrent, *linear):
        if name not in shapes:
            refuse("is missing; save the whole state_dict of layers made with bias=True", name)
    for name in remaining:
        if name not in linear:
            refuse("belongs to neither the recurrent layer nor the Linear; leave that layer out", name)
    roles = ("input", "recurrent", "bias", "second bias", "dense", "dense bias")
    return dict(zip(roles, (*recurrent, *linear), strict=True))


def _check_shapes(path: Path, layers: Arrays, names: dict[str, str]) -> None:
    """Refuse shapes that do not belong together, and values that are not finite numbers."""

    def refuse(role: str, why: str) -> NoReturn:
        raise InputError(f"network '{path}', array {names[role]}: {why}")

    shape = layers["recurrent"].shape
    if len(shape) != 2 or not shape[1] or shape[0] not in (3 * shape[1], 4 * shape[1]):
        refuse(
            "recurrent",
            f"has shape {shape}, neither (3 x hidden, hidden) of a GRU nor (4 x hidden, hidden) of an LSTM",
        )
    (rows, hidden), dense = shape, layers["dense"].shape
    expected = {
        "input": (rows, *layers["input"].shape[1:2]),
        "bias": (rows,),
        "second bias": (rows,),
        "dense": (dense[0], hidden),
        "dense bias": (dense[0],),
    }
    for role, array in layers.items():
        if array.shape != expected.get(role, shape) or not array.size:
            cell = "a GRU" if rows == 3 * hidden else "an LSTM"
            refuse(
                role,
                f"has shape {array.shape}, which does not match {cell} of {hidden} units "
                f"({names['recurrent']}) and {dense[0]} classes ({names['dense']}); save the arrays of "
                "one network",
            )
        if not np.isfinite(array).all():
            refuse(role, "holds values that are not finite numbers; train the network again")


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
    return scaling(config, real_features(config, touches.sums), touches.completed, touches.faults)


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
        A torch state_dict (``read_layers``); an ONNX file (`eskin.exchange.import_onnx`), whose cell and reset are
        its own.
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
        Without ``mean`` and ``std``: those of the window means of these recordings, as training here takes
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
    scale: Record
    notes: list[str] = []
    shows, own = "weights", NAMES
    _check_scale(mean, std)
    if Path(file).suffix == ONNX_SUFFIX:
        from eskin.exchange.import_onnx import convert_onnx, read_onnx

        network = read_onnx(file)
        config, arrays, shows, notes = convert_onnx(network, config, cell, reset)
        kind, names, own = "ONNX", network.names, network.graph.ends
        held = network.scale(config) if mean is None and recordings is None else None
        scale = held or _normalisation(file, config, mean, std, recordings)
    else:
        cell, reset = cell or config.network.cell, reset or config.network.reset
        if cell == "linear":
            raise InputError(
                f"network '{file}': is to be a linear cell, which is read from ONNX; export it as .onnx"
            )
        layers, kind = read_layers(file), "torch state_dict"
        (config, arrays), names = fitted(layers, config, cell, reset), dict(layers.names)
        scale = _normalisation(file, config, mean, std, recordings)
        if config.network.cell == "gru":
            notes = ["reset gate after the recurrent product, as torch has it"]
    arrays |= {
        name: np.broadcast_to(scale[key], constants_shape(config))
        for name, key in (("mu", "mean"), ("sigma", "std"))
    }
    scale |= {"mean": arrays["mu"].tolist(), "std": arrays["sigma"].tolist()}
    checked: Record = {}
    if check is not None:
        found = check_reference(check, FloatModel(config, arrays, str(file)), own)
        checked = {"check": found, "passed": found["passed"]}
        if found["shows"] == "last" and shows in ("every", "weights"):
            shows = "reference"
    config, decided = _decide(config, shows)
    notes = [decided, *notes]
    record = {
        "imported": {
            "file": str(file),
            "sha256": hashlib.sha256(Path(file).read_bytes()).hexdigest(),
            "kind": kind,
            "arrays": names,
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


def _decide(config: AcceleratorConfig, shows: str) -> tuple[AcceleratorConfig, str]:
    """``config`` that decides by the last step where the file shows that (a configuration that is ``early`` stays so),
    and a sentence about it."""
    if shows in BY_LAST_STEP and config.network.decision == "vote":
        config = config.replace(decision="last")
    kept = "" if shows == "metadata" or config.network.decision == "last" else ", the configuration's"
    return config, f"decision {config.network.decision}{kept}: {SHOWS[shows]}"


def _check_scale(mean: float | None, std: float | None) -> None:
    """Raise InputError for one without the other, and for values that are not a valid scale."""
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


def _normalisation(
    file: str | Path,
    config: AcceleratorConfig,
    mean: float | None,
    std: float | None,
    recordings: Recordings | None,
) -> Record:
    """mean, std and their source: those given, or measured on recordings."""
    if mean is not None:
        return {"mean": mean, "std": std, "source": "given"}
    if recordings is None:
        raise InputError(
            f"network '{file}': weights alone do not define the normalisation; give --mean "
            "and --std (codes), or "
            "--data to measure them on"
        )
    return dict(zip(("mean", "std"), measure_scaling(config, recordings), strict=True)) | {
        "source": str(recordings.source)
    }
