"""Cross-validation: accuracy on recordings that a network has not seen, in float and integer, all folds and
seeds at once."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from eskin.golden.core import AcceleratorConfig, Record
from eskin.golden.data import Recordings
from eskin.golden.model import FloatModel, IntegerModel, decide_touches, step_times
from eskin.golden.model.pipeline import by_recording
from eskin.training.datasets import Dataset, Datasets, find_dataset, touch_rows
from eskin.training.fit import fine_tune, fit_networks, post_training
from eskin.training.losses import LossCurves
from eskin.training.recipe import Recipe, choose_recipe
from eskin.training.splits import held_out, split_folds

Progress = Callable[[str, int, int], None]
"""Called with (what, updates done, updates in all)."""


def cross_validate(
    recordings: Recordings,
    config: AcceleratorConfig,
    splits: Sequence[Sequence[str]],
    seeds: Sequence[int] = (0, 1, 2),
    *,
    folds: int = 5,
    recipe: Recipe | None = None,
    widths: Record | None = None,
    quantisation_aware: bool = False,
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
    quantisation_aware:
        The integer networks are trained on in integer arithmetic; False: quantised after training. Float
        figures are the same.
    datasets:
        Touches that were found before.

    Returns
    -------
    A record for each split: groups, folds, seeds, float_accuracy, integer_accuracy, agreement, float_spread
    and integer_spread (standard deviation over folds x seeds), float_by_seed and integer_by_seed (accuracy
    over all folds), per_step (step, time_s since the onset, float_accuracy, integer_accuracy),
    decision_time_s (of the global decision since the onset, mean, integer; None: no decision), logit_error
    (mean and max of how far integer logits are from float ones over all completed steps; None: no step),
    training_curve (updates, training_loss and held_out_loss of the float networks on their way, means over
    folds and seeds; None: linear), per_fold (held_out, recordings, float_accuracy, integer_accuracy,
    agreement, by_seed), confusion (integer model, summed over seeds: rows
    = true class, columns = decided, last column = none), per_class (integer accuracy).
    """
    recipe = recipe or choose_recipe(config)
    work = Folds(recordings, config, recipe, splits, seeds, folds, datasets)
    models = work.fit(progress)
    integers = (
        work.fine_tune(models, widths or {}, progress)
        if quantisation_aware
        else work.quantise(models, widths or {})
    )
    return work.records(models, integers)


class Folds:
    """The networks of a cross-validation, all folds of all splits for every seed: trained, quantised and
    judged, in one order."""

    def __init__(
        self,
        recordings: Recordings,
        config: AcceleratorConfig,
        recipe: Recipe,
        splits: Sequence[Sequence[str]],
        seeds: Sequence[int],
        folds: int,
        datasets: Datasets | None = None,
    ) -> None:
        self._recordings, self._config, self._recipe = recordings, config, recipe
        self._splits, self._seeds = [list(groups) for groups in splits], list(map(int, seeds))
        self.data = (datasets or Datasets(recordings)).of(config, recipe)
        self._jobs: list[tuple[int, int, np.ndarray]] = []
        self._names: list[list[str]] = []
        for number, groups in enumerate(self._splits):
            tests = split_folds(recordings, groups, folds, None)
            self._names.append([held_out(recordings, groups, test) for test in tests])
            self._jobs += [(number, fold, test) for fold, test in enumerate(tests)]
        everything = np.arange(len(recordings))
        # seed by seed, and within a seed fold by fold: `tests` and `split_numbers` have the same order
        parts = [touch_rows(self.data, np.setdiff1d(everything, test)) for _, _, test in self._jobs]
        self.parts = [part for _ in self._seeds for part in parts]
        self._curves: LossCurves | None = None

    def fit(self, progress: Progress | None) -> list[FloatModel]:
        """A float network for each part."""
        unseen = [touch_rows(self.data, test) for test in self.tests]
        self._curves = LossCurves(self.data, self._config, self._recipe, unseen)
        report = named(progress, "cross-validation")
        return fit_networks(
            self.data, self._config, self._recipe, self.parts, self._seeds[0], report, curves=self._curves
        )

    def quantise(self, models: list[FloatModel], widths: Record) -> list[IntegerModel]:
        """Post-training integers of each, ranges profiled on its own training part."""
        return [
            post_training(model, self.data, rows, widths)
            for model, rows in zip(models, self.parts, strict=True)
        ]

    def fine_tune(
        self, models: list[FloatModel], widths: Record, progress: Progress | None
    ) -> list[IntegerModel]:
        """Integers of each by quantisation-aware training on its own part."""
        report = named(progress, "quantisation-aware training")
        return fine_tune(self.data, self._recipe, self.parts, models, self._seeds[0], widths, report)

    @property
    def tests(self) -> list[np.ndarray]:
        """For each network the recordings it has not seen."""
        return [test for _ in self._seeds for _, _, test in self._jobs]

    @property
    def trainings(self) -> list[np.ndarray]:
        """For each network the recordings it was trained on."""
        everything = np.arange(len(self._recordings))
        return [np.setdiff1d(everything, test) for test in self.tests]

    @property
    def split_numbers(self) -> list[int]:
        """For each network the index of its split."""
        return [number for _ in self._seeds for number, _, _ in self._jobs]

    def judge_on(self, recordings: Recordings, onsets: np.ndarray | None = None) -> None:
        """From now on ``records`` judges on ``recordings``, which stand for those trained on, one for one.

        onsets: forced, as for ``eskin.golden.model.preprocess.find_touches``.
        """
        self.data = find_dataset(recordings, self._config, self._recipe, onsets)

    def records(self, models: list[FloatModel], integers: list[IntegerModel]) -> list[Record]:
        """A record for each split, as ``cross_validate`` returns them."""
        return self.records_of(self.decided(models, integers))

    def decided(self, models: list[FloatModel], integers: list[IntegerModel]) -> list[FoldDecisions]:
        """What each network decided on the recordings it has not seen (``tests``)."""
        runs = [
            _judge(model, integer, self.data, test)
            for model, integer, test in zip(models, integers, self.tests, strict=True)
        ]
        if not self._curves or not self._curves.updates:
            return runs
        updates = tuple(self._curves.updates)
        return [
            dataclasses.replace(run, updates=updates, losses=self._curves.losses[:, m])
            for m, run in enumerate(runs)
        ]

    def records_of(self, runs: Sequence[FoldDecisions]) -> list[Record]:
        """A record for each split from what each network ``decided``."""
        decided: dict[tuple[int, int], list[FoldDecisions]] = {}
        for m, run in enumerate(runs):
            decided.setdefault(self._jobs[m % len(self._jobs)][:2], []).append(run)
        times = step_times(self._config, self.data.touches)
        return [
            split_record(
                groups,
                self._names[number],
                [test for n, _, test in self._jobs if n == number],
                [decided[number, fold] for fold in range(len(self._names[number]))],
                self._recordings,
                self._seeds,
                times,
            )
            for number, groups in enumerate(self._splits)
        ]


@dataclass(frozen=True, kw_only=True, eq=False)
class Terms:
    """What all networks of a choice are judged on.

    groups: what is left out. seeds: of the networks of a fold.
    """

    recordings: Recordings
    groups: Sequence[str]
    datasets: Datasets
    seeds: Sequence[int] = (0, 1, 2)
    folds: int = 5
    progress: Progress | None = None

    def called(self, name: str) -> Progress | None:
        """Its progress, that says what is worked on."""
        progress = self.progress
        return progress and (lambda task, done, total: progress(f"{task}, {name}", done, total))


@dataclass(frozen=True, eq=False)
class Piece:
    """A network to train on the recordings ``train`` and to judge on ``test``; copies begin at other
    weights."""

    config: AcceleratorConfig
    recipe: Recipe
    train: np.ndarray
    test: np.ndarray
    copy: int = 0

    @property
    def key(self) -> tuple[int, bytes]:
        """Of what it is trained on."""
        return self.copy, self.train.tobytes()


def judge_pieces(
    datasets: Datasets, pieces: Sequence[Piece], seed: int, progress: Progress | None = None
) -> list[FoldDecisions]:
    """The decisions of each network on its test.

    Networks of one configuration and recipe train at once. Pieces with the same training part share one
    network, which is judged on each of their tests.
    """
    outcomes: dict[int, FoldDecisions] = {}
    kinds: dict[tuple[AcceleratorConfig, Recipe], list[int]] = {}
    for number, piece in enumerate(pieces):
        kinds.setdefault((piece.config, piece.recipe), []).append(number)
    for (config, recipe), numbers in kinds.items():
        data = datasets.of(config, recipe)
        first = {pieces[number].key: pieces[number] for number in reversed(numbers)}
        keys = list(dict.fromkeys(pieces[number].key for number in numbers))
        parts = [touch_rows(data, first[key].train) for key in keys]
        curves = LossCurves(data, config, recipe, [touch_rows(data, first[key].test) for key in keys])
        report = named(progress, "cross-validation")
        models = fit_networks(data, config, recipe, parts, seed, report, curves)
        integers = [post_training(model, data, rows, {}) for model, rows in zip(models, parts, strict=True)]
        for number in numbers:
            at = keys.index(pieces[number].key)
            run = _judge(models[at], integers[at], data, pieces[number].test)
            if curves.updates:
                run = dataclasses.replace(run, updates=tuple(curves.updates), losses=curves.losses[:, at])
            outcomes[number] = run
    return [outcomes[number] for number in range(len(pieces))]


def named(progress: Progress | None, activity: str) -> Callable[[int, int], None]:
    return (lambda done, total: progress(activity, done, total)) if progress else (lambda done, total: None)


@dataclass(frozen=True, eq=False)
class FoldDecisions:
    """Decisions of one network on its test part: global (r) and local (r, K), -1 none, float and integer; the
    step (r) after which the integer global one was given, -1 none; how far integer logits are from float ones
    (values of completed steps); the configuration with its formats; its losses (points, 2) in training after
    so many updates (``LossCurves``), none of a linear cell."""

    float_global: np.ndarray
    float_local: np.ndarray
    integer_global: np.ndarray
    integer_local: np.ndarray
    integer_step: np.ndarray
    logit_error: np.ndarray
    config: AcceleratorConfig
    updates: tuple[int, ...] = ()
    losses: np.ndarray | None = None

    @classmethod
    def of_images(cls, ideal: np.ndarray, whole: np.ndarray, config: AcceleratorConfig) -> FoldDecisions:
        """Float and integer decisions on images, each made in one step."""
        step, error = np.zeros_like(whole), np.zeros(0)
        return cls(ideal, ideal[:, None], whole, whole[:, None], step, error, config)


def _judge(model: FloatModel, integer: IntegerModel, data: Dataset, test: np.ndarray) -> FoldDecisions:
    rows = data.index[test]
    touches = data.touches.take(rows[rows >= 0])
    placed = np.where(rows >= 0, np.cumsum(rows >= 0) - 1, -1)
    real = decide_touches(model, touches, config=integer.config)
    exact = decide_touches(integer, touches)
    complete = np.arange(exact.logits.shape[1]) < touches.completed[:, None]
    return FoldDecisions(
        by_recording(real.decision, placed),
        by_recording(real.local, placed),
        by_recording(exact.decision, placed),
        by_recording(exact.local, placed),
        by_recording(exact.step, placed),
        np.abs(integer.config.formats.logit_format.to_real(exact.logits) - real.logits)[complete].ravel(),
        integer.config,
    )


SHARES = ("float_accuracy", "integer_accuracy", "agreement")


def fold_records(names, tests, decided, labels: np.ndarray) -> list[Record]:
    """For each fold what it holds out, its recordings, and SHARES: means over seeds, and by seed."""
    records = []
    for name, test, runs in zip(names, tests, decided, strict=True):
        right = labels[test]
        shares = {
            "float_accuracy": [float(np.mean(run.float_global == right)) for run in runs],
            "integer_accuracy": [float(np.mean(run.integer_global == right)) for run in runs],
            "agreement": [float(np.mean(run.float_global == run.integer_global)) for run in runs],
        }
        means = {key: float(np.mean(values)) for key, values in shares.items()}
        records.append({"held_out": name, "recordings": len(test), "by_seed": shares} | means)
    return records


def over_folds(per_fold: Sequence[Record]) -> dict[str, float]:
    """SHARES of all recordings."""
    weights = [fold["recordings"] for fold in per_fold]
    return {key: float(np.average([fold[key] for fold in per_fold], weights=weights)) for key in SHARES}


def share_right(labels: np.ndarray, tests: Sequence[np.ndarray], runs: Sequence[FoldDecisions]) -> np.ndarray:
    """(recordings) the share of the integer networks that decided each rightly, of those that had not seen
    it."""
    right, judged = np.zeros(len(labels)), np.zeros(len(labels))
    for test, run in zip(tests, runs, strict=True):
        right[test] += run.integer_global == labels[test]
        judged[test] += 1
    return right / np.maximum(judged, 1)


def split_record(groups, names, tests, decided, recordings, seeds, times) -> Record:
    """The record of one split, as training.json has it, of what each network (a list a fold, one a seed)
    decided on the part left out."""
    classes = len(recordings.class_names)
    confusion = np.zeros((classes, classes + 1), dtype=np.int64)
    steps = np.zeros((2, len(times)))
    for test, runs in zip(tests, decided, strict=True):
        labels = recordings.labels[test]
        for run in runs:
            np.add.at(confusion, (labels, run.integer_global), 1)  # -1, no decision, is the last column
            for row, local in enumerate((run.float_local, run.integer_local)):
                steps[row] += (local == labels[:, None]).sum(axis=0) / (len(recordings) * len(seeds))
    per_fold = fold_records(names, tests, decided, recordings.labels)
    weights = [len(test) for test in tests]

    def spread(key: str) -> float:
        return float(np.std([value for fold in per_fold for value in fold["by_seed"][key]]))

    decided_steps = np.concatenate(
        [run.integer_step[run.integer_step >= 0] for runs in decided for run in runs]
    )

    errors = np.concatenate([run.logit_error for runs in decided for run in runs])

    def by_seed(key: str) -> list[float]:
        return np.average([fold["by_seed"][key] for fold in per_fold], axis=0, weights=weights).tolist()

    return {
        "groups": groups,
        "folds": len(tests),
        "seeds": seeds,
        **over_folds(per_fold),
        "float_spread": spread("float_accuracy"),
        "integer_spread": spread("integer_accuracy"),
        "float_by_seed": by_seed("float_accuracy"),
        "integer_by_seed": by_seed("integer_accuracy"),
        "per_step": [
            {
                "step": k + 1,
                "time_s": float(time),
                "float_accuracy": float(real),
                "integer_accuracy": float(integer),
            }
            for k, (time, real, integer) in enumerate(zip(times, *steps, strict=True))
        ],
        "per_fold": per_fold,
        "decision_time_s": float(np.mean(np.asarray(times)[decided_steps])) if len(decided_steps) else None,
        "logit_error": {"mean": float(errors.mean()), "max": float(errors.max())}
        if len(errors)
        else {"mean": None, "max": None},
        "training_curve": _training_curve([run for runs in decided for run in runs]),
        "confusion": confusion.tolist(),
        "per_class": {
            name: float(confusion[c, c] / max(confusion[c].sum(), 1))
            for c, name in enumerate(recordings.class_names)
        },
    }


def _training_curve(runs: Sequence[FoldDecisions]) -> Record | None:
    """{updates, training_loss, held_out_loss (None: nothing to judge)}, means over networks; None of a linear
    cell."""
    losses = [run.losses for run in runs if run.losses is not None]
    if not losses:
        return None
    trained, unseen = np.moveaxis(np.array(losses), -1, 0)
    judged = unseen[~np.isnan(unseen).any(axis=1)]
    return {
        "updates": list(runs[0].updates),
        "training_loss": trained.mean(axis=0).tolist(),
        "held_out_loss": judged.mean(axis=0).tolist() if len(judged) else None,
    }
