"""Training networks for images, in float and with weights of few bits; choosing formats; cross-validation by
pieces of work.

The recipe comes from a study on the 22 objects of Gandarias et al. (2019), tuned on the same folds: AdamW on
a one-cycle schedule, each batch turned, mirrored, shifted and scaled anew. Batch norm is folded into weights
and biases at the end, so hardware computes the stored network.
"""

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from eskin.golden.core import AcceleratorConfig, Arrays, Conv, InputError, Pool, Record
from eskin.golden.core.images import PIXEL_FORMAT
from eskin.golden.model import FloatModel, float_images, run_images
from eskin.memo import code_version
from eskin.training.image_formats import equalised, quantised
from eskin.training.losses import Progress


@dataclass(frozen=True, kw_only=True)
class ImageRecipe:
    """Training of a network for images.

    epochs, batch; learning_rate: the largest of a one-cycle schedule; weight_decay: AdamW's, on weights
    alone; label_smoothing; dropout: before the last layer. Each image of each batch anew: turn (degrees, +-),
    mirror (both axes, each with probability 1/2), shift (share of the side, +-), zoom and intensity (share,
    +-), noise (standard deviation, share of full scale, where the image is not 0).
    """

    epochs: int = 100
    batch: int = 32
    learning_rate: float = 5e-3
    weight_decay: float = 0.03
    label_smoothing: float = 0.1
    dropout: float = 0.4
    turn: float = 30.0
    mirror: bool = True
    shift: float = 0.15
    zoom: float = 0.1
    intensity: float = 0.2
    noise: float = 0.02


class ImageNetwork(nn.Module):
    """The network of a configuration with batch norm behind each convolution; images (n, 1, height, width) of
    pixels 0..1."""

    def __init__(self, config: AcceleratorConfig, dropout: float) -> None:
        super().__init__()
        self._config, self._dropout = config, nn.Dropout(dropout)
        self._pooled = {stage.number - 1 for stage in config.stages if isinstance(stage.layer, Pool)}
        self.layers, self.norms = nn.ModuleDict(), nn.ModuleDict()
        for stage in config.weighted_stages:
            if isinstance(stage.layer, Conv):
                kernel, before, channels = stage.layer.kernel, stage.source[2], stage.layer.channels
                self.layers[str(stage.number)] = nn.Conv2d(before, channels, kernel, padding=kernel // 2)
                self.norms[str(stage.number)] = nn.BatchNorm2d(channels)
            else:
                self.layers[str(stage.number)] = nn.Linear(stage.products, stage.outputs)

    def forward(self, values: Tensor) -> Tensor:
        for stage in self._config.stages:
            name = str(stage.number)
            if isinstance(stage.layer, Pool):
                values = nn.functional.max_pool2d(values, 2, ceil_mode=True).relu()
            elif isinstance(stage.layer, Conv):
                values = self.norms[name](self.layers[name](values))
                # pool and ReLU may change places, and a pooled map is smaller
                if stage.number not in self._pooled:
                    values = values.relu()
            else:
                if values.ndim == 4:
                    values = values.permute(0, 2, 3, 1).flatten(1)  # channels last, as values are numbered
                values = self.layers[name](self._dropout(values) if stage.last else values)
                values = values if stage.last else values.relu()
        return values

    def folded(self) -> Arrays:
        """Weights and biases by the names of a model's arrays, batch norm folded in, float64."""
        arrays: dict[str, np.ndarray] = {}
        layer: Any
        norm: Any
        for name, layer in self.layers.items():
            weight, bias = layer.weight.detach().double(), layer.bias.detach().double()
            if name in self.norms:
                norm = self.norms[name]
                scale = norm.weight.detach().double() / torch.sqrt(norm.running_var.double() + norm.eps)
                weight = weight * scale[:, None, None, None]
                bias = (bias - norm.running_mean.double()) * scale + norm.bias.detach().double()
                weight = weight.permute(0, 2, 3, 1)
            arrays[f"W_{name}"], arrays[f"b_{name}"] = weight.contiguous().numpy(), bias.numpy()
        return arrays


# ---------------------------------------------------------------------- augmentation
def augmented(images: Tensor, recipe: ImageRecipe, generator: torch.Generator) -> Tensor:
    """Images (n, 1, height, width) of pixels 0..1, each turned, mirrored, shifted, scaled, brightened and
    with noise by different numbers."""
    count, _, height, width = images.shape

    def spread(limit: float) -> Tensor:
        return (2 * torch.rand(count, generator=generator) - 1) * limit

    angle, zoom = spread(math.radians(recipe.turn)), 1 + spread(recipe.zoom)
    down, across = 2 * spread(recipe.shift), 2 * spread(recipe.shift)
    flip_x, flip_y = (
        1 - 2 * torch.randint(0, 2, (count,), generator=generator) * recipe.mirror for _ in range(2)
    )
    aspect = height / width
    cos, sin = torch.cos(angle) / zoom, torch.sin(angle) / zoom
    rows = [
        torch.stack([cos * flip_x, -sin * aspect * flip_y, across], 1),
        torch.stack([sin / aspect * flip_x, cos * flip_y, down], 1),
    ]
    grid = nn.functional.affine_grid(torch.stack(rows, 1), list(images.shape), align_corners=False)
    moved = nn.functional.grid_sample(images, grid, align_corners=False)
    noise = torch.randn(moved.shape, generator=generator) * recipe.noise * (moved > 0)
    return ((moved + noise) * (1 + spread(recipe.intensity))[:, None, None, None]).clamp(0, 1)


def train_network(
    config: AcceleratorConfig,
    images: np.ndarray,
    labels: np.ndarray,
    *,
    recipe: ImageRecipe,
    seed: int,
    progress: Progress | None = None,
) -> FloatModel:
    """A network trained on images (n, height, width) of codes 0..255; deterministic by ``seed``.

    Raises
    ------
    InputError
        Fewer than two images: batch norm has nothing to measure.
    """
    if len(images) < 2:
        raise InputError(f"training: there are {len(images)} images to train on; give at least 2")
    generator = torch.Generator().manual_seed(seed)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)  # for the initial weights and dropout, which take no generator
        network: Any = ImageNetwork(config, recipe.dropout)
        network.to(memory_format=torch.channels_last)
        network.train()
        parameters = list(network.parameters())
        groups = [
            {"params": [one for one in parameters if one.ndim > 1], "weight_decay": recipe.weight_decay},
            {"params": [one for one in parameters if one.ndim <= 1], "weight_decay": 0.0},
        ]
        optimiser = torch.optim.AdamW(groups, lr=recipe.learning_rate)
        updates = recipe.epochs * max(len(images) // recipe.batch, 1)
        steps = torch.optim.lr_scheduler.OneCycleLR(optimiser, recipe.learning_rate, total_steps=updates)
        pixels = torch.from_numpy(images.astype(np.float32))[:, None] / 2**PIXEL_FORMAT.frac_bits
        targets = torch.from_numpy(labels.astype(np.int64))
        loss_of = nn.CrossEntropyLoss(label_smoothing=recipe.label_smoothing)
        for epoch in range(recipe.epochs):
            # batches of one size; of fewer images than a batch one
            whole = len(images) - len(images) % recipe.batch or len(images)
            for rows in torch.randperm(len(images), generator=generator)[:whole].split(recipe.batch):
                loss = loss_of(network(augmented(pixels[rows], recipe, generator)), targets[rows])
                optimiser.zero_grad()
                loss.backward()
                optimiser.step()
                steps.step()
            if progress:
                progress(epoch + 1, recipe.epochs)
    return equalised(FloatModel(config, network.folded()), images)


# ---------------------------------------------------------------------- pieces of work
@dataclass(frozen=True)
class ImageFold:
    """One network of a cross-validation: trained without the images ``left_out`` and judged on them."""

    config: AcceleratorConfig
    left_out: tuple[int, ...]
    seed: int
    recipe: ImageRecipe


CODE = partial(code_version, "golden", "training")
"""Code on which the result of an `ImageFold` depends beside its data."""


def judge_fold(shared: tuple[np.ndarray, np.ndarray], fold: ImageFold) -> Record:
    """Decisions on the images left out: ``float`` and ``integer`` (8-bit weights), each a list of classes in the
    order of ``left_out``. shared: images and labels."""
    from eskin.training.fit import one_thread

    (images, labels), out = shared, np.array(fold.left_out)
    train = np.setdiff1d(np.arange(len(images)), out)
    with one_thread():
        model = train_network(fold.config, images[train], labels[train], recipe=fold.recipe, seed=fold.seed)
        real = float_images(model, images[out], maps=False)
        integer = run_images(quantised(model, images[train]), images[out], maps=False)
    return {"float": real.decision.tolist(), "integer": integer.decision.tolist()}
