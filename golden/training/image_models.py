"""Model folders of networks for images: cross-validated and trained, made integers, judged. What `eskin train`, `quantise` and
`evaluate` do with an archive of images.

``auto`` trains three networks of NETWORKS on the same folds and takes the one with the fewest multiplies whose accuracy lies within one
standard error of the best one's, as the choice among cells does (`eskin.golden.training.choose_network`).
"""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.core.formats import QFormat
from eskin.golden.core.images import NETWORKS, network
from eskin.golden.core.jobs import Jobs, Kept, content_key
from eskin.golden.data.recordings import Recordings, check_fit
from eskin.golden.model.image_network import ImageTrace, float_images, images_of, layer_by_layer, run_images
from eskin.golden.model.model import TRAINING_FILE, FloatModel, IntegerModel, check_model_target, load_training
from eskin.golden.training.train import Decided, one_thread, split_folds, split_record
from eskin.golden.training.train_images import (
    ImageRecipe,
    Piece,
    choose_image_formats,
    integers_of,
    judge,
    profile_images,
    train_network,
    tune_network,
)

AUTO = "auto"
CANDIDATES = ("tactnet", "four", "tactnet-half")
"""Networks among which ``auto`` chooses."""

CHOOSING_EPOCHS = 60
"""Epochs of a candidate's training; the one taken is trained with the recipe's."""

LOOKED_AT = 200
"""Images on which errors are taken layer by layer."""

Progress = Callable[[str, int, int], None]


def image_config(recordings: Recordings, name: str) -> AcceleratorConfig:
    """The configuration of one of NETWORKS for an archive of images.

    Raises
    ------
    InputError
        The images do not suit it, or there are too many classes.
    """
    assert recordings.image_shape is not None
    height, width = recordings.image_shape
    try:
        layers = network(name, len(recordings.class_names))
        rate = {"sample_rate_hz": recordings.sample_rate_hz}
        return AcceleratorConfig.of_image(height, width, layers, recordings.class_names, name=name, **rate)
    except ValueError as error:
        raise InputError(f"recordings '{recordings.source}', array images: {error}") from None


def chosen_config(recordings: Recordings, asked: AcceleratorConfig | None, cell: str | None) -> AcceleratorConfig | None:
    """The configuration that was asked for, checked against the images; None: it is to be chosen."""
    if cell in NETWORKS:
        return image_config(recordings, cell)
    if cell not in (None, AUTO):
        raise InputError(f"--cell {cell}: reads recordings, and {recordings.source} holds images; use {', '.join(NETWORKS)} or auto")
    if asked is None or cell == AUTO:
        return None
    check_fit(recordings, asked)
    return asked.replace(weight_formats=(), map_formats=())


# ---------------------------------------------------------------------- training
def train_image_model(
    recordings: Recordings,
    asked: AcceleratorConfig | None,
    *,
    out: str | Path,
    cell: str | None = None,
    group: Sequence[str] | None = None,
    folds: int = 5,
    seed: int = 0,
    seeds: int = 1,
    quantisation_aware: bool = False,
    weight_bits: int | None = None,
    recipe: ImageRecipe | None = None,
    keep: Kept | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Cross-validate (choosing the network where none was asked for), fit it to all images, and write the model folder.

    Parameters
    ----------
    asked, cell:
        The configuration that was asked for, or a name of NETWORKS, or ``auto``; neither: ``auto``.
    seeds:
        Networks of each fold, from ``seed`` on.
    quantisation_aware, weight_bits:
        Train on with rounded weights (default: 8 bits); the folder then holds the integers too.
    keep:
        Where networks that were trained and judged are kept; None: nowhere.

    Returns
    -------
    The training record, as `eskin.golden.training.train.train` gives it.

    Raises
    ------
    InputError
        Images and configuration do not fit each other; before any long work.
    """
    begin = time.perf_counter()
    check_model_target(out)
    recipe, bits = recipe or ImageRecipe(), weight_bits or 8
    if bits not in (4, 8):
        raise InputError(f"--weight-bits {bits}: networks for images have weights of 4 or 8 bits; give one of these")
    config = chosen_config(recordings, asked, cell)
    if config is None and not folds:
        raise InputError(f"--cell auto: needs folds to judge networks on; leave --folds 0 out or name one of {', '.join(NETWORKS)}")
    candidates = [config] if config else [image_config(recordings, name) for name in CANDIDATES]
    judged_by = recipe if config else dataclasses.replace(recipe, epochs=min(recipe.epochs, CHOOSING_EPOCHS))
    images, groups = images_of(recordings), list(group or [])
    rows: list[dict[str, Any]] = []
    records: list[dict[str, Any]] = []
    if folds:
        jobs = Jobs(workers=workers, progress=progress)
        many = range(seed, seed + seeds)
        pieces = [_pieces(recordings, one, groups, folds, many, judged_by, bits if quantisation_aware else 0) for one in candidates]
        keyed = {_key(images, recordings, piece): piece for of_one in pieces for of_seed in of_one for piece in of_seed}
        results = jobs.results(judge, keyed, (images, recordings.labels), keep=keep, what="networks of the cross-validation")
        for one, of_one in zip(candidates, pieces, strict=True):
            found = [[results[_key(images, recordings, piece)] for piece in of_seed] for of_seed in of_one]
            records.append(_judged(recordings, one, groups, of_one, found, list(many), "tuned" if quantisation_aware else "w8"))
        rows = _candidate_rows(candidates, records, seeds)
    taken = next((index for index, row in enumerate(rows) if row["chosen"]), 0)
    config = candidates[taken]
    model, integer = _fit(config, recordings, recipe, seed, bits if quantisation_aware else 0, progress)
    record: dict[str, Any] = {
        "seed": seed,
        "recipe": dataclasses.asdict(recipe),
        "config": config.to_dict(),
        "data": str(recordings.source),
        "recordings": len(recordings),
        "parameters": config.parameter_count,
        "multiplies": config.multiplies,
        "ranges": profile_images(model, images),
        "quantisation_aware": quantisation_aware,
        "widths": {"weight_bits": bits},
        "cross_validation": [_without_correct(records[taken])] if records else [],
        "baselines": [],
        "warnings": [],
        "reasons": list(recordings.notes),
        "wall_s": time.perf_counter() - begin,
    }
    if len(candidates) > 1:
        record["candidates"] = rows
    record = json.loads(json.dumps(record))
    model.save(out, record)
    if integer is not None:
        integer.save(out)
    return record


def _fit(
    config: AcceleratorConfig, recordings: Recordings, recipe: ImageRecipe, seed: int, bits: int, progress: Progress | None
) -> tuple[FloatModel, IntegerModel | None]:
    images, labels = images_of(recordings), recordings.labels

    def told(what: str) -> Callable[[int, int], None]:
        return lambda done, total: progress(what, done, total) if progress else None

    with one_thread():
        model = train_network(config, images, labels, recipe=recipe, seed=seed, progress=told("training on all images, epochs"))
        if not bits:
            return model, None
        report = told(f"training on with weights of {bits} bits, epochs")
        return tune_network(model, images, labels, weight_bits=bits, recipe=recipe, seed=seed, progress=report)


def _pieces(
    recordings: Recordings, config: AcceleratorConfig, groups: list[str], folds: int, seeds: Sequence[int], recipe: ImageRecipe, bits: int
) -> list[list[Piece]]:
    """A list for each seed, a piece for each fold."""
    made = []
    for seed in seeds:
        parts = split_folds(recordings, groups, folds, seed if not groups else None)
        made.append([Piece(config, tuple(map(int, part)), seed, recipe, bits) for part in parts])
    return made


def _key(images: np.ndarray, recordings: Recordings, piece: Piece) -> str:
    return content_key(
        images.tobytes(), recordings.labels.tobytes(), piece.config.to_dict(), list(piece.left_out), piece.seed,
    dataclasses.asdict(piece.recipe), piece.tuned_bits )  # fmt: skip


def _judged(
    recordings: Recordings,
    config: AcceleratorConfig,
    groups: list[str],
    pieces: list[list[Piece]],
    results: list[list[dict[str, Any]]],
    seeds: list[int],
    integers: str,
) -> dict[str, Any]:
    """The record of a cross-validation, and ``correct``: the share of seeds whose integers were right, for each image."""
    correct = np.zeros(len(recordings))
    decided: list[list[Decided]] = []
    for fold in range(len(pieces[0])):
        of_fold = []
        for of_seed, found in zip(pieces, results, strict=True):
            out, ideal, whole = np.array(of_seed[fold].left_out), np.array(found[fold]["float"]), np.array(found[fold][integers])
            correct[out] += (whole == recordings.labels[out]) / len(seeds)
            given = {"float_global": ideal, "float_local": ideal[:, None], "integer_global": whole, "integer_local": whole[:, None]}
            of_fold.append(Decided(**given, integer_step=np.zeros_like(whole), logit_error=np.array([])))
        decided.append(of_fold)
    tests = [np.array(piece.left_out) for piece in pieces[0]]
    record = {"correct": correct}
    if len(seeds) == 1:
        return record | split_record(groups, _names(tests, groups), tests, decided, recordings, seeds, [_seconds(config)])
    # every seed deals its own folds: the figures of each, and their means
    each = [
        split_record(groups, _names(tests, groups), [np.array(p.left_out) for p in of_seed], [[of_fold[number]] for of_fold in decided],
                     recordings, [seed], [_seconds(config)])
        for number, (seed, of_seed) in enumerate(zip(seeds, pieces, strict=True))
    ]  # fmt: skip
    shares = ("float_accuracy", "integer_accuracy", "agreement")
    means = {name: float(np.mean([one[name] for one in each])) for name in shares}
    by_seed = {f"{kind}_by_seed": [one[f"{kind}_accuracy"] for one in each] for kind in ("float", "integer")}
    return record | each[0] | means | by_seed | {"seeds": seeds}


def _names(tests: Sequence[np.ndarray], groups: list[str]) -> list[str]:
    return [f"part {number + 1}" for number in range(len(tests))]


def _seconds(config: AcceleratorConfig) -> float:
    return config.image.height / config.sensor.sample_rate_hz


def _without_correct(record: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in record.items() if name != "correct"}


def _candidate_rows(candidates: Sequence[AcceleratorConfig], records: Sequence[dict[str, Any]], seeds: int) -> list[dict[str, Any]]:
    """What training.json says of each network; the one with the fewest multiplies within one standard error of the best is chosen."""
    correct = [record["correct"] for record in records]
    errors = [float(one.std(ddof=1) / np.sqrt(len(one))) for one in correct]
    best = int(np.argmax([one.mean() for one in correct]))
    enough = [index for index, one in enumerate(correct) if one.mean() >= correct[best].mean() - errors[best]]
    taken = min(enough, key=lambda index: candidates[index].multiplies)
    return [
        {
            "cell": config.name,
            "hidden": 0,
            "recipe": "images",
            "accuracy": float(one.mean()),
            "standard_error": error,
            "float_accuracy": record["float_accuracy"],
            "agreement": record["agreement"],
            "multiplies_touch": config.multiplies,
            "multiplies_step": config.multiplies,
            "parameters": config.parameter_count,
            "seeds": seeds,
            "chosen": index == taken,
        }
        for index, (config, record, one, error) in enumerate(zip(candidates, records, correct, errors, strict=True))
    ]


# ---------------------------------------------------------------------- integers
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


# ---------------------------------------------------------------------- judging
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
        "per_step": [{"step": 1, "time_s": _seconds(config), **accuracy}],
        "per_class": per_class,
        "not_touched": 0,
        "partial": 0,
        "confusion": confusion.tolist(),
        "class_names": list(config.network.class_names),
        "decision": config.network.decision,
        "decision_time_s": _seconds(config),
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
    stage, before = config.weighted_stages[index], (QFormat(0, 8, signed=False), *config.image.map_formats)[index]
    after = (*config.image.map_formats, config.formats.logit_format)[index]
    weight = config.image.weight_formats[index]
    arrays = dict(real.arrays)
    arrays[f"W_{stage.number}"] = weight.to_real(integer.arrays[f"W_{stage.number}"])
    arrays[f"b_{stage.number}"] = integer.arrays[f"b_{stage.number}"] / 2.0 ** (weight.frac_bits + before.frac_bits)

    def behind(number: int, sums: np.ndarray) -> np.ndarray:
        if number == index:
            return after.to_real(after.quantise(sums, rounding="RND"))
        return sums if number == len(config.weighted_stages) - 1 else np.maximum(sums, 0.0)

    values = images[..., None] / 256.0
    for given in layer_by_layer(config, arrays, values, behind):
        values = given
    return values.reshape(len(images), -1)
