"""A network trained elsewhere, from a file into a model folder: a torch state_dict. ONNX, and with it linear
cells, is `eskin.exchange.import_onnx`.

The shapes of a state_dict determine the cell; torch's GRU has its reset gate after the recurrent product.
The user's options must agree with it. Nothing in a file is ever run: torch files are read with
``weights_only``, archives without pickles.
"""

import hashlib
import math
import pickle
import warnings
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import NoReturn

import numpy as np
import torch

from eskin.exchange.network import MOST_VALUES, NAMES, ROLES, Network, check_reference, fitted
from eskin.golden.core import AcceleratorConfig, ArchiveError, InputError, Record
from eskin.golden.core.files import check_unpacked
from eskin.golden.data import Recordings
from eskin.golden.model import FloatModel, check_model_target, constants_shape, find_touches, real_features
from eskin.training.datasets import scaling

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
        if cell == "linear":
            raise InputError(
                f"network '{file}': is to be a linear cell, which is read from ONNX; export it as .onnx"
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
    kept = "" if shows == "metadata" or decision == "last" else ", the configuration's"
    notes = [f"decision {decision}{kept}: {SHOWS[shows]}", *notes]
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
            f"network '{path}': is not a torch state_dict (.pt, .pth); save one, or export the network as .onnx"
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
    """Names by role: ``weight_ih_l0`` and so on (``weight_ih`` of a cell) after any prefix, and the one
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
