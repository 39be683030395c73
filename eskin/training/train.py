"""Training: a network fitted on all recordings, and the model folder."""

import dataclasses
import time
from pathlib import Path

import numpy as np
import torch

from eskin.data.fit import check_fit
from eskin.golden.core import AcceleratorConfig, Progress
from eskin.golden.data import Recordings
from eskin.golden.model import check_model_target, decide_touches
from eskin.training.datasets import Datasets, touch_rows
from eskin.training.fit import fit_networks
from eskin.training.judge import named
from eskin.training.losses import Callback, EpochReporter
from eskin.training.quantise import profile, range_records
from eskin.training.recipe import Recipe, choose_recipe
from eskin.training.record import Training


def train(
    recordings: Recordings,
    config: AcceleratorConfig,
    *,
    out: str | Path,
    recipe: Recipe | None = None,
    seed: int = 0,
    datasets: Datasets | None = None,
    notes: Training | None = None,
    progress: Progress | None = None,
    callback: Callback | None = None,
) -> Training:
    """Fit a network on ALL recordings, and write the model folder (config.json, float.npz, training.json).

    Parameters
    ----------
    recipe:
        None: from ``choose_recipe``.
    out:
        A new folder, or a model folder, which is replaced.
    datasets:
        Touches that were found before.
    notes:
        Further fields of the record, with the time that they took.
    callback:
        Called while the network is trained: with {``loss``} at each epoch of a recurrent cell, and at the end, as
        one epoch more, with {``accuracy``}, the share of the training touches that the float network classifies
        correctly.

    Returns
    -------
    The training record, as written to training.json.

    Raises
    ------
    InputError
        Before any work: a folder that must not be replaced, recordings that do not fit the configuration.
    """
    begin = time.perf_counter()
    check_model_target(out)
    check_fit(recordings, config)
    recipe = recipe or choose_recipe(config)
    data = (datasets or Datasets(recordings)).of(config, recipe)
    rows = touch_rows(data, np.arange(len(recordings)))
    reporter = EpochReporter(callback) if callback else None
    report = named(progress, "training on all recordings")
    (model,) = fit_networks(data, config, recipe, [rows], seed, report, reporter)
    if reporter:
        decided = decide_touches(model, data.touches.take(rows)).decision
        reporter.tell(accuracy=float(np.mean(decided == data.labels[data.index >= 0][rows])))
    record = notes or Training(cross_validation=[])
    record.seed, record.recipe, record.config = seed, dataclasses.asdict(recipe), model.config.to_dict()
    record.data, record.unit = str(recordings.source), recordings.unit
    record.channel_names = list(recordings.channel_names)
    record.recordings, record.touched = len(recordings), len(data.touches)
    record.parameters = model.config.parameter_count
    record.ranges = range_records(model.config, profile(model, data.touches))
    record.versions = {"torch": torch.__version__, "numpy": np.__version__}
    record.wall_s += time.perf_counter() - begin
    model.save(out, record)
    return record
