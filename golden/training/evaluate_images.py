"""A network for images in float against its integers: accuracy, agreement, errors layer by layer. No torch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.formats import QFormat
from eskin.golden.core.images import BIAS_BITS, PIXEL_FORMAT
from eskin.golden.data.recordings import Recordings, check_fit
from eskin.golden.model.image_network import ImageTrace, float_images, images_of, layer_by_layer, run_images
from eskin.golden.model.model import FloatModel, IntegerModel
from eskin.golden.model.stage_error import profile_of, records

LOOKED_AT = 200
"""Images on which errors are taken layer by layer."""


def image_seconds(config: AcceleratorConfig) -> float:
    """Seconds that the rows of an image take on their way in."""
    return config.image.height / config.sensor.sample_rate_hz


def compare_images(ideal: ImageTrace, trace: ImageTrace, labels: np.ndarray) -> dict[str, Any]:
    """The keys of `eskin.golden.training.evaluate.compare`, of images."""
    config, labels = trace.config, np.asarray(labels)
    confusion = np.zeros((config.classes, config.classes + 1), dtype=np.int64)
    np.add.at(confusion, (labels, trace.decision), 1)
    accuracy = {"float_accuracy": ideal.accuracy(labels), "integer_accuracy": trace.accuracy(labels)}
    per_class = {}
    for index, name in enumerate(config.network.class_names):
        members = labels == index
        if members.any():
            shares = {"float_accuracy": ideal.decision[members] == index, "integer_accuracy": trace.decision[members] == index}
            per_class[name] = {"recordings": int(members.sum())} | {key: float(np.mean(right)) for key, right in shares.items()}
    return {
        "recordings": len(labels),
        **accuracy,
        "agreement": trace.agreement(ideal),
        "chance": float(np.bincount(labels).max() / len(labels)),
        "per_step": [{"step": 1, "time_s": image_seconds(config), **accuracy}],
        "per_class": per_class,
        "not_touched": 0,
        "partial": 0,
        "confusion": confusion.tolist(),
        "class_names": list(config.network.class_names),
        "decision": config.network.decision,
        "decision_time_s": image_seconds(config),
    }


def evaluate_images(model_dir: str | Path, recordings: Recordings) -> dict[str, Any]:
    """What `eskin.golden.training.evaluate.evaluate` returns without ``passed``, of a model for images: one step an image; stages are
    layers."""
    model, real = IntegerModel.load(model_dir, images=True), FloatModel.load(model_dir, images=True)
    check_fit(recordings, model.config)
    images = images_of(recordings)
    result = compare_images(float_images(real, images, maps=False), run_images(model, images, maps=False), recordings.labels)
    some = images[recordings.evenly(LOOKED_AT)]
    stages = layer_errors(real, model, some)
    worst = max(stages, key=lambda one: one["logit_max"])
    difference = np.abs(_real_logits(model, some) - float_images(real, some, maps=False).logits)
    error = {"mean": float(difference.mean()), "max": float(difference.max()), "stage": worst["stage"]}
    return result | {"logit_error": error, "stages": stages}


def compare_image_stages(model_dir: str | Path, recordings: Recordings) -> dict[str, Any]:
    """What `eskin.golden.training.evaluate.compare_stages` returns, of a model for images: an image is a step, stages are layers, signals
    are the weights, biases and maps of each layer, and the logits. Errors are taken on LOOKED_AT images at most, evenly over the classes.

    Raises
    ------
    InputError
        When the folder is no quantised model of images, or the recordings are no images of its size.
    """
    model, real = IntegerModel.load(model_dir, images=True), FloatModel.load(model_dir, images=True)
    check_fit(recordings, model.config)
    images = images_of(recordings)
    agreement = run_images(model, images, maps=False).agreement(float_images(real, images, maps=False))
    some = images[recordings.evenly(LOOKED_AT)]
    stages, signals = layer_errors(real, model, some), signal_records(real, model, some)
    worst, logits = max(stages, key=lambda one: one["logit_max"]), signals[-1]
    return {
        "model": str(model_dir),
        "source": str(recordings.source),
        "recordings": len(recordings),
        "steps": len(recordings),
        "agreement": agreement,
        "local_agreement": None,
        "logit_error": {"mean": logits["error_mean"], "max": logits["error_max"], "stage": worst["stage"]},
        "stages": stages,
        "signals": signals,
    }


def signal_records(real: FloatModel, integer: IntegerModel, images: np.ndarray) -> list[dict[str, Any]]:
    """A record, of the keys of `eskin.golden.model.stage_error.SignalProfile`, for the weights, the biases and the map of each layer with
    weights, and for the logits, which come last."""
    config = integer.config
    ideal, trace = float_images(real, images), run_images(integer, images)
    found, before = [], PIXEL_FORMAT
    for stage, weight, after in zip(
        config.weighted_stages, config.image.weight_formats, (*config.image.map_formats, config.formats.logit_format), strict=True
    ):
        layer, frac = f"{stage.number} {stage.layer}", weight.frac_bits + before.frac_bits
        bias = QFormat(BIAS_BITS - frac, frac)
        for role, fmt in (("W", weight), ("b", bias)):
            name, word = f"{role}_{stage.number}", "weights" if role == "W" else "biases"
            found.append(profile_of(f"{layer}: {word}", "weights", fmt, real.arrays[name], fmt.to_real(integer.arrays[name])))
        wanted, made = (ideal.logits, trace.logits) if stage.last else (ideal.maps[stage.number], trace.maps[stage.number])
        given = "logits" if stage.last else f"{layer}: map"
        found.append(profile_of(given, "activations", after, wanted, after.to_real(made)))
        before = after
    return records(found)


def _real_logits(model: IntegerModel, images: np.ndarray) -> np.ndarray:
    return model.config.formats.logit_format.to_real(run_images(model, images, maps=False).logits)


def layer_errors(real: FloatModel, integer: IntegerModel, images: np.ndarray) -> list[dict[str, Any]]:
    """A record for each layer with weights, of the keys of `eskin.golden.model.stage_error.StageError`, on ``images``."""
    config = integer.config
    ideal, trace = float_images(real, images), run_images(integer, images)
    given = (*config.image.map_formats, config.formats.logit_format)
    found = []
    for index, (stage, fmt) in enumerate(zip(config.weighted_stages, given, strict=True)):
        codes = trace.logits if stage.last else trace.maps[stage.number]
        exact = ideal.logits if stage.last else ideal.maps[stage.number]
        error = np.abs(fmt.to_real(codes) - exact)
        alone = np.abs(_alone(real, integer, index, images) - ideal.logits)
        at_end = codes >= fmt.max_code if not fmt.signed else (codes >= fmt.max_code) | (codes <= fmt.min_code)
        record = {"stage": f"{stage.number} {stage.layer}", "mean": error.mean(), "max": error.max(), "saturated": np.mean(at_end)}
        record |= {"used": np.abs(codes.astype(np.int64)).max() / fmt.max_code, "logit_mean": alone.mean(), "logit_max": alone.max()}
        found.append({name: value if isinstance(value, str) else float(value) for name, value in record.items()})
    return found


def _alone(real: FloatModel, integer: IntegerModel, index: int, images: np.ndarray) -> np.ndarray:
    """Logits of the float network with the weights, bias and output of one layer as the integer one has them."""
    config = integer.config
    stage, before = config.weighted_stages[index], (PIXEL_FORMAT, *config.image.map_formats)[index]
    after = (*config.image.map_formats, config.formats.logit_format)[index]
    weight = config.image.weight_formats[index]
    arrays = dict(real.arrays)
    arrays[f"W_{stage.number}"] = weight.to_real(integer.arrays[f"W_{stage.number}"])
    arrays[f"b_{stage.number}"] = integer.arrays[f"b_{stage.number}"] / 2.0 ** (weight.frac_bits + before.frac_bits)

    def behind(number: int, sums: np.ndarray) -> np.ndarray:
        if number == index:
            return after.to_real(after.quantise(sums, rounding="RND"))
        return sums if number == len(config.weighted_stages) - 1 else np.maximum(sums, 0.0)

    values = PIXEL_FORMAT.to_real(images)[..., None]
    for given in layer_by_layer(config, arrays, values, behind):
        values = given
    return values.reshape(len(images), -1)
