"""Integers of a network for images: a format for each layer, from ranges, and the model folder's integer half. No torch."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.core.formats import QFormat
from eskin.golden.core.images import BIAS_BITS, PIXEL_FORMAT
from eskin.golden.data.recordings import Recordings, check_fit
from eskin.golden.model.image_network import float_images, images_of
from eskin.golden.model.model import TRAINING_FILE, FloatModel, IntegerModel, load_training

COVERED = 0.9999
"""Share of the values of a map that its format holds; rarer ones saturate."""

LOGIT_HEADROOM = 2.0
"""Logits outside the profiled images may be this many times larger before they saturate."""


def check_weight_bits(bits: int) -> None:
    """Refuse other weights than hardware has."""
    if bits not in (4, 8):
        raise InputError(f"--weight-bits {bits}: networks for images have weights of 4 or 8 bits; give one of these")


def profile_images(model: FloatModel, images: np.ndarray) -> dict[str, float]:
    """The largest value, covering COVERED of them, that each layer with weights gives for images; of the logits twice the largest.
    Number of the layer, as text -> real value."""
    trace = float_images(model, images)
    stages = model.config.weighted_stages
    ranges = {str(stage.number): float(np.quantile(trace.maps[stage.number], COVERED)) for stage in stages[:-1]}
    return ranges | {str(stages[-1].number): LOGIT_HEADROOM * float(np.abs(trace.logits).max())}


def weight_fraction(weights: np.ndarray, bits: int) -> int:
    """Fraction bits with which weights of ``bits`` bits come closest to ``weights``: least squares, the largest may saturate."""
    largest = max(float(np.abs(weights).max()), 2.0**-16)
    fits = bits - 1 - math.ceil(math.log2(largest))
    errors = {}
    for fraction in range(fits - 1, fits + 4):
        fmt = QFormat(bits - fraction, fraction)
        errors[fraction] = float(np.square(fmt.to_real(fmt.quantise(weights)) - weights).sum())
    return min(errors, key=lambda fraction: (errors[fraction], fraction))


def choose_image_formats(model: FloatModel, ranges: Mapping[str, float], weight_bits: int = 8) -> AcceleratorConfig:
    """The configuration with a format for each layer: power-of-two scales, so that one shift a layer is all that hardware needs.

    ranges: `profile_images`. A shift is never below 0: a layer whose map could be finer than its products keeps theirs.
    """
    check_weight_bits(weight_bits)
    config, before = model.config, PIXEL_FORMAT.frac_bits
    weights, given = [], []
    for stage in config.weighted_stages:
        fraction = weight_fraction(model.arrays[f"W_{stage.number}"], weight_bits)
        weights.append(QFormat(weight_bits - fraction, fraction))
        integers = math.ceil(math.log2(max(ranges[str(stage.number)], 2.0**-12)))
        behind = min((15 if stage.last else 8) - integers, fraction + before)
        width = 16 if stage.last else 8
        given.append(QFormat(width - behind, behind, signed=stage.last))
        before = behind
    return config.replace(weight_formats=tuple(weights), map_formats=tuple(given[:-1]), logit_format=given[-1])


def integers_of(model: FloatModel, config: AcceleratorConfig) -> IntegerModel:
    """The integer network: weights and biases of the float one, rounded to the formats of ``config``; biases saturate at 24 bits."""
    arrays: dict[str, np.ndarray] = {}
    before, behind = PIXEL_FORMAT, (*config.image.map_formats, config.formats.logit_format)
    for stage, fmt, after in zip(config.weighted_stages, config.image.weight_formats, behind, strict=True):
        bias = QFormat(BIAS_BITS - fmt.frac_bits - before.frac_bits, fmt.frac_bits + before.frac_bits)
        arrays[f"W_{stage.number}"] = fmt.quantise(model.arrays[f"W_{stage.number}"])
        arrays[f"b_{stage.number}"] = bias.quantise(model.arrays[f"b_{stage.number}"])
        before = after
    return IntegerModel(config, arrays)


def quantised(model: FloatModel, images: np.ndarray, weight_bits: int = 8) -> IntegerModel:
    """The integer network of a float one, formats profiled on ``images``."""
    return integers_of(model, choose_image_formats(model, profile_images(model, images), weight_bits))


def quantise_image_model(
    model_dir: str | Path, recordings: Recordings | None = None, *, weight_bits: int | None = None, **other: Any
) -> IntegerModel:
    """As `eskin.golden.training.quantise.quantise`, of a model for images: weights of 8 or 4 bits, a format for each layer, profiled on
    ``recordings`` or of the ranges noted at training.

    Raises
    ------
    InputError
        Other widths than ``weight_bits``, which networks for images do not have; no ranges.
    """
    for name, value in other.items():
        if value:
            raise InputError(f"--{name.replace('_', '-')}: networks for images have no such width; leave it out, or give --weight-bits 4")
    model, record = FloatModel.load(model_dir, images=True), load_training(model_dir)
    model = FloatModel(model.config.replace(weight_formats=(), map_formats=()), model.arrays, model.source)
    if recordings is not None:
        check_fit(recordings, model.config)
        ranges = profile_images(model, images_of(recordings))
    else:
        ranges = _noted(model_dir, model.config, record)
    integer = integers_of(model, choose_image_formats(model, ranges, weight_bits or 8))
    integer.save(model_dir, training=record | {"quantisation_aware": False, "widths": {"weight_bits": weight_bits or 8}, "ranges": ranges})
    return integer


def _noted(model_dir: str | Path, config: AcceleratorConfig, record: Mapping[str, Any]) -> dict[str, float]:
    """The ranges that the training record notes."""
    ranges = record.get("ranges")
    wanted = {str(stage.number) for stage in config.weighted_stages}
    try:
        found = {name: float(ranges[name]) for name in wanted}  # type: ignore[index]
    except (TypeError, KeyError, ValueError):
        found = {}
    if not found or not all(np.isfinite(value) and value >= 0 for value in found.values()):
        raise InputError(f"{model_dir}/{TRAINING_FILE}, field ranges: is missing or damaged; give the images it was trained on (--data)")
    return found
