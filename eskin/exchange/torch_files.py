"""Tensors of a torch state_dict, read without running anything of the file."""

import pickle
import warnings
import zipfile
from pathlib import Path

import numpy as np
import torch

from eskin.golden.core import ArchiveError, InputError
from eskin.golden.core.files import check_unpacked

MOST_VALUES = 1 << 20
"""Most values of one array; the largest that the accelerator takes has 4 x 32 x 512."""
TORCH_SUFFIXES = (".pt", ".pth")


def check_readable(path: Path) -> None:
    """Raise InputError for a file that cannot be opened, so that later errors concern its content."""
    try:
        path.open("rb").close()
    except OSError as error:
        raise InputError(
            f"network '{path}': cannot be read ({error.strerror or error}); check the path and its "
            "permissions"
        ) from None


def read_state(path: Path) -> dict[str, torch.Tensor]:
    """The tensors of a torch state_dict, in its order; nothing in the file is run, and none is beyond what an
    accelerator takes.

    Raises
    ------
    InputError
        The file is damaged, needs a pickle, or holds other things than tensors.
    """
    damaged = InputError(
        f"network '{path}': is damaged or no torch file; save it again with torch.save(model.state_dict(), "
        "FILE)"
    )
    try:
        if zipfile.is_zipfile(path):  # torch itself does not look at the check sums
            with zipfile.ZipFile(path) as archive:
                check_unpacked(archive)
                if archive.testzip() is not None:
                    raise damaged
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            state = torch.load(path, weights_only=True, map_location="cpu")
    except InputError:
        raise
    except ArchiveError as error:
        raise InputError(
            f"network '{path}': {error}; save only the weights: torch.save(model.state_dict(), FILE)"
        ) from None
    except pickle.UnpicklingError as error:
        if "GLOBAL" not in str(error) and "reduce" not in str(error):  # an opcode that no torch file has
            raise damaged from None
        raise InputError(
            f"network '{path}': holds pickled code, which is never run; save only the weights: "
            "torch.save(model.state_dict(), FILE)"
        ) from None
    except Exception:  # a damaged file can fail anywhere inside torch's reader
        raise damaged from None
    if (
        not isinstance(state, dict)
        or not state
        or not all(isinstance(value, torch.Tensor) for value in state.values())
    ):
        raise InputError(
            f"network '{path}': holds objects other than tensors; save only the weights: "
            "torch.save(model.state_dict(), FILE)"
        )
    return {str(name): tensor for name, tensor in state.items()}


def plain_array(path: Path, name: str, tensor: torch.Tensor) -> np.ndarray:
    """A tensor of a state_dict as float64.

    Raises
    ------
    InputError
        It is larger than any that the accelerator takes, or no dense array of numbers.
    """
    if tensor.numel() > MOST_VALUES:  # a view can show one stored number as often as it likes
        shape = tuple(tensor.shape)
        raise InputError(
            f"network '{path}', array {name}: has shape {shape}, beyond any network that the accelerator "
            "takes"
        )
    try:
        return tensor.detach().to(torch.float64).numpy()
    except (RuntimeError, TypeError, NotImplementedError):
        raise InputError(
            f"network '{path}', array {name}: is not a plain array of numbers; save it dense and not quantised"
        ) from None
