"""The evaluation of all learners: fitted on a part of the recordings, judged on the rest, in float and in the
integers of the hardware.

A `Learner` makes a `Decider` of each part. `judge` asks the deciders about recordings that they have not seen.
Its result is one table, `Decisions`, from which every figure comes. A search is a learner, too
(`eskin.choose.choice.Searched`): a choice is judged like a network.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import pandas as pd

from eskin.golden.core import AcceleratorConfig, Progress, Record
from eskin.golden.data import Recordings
from eskin.golden.model import FloatModel, IntegerModel, decide_touches
from eskin.golden.model.pipeline import by_recording
from eskin.training.datasets import Dataset, Datasets, touch_rows
from eskin.training.fit import fit_networks, post_training
from eskin.training.recipe import Recipe, choose_recipe
from eskin.training.record import FoldShares, Split
from eskin.training.splits import held_out, over_groups, split_folds
from eskin.training.times import step_rows, step_times

Rows = np.ndarray
"""Numbers of recordings in an archive."""


# ---------------------------------------------------------------------- learners
@dataclass(frozen=True, eq=False)
class Decided:
    """Decisions on r recordings; -1: none.

    real, integer: global decision (r) of the float and of the integer classifier. step: (r) after which the
    integer one was given. local_real, local_integer: (r, K) local decisions.
    """

    real: np.ndarray
    integer: np.ndarray
    step: np.ndarray
    local_real: np.ndarray
    local_integer: np.ndarray

    @classmethod
    def at_once(cls, real: np.ndarray, integer: np.ndarray) -> Decided:
        """Decisions that are made in one step."""
        return cls(real, integer, np.zeros_like(integer), real[:, None], integer[:, None])


class Decider(Protocol):
    """A fitted classifier."""

    def decide(self, rows: Rows) -> Decided:
        """Its decisions on recordings."""


class Learner(Protocol):
    """A way to fit classifiers to recordings of one archive."""

    def fit(
        self, parts: Sequence[Rows], seeds: Sequence[int], progress: Progress | None = None
    ) -> Sequence[Decider]:
        """A decider for each part. It sees the labels of this part alone. seeds: one for each part; equal parts
        with different seeds start from different weights."""


@dataclass(frozen=True, eq=False)
class FittedNetwork:
    """A network, float and integer, and the touches that it decides."""

    real: FloatModel
    integer: IntegerModel
    data: Dataset

    def decide(self, rows: Rows) -> Decided:
        """As `Decider.decide`."""
        of_touch = self.data.index[rows]
        touches = self.data.touches.take(of_touch[of_touch >= 0])
        placed = np.where(of_touch >= 0, np.cumsum(of_touch >= 0) - 1, -1)
        real = decide_touches(self.real, touches, config=self.integer.config)
        exact = decide_touches(self.integer, touches)
        columns = real.decision, exact.decision, exact.step, real.local, exact.local
        return Decided(*(by_recording(column, placed) for column in columns))


@dataclass(frozen=True, eq=False)
class NetworkLearner:
    """The network of a configuration, trained by a recipe and quantised with ranges of its part; all parts
    train at once."""

    datasets: Datasets
    config: AcceleratorConfig
    recipe: Recipe

    @property
    def data(self) -> Dataset:
        """Touches of the archive under this front end."""
        return self.datasets.of(self.config, self.recipe)

    def fit(
        self, parts: Sequence[Rows], seeds: Sequence[int], progress: Progress | None = None
    ) -> list[FittedNetwork]:
        """As `Learner.fit`. The first seed alone is used: further networks continue its random numbers."""
        data = self.data
        rows = [touch_rows(data, part) for part in parts]
        report = named(progress, "cross-validation")
        models = fit_networks(data, self.config, self.recipe, rows, int(seeds[0]), report)
        named(progress, "rounding and judging what was trained")(0, 0)
        return [
            FittedNetwork(model, post_training(model, data, part, {}), data)
            for model, part in zip(models, rows, strict=True)
        ]


def named(progress: Progress | None, activity: str) -> Callable[[int, int], None]:
    """``progress`` without its first parameter, which is ``activity`` from then on."""
    return (lambda done, total: progress(activity, done, total)) if progress else (lambda done, total: None)


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


# ---------------------------------------------------------------------- folds
@dataclass(frozen=True, eq=False)
class Fold:
    """Recordings to learn from (part) and to judge on (test). split, number: its place among the splits and among
    their folds."""

    part: Rows
    test: Rows
    seed: int
    number: int = 0
    split: int = 0


def folds_of(tests: Sequence[Rows], seeds: Sequence[int], rows: Rows, split: int = 0) -> list[Fold]:
    """A fold for each of ``tests``, left out of ``rows``, and for each seed: seed by seed."""
    return [
        Fold(np.setdiff1d(rows, test), test, int(seed), number, split)
        for seed in seeds
        for number, test in enumerate(tests)
    ]


# ---------------------------------------------------------------------- the table
SHARES = ("float_accuracy", "integer_accuracy", "agreement")
KEYS = ["split", "fold", "seed"]


@dataclass(frozen=True, eq=False)
class Decisions:
    """What deciders decided on recordings that they have not seen.

    table: a row for each recording and decider: split, fold, seed, recording, label, float, integer (classes),
    step, and SHARES (bool). local: (2, rows, K) local decisions, float and integer; K: most
    steps of a decider. fitted: each fold with its
    decider.
    """

    table: pd.DataFrame
    local: np.ndarray
    fitted: tuple[tuple[Fold, Any], ...]

    @classmethod
    def of(cls, fitted: Sequence[tuple[Fold, Decider]], labels: np.ndarray) -> Decisions:
        """The table of these deciders, each on the test of its fold. labels: of all recordings."""
        decided = [decider.decide(fold.test) for fold, decider in fitted]
        counts = [len(fold.test) for fold, _ in fitted]
        keys = np.repeat([(fold.split, fold.number, fold.seed) for fold, _ in fitted], counts, axis=0)
        recording = np.concatenate([fold.test for fold, _ in fitted])
        label = labels[recording]
        names = "real", "integer", "step"
        real, integer, step = (np.concatenate([getattr(each, name) for each in decided]) for name in names)
        columns = dict(zip(KEYS, keys.T, strict=True)) | {
            "recording": recording,
            "label": label,
            "float": real,
            "integer": integer,
            "step": step,
            "float_accuracy": real == label,
            "integer_accuracy": integer == label,
            "agreement": real == integer,
        }
        table = pd.DataFrame(columns)
        local = np.full((2, len(table), max(each.local_integer.shape[1] for each in decided)), -1)
        for each, end, count in zip(decided, np.cumsum(counts), counts, strict=True):
            local[:, end - count : end, : each.local_integer.shape[1]] = each.local_real, each.local_integer
        return cls(table, local, tuple(fitted))

    @property
    def seeds(self) -> list[int]:
        """Seeds of the deciders."""
        return self.table["seed"].unique().tolist()

    def joined(self, other: Decisions) -> Decisions:
        """These decisions and the decisions of ``other``."""
        table = pd.concat([self.table, other.table], ignore_index=True)
        local = np.concatenate([self.local, other.local], axis=1)
        return Decisions(table, local, self.fitted + other.fitted)

    def of_split(self, split: int) -> Decisions:
        """The rows of one split."""
        rows = (self.table["split"] == split).to_numpy()
        fitted = tuple(pair for pair in self.fitted if pair[0].split == split)
        return Decisions(self.table[rows], self.local[:, rows], fitted)

    @cached_property
    def correct(self) -> pd.Series:
        """By recording: the share of integer deciders that decided it correctly."""
        recordings, place = np.unique(self.table["recording"], return_inverse=True)
        return pd.Series(
            np.bincount(place, self.table["integer_accuracy"]) / np.bincount(place), index=recordings
        )

    def accuracy(self, by: list[str]) -> pd.DataFrame:
        """SHARES by columns of the table."""
        return self.table.groupby(by)[[*SHARES]].mean()

    def shares(self) -> Record:
        """SHARES over all rows."""
        return self.table[[*SHARES]].mean().to_dict()

    def per_fold(self, recordings: Recordings, groups: Sequence[str]) -> list[FoldShares]:
        """A row for each fold."""
        tests = {fold.number: fold.test for fold, _ in reversed(self.fitted)}
        return [
            FoldShares(
                held_out=held_out(recordings, groups, tests[number]),
                recordings=len(tests[number]),
                **shares.mean(),
            )
            for number, shares in self.accuracy(["fold", "seed"]).groupby("fold")
        ]

    def record(
        self, recordings: Recordings, groups: Sequence[str], times: Sequence[float] | np.ndarray
    ) -> Split:
        """The figures of one split. times: seconds of each step."""
        table, classes = self.table, len(recordings.class_names)
        confusion = np.zeros((classes, classes + 1), dtype=np.int64)
        np.add.at(confusion, (table["label"], table["integer"]), 1)  # -1, no decision, is the last column
        steps = (self.local == table["label"].to_numpy()[:, None]).mean(axis=1)
        decided = table["step"][table["step"] >= 0]
        by_seed = self.accuracy(["seed"])["integer_accuracy"]
        per_fold, by_fold = self.per_fold(recordings, groups), self.accuracy(["fold", "seed"])
        for row, (_, shares) in zip(per_fold, by_fold.groupby("fold"), strict=True):
            row.by_seed = shares.to_dict("list")
        tests = [fold.test for fold, _ in self.fitted if fold.seed == self.seeds[0]]
        return Split(
            groups=groups,
            folds=len(per_fold),
            seeds=self.seeds,
            **self.shares(),
            integer_spread=by_fold["integer_accuracy"].std(ddof=0),
            **over_groups(recordings, groups, tests, self.correct.to_numpy()),
            integer_by_seed=by_seed[self.seeds].tolist(),
            per_step=step_rows(zip(times, *steps, strict=True)),
            per_fold=per_fold,
            decision_time_s=np.asarray(times)[decided].mean() if len(decided) else None,
            confusion=confusion.tolist(),
        )


# ---------------------------------------------------------------------- judging
def judge(
    learner: Learner, folds: Sequence[Fold], labels: np.ndarray, progress: Progress | None = None
) -> Decisions:
    """Fit ``learner`` to the part of each fold and judge it on the fold's test. Folds with the same part and
    seed share one decider. labels: of all recordings.

    Raises
    ------
    InputError
        As the learner.
    """
    keys = [(fold.seed, fold.part.tobytes()) for fold in folds]
    unique = dict(zip(keys, folds, strict=True))
    parts, seeds = zip(*((fold.part, fold.seed) for fold in unique.values()), strict=True)
    deciders = dict(zip(unique, learner.fit(parts, seeds, progress), strict=True))
    return Decisions.of([(fold, deciders[key]) for fold, key in zip(folds, keys, strict=True)], labels)


def cross_validate(
    recordings: Recordings,
    config: AcceleratorConfig,
    splits: Sequence[Sequence[str]],
    seeds: Sequence[int] = (0, 1, 2),
    *,
    folds: int = 5,
    recipe: Recipe | None = None,
    datasets: Datasets | None = None,
    progress: Progress | None = None,
) -> list[Split]:
    """Accuracy on recordings that a network has not seen, float and integer, for every split; all folds and
    seeds train at once.

    Every fold's network is quantised after training, with ranges profiled on its training part. A
    recording without a touch, or without the step in question, counts as wrong.

    Parameters
    ----------
    splits:
        Group names for each split (``label`` is the class); empty: stratified by class.
    seeds:
        A network for each fold and seed; figures are means over seeds of the share of recordings.
    datasets:
        Touches that were found before.

    Returns
    -------
    A record for each split.
    """
    if not splits:
        return []
    recipe, datasets = recipe or choose_recipe(config), datasets or Datasets(recordings)
    everything = np.arange(len(recordings))
    tests = [split_folds(recordings, groups, folds, None) for groups in splits]
    # seed by seed over all splits: the order in which networks draw their random numbers
    every = [
        fold
        for seed in seeds
        for split, of_split in enumerate(tests)
        for fold in folds_of(of_split, [seed], everything, split)
    ]
    learner = NetworkLearner(datasets, config, recipe)
    decisions = judge(learner, every, recordings.labels, progress)
    times = step_times(config, learner.data.touches)
    return [
        decisions.of_split(split).record(recordings, groups, times) for split, groups in enumerate(splits)
    ]
