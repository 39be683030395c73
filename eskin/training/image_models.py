"""Model folders of networks for images: cross-validation, training, quantisation and evaluation, for `eskin
train`, `quantise` and `evaluate` with an archive of images.

``auto`` trains three networks of NETWORKS on the same folds and takes, of those level with the best
(`eskin.training.level`), the one with the fewest multiplies.
"""

import dataclasses
import itertools
import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eskin.data.fit import check_fit
from eskin.golden.core import NETWORKS, AcceleratorConfig, Arrays, InputError, Progress, Record, content_key
from eskin.golden.core.images import network
from eskin.golden.data import Recordings
from eskin.golden.model import check_model_target, images_of
from eskin.golden.model.image_network import image_seconds
from eskin.jobs import Jobs
from eskin.memo import Memo
from eskin.training.crossval import FoldDecisions, named, split_record
from eskin.training.fit import one_thread
from eskin.training.image_formats import profile_images
from eskin.training.level import is_level
from eskin.training.splits import split_folds
from eskin.training.train_images import CODE, ImageFold, ImageRecipe, judge, size_of, train_network

AUTO = "auto"
CANDIDATES = ("tactnet", "four", "tactnet-half")
"""Networks among which ``auto`` chooses."""

CHOOSING_EPOCHS = 60
"""Epochs for training a candidate; the one taken is trained with the recipe's number of epochs."""

KEPT = Path("build/image_networks")
"""Cache of judged networks of cross-validations, by content; shared by all verbs, safe to delete."""


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


def chosen_config(
    recordings: Recordings, requested: AcceleratorConfig | None, cell: str | None
) -> AcceleratorConfig | None:
    """The requested configuration, checked against the images; None: the network is to be chosen."""
    if cell in NETWORKS:
        return image_config(recordings, cell)
    if cell not in (None, AUTO):
        raise InputError(
            f"--cell {cell}: reads recordings, and {recordings.source} holds images; use "
            f"{', '.join(NETWORKS)} or auto"
        )
    if requested is None or cell == AUTO:
        return None
    check_fit(recordings, requested)
    return requested.replace(weight_formats=(), map_formats=())


# ---------------------------------------------------------------------- training
def train_image_model(
    recordings: Recordings,
    requested: AcceleratorConfig | None,
    *,
    out: str | Path,
    cell: str | None = None,
    group: Sequence[str] | None = None,
    folds: int = 5,
    seed: int = 0,
    seeds: int = 1,
    recipe: ImageRecipe | None = None,
    keep: Memo | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Record:
    """Cross-validate (and choose the network if none was requested), fit it to all images, and write the
    model folder.

    Parameters
    ----------
    asked, cell:
        The requested configuration, or a name of NETWORKS, or ``auto``; neither: ``auto``.
    seeds:
        Networks of each fold, from ``seed`` on.
    keep:
        Folder in which trained and judged networks are cached; None: no cache.

    Returns
    -------
    The training record, as `eskin.training.train.train` gives it.

    Raises
    ------
    InputError
        Images and configuration do not fit each other; raised before any long work.
    """
    begin = time.perf_counter()
    check_model_target(out)
    recipe = recipe or ImageRecipe()
    config = chosen_config(recordings, requested, cell)
    if config is None and not folds:
        raise InputError(
            f"--cell auto: needs cross-validation; leave --folds 0 out or name one of {', '.join(NETWORKS)}"
        )
    candidates = [config] if config else [image_config(recordings, name) for name in CANDIDATES]
    judged_by = recipe if config else dataclasses.replace(recipe, epochs=min(recipe.epochs, CHOOSING_EPOCHS))
    images, groups = images_of(recordings), list(group or [])
    rows: list[Record] = []
    records: list[Record] = []
    if folds:
        jobs, many = Jobs(workers=workers, progress=progress), list(range(seed, seed + seeds))
        pieces = [fold_jobs(recordings, network, groups, folds, many, judged_by) for network in candidates]
        sized = {size_of(candidates[0]): images}
        results = judged_pieces(
            sized, recordings.labels, pieces, jobs, keep, "networks of the cross-validation", judge
        )
        for of_one in zip(candidates, pieces, results, strict=True):
            records.append(split_of(recordings, of_one[0], groups, *of_one[1:], many, "w8"))
        rows = _candidate_rows(candidates, records, [record.pop("correct") for record in records], seeds)
    chosen = next((index for index, row in enumerate(rows) if row["chosen"]), 0)
    config = candidates[chosen]
    with one_thread():
        report = named(progress, "training on all images, epochs")
        model = train_network(config, images, recordings.labels, recipe=recipe, seed=seed, progress=report)
    record: Record = {
        "seed": seed,
        "recipe": dataclasses.asdict(recipe),
        "config": config.to_dict(),
        "data": str(recordings.source),
        "recordings": len(recordings),
        "parameters": config.parameter_count,
        "multiplies": config.multiplies,
        "ranges": profile_images(model, images),
        "cross_validation": [records[chosen]] if records else [],
        "baselines": [],
        "doubts": [],
        "warnings": [],
        "reasons": list(recordings.notes),
        "wall_s": time.perf_counter() - begin,
    }
    if len(candidates) > 1:
        record["candidates"] = rows
    record = json.loads(json.dumps(record))
    model.save(out, record)
    return record


def fold_jobs(
    recordings: Recordings,
    config: AcceleratorConfig,
    groups: list[str],
    folds: int,
    seeds: Sequence[int],
    recipe: ImageRecipe,
) -> list[list[ImageFold]]:
    """A list for each seed, with a piece for each fold."""
    pieces = []
    for seed in seeds:
        parts = split_folds(recordings, groups, folds, seed if not groups else None)
        pieces.append([ImageFold(config, tuple(map(int, part)), seed, recipe) for part in parts])
    return pieces


def judged_pieces(
    images: Arrays,
    labels: np.ndarray,
    pieces: Sequence[list[list[ImageFold]]],
    jobs: Jobs,
    keep: Memo | None,
    what: str,
    judging: Callable[[Any, ImageFold], Record],
) -> list[list[list[Record]]]:
    """The result of each piece of several networks, in their order, from `eskin.training.train_images.judge`
    or a function that replaces it.

    Parameters
    ----------
    images, labels:
        Images by their size (`eskin.training.train_images.size_of`), all of the same labels.
    pieces:
        For each network a list for each seed, in it a piece for each fold.
    jobs, keep, what:
        As for `eskin.jobs.Jobs.results`. A result is named by everything that it depends on, code included.
    """
    code = CODE()
    of_images = {size: content_key(pixels, labels, code) for size, pixels in images.items()}

    def key(piece: ImageFold) -> str:
        options = [list(piece.left_out), piece.seed, dataclasses.asdict(piece.recipe)]
        return content_key(of_images[size_of(piece.config)], piece.config.to_dict(), *options)

    # a fold of every network before the next fold: then an interrupted sweep has cached results of all
    # networks
    turns = itertools.zip_longest(*(of_seed for of_network in pieces for of_seed in of_network))
    keyed = {key(piece): piece for turn in turns for piece in turn if piece is not None}
    results = jobs.results(judging, keyed, (dict(images), labels), keep=keep, what=what)
    return [[[results[key(piece)] for piece in of_seed] for of_seed in of_network] for of_network in pieces]


def split_of(
    recordings: Recordings,
    config: AcceleratorConfig,
    groups: list[str],
    pieces: list[list[ImageFold]],
    results: list[list[Record]],
    seeds: list[int],
    integers: str,
) -> Record:
    """The record of a cross-validation, as `eskin.training.crossval.cross_validate` gives it, from
    ``fold_jobs`` and their results, and ``correct``: the share of seeds whose integers were right, for each
    image. integers: the key of the results that count."""
    correct, records = np.zeros(len(recordings)), []
    for seed, of_seed, outcomes in zip(seeds, pieces, results, strict=True):  # every seed deals its own folds
        tests, decided = [np.array(piece.left_out) for piece in of_seed], []
        for test, result in zip(tests, outcomes, strict=True):
            ideal, whole = np.array(result["float"]), np.array(result[integers])
            correct[test] += (whole == recordings.labels[test]) / len(seeds)
            decided.append([FoldDecisions.from_images(ideal, whole, config)])
        records.append(split_record(recordings, groups, tests, decided, [seed], [image_seconds(config)]))
    record = records[0] | {"seeds": seeds, "correct": correct}
    for kind in ("float", "integer"):
        by_seed = [of_seed[f"{kind}_accuracy"] for of_seed in records]
        record |= {f"{kind}_accuracy": float(np.mean(by_seed)), f"{kind}_by_seed": by_seed}
    return record | {"agreement": float(np.mean([of_seed["agreement"] for of_seed in records]))}


def _candidate_rows(
    candidates: Sequence[AcceleratorConfig],
    records: Sequence[Record],
    correct: Sequence[np.ndarray],
    seeds: int,
) -> list[Record]:
    """Rows of each network for training.json; of those tied with the best the one with the fewest multiplies
    is chosen.

    correct: for each network the share of seeds that were right, for each image.
    """
    accuracies = [float(shares.mean()) for shares in correct]
    best = correct[int(np.argmax(accuracies))]
    enough = [index for index, shares in enumerate(correct) if is_level(best, shares)]
    cheapest = min(enough, key=lambda index: candidates[index].multiplies)
    return [
        {
            "cell": config.name,
            "hidden": 0,
            "recipe": "images",
            "accuracy": accuracies[index],
            "standard_error": float(correct[index].std(ddof=1) / np.sqrt(len(correct[index]))),
            "float_accuracy": record["float_accuracy"],
            "agreement": record["agreement"],
            "multiplies_touch": config.multiplies,
            "multiplies_step": config.multiplies,
            "parameters": config.parameter_count,
            "seeds": seeds,
            "chosen": index == cheapest,
        }
        for index, (config, record) in enumerate(zip(candidates, records, strict=True))
    ]
