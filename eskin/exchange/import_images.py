"""A network for images trained elsewhere: a torch state_dict beside a list of layers, into a model folder.

The state_dict's tensors stand in the order of the layers. A convolution may be followed by a batch norm,
which is folded in: ``w' = w g / sqrt(v + eps)``, ``b' = (b - m) g / sqrt(v + eps) + beta``; torch's eps is
not in the file, and its default is taken. Behind the last map torch flattens channel by channel, our memories
hold channels last: the first dense layer's columns change places. Pixels were ``code / std`` there and are
``code / 256`` here: the first layer's weights are scaled.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from eskin.exchange.torch_files import TORCH_SUFFIXES, check_readable, plain_array, read_state
from eskin.golden.core import AcceleratorConfig, Conv, Dense, InputError
from eskin.golden.core.images import PIXEL_FORMAT, Stage

EPS = 1e-5
"""torch.nn.BatchNorm2d's default, which a state_dict does not tell."""

Tensors = dict[str, np.ndarray]
"""A module's tensors by the last word of their names."""


def read_image_network(
    path: Path, config: AcceleratorConfig, mean: float | None, std: float | None
) -> tuple[AcceleratorConfig, dict[str, np.ndarray], dict[str, str]]:
    """``config`` without formats, the float network's arrays, and the module that each layer comes from, of a
    torch state_dict.

    Parameters
    ----------
    path:
        ``.pt`` or ``.pth``: convolutions with or without batch norm, then dense layers, in the order of the
        configuration's.
    config:
        With group image: height, width, layers; and the classes.
    mean, std:
        Pixels of its training: (code - mean) / std. mean is 0, since zeros are put around maps; std is 255
        where pixels were 0 to 1.

    Raises
    ------
    InputError
        Another file, other layers or sizes, a missing or impossible mean or std.
    """
    if mean is None or std is None:
        raise InputError(
            f"network '{path}': does not say how pixels were scaled; give --mean 0 --std 255 if 0..255 "
            "became 0..1"
        )
    if mean != 0:
        raise InputError(
            f"--mean {mean:g}: a map of images has zeros around it, which must be the pixels' 0; train with "
            "a mean of 0"
        )
    if not (math.isfinite(std) and std > 0):
        raise InputError(
            f"--std {std:g}: is no spread above 0; give the codes that became 1, 255 if pixels were 0 to 1"
        )
    if path.suffix not in TORCH_SUFFIXES or not path.is_file():
        raise InputError(
            f"network '{path}': is no .pt or .pth file; save it with torch.save(model.state_dict(), FILE)"
        )
    check_readable(path)
    config = config.replace(weight_formats=(), map_formats=())
    arrays, names = convert(path, _modules(path), config)
    arrays[f"W_{config.weighted_stages[0].number}"] *= 2**PIXEL_FORMAT.frac_bits / std
    return config, arrays, names


def _modules(path: Path) -> dict[str, Tensors]:
    """Modules by their names, in the file's order."""
    modules: dict[str, Tensors] = {}
    for name, tensor in read_state(path).items():
        module, _, role = name.rpartition(".")
        if role != "num_batches_tracked":
            modules.setdefault(module, {})[role] = _finite(path, name, plain_array(path, name, tensor))
    return modules


def _finite(path: Path, name: str, array: np.ndarray) -> np.ndarray:
    if not np.isfinite(array).all():
        raise InputError(
            f"network '{path}', array {name}: holds values that are no finite numbers; train the network "
            "again"
        )
    return array


def convert(
    path: Path, modules: dict[str, Tensors], config: AcceleratorConfig
) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """The float network's arrays by the names of a model folder, and the name of the module that each layer
    comes from.

    Raises
    ------
    InputError
        Modules are missing, too many, of other kinds or of other sizes than the layers.
    """

    def refuse(module: str, role: str, why: str) -> NoReturn:
        raise InputError(f"network '{path}', array {module + '.' if module else ''}{role}: {why}")

    waiting = list(modules.items())
    arrays: dict[str, np.ndarray] = {}
    names: dict[str, str] = {}
    for stage in config.weighted_stages:
        if not waiting:
            raise InputError(
                f"network '{path}': ends before layer '{stage.layer}'; give the layers that it has in group "
                "image"
            )
        module, tensors = waiting.pop(0)
        weight = tensors.get("weight")
        roles = {"weight", "bias"}
        if weight is None or not set(tensors) <= roles:
            refuse(
                module,
                next(iter(set(tensors) - roles), "weight"),
                f"belongs to no convolution or dense layer, and '{stage.layer}' is due",
            )
        _check_shape(stage, weight, lambda why, module=module: refuse(module, "weight", why))
        bias = tensors.get("bias", np.zeros(stage.outputs))
        if bias.shape != (stage.outputs,):
            refuse(
                module,
                "bias",
                f"has shape {bias.shape} beside {stage.outputs} outputs; save the state_dict of one network",
            )
        if isinstance(stage.layer, Conv) and waiting and "running_mean" in waiting[0][1]:
            norm, statistics = waiting.pop(0)
            weight, bias = _folded(
                stage, weight, bias, statistics, lambda role, why, norm=norm: refuse(norm, role, why)
            )
        arrays[f"W_{stage.number}"] = (
            weight.transpose(0, 2, 3, 1).copy() if weight.ndim == 4 else _columns(stage, weight)
        )
        arrays[f"b_{stage.number}"], names[f"{stage.number} {stage.layer}"] = bias, module
    if waiting:
        module, tensors = waiting[0]
        refuse(
            module,
            next(iter(tensors)),
            f"is more than the {len(config.weighted_stages)} layers of the configuration; add its layer "
            "there",
        )
    return arrays, names


def _check_shape(stage: Stage, weight: np.ndarray, refuse: Any) -> None:
    if isinstance(stage.layer, Conv):
        channels, kernel = stage.layer.channels, stage.layer.kernel
        expected: Sequence[int] = (channels, stage.source[2], kernel, kernel)
    else:
        expected = (stage.outputs, math.prod(stage.source))
    if weight.shape == tuple(expected):
        return
    more = ""
    if (
        isinstance(stage.layer, Dense)
        and weight.ndim == 2
        and len(weight) == stage.outputs
        and stage.source[:2] != (1, 1)
    ):
        size = " x ".join(map(str, stage.source))
        more = f" (a map of {size}; pools here keep a last odd row: ceil_mode=True)"
    refuse(
        f"has shape {weight.shape}, and '{stage.layer}' takes {tuple(expected)}{more}; give the layers and "
        "image size it was trained with"
    )


def _folded(
    stage: Stage, weight: np.ndarray, bias: np.ndarray, statistics: Tensors, refuse: Any
) -> tuple[np.ndarray, np.ndarray]:
    channels = (stage.outputs,)
    for role in ("running_mean", "running_var"):
        if role not in statistics or statistics[role].shape != channels:
            refuse(
                role,
                f"is missing or has not the {stage.outputs} channels of the convolution before it; save the "
                "whole state_dict",
            )
    scale, shift = statistics.get("weight", np.ones(channels)), statistics.get("bias", np.zeros(channels))
    if scale.shape != channels or shift.shape != channels:
        refuse(
            "weight",
            f"has not the {stage.outputs} channels of the convolution before it; save the whole state_dict",
        )
    if (statistics["running_var"] < 0).any():
        refuse("running_var", "is below 0; train the network again")
    factor = scale / np.sqrt(statistics["running_var"] + EPS)
    return weight * factor[:, None, None, None], (bias - statistics["running_mean"]) * factor + shift


def _columns(stage: Stage, weight: np.ndarray) -> np.ndarray:
    """Columns from torch's order (channel, row, column) to ours (row, column, channel)."""
    rows, columns, channels = stage.source
    return weight.reshape(-1, channels, rows, columns).transpose(0, 2, 3, 1).reshape(len(weight), -1).copy()
