"""A baseline on recordings that it has not seen, and what it costs.

A *run* is one fold with one seed: trained on the other folds, judged on this one. A recording without a
touch, or without a completed window, counts as wrong. Seconds of training and microseconds of a decision, one
touch at a time, are those of the processor, in one thread: other work beside it does not count.
"""

import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from eskin.golden.core import InputError, Record
from eskin.golden.model import FloatModel, IntegerModel, Touches, decide_touches, network_formats
from eskin.study.baselines.method import FLOAT_BYTES, Fitted, Method
from eskin.study.baselines.recurrent import NetworkMethod
from eskin.study.baselines.scene import Scene
from eskin.training.crossval import Folds
from eskin.training.datasets import Datasets
from eskin.training.fit import one_thread
from eskin.training.splits import split_folds

TIMED, TIMED_S = 40, 0.5
"""Decisions of a run that are timed at most, and seconds that this may take."""


@dataclass(frozen=True)
class Judging:
    """One piece of work: a method on a split."""

    method: Method | NetworkMethod
    groups: tuple[str, ...]
    seeds: tuple[int, ...]
    folds: int


def judge(scene: Scene, piece: Judging) -> Record:
    """Its runs, {fold, seed, recordings, accuracy, parameters, multiplies, bytes, comparisons, train_s,
    decision_us (each timed)}; networks also float_accuracy. ``refused`` in their place where the method
    cannot see these touches."""
    method = piece.method
    with one_thread():
        try:
            if isinstance(method, NetworkMethod):
                return {"runs": _network_runs(scene, method, piece)}
            return {"runs": _runs(scene, method, piece)}
        except InputError as error:
            return {"refused": str(error)}


def _runs(scene: Scene, method: Method, piece: Judging) -> list[Record]:
    recordings, runs = scene.recordings, []
    tests = split_folds(recordings, piece.groups, piece.folds, None)
    for seed, (fold, test) in itertools.product(piece.seeds, enumerate(tests)):
        part, judged = (scene.where[rows] for rows in (np.setdiff1d(np.arange(len(recordings)), test), test))
        part, train, judged = part[part >= 0], test[judged >= 0], judged[judged >= 0]
        if not len(part):
            raise InputError(
                f"{recordings.source}: no touch was found in a training part; check the onset rule with "
                "'eskin inspect'"
            )
        begin = time.process_time()
        fitted = (
            method.fit(scene, part, seed)
            if len(np.unique(scene.labels[part])) > 1
            else _constant(scene, part)
        )
        seconds = time.process_time() - begin
        right = int((fitted.decide(judged) == recordings.labels[train]).sum()) if len(judged) else 0
        alone = fitted.alone or partial(_decided, fitted.decide)
        runs.append(
            {
                "fold": fold,
                "seed": seed,
                "recordings": len(test),
                "accuracy": right / len(test),
                "parameters": fitted.parameters,
                "multiplies": fitted.multiplies,
                "bytes": FLOAT_BYTES * fitted.parameters,
                "comparisons": fitted.comparisons,
                "train_s": seconds,
                "decision_us": timed(alone, judged),
            }
        )
    return runs


def _constant(scene: Scene, part: np.ndarray) -> Fitted:
    """The one class that a training part has."""
    return Fitted(lambda rows: np.full(len(rows), scene.labels[part[0]]), 1, 0)


def timed(decide: Callable[[Any], Any], rows: np.ndarray) -> list[float]:
    """Microseconds of each decision, the first one left out; of TIMED rows, as far as TIMED_S go."""
    microseconds: list[float] = []
    for number, row in enumerate(rows[: TIMED + 1]):
        begin = time.thread_time()
        decide(row)
        if number:
            microseconds.append(1e6 * (time.thread_time() - begin))
        if sum(microseconds) > 1e6 * TIMED_S:
            break
    return microseconds


def _network_runs(scene: Scene, method: NetworkMethod, piece: Judging) -> list[Record]:
    config, recipe = method.network(scene.config)
    work = Folds(
        scene.recordings,
        config,
        recipe,
        [list(piece.groups)],
        piece.seeds,
        piece.folds,
        Datasets(scene.recordings),
    )
    begin = time.process_time()
    models = work.fit(None)
    seconds = (time.process_time() - begin) / len(models)
    integers = work.quantise(models, {})
    labels, runs = scene.recordings.labels, []
    folds = len(work.tests) // len(piece.seeds)
    for number, (model, integer, test, outcome) in enumerate(
        zip(models, integers, work.tests, work.decided(models, integers), strict=True)
    ):
        rows = work.data.index[test]
        touches = work.data.touches
        runs.append(
            {
                "fold": number % folds,
                "seed": piece.seeds[number // folds],
                "recordings": len(test),
                "accuracy": float(np.mean(outcome.integer_global == labels[test])),
                "float_accuracy": float(np.mean(outcome.float_global == labels[test])),
                "parameters": model.parameter_count,
                "multiplies": config.windows.steps * config.multiplies,
                "bytes": bytes_of(integer),
                "comparisons": 0,
                "train_s": seconds,
                "decision_us": timed(partial(_network_decided, model, touches), rows[rows >= 0]),
            }
        )
    return runs


def bytes_of(model: IntegerModel) -> int:
    """Bytes of an integer network's weights and biases, packed."""
    return -(
        -sum(model.arrays[name].size * fmt.width for name, fmt in network_formats(model.config).items()) // 8
    )


def _decided(decide: Callable[[np.ndarray], Any], row: int) -> Any:
    return decide(np.array([row]))


def _network_decided(model: FloatModel, touches: Touches, row: int) -> Any:
    return decide_touches(model, touches.take(np.array([row])))
