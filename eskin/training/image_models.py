"""Model folders of networks for images: cross-validation, training, quantisation and evaluation, for `eskin
train`, `quantise` and `evaluate` with an archive of images.

``auto`` trains three networks of NETWORKS on the same folds and takes, of those level with the best
(`eskin.training.level`), the network with the fewest multiplies.
"""

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from eskin.data.fit import check_fit
from eskin.golden.core import NETWORKS, AcceleratorConfig, InputError, Progress, Record, content_key
from eskin.golden.core.images import network
from eskin.golden.data import Recordings
from eskin.golden.model import check_model_target, images_of
from eskin.golden.model.image_network import image_seconds
from eskin.jobs import Jobs
from eskin.memo import Memo
from eskin.training.fit import one_thread
from eskin.training.image_formats import profile_images
from eskin.training.judge import Decided, Rows, folds_of, judge, named
from eskin.training.level import is_level
from eskin.training.record import NetworkRow, Split, Training
from eskin.training.settings import TrainingSettings
from eskin.training.splits import split_folds
from eskin.training.train_images import CODE, ImageFold, ImageRecipe, judge_fold, train_network

AUTO = "auto"
CANDIDATES = ("tactnet", "four", "tactnet-half")
"""Networks among which ``auto`` chooses."""

CHOOSING_EPOCHS = 60
"""Epochs for training a candidate; the network taken is trained with the recipe's number of epochs."""

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
            f"`cell` {cell}: reads recordings, and {recordings.source} holds images; use "
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
    wanted: TrainingSettings,
    *,
    recipe: ImageRecipe | None = None,
    keep: Memo | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Training:
    """Cross-validate (and choose the network if none was requested), fit it to all images, and write the
    model folder.

    Parameters
    ----------
    requested:
        The requested configuration; None, and no cell of NETWORKS in the request: the network is chosen.
    wanted:
        Its ``seeds``, 1 by default, are networks of each fold.
    keep:
        Folder in which trained and judged networks are cached; None: no cache.

    Returns
    -------
    The training record, as `eskin.training.train.train` gives it.

    Raises
    ------
    InputError
        Images and configuration do not fit each other, or a request that networks for images cannot meet; raised
        before any long work.
    """
    begin, folds, seed, seeds = time.perf_counter(), wanted.folds, wanted.seed, wanted.seeds or 1
    check_model_target(wanted.out)
    usual = {"hidden": None, "reset": None, "protocol": "default", "fits": None, "prefer": "energy"}
    for name, value in usual.items():
        if getattr(wanted, name) != value:
            raise InputError(
                f"`{name}`: networks for images have none, and '{recordings.source}' holds images; leave it out"
            )
    recipe = recipe or ImageRecipe()
    config = chosen_config(recordings, requested, wanted.cell)
    if config is None and not folds:
        raise InputError(
            f"`cell` auto: needs cross-validation; leave `folds` 0 out or name one of {', '.join(NETWORKS)}"
        )
    candidates = [config] if config else [image_config(recordings, name) for name in CANDIDATES]
    judged_by = recipe if config else dataclasses.replace(recipe, epochs=min(recipe.epochs, CHOOSING_EPOCHS))
    images = images_of(recordings)
    rows: list[NetworkRow] = []
    records: list[Split] = []
    if folds:
        jobs, groups = Jobs(workers=workers, progress=progress), list(wanted.groups or [])
        everything = np.arange(len(recordings))
        every = [  # every seed deals other folds
            fold
            for each in range(seed, seed + seeds)
            for fold in folds_of(
                split_folds(recordings, groups, folds, each if not groups else None), [each], everything
            )
        ]
        decisions = [
            judge(ImageLearner(recordings, config, judged_by, jobs, keep), every, recordings.labels)
            for config in candidates
        ]
        records = [
            of_network.record(recordings, groups, [image_seconds(config)])
            for config, of_network in zip(candidates, decisions, strict=True)
        ]
        correct = [of_network.correct.to_numpy() for of_network in decisions]
        rows = _candidate_rows(candidates, records, correct, seeds)
    chosen = next((index for index, row in enumerate(rows) if row.chosen), 0)
    config = candidates[chosen]
    with one_thread():
        report = named(progress, "training on all images, epochs")
        model = train_network(config, images, recordings.labels, recipe=recipe, seed=seed, progress=report)
    named(progress, "measuring ranges on all images")(0, 0)
    record = Training(
        seed=seed,
        recipe=asdict(recipe),
        config=config.to_dict(),
        data=str(recordings.source),
        recordings=len(recordings),
        parameters=config.parameter_count,
        multiplies=config.multiplies,
        ranges=profile_images(model, images),
        cross_validation=records[chosen : chosen + 1],
        baselines=[],
        doubts=[],
        warnings=[],
        reasons=list(recordings.notes),
        wall_s=time.perf_counter() - begin,
    )
    if len(candidates) > 1:
        record.candidates = [*rows]
    model.save(wanted.out, record)
    return record


@dataclass(frozen=True, eq=False)
class ImageDecider:
    """Decisions of one network on the images that it was trained without. result: as of
    `eskin.training.train_images.judge_fold`."""

    fold: ImageFold
    result: Record

    def decide(self, rows: Rows) -> Decided:
        """As `eskin.training.judge.Decider.decide`, for some of these images."""
        places = np.searchsorted(self.fold.left_out, rows)
        real, integer = (np.array(self.result[kind])[places] for kind in ("float", "integer"))
        return Decided.at_once(real, integer)


@dataclass(frozen=True, eq=False)
class ImageLearner:
    """A network for images. A result is kept under a name of everything that it depends on, code included."""

    recordings: Recordings
    config: AcceleratorConfig
    recipe: ImageRecipe
    jobs: Jobs
    keep: Memo | None

    def fit(
        self, parts: Sequence[Rows], seeds: Sequence[int], progress: Progress | None = None
    ) -> list[ImageDecider]:
        """As `eskin.training.judge.Learner.fit`, in one job for each part."""
        everything, labels = np.arange(len(self.recordings)), self.recordings.labels
        folds = [
            ImageFold(self.config, tuple(map(int, np.setdiff1d(everything, part))), seed, self.recipe)
            for part, seed in zip(parts, seeds, strict=True)
        ]
        images = images_of(self.recordings)
        content = content_key(images, labels, CODE())
        keys = [
            content_key(content, fold.config.to_dict(), list(fold.left_out), fold.seed, asdict(fold.recipe))
            for fold in folds
        ]
        results = self.jobs.results(
            judge_fold,
            dict(zip(keys, folds, strict=True)),
            (images, labels),
            keep=self.keep,
            what=f"networks {self.config.name} trained and judged",
        )
        return [ImageDecider(fold, results[key]) for key, fold in zip(keys, folds, strict=True)]


def _candidate_rows(
    candidates: Sequence[AcceleratorConfig],
    records: Sequence[Split],
    correct: Sequence[np.ndarray],
    seeds: int,
) -> list[NetworkRow]:
    """Rows of each network for training.json; of networks tied with the best that with the fewest multiplies
    is chosen.

    correct: for each network the share of seeds that were right, for each image.
    """
    accuracies = [float(shares.mean()) for shares in correct]
    best = correct[int(np.argmax(accuracies))]
    enough = [index for index, shares in enumerate(correct) if is_level(best, shares)]
    cheapest = min(enough, key=lambda index: candidates[index].multiplies)
    return [
        NetworkRow(
            cell=config.name,
            hidden=0,
            recipe="images",
            accuracy=accuracies[index],
            standard_error=correct[index].std(ddof=1) / np.sqrt(len(correct[index])),
            float_accuracy=record.float_accuracy,
            agreement=record.agreement,
            multiplies_touch=config.multiplies,
            multiplies_step=config.multiplies,
            parameters=config.parameter_count,
            seeds=seeds,
            chosen=index == cheapest,
        )
        for index, (config, record) in enumerate(zip(candidates, records, strict=True))
    ]
