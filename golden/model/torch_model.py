"""The integer network on int64 tensors of torch: the reference of the co-simulation.

The cells are the text of `eskin.golden.model.cells`, which the float network trains with; here they run in whole
numbers. Everything else of the trace (front end, decisions) is that of `eskin.golden.model.pipeline`.
"""

import numpy as np
import torch

from eskin.golden.core import AcceleratorConfig, Conv, Pool, QFormat, sigmoid_table, tanh_table
from eskin.golden.model.cells import run_cell
from eskin.golden.model.image_network import ImageTrace
from eskin.golden.model.model import IntegerModel
from eskin.golden.model.pipeline import first_maximum


class Int64:
    """Integer arithmetic in codes, bit-true to docs/specification.md sections 4 to 6: shifts of whole numbers, where
    `Fixed` scales real ones."""

    def __init__(self, config: AcceleratorConfig) -> None:
        self._config = config
        self.one = int(config.gate_one)
        self._sigmoid, self._tanh = (
            torch.from_numpy(table(config)).long() for table in (sigmoid_table, tanh_table)
        )

    def operand(self, feature: torch.Tensor) -> torch.Tensor:
        """``feature << feature_align``."""
        return feature << self._config.feature_align

    def bias(self, bias: torch.Tensor) -> torch.Tensor:
        """``bias << bias_shift``."""
        return bias << self._config.bias_shift

    def dense_bias(self, bias: torch.Tensor) -> torch.Tensor:
        """``bias << dense_bias_shift``."""
        return bias << self._config.dense_bias_shift

    def sigmoid(self, acc: torch.Tensor) -> torch.Tensor:
        """``sig[narrow(acc, sigmoid_shift, index_format)]``, a gate code."""
        return self._look_up(self._sigmoid, acc, self._config.sigmoid_shift)

    def tanh(self, acc: torch.Tensor) -> torch.Tensor:
        """``tanh[narrow(acc, tanh_shift, index_format)]``, a state code."""
        return self._look_up(self._tanh, acc, self._config.tanh_shift)

    def tanh_of_state(self, value: torch.Tensor) -> torch.Tensor:
        """``tanh[narrow(value, state_index_shift, index_format)]``, a state code."""
        return self._look_up(self._tanh, value, self._config.state_index_shift)

    def value(self, acc: torch.Tensor) -> torch.Tensor:
        """``narrow(acc, value_shift, state_format)``."""
        return _narrow(acc, self._config.value_shift, self._config.formats.state_format)

    def state(self, products: torch.Tensor) -> torch.Tensor:
        """``narrow(products, gate_frac, state_format)``."""
        return _narrow(products, self._config.formats.gate_frac, self._config.formats.state_format)

    def logit(self, acc: torch.Tensor) -> torch.Tensor:
        """``narrow(acc, logit_shift, logit_format)``."""
        return _narrow(acc, self._config.logit_shift, self._config.formats.logit_format)

    def _look_up(self, table: torch.Tensor, value: torch.Tensor, shift: int) -> torch.Tensor:
        return table[_narrow(value, shift, self._config.index_format) + len(table) // 2]


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
        with torch.inference_mode():
            hidden, logits = run_cell(Int64(self.config), self.config, parameters, codes)
        return hidden.numpy(), logits.numpy()


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
