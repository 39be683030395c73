"""A trained network trained on in integer arithmetic, of few bits: what `eskin quantise --quantisation-aware`
does."""

from pathlib import Path
from typing import Any

import numpy as np

from eskin.data.fit import check_fit
from eskin.golden.core import InputError, Record
from eskin.golden.data import Recordings
from eskin.golden.model import FloatModel, IntegerModel, images_of, load_config
from eskin.training.datasets import find_dataset, touch_rows
from eskin.training.fit import fine_tune, one_thread
from eskin.training.image_formats import check_weight_bits, profile_images
from eskin.training.losses import Progress
from eskin.training.quantise import check_widths, profile, range_records
from eskin.training.recipe import Recipe, choose_recipe
from eskin.training.train_images import ImageRecipe, tune_network
from eskin.training.trained import load_trained, written_by


def train_in_integers(
    model_dir: str | Path,
    recordings: Recordings,
    progress: Progress = lambda done, total: None,
    **widths: Any,
) -> IntegerModel:
    """Train the network of a model folder on with the integers of these widths, and write both into it; the
    seed and the recipe are those of its training.

    Parameters
    ----------
    recordings:
        Those of the training.
    widths:
        As for `eskin.training.quantise.quantise`.

    Raises
    ------
    InputError
        The folder is no model folder, or no format of the asked widths works.
    """
    if load_config(model_dir).is_image:
        return _images(model_dir, recordings, widths.get("weight_bits") or 8, progress)
    trained = load_trained(model_dir)
    model, record = trained.model, trained.record
    config, seed = model.config, int(record.get("seed", 0))
    if config.has_prototypes:
        raise InputError(
            f"model '{model_dir}', field readout: is 'prototypes', which weights trained on would not fit; quantise "
            "it with --readout dense first"
        )
    check_widths(config, **widths)
    check_fit(recordings, config)
    recipe = Recipe(**record["recipe"]) if "recipe" in record else choose_recipe(config)
    data = find_dataset(recordings, config, recipe)
    rows = touch_rows(data, np.arange(len(recordings)))
    (integer,) = fine_tune(data, recipe, [rows], [model], seed, widths, progress)
    trained.check_kept(integer.config, widths)
    ranges = range_records(integer.config, profile(model, data.touches))
    record |= _trained_on(widths) | {"ranges": ranges, **written_by(config, integer)}
    integer.save(model_dir, training=record, unchanged=trained.files)
    return integer


def _images(model_dir: str | Path, recordings: Recordings, bits: int, progress: Progress) -> IntegerModel:
    check_weight_bits(bits)
    trained = load_trained(model_dir, images=True)
    model, record = trained.model, trained.record
    model = FloatModel(model.config.replace(weight_formats=(), map_formats=()), model.arrays, model.source)
    check_fit(recordings, model.config)
    recipe = ImageRecipe(**record["recipe"]) if "recipe" in record else ImageRecipe()
    images = images_of(recordings)
    with one_thread():
        tuned, integer = tune_network(
            model,
            images,
            recordings.labels,
            weight_bits=bits,
            recipe=recipe,
            seed=int(record.get("seed", 0)),
            progress=progress,
        )
    trained.check_kept(integer.config, {"weight_bits": bits})
    record |= _trained_on({"weight_bits": bits}) | {"ranges": profile_images(model, images)}
    record |= written_by(trained.model.config, integer)
    tuned.save(model_dir, record, integer, trained.files)
    return integer


def _trained_on(widths: Record) -> Record:
    return {"quantisation_aware": True, "widths": dict(widths)}
