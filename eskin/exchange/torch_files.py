"""A torch state_dict, read without running anything of the file."""

import pickle
import warnings
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import NoReturn

import numpy as np
import torch

from eskin.exchange.network import MOST_VALUES, ROLES, Network
from eskin.golden.core import ArchiveError, InputError
from eskin.golden.core.files import check_unpacked

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
