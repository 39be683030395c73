"""The integer network on int64 tensors of torch: the reference of the co-simulation.

The cells are the code of `eskin.golden.model.cells`, with which the float network is trained too; here they
run on integers. Everything else of the trace (front end, decisions) comes from `eskin.golden.model.pipeline`.
"""

import numpy as np
import torch

from eskin.golden.core import AcceleratorConfig, Conv, Pool, QFormat
from eskin.golden.model.cells import Fixed, run_cell
from eskin.golden.model.image_network import ImageTrace
from eskin.golden.model.model import IntegerModel
from eskin.golden.model.pipeline import first_maximum


class Int64(Fixed):
    """Integer arithmetic in codes, bit-true to docs/specification.md sections 4 to 6: it shifts integers,
    where `Fixed` scales real numbers."""

    def __init__(self, config: AcceleratorConfig) -> None:
        super().__init__(config)
        self.unit = int(config.gate_one)

    def operand(self, feature: torch.Tensor) -> torch.Tensor:
        """``feature << feature_align``."""
        return feature << self._config.feature_align

    def bias(self, bias: torch.Tensor) -> torch.Tensor:
        """``bias << bias_shift``."""
        return bias << self._config.bias_shift

    def dense_bias(self, bias: torch.Tensor) -> torch.Tensor:
        """``bias << dense_bias_shift``."""
        return bias << self._config.dense_bias_shift

    @staticmethod
    def _narrow(value: torch.Tensor, shift: int, fmt: QFormat) -> torch.Tensor:
        return _narrow(value, shift, fmt)

    def _look_up(self, table: np.ndarray, value: torch.Tensor, shift: int, smooth: object) -> torch.Tensor:
        place = _narrow(value, shift, self._config.index_format) + len(table) // 2
        return torch.from_numpy(table).long()[place]


def _narrow(value: torch.Tensor, shift: int, fmt: QFormat) -> torch.Tensor:
    """Round half up, then saturate."""
    half = 1 << shift >> 1
    return ((value + half) >> shift).clamp(fmt.min_code, fmt.max_code)


class TorchModel(IntegerModel):
    """An integer model whose network runs in torch."""

    def forward(self, features: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(h' codes (n, K, H), logit codes (n, K, C)), int64, of feature codes (n, K, D)."""
        parameters = {name: torch.tensor(array, dtype=torch.int64) for name, array in self.arrays.items()}
        codes = torch.from_numpy(np.ascontiguousarray(features, np.int64))
        if self.config.is_forest:
            return features[..., :0].astype(np.int64), _forest_logits(self.config, parameters, codes).numpy()
        with torch.inference_mode():
            hidden, logits = run_cell(Int64(self.config), self.config, parameters, codes)
        return hidden.numpy(), logits.numpy()


def _forest_logits(
    config: AcceleratorConfig, arrays: dict[str, torch.Tensor], codes: torch.Tensor
) -> torch.Tensor:
    """Logits (n, K, C) of trees: every node is compared, then marked if its tree's walk comes by it."""
    steps, first = torch.arange(codes.shape[1]), arrays["tree_input"] // config.inputs
    windows = torch.minimum(first, steps[:, None])  # (K, N)
    inputs, less = (arrays[name] % config.inputs for name in ("tree_input", "subtrahend"))
    values = codes[:, windows, inputs] - (inputs != less) * codes[:, windows, less]
    right = values > arrays["threshold"]
    logits = codes.new_zeros((*right.shape[:2], config.classes))
    passed = torch.zeros_like(right)
    passed[..., : config.forest.trees] = True
    for node, (children, votes) in enumerate(zip(arrays["child"].tolist(), arrays["vote"], strict=True)):
        for child, vote, side in zip(children, votes, (~right, right), strict=True):
            goes = passed[..., node] & side[..., node]
            if child < 0:
                logits[..., -1 - child] += goes * vote
            else:
                passed[..., child] |= goes
    return logits


def on_torch(model: IntegerModel) -> TorchModel:
    """The same model."""
    return TorchModel(model.config, model.arrays, model.source)


def run_images_on_torch(model: IntegerModel, images: np.ndarray) -> ImageTrace:
    """`eskin.golden.model.image_network.run_images`, layer by layer in torch."""
    config, functional = model.config, torch.nn.functional
    formats = (*config.image.map_formats, config.formats.logit_format)
    narrowing = iter(zip(config.layer_shifts, formats, strict=True))
    values = torch.from_numpy(images.astype(np.int64))[:, None]
    maps = {}
    for stage in config.stages:
        if isinstance(stage.layer, Pool):
            values = functional.max_pool2d(values.double(), 2, ceil_mode=True).long()
        else:
            weights, bias = (torch.tensor(model.arrays[f"{name}_{stage.number}"]) for name in "Wb")
            if isinstance(stage.layer, Conv):
                kernel = stage.layer.kernel
                patches = functional.unfold(values.double(), kernel, padding=kernel // 2).long()
                rows = weights.reshape(stage.outputs, kernel, kernel, -1).permute(0, 3, 1, 2)
                sums = (rows.reshape(stage.outputs, -1) @ patches).reshape(
                    -1, stage.outputs, *values.shape[2:]
                )
            else:  # channel last, as the hardware's memory holds a map
                columns = values.permute(0, 2, 3, 1).reshape(len(values), -1, 1)
                sums = (weights.reshape(stage.outputs, -1) @ columns)[..., None]
            values = _narrow(sums + bias[:, None, None], *next(narrowing))
        maps[stage.number] = values.permute(0, 2, 3, 1).numpy()
    logits = maps.pop(config.stages[-1].number).reshape(len(images), config.classes)
    maps = {number: array.astype(np.uint8) for number, array in maps.items()}
    return ImageTrace(config, *first_maximum(logits), logits, maps)
