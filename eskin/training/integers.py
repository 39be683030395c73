"""The integer half of a model folder: the float network, rounded or with its training continued in
integers."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from eskin.data.fit import check_fit
from eskin.golden.core import AcceleratorConfig, InputError, Record
from eskin.golden.data import Recordings
from eskin.golden.model import FloatModel, IntegerModel, find_touches, images_of, load_config
from eskin.golden.model.model import TRAINING_FILE
from eskin.training.datasets import find_dataset, touch_rows
from eskin.training.fit import fine_tune
from eskin.training.image_formats import (
    check_weight_bits,
    choose_image_formats,
    equalised,
    integers_of,
    profile_images,
)
from eskin.training.losses import Progress
from eskin.training.prototypes import prototypes_from_recordings, training_groups
from eskin.training.quantise import (
    LAST_LOGIT,
    LAST_MARGIN,
    Range,
    check_given,
    check_widths,
    profile,
    quantise_model,
    range_records,
    signals,
)
from eskin.training.recipe import noted_recipe
from eskin.training.record import Quantised, Training
from eskin.training.trained import Trained, load_trained


def _noted_ranges(model_dir: str | Path, config: AcceleratorConfig, record: Training) -> dict[str, Range]:
    """The ranges that the training record notes."""
    fix = "give the recordings it was trained on (`data`)"
    if not record.ranges or isinstance(record.ranges, dict):
        raise InputError(f"model '{model_dir}': has no ranges from its training; {fix}")
    ranges = {entry.signal: (entry.min, entry.max) for entry in record.ranges}
    for signal in signals(config):
        least = ranges.get(signal, (0.0,) if signal in (LAST_LOGIT, LAST_MARGIN) else (math.nan,))
        if not all(map(math.isfinite, least)):
            why = "is not finite" if signal in ranges else "is missing"
            raise InputError(f"{model_dir}/{TRAINING_FILE}, field ranges: {signal} {why}; {fix}")
    return ranges


def quantise(
    model_dir: str | Path,
    recordings: Recordings | None = None,
    *,
    readout: Record | Literal["dense"] | None = None,
    aware: Progress | None = None,
    **widths: Any,
) -> IntegerModel:
    """Quantise the float model in a model folder and write config.json and weights.npz into it; the ranges go
    into training.json. All other fields of config.json stay.

    Parameters
    ----------
    recordings:
        Recordings to profile ranges on (the training data). Without them the ranges noted during training are
        used.
    readout:
        ``dense``: logits decide. A mapping: prototypes decide, made from ``recordings``; it holds groups
        (None: the groups of the training) and further parameters of `eskin.training.prototypes.with_prototypes`.
        None: as in config.json.
    aware:
        Quantisation-aware: the training continues with integers of these widths, with the seed and the recipe
        of the training. The callback gets the updates done. This requires recordings.
    widths:
        weight_bits, state_bits, feature_bits, gate_bits, table_entries: see ``choose_formats``.

    Raises
    ------
    InputError
        When the folder is not a model folder, no format of the requested widths works, or a field of
        config.json cannot be kept (the sentence names it).
    """
    if aware and recordings is None:
        raise InputError("quantise, aware: needs the recordings of the training; give recordings")
    if load_config(model_dir).is_image:
        if aware:
            raise InputError("`quantisation_aware`: is for networks that read recordings; leave it out")
        return _quantise_images(model_dir, recordings, **widths)
    trained = load_trained(model_dir, ranges=recordings is None)
    model, record = trained.model, trained.record
    asked: Record = readout if isinstance(readout, Mapping) else {}
    prototypes = readout != "dense" and (readout is not None or model.config.has_prototypes)
    if prototypes and aware:
        raise InputError(
            f"model '{model_dir}', field readout: is 'prototypes', which would not fit the new weights; quantise "
            "it with `readout` dense first"
        )
    if prototypes:
        options = _of_prototypes(trained, asked, recordings)
    if aware and recordings is not None:
        integer, ranges = _trained_on(model, record, recordings, aware, widths)
    else:
        ranges = (
            _noted_ranges(model_dir, model.config, record)
            if recordings is None
            else profile(model, find_touches(model.config, recordings))
        )
        integer = quantise_model(model, ranges, **widths)
        check_given(integer.config, widths.get("feature_bits"))
    if prototypes and recordings is not None:
        groups = training_groups(recordings, record, options.get("groups"))
        integer = prototypes_from_recordings(
            integer, recordings, groups, **{k: v for k, v in options.items() if k != "groups"}
        )
    record.quantisation_aware, record.widths = bool(aware), widths
    record.ranges = range_records(integer.config, ranges)
    record.quantised = Quantised(config=integer.config.to_dict())
    model.save(model_dir, record, integer, trained.check_unchanged)
    return integer


def _trained_on(
    model: FloatModel, record: Training, recordings: Recordings, progress: Progress, widths: Record
) -> tuple[IntegerModel, dict[str, Range]]:
    """The integers of the network after further training, and its ranges before that."""
    check_widths(model.config, widths)
    check_fit(recordings, model.config)
    recipe = noted_recipe(record, model.config)
    data, seed = find_dataset(recordings, model.config, recipe), record.seed
    rows = touch_rows(data, np.arange(len(recordings)))
    (integer,) = fine_tune(data, recipe, [rows], [model], seed, widths, progress)
    return integer, profile(model, data.touches)


KEPT_OF_READOUT = ("prototypes", "taught", "state_code_bits", "spare_classes", "unknown_above")
"""Fields with which prototypes are made again, unless an option changes them."""


IN_LOGITS = ("margin_threshold", "early_margin")
"""Fields with a margin, which is one of logits or of distances."""


def _of_prototypes(trained: Trained, asked: Record, recordings: Recordings | None) -> Record:
    """Settings of prototypes: as requested, otherwise from config.json.

    Raises
    ------
    InputError
        There are no recordings to make prototypes from, or a margin is one of logits.
    """
    config = trained.current
    if recordings is None:
        raise InputError(
            f"model '{trained.folder}', field readout: is 'prototypes', which are made of the recordings of the "
            "training; give them (`data`), or `readout` dense"
        )
    if config.has_prototypes:
        return {name: config.value(name) for name in KEPT_OF_READOUT} | asked
    if config.network.decision != "vote":  # which counts steps, for logits and prototypes alike
        for field in IN_LOGITS:
            if config.value(field):
                raise InputError(
                    f"model '{trained.folder}', field {field}: is {config.value(field)} in config.json, of logits, "
                    "and prototypes decide by distances; set it to 0 there, and to one of distances afterwards"
                )
    return asked


def _quantise_images(
    model_dir: str | Path,
    recordings: Recordings | None = None,
    *,
    weight_bits: int | None = None,
    **other: Any,
) -> IntegerModel:
    """As `quantise`, for a model for images: weights of 8 or 4 bits and a format for each layer. The formats
    come from ranges profiled on ``recordings``, after the network's internal scales were adapted to them
    (``equalised``), or from the ranges noted during training.

    Raises
    ------
    InputError
        Other widths than ``weight_bits``, which networks for images do not have; no ranges.
    """
    for name, value in other.items():
        if value:
            raise InputError(
                f"{name}: networks for images have no such width; leave it out, or give `weight_bits` 4"
            )
    bits = weight_bits or 8
    check_weight_bits(bits)
    trained = load_trained(model_dir, images=True)
    model, record = trained.model, trained.record
    model = FloatModel(model.config.replace(weight_formats=(), map_formats=()), model.arrays, model.source)
    if recordings is None:
        ranges = _noted(model_dir, model.config, record)
    else:
        check_fit(recordings, model.config)
        images = images_of(recordings)
        model = equalised(model, images, bits)
        ranges = profile_images(model, images)
    integer = integers_of(model, choose_image_formats(model, ranges, bits))
    record.quantisation_aware, record.widths, record.ranges = False, {"weight_bits": bits}, ranges
    record.quantised = Quantised(config=integer.config.to_dict())
    # the float network too: it is the same function at other scales, with which the integers are compared
    # layer by layer
    model.save(model_dir, record, integer, trained.check_unchanged)
    return integer


def _noted(model_dir: str | Path, config: AcceleratorConfig, record: Training) -> dict[str, float]:
    """The ranges that the training record notes."""
    ranges = record.ranges if isinstance(record.ranges, dict) else {}
    noted = {
        name: ranges.get(name, math.nan) for name in {str(stage.number) for stage in config.weighted_stages}
    }
    if not all(math.isfinite(value) and value >= 0 for value in noted.values()):
        raise InputError(
            f"{model_dir}/{TRAINING_FILE}, field ranges: is missing or damaged; give the images it was "
            "trained on (`data`)"
        )
    return noted
