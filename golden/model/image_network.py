"""Image networks in integers and in float: every map, the logits, the decision (docs/specification.md,
section 15)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from eskin.golden.core import AcceleratorConfig, Arrays, Conv, InputError, Pool, QFormat, narrow
from eskin.golden.core.images import PIXEL_FORMAT, Stage
from eskin.golden.data import Recordings
from eskin.golden.model.model import FloatModel, IntegerModel
from eskin.golden.model.pipeline import Decisions, Stream, first_maximum

BATCH = 64
"""Images at a time: a batch's products stay within some 50 MB."""


@dataclass(frozen=True)
class ImageTrace(Decisions):
    """All values that a network computes from n images.

    decision (n): class. margin (n): largest minus second largest logit. logits (n, C): codes of
    ``logit_format``, or real ones. maps: number of each layer but the last -> its output (n, rows, columns,
    channels), uint8 codes or real values.
    """

    config: AcceleratorConfig
    decision: np.ndarray
    margin: np.ndarray
    logits: np.ndarray
    maps: dict[int, np.ndarray] = field(default_factory=dict, repr=False)

    @property
    def confident(self) -> np.ndarray:
        """(n), bool: the margin is at least ``margin_threshold``."""
        return self.margin >= self.config.network.margin_threshold

    @property
    def streams(self) -> dict[str, Stream]:
        """Stage -> (values int64, offsets (n + 1)), of an integer run: ``map_N`` flat, channels last, for
        each layer N whose map is kept (the map of a convolution with a pool behind it is not); ``logit`` flat;
        ``decision`` rows of `eskin.golden.model.pipeline.DECISION_FIELDS`, the local one and then the global
        one."""
        count = len(self.decision)
        streams: dict[str, Stream] = {}
        for stage, following in zip(self.config.stages, self.config.stages[1:], strict=False):
            if not isinstance(following.layer, Pool):
                values = self.maps[stage.number].reshape(count, -1)
                streams[f"map_{stage.number}"] = (
                    values.astype(np.int64).ravel(),
                    np.arange(count + 1) * values.shape[1],
                )
        streams["logit"] = (self.logits.astype(np.int64).ravel(), np.arange(count + 1) * self.config.classes)
        zero = np.zeros(count, dtype=np.int64)
        local = np.stack([zero, zero, self.decision, self.margin, zero, zero], axis=1).astype(np.int64)
        whole = local.copy()
        whole[:, 0], whole[:, 5] = 1, ~self.confident
        streams["decision"] = (np.stack([local, whole], axis=1).reshape(-1, 6), 2 * np.arange(count + 1))
        return streams


def images_of(recordings: Recordings) -> np.ndarray:
    """The images (n, height, width), uint8, of an image archive's recordings."""
    if recordings.image_shape is None:
        raise InputError(f"recordings '{recordings.source}': are not images; this model takes images")
    return recordings.samples.reshape(len(recordings), *recordings.image_shape).astype(np.uint8)


def image_seconds(config: AcceleratorConfig) -> float:
    """Seconds in which all rows of an image arrive."""
    return config.image.height / config.sensor.sample_rate_hz


def layer_formats(config: AcceleratorConfig) -> list[tuple[Stage, QFormat, QFormat, QFormat]]:
    """(layer with weights, format of its weights, of its inputs, of its outputs), in their order."""
    outputs = (*config.image.map_formats, config.formats.logit_format)
    return list(
        zip(
            config.weighted_stages,
            config.image.weight_formats,
            (PIXEL_FORMAT, *outputs),
            outputs,
            strict=False,
        )
    )


def columns(values: np.ndarray, kernel: int) -> np.ndarray:
    """Input of the kernel at each place of maps (n, rows, columns, channels) with zeros around them: (n,
    rows, columns, kernel x kernel x channels); row of the kernel first, then its column, then the channel."""
    around = kernel // 2
    padded = np.pad(values, ((0, 0), (around, around), (around, around), (0, 0)))
    # n, rows, columns, channels, kernel, kernel
    patches = np.lib.stride_tricks.sliding_window_view(padded, (kernel, kernel), axis=(1, 2))
    return patches.transpose(0, 1, 2, 4, 5, 3).reshape(*values.shape[:3], -1)


def pooled(values: np.ndarray) -> np.ndarray:
    """Largest of 2 x 2 of maps (n, rows, columns, channels); a last odd row or column is a separate
    window."""
    rows, across = values.shape[1:3]
    padded = np.pad(values, ((0, 0), (0, rows % 2), (0, across % 2), (0, 0)), mode="edge")
    parts = padded.reshape(len(values), padded.shape[1] // 2, 2, padded.shape[2] // 2, 2, values.shape[3])
    return parts.max(axis=(2, 4))


def accumulators(stage: Stage, values: np.ndarray, weights: np.ndarray, bias: np.ndarray) -> np.ndarray:
    """Sums of a layer with weights and their bias, float64, which holds integer ones exactly (below
    2**53)."""
    patches = (
        columns(values, stage.layer.kernel)
        if isinstance(stage.layer, Conv)
        else values.reshape(len(values), 1, 1, -1)
    )
    return patches.astype(np.float64) @ weights.reshape(stage.outputs, -1).T.astype(np.float64) + bias


Finish = Callable[[int, np.ndarray], np.ndarray]
"""(number of a layer among those with weights, its sums) -> its output."""


def layer_by_layer(
    config: AcceleratorConfig, arrays: Arrays, values: np.ndarray, finish: Finish
) -> Iterator[np.ndarray]:
    """Output of each layer for maps (n, height, width, 1)."""
    numbers = {stage.number: index for index, stage in enumerate(config.weighted_stages)}
    for stage in config.stages:
        if isinstance(stage.layer, Pool):
            values = pooled(values)
        else:
            sums = accumulators(stage, values, arrays[f"W_{stage.number}"], arrays[f"b_{stage.number}"])
            values = finish(numbers[stage.number], sums)
        yield values


def run_images(model: IntegerModel, images: np.ndarray, *, maps: bool = True) -> ImageTrace:
    """The integer network on images (n, height, width) of codes 0..255; ``maps``: keep them too."""
    return _run(
        model.config,
        model.arrays,
        _integer(model.config),
        _checked(model.config, images)[..., None].astype(np.int64),
        maps,
        np.int64,
    )


def float_images(model: FloatModel, images: np.ndarray, *, maps: bool = True) -> ImageTrace:
    """The float network on images (n, height, width) of codes 0..255, a pixel being code / 256."""
    pixels = PIXEL_FORMAT.to_real(_checked(model.config, images))[..., None]
    return _run(model.config, model.arrays, _real(model.config), pixels, maps, np.float64)


def _integer(config: AcceleratorConfig) -> Finish:
    formats, shifts = (*config.image.map_formats, config.formats.logit_format), config.layer_shifts
    return lambda number, sums: narrow(sums.astype(np.int64), shifts[number], formats[number])


def _real(config: AcceleratorConfig) -> Finish:
    last = len(config.weighted_stages) - 1
    return lambda number, sums: sums if number == last else np.maximum(sums, 0.0)


def _checked(config: AcceleratorConfig, images: np.ndarray) -> np.ndarray:
    size = (config.image.height, config.image.width)
    if images.ndim != 3 or images.shape[1:] != size:
        raise InputError(f"images: have shape {images.shape}; the model takes (images, {size[0]}, {size[1]})")
    return images


def _run(
    config: AcceleratorConfig, arrays: Arrays, finish: Finish, pixels: np.ndarray, keep: bool, kind
) -> ImageTrace:
    maps_of: dict[int, list[np.ndarray]] = {stage.number: [] for stage in config.stages}
    for begin in range(0, len(pixels), BATCH):
        for stage, values in zip(
            config.stages, layer_by_layer(config, arrays, pixels[begin : begin + BATCH], finish), strict=True
        ):
            if stage.last or keep:
                maps_of[stage.number].append(
                    values if stage.last or kind is np.float64 else values.astype(np.uint8)
                )
    last = config.stages[-1].number
    logits = np.concatenate(maps_of.pop(last)).reshape(len(pixels), config.classes).astype(kind)
    maps = {number: np.concatenate(parts) for number, parts in maps_of.items() if parts}
    return ImageTrace(config, *first_maximum(logits), logits, maps)
