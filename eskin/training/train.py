"""Training: cross-validation, a network fitted on all recordings, and the model folder."""

import dataclasses
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from eskin.data.fit import check_fit
from eskin.golden.core import AcceleratorConfig, Progress, Record
from eskin.golden.data import Recordings
from eskin.golden.model import check_model_target, decide_touches
from eskin.training.crossval import cross_validate, named
from eskin.training.datasets import Datasets, touch_rows
from eskin.training.fit import fit_networks
from eskin.training.losses import Callback, EpochReporter
from eskin.training.quantise import profile, range_records
from eskin.training.recipe import Recipe, choose_recipe
from eskin.training.splits import check_split, default_splits


@dataclass(frozen=True, kw_only=True)
class TrainingRequest:
    """Settings of cross-validation and training of a network of a configuration.

    Parameters
    ----------
    folds:
        Folds of the cross-validation; 0 = none. With no more groups than folds each is left out in turn.
    splits:
        Group names of each split; None: every split the configuration names (``default_splits``).
    seed, seeds:
        First seed, which is also that of the network written; number of seeds over which the cross-validation
        averages.
    protocol:
        ``default``, ``robust`` (``choose_recipe``) or ``thesis`` (last-step loss, Adam, 96 epochs of batch
        48; splits stratified by class).
    recipe:
        Recipe in place of that of the protocol.
    known:
        Records of splits over which this network, recipe and seeds were cross-validated before; these are not
        repeated.
    """

    folds: int = 5
    splits: Sequence[Sequence[str]] | None = None
    seed: int = 0
    seeds: int = 3
    protocol: str = "default"
    recipe: Recipe | None = None
    known: Sequence[Record] = ()


def train(
    recordings: Recordings,
    config: AcceleratorConfig,
    request: TrainingRequest | None = None,
    *,
    out: str | Path,
    datasets: Datasets | None = None,
    notes: Callable[[Record], Record] | None = None,
    progress: Progress | None = None,
    callback: Callback | None = None,
) -> Record:
    """Cross-validate, fit a network on ALL recordings, and write the model folder (config.json, float.npz,
    training.json).

    Parameters
    ----------
    request:
        None: the defaults of `TrainingRequest`.
    out:
        A new folder, or a model folder, which is replaced.
    datasets:
        Touches that were found before.
    notes:
        Called with the record before it is written; its result is added to the record.
    callback:
        Called while the network on all recordings is trained: with {``loss``} at each epoch of a recurrent
        cell, and at the end, as one epoch more, with {``accuracy``}, the share of the training touches that
        the float network classifies correctly.

    Returns
    -------
    The training record, as written to training.json: seed, recipe, config, data, recordings, touched,
    parameters, ranges, cross_validation (``cross_validate``), versions, wall_s.

    Raises
    ------
    InputError
        Before any work: a folder that must not be replaced, an unknown group, a network or protocol that does
        not exist.
    """
    begin = time.perf_counter()
    check_model_target(out)
    request = request or TrainingRequest()
    recipe = request.recipe or choose_recipe(config, request.protocol)
    seed = request.seed
    check_fit(recordings, config)
    datasets = datasets or Datasets(recordings)
    results = (
        _cross_validation(recordings, config, request, recipe, datasets, progress) if request.folds else []
    )

    data = datasets.of(config, recipe)
    rows = touch_rows(data, np.arange(len(recordings)))
    reporter = EpochReporter(callback) if callback else None
    report = named(progress, "training on all recordings")
    (model,) = fit_networks(data, config, recipe, [rows], seed, report, reporter)
    if reporter:
        decided = decide_touches(model, data.touches.take(rows)).decision
        reporter.tell(accuracy=float(np.mean(decided == data.labels[data.index >= 0][rows])))
    ranges = profile(model, data.touches)
    record = {
        "seed": seed,
        "recipe": dataclasses.asdict(recipe),
        "config": config.to_dict(),
        "data": str(recordings.source),
        "unit": recordings.unit,
        "channel_names": list(recordings.channel_names),
        "recordings": len(recordings),
        "touched": int((data.index >= 0).sum()),
        "parameters": model.config.parameter_count,
        "ranges": range_records(config, ranges),
        "cross_validation": results,
        "versions": {"torch": torch.__version__, "numpy": np.__version__},
        "wall_s": time.perf_counter() - begin,
    }
    if notes:
        record |= notes(record)
        record["wall_s"] = time.perf_counter() - begin  # notes may take long
    record = json.loads(json.dumps(record))  # as the file will hold it: lists, not tuples
    model.save(out, record)
    return record


def _cross_validation(
    recordings: Recordings,
    config: AcceleratorConfig,
    request: TrainingRequest,
    recipe: Recipe,
    datasets: Datasets,
    progress: Progress | None,
) -> list[Record]:
    """A record for each split of the request, in its order."""
    splits = request.splits
    if splits is None:
        splits = [[]] if request.protocol == "thesis" else default_splits(recordings, config)
    for groups in splits:
        check_split(recordings, groups, request.folds)  # refuses before the work begins
    records = {tuple(record["groups"]): record for record in request.known}
    missing = [list(groups) for groups in splits if tuple(groups) not in records]
    if missing:
        fresh = cross_validate(
            recordings,
            config,
            missing,
            range(request.seed, request.seed + request.seeds),
            folds=request.folds,
            recipe=recipe,
            datasets=datasets,
            progress=progress,
        )
        records |= {tuple(record["groups"]): record for record in fresh}
    return [records[tuple(groups)] for groups in splits]
