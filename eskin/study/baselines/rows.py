"""Results of the baselines' runs: rows, methods near the best that fit hardware, and which of the thesis's
orders hold."""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, InputError, Record
from eskin.golden.data import Recordings
from eskin.study.baselines.judge import Judging, judge
from eskin.study.baselines.method import Method
from eskin.study.baselines.recurrent import NetworkMethod
from eskin.study.baselines.registry import METHODS
from eskin.study.baselines.scene import Scene

NEAR = 0.01
"""Accuracy within which a network is as good as the best method."""


def row_of(
    method: Method | NetworkMethod, groups: Sequence[str], runs: Sequence[Mapping[str, Any]]
) -> Record:
    """A row of baselines.json: method, label, family, split, groups, accuracy (mean over seeds of the share
    of all recordings), spread (standard deviation over runs), best (run), standard_error (over recordings),
    runs, seeds; parameters, multiplies, bytes, comparisons and train_s (means over runs); decision_us
    (median) and decision_us_99 of all timed decisions; hardware; networks float_accuracy, float_spread."""
    weights = [run["recordings"] for run in runs]
    shares = np.array([run["accuracy"] for run in runs])
    accuracy = float(np.average(shares, weights=weights))
    seeds = len({run["seed"] for run in runs})
    times = list(itertools.chain.from_iterable(run["decision_us"] for run in runs))
    hardware = isinstance(method, NetworkMethod)
    row = {
        "method": method.name,
        "label": method.label,
        "family": method.family,
        "split": " and ".join(groups) or "recordings",
        "groups": list(groups),
        "accuracy": accuracy,
        "spread": float(shares.std()),
        "best": float(shares.max()),
        "standard_error": math.sqrt(accuracy * (1 - accuracy) * seeds / sum(weights)),
        "runs": [
            {
                key: run[key]
                for key in ("fold", "seed", "recordings", "accuracy", "float_accuracy")
                if key in run
            }
            for run in runs
        ],
        "seeds": seeds,
        **{
            key: round(float(np.mean([run[key] for run in runs])))
            for key in ("parameters", "multiplies", "bytes", "comparisons")
        },
        "train_s": float(np.mean([run["train_s"] for run in runs])),
        "decision_us": float(np.median(times)) if times else None,
        "decision_us_99": float(np.quantile(times, 0.99)) if times else None,
        "hardware": hardware,
    }
    if hardware:
        real = [run["float_accuracy"] for run in runs]
        row |= {
            "float_accuracy": float(np.average(real, weights=weights)),
            "float_spread": float(np.std(real)),
        }
    return row


def nearest(rows: Sequence[Mapping[str, Any]]) -> Record:
    """Of the rows of one split: best (method) and its accuracy; network: of the hardware-ready ones within
    NEAR of it that with the fewest multiplies, else the most accurate; gap: how far it is below the best,
    accuracy; within: gap <= NEAR."""
    best = max(rows, key=lambda row: row["accuracy"])
    ready = [row for row in rows if row["hardware"]]
    close = [row for row in ready if row["accuracy"] >= best["accuracy"] - NEAR - 1e-12]
    chosen = (
        min(close, key=lambda row: row["multiplies"])
        if close
        else max(ready, key=lambda row: row["accuracy"], default=None)
    )
    return {
        "split": best["split"],
        "best": best["method"],
        "best_accuracy": best["accuracy"],
        "network": chosen and chosen["method"],
        "accuracy": chosen and chosen["accuracy"],
        "multiplies": chosen and chosen["multiplies"],
        "gap": chosen and best["accuracy"] - chosen["accuracy"],
        "within": bool(close),
    }


ORDERS = (
    ("GRU20 above GRU256", ("gru12-n20",), ("gru12-n256",)),
    ("LSTM20 above LSTM256", ("lstm10-n20",), ("lstm10-n256",)),
    ("recurrent above tensor methods", ("gru12-n20", "lstm10-n20"), ("tensor-svm", "tensor-rls")),
)
"""What table 3.1 of the thesis says: the best of the first above the best of the others."""


def orders(rows: Sequence[Mapping[str, Any]]) -> list[Record]:
    """The thesis's orders on the rows of one split, as far as the methods are there, in float: order, split,
    above and below (method, accuracy, spread over runs), difference, its standard error over the folds'
    differences, and holds: True, False, or None where the difference is within that error."""
    by_name = {row["method"]: row for row in rows}
    orders = []
    for order, above, below in ORDERS:
        if not all(name in by_name for name in (*above, *below)):
            continue
        first, second = (max((by_name[name] for name in names), key=_real) for names in (above, below))
        difference = _real(first) - _real(second)
        paired = np.array(_by_fold(first)) - np.array(_by_fold(second))
        error = float(paired.std(ddof=1) / math.sqrt(len(paired))) if len(paired) > 1 else math.inf
        orders.append(
            {
                "order": order,
                "split": first["split"],
                **{
                    side: {
                        "method": row["method"],
                        "accuracy": _real(row),
                        "spread": row.get("float_spread", row["spread"]),
                    }
                    for side, row in (("above", first), ("below", second))
                },
                "difference": difference,
                "standard_error": error,
                "holds": None if abs(difference) <= error else difference > 0,
            }
        )
    return orders


def _real(row: Mapping[str, Any]) -> float:
    return row.get("float_accuracy", row["accuracy"])


def _by_fold(row: Mapping[str, Any]) -> list[float]:
    """Accuracy of each fold, in float where that is known, mean over seeds."""
    folds: dict[int, list[float]] = {}
    for run in row["runs"]:
        folds.setdefault(run["fold"], []).append(run.get("float_accuracy", run["accuracy"]))
    return [float(np.mean(folds[fold])) for fold in sorted(folds)]


SWEPT = ("logistic", "svm", "cnn")
"""The baselines that a sweep shows beside its points."""


def judge_baseline(
    name: str,
    recordings: Recordings,
    config: AcceleratorConfig,
    splits: Sequence[Sequence[str]],
    seeds: Sequence[int],
    folds: int,
) -> Record:
    """One method on every split of a sweep.

    Returns
    -------
    label; parameters and multiplies_decision (means over runs: support vectors differ); splits: {groups,
    accuracy, by_seed, per_fold: {recordings, accuracy}} each.
    """
    scene, seeds = Scene.of(recordings, config), tuple(int(seed) for seed in seeds)
    every, split_rows = [], []
    for groups in splits:
        outcome = judge(scene, Judging(METHODS[name], tuple(groups), seeds, folds))
        if "refused" in outcome:
            raise InputError(outcome["refused"])
        runs = outcome["runs"]
        every += runs
        sizes = [run["recordings"] for run in runs if run["seed"] == seeds[0]]
        shares = np.array([[run["accuracy"] for run in runs if run["seed"] == seed] for seed in seeds])
        split_rows.append(
            {
                "groups": list(groups),
                "accuracy": float(np.average(shares.mean(axis=0), weights=sizes)),
                "by_seed": np.average(shares, axis=1, weights=sizes).tolist(),
                "per_fold": [
                    {"recordings": size, "accuracy": float(a)}
                    for size, a in zip(sizes, shares.mean(axis=0), strict=True)
                ],
            }
        )
    row = row_of(METHODS[name], [], every)
    return {
        "label": row["label"],
        "parameters": row["parameters"],
        "multiplies_decision": row["multiplies"],
        "splits": split_rows,
    }
