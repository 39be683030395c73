"""Integers of a network for images: a format for each layer, from ranges, and the model folder's integer
half. No torch."""

import itertools
import math
from collections.abc import Mapping

import numpy as np

from eskin.golden.core import AcceleratorConfig, InputError, QFormat
from eskin.golden.core.images import BIAS_BITS, PIXEL_FORMAT, Stage
from eskin.golden.model import FloatModel, IntegerModel, float_images, layer_formats, run_images

COVERED = 0.9999
"""Share of the values of a map that its format holds; rarer ones saturate."""

LOGIT_HEADROOM = 2.0
"""Logits outside the profiled images may be this many times larger before they saturate."""


def check_weight_bits(bits: int) -> None:
    """Refuse weight widths that the hardware does not have."""
    if bits not in (4, 8):
        raise InputError(
            f"`weight_bits` {bits}: networks for images have weights of 4 or 8 bits; give one of these"
        )


def profile_images(model: FloatModel, images: np.ndarray) -> dict[str, float]:
    """For each layer with weights, the value that a share COVERED of its outputs for images does not exceed;
    for the logits twice the largest. Number of the layer, as text -> real value."""
    trace = float_images(model, images)
    stages = model.config.weighted_stages
    ranges = {
        str(stage.number): float(np.quantile(trace.maps[stage.number], COVERED)) for stage in stages[:-1]
    }
    return ranges | {str(stages[-1].number): LOGIT_HEADROOM * float(np.abs(trace.logits).max())}


def weight_fraction(weights: np.ndarray, bits: int) -> int:
    """Fraction bits with which weights of ``bits`` bits approximate ``weights`` best (least squares); the
    largest may saturate."""
    largest = max(float(np.abs(weights).max()), 2.0**-16)
    fits = bits - 1 - math.ceil(math.log2(largest))
    errors = {}
    for fraction in range(fits - 1, fits + 4):
        fmt = QFormat(bits - fraction, fraction)
        errors[fraction] = float(np.square(fmt.to_real(fmt.quantise(weights)) - weights).sum())
    return min(errors, key=lambda fraction: (errors[fraction], fraction))


def choose_image_formats(
    model: FloatModel, ranges: Mapping[str, float], weight_bits: int = 8
) -> AcceleratorConfig:
    """The configuration with a format for each layer: power-of-two scales, so that one shift a layer is all
    that hardware needs.

    ranges: `profile_images`. A shift is never below 0: a layer whose map could be finer than its products
    keeps theirs.
    """
    check_weight_bits(weight_bits)
    config, before = model.config, PIXEL_FORMAT.frac_bits
    weights, maps = [], []
    for stage in config.weighted_stages:
        fraction = weight_fraction(model.arrays[f"W_{stage.number}"], weight_bits)
        weights.append(QFormat(weight_bits - fraction, fraction))
        integers = math.ceil(math.log2(max(ranges[str(stage.number)], 2.0**-12)))
        behind = min((15 if stage.last else 8) - integers, fraction + before)
        width = 16 if stage.last else 8
        maps.append(QFormat(width - behind, behind, signed=stage.last))
        before = behind
    return config.replace(weight_formats=tuple(weights), map_formats=tuple(maps[:-1]), logit_format=maps[-1])


# ---------------------------------------------------------------------- the same network, easier to round
LEAST_SHARE = 1 / 16
"""Least range of a channel, as a share of the largest of its layer, so that a channel that is hardly ever
active is not amplified."""

ALIGNMENTS = (0.0, 0.25, 0.5, 0.75)
"""Exponents of two that are tried as factors for the scale of a whole layer."""

ALIGNED_ON = 64
"""Number of images on which these factors are tried."""


def equalised(model: FloatModel, images: np.ndarray, weight_bits: int = 8) -> FloatModel:
    """A network that computes the same function with other internal scales, so that one power-of-two format
    per layer loses less.

    A channel of a hidden layer may be multiplied by any s > 0 when the weights that read it are divided by s:
    ReLU and pools keep positive factors. First each channel gets s = (v / (w m))^(1/3), with w the range of
    its weights, m of its map and v of the weights that read it. That brings w s, m s and v / s of a layer's
    channels closest together, by least squares of their logarithms (after Nagel et al., Data-free
    quantization through weight equalization, 2019, who have w and v). Then each layer as a whole, from the
    first one on, gets that member of ALIGNMENTS with the least mean square error of the integer logits (weights
    of ``weight_bits``).
    """
    stages = model.config.weighted_stages
    arrays = {name: array.copy() for name, array in model.arrays.items()}
    maps = float_images(model, images).maps
    for stage, reader in itertools.pairwise(stages):
        weights = np.abs(arrays[f"W_{stage.number}"]).reshape(stage.outputs, -1).max(axis=1)
        reading = np.abs(_by_channel(arrays[f"W_{reader.number}"], stage.outputs)).max(axis=(0, 1))
        ranges = [
            weights,
            reading,
            np.quantile(maps[stage.number].reshape(-1, stage.outputs), COVERED, axis=0),
        ]
        weights, reading, mapped = (
            np.maximum(candidate, max(LEAST_SHARE * candidate.max(), 2.0**-24)) for candidate in ranges
        )
        factor = np.cbrt(reading / (weights * mapped))
        # relative to their geometric mean: the layer as a whole is scaled later
        _scale(arrays, stage, reader, factor / np.exp(np.log(factor).mean()))
    sample = images[:: max(len(images) // ALIGNED_ON, 1)]
    ideal = float_images(model, sample, maps=False).logits
    for stage, reader in itertools.pairwise(stages):
        tried = {}
        for power in ALIGNMENTS:
            changed = dict(arrays)
            _scale(changed, stage, reader, np.full(stage.outputs, 2.0**power))
            candidate = FloatModel(model.config, changed, model.source)
            whole = quantised(candidate, sample, weight_bits)
            logits = whole.config.formats.logit_format.to_real(run_images(whole, sample, maps=False).logits)
            tried[power] = (float(np.square(logits - ideal).mean()), power, changed)
        arrays = min(tried.values(), key=lambda entry: entry[:2])[2]
    return FloatModel(model.config, arrays, model.source)


def _by_channel(weights: np.ndarray, channels: int) -> np.ndarray:
    """Weights of a layer as (outputs, places, channels that it reads)."""
    return weights.reshape(len(weights), -1, channels)


def _scale(arrays: dict[str, np.ndarray], stage: Stage, reader: Stage, factor: np.ndarray) -> None:
    """Multiply the channels of a layer by ``factor`` and divide the weights that read them by it."""
    weights, reading = arrays[f"W_{stage.number}"], arrays[f"W_{reader.number}"]
    arrays[f"W_{stage.number}"] = (weights.reshape(stage.outputs, -1) * factor[:, None]).reshape(
        weights.shape
    )
    arrays[f"b_{stage.number}"] = arrays[f"b_{stage.number}"] * factor
    arrays[f"W_{reader.number}"] = (_by_channel(reading, stage.outputs) / factor).reshape(reading.shape)


def integers_of(model: FloatModel, config: AcceleratorConfig) -> IntegerModel:
    """The integer network: weights and biases of the float one, rounded to the formats of ``config``; biases
    saturate at 24 bits."""
    arrays: dict[str, np.ndarray] = {}
    for stage, fmt, before, _ in layer_formats(config):
        bias = QFormat(BIAS_BITS - fmt.frac_bits - before.frac_bits, fmt.frac_bits + before.frac_bits)
        arrays[f"W_{stage.number}"] = fmt.quantise(model.arrays[f"W_{stage.number}"])
        arrays[f"b_{stage.number}"] = bias.quantise(model.arrays[f"b_{stage.number}"])
    return IntegerModel(config, arrays)


def quantised(model: FloatModel, images: np.ndarray, weight_bits: int = 8) -> IntegerModel:
    """The integer network of a float one, formats profiled on ``images``."""
    return integers_of(model, choose_image_formats(model, profile_images(model, images), weight_bits))
