"""Cross-validation: accuracy on recordings that a network has not seen, in float and integer, all folds and
seeds at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, TypeVar

import numpy as np

from eskin.golden.core import AcceleratorConfig, Progress, Record
from eskin.golden.data import Recordings
from eskin.golden.model import FloatModel, IntegerModel, decide_touches
from eskin.golden.model.pipeline import by_recording
from eskin.training.datasets import Dataset, Datasets, touch_rows
from eskin.training.fit import fit_networks, post_training
from eskin.training.recipe import Recipe, choose_recipe
from eskin.training.splits import held_out, over_groups, split_folds
from eskin.training.times import step_rows, step_times


def cross_validate(
    recordings: Recordings,
    config: AcceleratorConfig,
    splits: Sequence[Sequence[str]],
    seeds: Sequence[int] = (0, 1, 2),
    *,
    folds: int = 5,
    recipe: Recipe | None = None,
    widths: Record | None = None,
    datasets: Datasets | None = None,
    progress: Progress | None = None,
) -> list[Record]:
    """Accuracy on recordings that a network has not seen, float and integer, for every split; all folds and
    seeds train at once.

    Every fold's network is quantised after training, with ranges profiled on its own training part. A
    recording without a touch, or without the step in question, counts as wrong.

    Parameters
    ----------
    splits:
        Group names for each split (``label`` is the class); empty: stratified by class.
    seeds:
        A network for each fold and seed; figures are means over seeds of the share of recordings.
    widths:
        Bits, as ``eskin.training.quantise.choose_formats`` takes them.
    datasets:
        Touches that were found before.

    Returns
    -------
    A record for each split: groups, folds, seeds, float_accuracy, integer_accuracy, agreement, integer_spread
    (standard deviation over folds x seeds), integer_by_seed (accuracy over all folds), per_step (step, time_s since
    the onset, float_accuracy, integer_accuracy), decision_time_s (of the global decision since the onset, mean,
    integer; None: no decision), standard_error and range (``over_groups``, integer), per_fold (held_out, recordings, float_accuracy,
    integer_accuracy, agreement, by_seed), confusion (integer model, summed over seeds: rows = true class,
    columns = decided, last column = none).
    """
    recipe, datasets = recipe or choose_recipe(config), datasets or Datasets(recordings)
    tests = [split_folds(recordings, groups, folds, None) for groups in splits]
    every = [test for of_split in tests for test in of_split]
    jobs = fold_jobs(config, recipe, len(recordings), every, seeds)
    trained = train_folds(datasets, jobs, int(seeds[0]), progress, widths)
    by_fold = iter(seed_by_seed([network.decided() for network in trained], len(every)))
    times = step_times(config, datasets.of(config, recipe).touches)
    return [
        split_record(recordings, groups, of_split, list(islice(by_fold, len(of_split))), seeds, times)
        for groups, of_split in zip(splits, tests, strict=True)
    ]


Run = TypeVar("Run")


def seed_by_seed(runs: Sequence[Run], folds: int) -> list[Sequence[Run]]:
    """Runs of all folds with the first seed, then with the next, as a list for each fold."""
    return [runs[fold::folds] for fold in range(folds)]


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossValidationSettings:
    """Shared settings of cross-validation.

    groups: arrays whose values are left out. seeds: one for each network of a fold. stress: disturbances for
    a second score.
    """

    recordings: Recordings
    groups: Sequence[str]
    datasets: Datasets
    seeds: Sequence[int] = (0, 1, 2)
    folds: int = 5
    progress: Progress | None = None
    stress: Any = None

    def called(self, name: str) -> Progress | None:
        """A progress callback that adds ``name`` to the names of tasks."""
        progress = self.progress
        return progress and (lambda task, done, total: progress(f"{task}, {name}", done, total))


@dataclass(frozen=True, eq=False)
class FoldJob:
    """One network to train on the recordings ``train`` and to test on ``test``; each ``copy`` has other
    initial weights."""

    config: AcceleratorConfig
    recipe: Recipe
    train: np.ndarray
    test: np.ndarray
    copy: int = 0


def fold_jobs(
    config: AcceleratorConfig, recipe: Recipe, count: int, tests: Sequence[np.ndarray], seeds: Sequence[int]
) -> list[FoldJob]:
    """A job for each of ``tests`` left out of ``count`` recordings, seed by seed."""
    everything = np.arange(count)
    return [
        FoldJob(config, recipe, np.setdiff1d(everything, test), test, copy)
        for copy in range(len(seeds))
        for test in tests
    ]


@dataclass(frozen=True, eq=False)
class Trained:
    """The network of a job, float and integer."""

    job: FoldJob
    real: FloatModel
    integer: IntegerModel
    data: Dataset

    def decided(self) -> FoldDecisions:
        """Decisions on its test recordings."""
        return _judge(self.real, self.integer, self.data, self.job.test)


def train_folds(
    datasets: Datasets,
    jobs: Sequence[FoldJob],
    seed: int,
    progress: Progress | None = None,
    widths: Record | None = None,
) -> list[Trained]:
    """The network of each job, quantised with ranges of its own training part.

    Networks of one configuration and recipe train at once. Jobs with the same training part share one
    network.
    """
    trained: dict[FoldJob, tuple[FloatModel, IntegerModel]] = {}
    kinds: dict[tuple[AcceleratorConfig, Recipe], dict[tuple[int, bytes], list[FoldJob]]] = {}
    for job in jobs:
        alike = kinds.setdefault((job.config, job.recipe), {})
        alike.setdefault((job.copy, job.train.tobytes()), []).append(job)
    for (config, recipe), alike in kinds.items():
        data = datasets.of(config, recipe)
        parts = [touch_rows(data, sharing[0].train) for sharing in alike.values()]
        models = fit_networks(data, config, recipe, parts, seed, named(progress, "cross-validation"))
        for model, rows, sharing in zip(models, parts, alike.values(), strict=True):
            trained |= dict.fromkeys(sharing, (model, post_training(model, data, rows, widths or {})))
    return [Trained(job, *trained[job], datasets.of(job.config, job.recipe)) for job in jobs]


def named(progress: Progress | None, activity: str) -> Callable[[int, int], None]:
    return (lambda done, total: progress(activity, done, total)) if progress else (lambda done, total: None)


@dataclass(frozen=True, eq=False)
class FoldDecisions:
    """Decisions of one network on its test part: global (r) and local (r, K), -1 none, float and integer; the
    step (r) after which the integer global one was given, -1 none; the configuration with its formats."""

    float_global: np.ndarray
    float_local: np.ndarray
    integer_global: np.ndarray
    integer_local: np.ndarray
    integer_step: np.ndarray
    config: AcceleratorConfig

    @classmethod
    def from_images(cls, ideal: np.ndarray, whole: np.ndarray, config: AcceleratorConfig) -> FoldDecisions:
        """Float and integer decisions on images, each made in one step."""
        return cls(ideal, ideal[:, None], whole, whole[:, None], np.zeros_like(whole), config)


def _judge(model: FloatModel, integer: IntegerModel, data: Dataset, test: np.ndarray) -> FoldDecisions:
    rows = data.index[test]
    touches = data.touches.take(rows[rows >= 0])
    placed = np.where(rows >= 0, np.cumsum(rows >= 0) - 1, -1)
    real = decide_touches(model, touches, config=integer.config)
    exact = decide_touches(integer, touches)
    return FoldDecisions(
        by_recording(real.decision, placed),
        by_recording(real.local, placed),
        by_recording(exact.decision, placed),
        by_recording(exact.local, placed),
        by_recording(exact.step, placed),
        integer.config,
    )


SHARES = ("float_accuracy", "integer_accuracy", "agreement")


def fold_records(
    recordings: Recordings,
    groups: Sequence[str],
    tests: Sequence[np.ndarray],
    decided: Sequence[Sequence[FoldDecisions]],
) -> list[Record]:
    """For each fold: the groups held out, the number of recordings, and SHARES as means over seeds and by
    seed. decided: a list for each fold, in it one entry for each seed."""
    records = []
    for test, runs in zip(tests, decided, strict=True):
        right = recordings.labels[test]
        shares = {
            "float_accuracy": [float(np.mean(run.float_global == right)) for run in runs],
            "integer_accuracy": [float(np.mean(run.integer_global == right)) for run in runs],
            "agreement": [float(np.mean(run.float_global == run.integer_global)) for run in runs],
        }
        means = {key: float(np.mean(values)) for key, values in shares.items()}
        name = held_out(recordings, groups, test)
        records.append({"held_out": name, "recordings": len(test), "by_seed": shares} | means)
    return records


def over_folds(per_fold: Sequence[Record]) -> dict[str, float]:
    """SHARES over all recordings."""
    weights = [fold["recordings"] for fold in per_fold]
    return {key: float(np.average([fold[key] for fold in per_fold], weights=weights)) for key in SHARES}


def share_right(labels: np.ndarray, tests: Sequence[np.ndarray], runs: Sequence[FoldDecisions]) -> np.ndarray:
    """(recordings) share of the integer networks that classified the recording correctly, among those that
    were not trained on it."""
    right, judged = np.zeros(len(labels)), np.zeros(len(labels))
    for test, run in zip(tests, runs, strict=True):
        right[test] += run.integer_global == labels[test]
        judged[test] += 1
    return right / np.maximum(judged, 1)


def split_record(
    recordings: Recordings,
    groups: Sequence[str],
    tests: Sequence[np.ndarray],
    decided: Sequence[Sequence[FoldDecisions]],
    seeds: Sequence[int],
    times: Sequence[float] | np.ndarray,
) -> Record:
    """The record of one split, as ``cross_validate`` returns it. decided: a list for each fold, in it one entry
    for each seed. times: seconds of each step."""
    classes = len(recordings.class_names)
    confusion = np.zeros((classes, classes + 1), dtype=np.int64)
    steps, correct = np.zeros((2, len(times))), np.zeros(len(recordings))
    for test, runs in zip(tests, decided, strict=True):
        labels = recordings.labels[test]
        for run in runs:
            correct[test] += (run.integer_global == labels) / len(runs)
            np.add.at(confusion, (labels, run.integer_global), 1)  # -1, no decision, is the last column
            for row, local in enumerate((run.float_local, run.integer_local)):
                steps[row] += (local == labels[:, None]).sum(axis=0) / (len(recordings) * len(seeds))
    per_fold = fold_records(recordings, groups, tests, decided)
    of_steps = np.concatenate([run.integer_step[run.integer_step >= 0] for runs in decided for run in runs])
    of_seeds = [fold["by_seed"]["integer_accuracy"] for fold in per_fold]
    return {
        "groups": list(groups),
        "folds": len(tests),
        "seeds": list(map(int, seeds)),
        **over_folds(per_fold),
        "integer_spread": float(np.std(of_seeds)),
        **over_groups(recordings, groups, tests, correct),
        "integer_by_seed": np.average(of_seeds, axis=0, weights=[len(test) for test in tests]).tolist(),
        "per_step": step_rows(zip(times, *steps, strict=True)),
        "per_fold": per_fold,
        "decision_time_s": float(np.mean(np.asarray(times)[of_steps])) if len(of_steps) else None,
        "confusion": confusion.tolist(),
    }
