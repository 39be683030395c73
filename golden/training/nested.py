"""Accuracy on recordings that chose nothing: front end and network are chosen again inside the training part
of every fold.

What is cross-validated on the folds it was chosen on looks better than it is: on pure noise of 60 recordings
and two classes the best of eighty front ends is 60 to 75 % right. Here each fold is left out of everything
that looks at a label, by a cheaper choice of the same kind:

- *front end*: of a `eskin.golden.training.choose_front_end.Field`, which no label picked, by ridge regression
  on folds of the training part, NESTED_ON recordings at most. A recurrent network that was asked for may
  stand on a rival of another gate: half its updates on one inner fold decide.
- *network*: the one that was asked for; else the linear cell by least squares, or a GRU 8 (half the updates,
  one seed) where it is better on the inner folds by more than a standard error, and not tried where it cannot
  be.
- the network chosen is trained on the whole training part with the full recipe, quantised, and judged on the
  fold.

Inner folds leave out what the choice itself leaves out. Thresholds and scales of the candidates are measured
on all recordings, without a label.

Where recordings are few, the ridge regression does the same with SHUFFLES shufflings of the labels: what luck
alone reaches.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.kernel_ridge import KernelRidge

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.data.recordings import Recordings
from eskin.golden.training.choice_table import front_end_words, network_name
from eskin.golden.training.choose_front_end import (
    Field,
    Judged,
    choose,
    inner_folds,
    is_level,
    rivals_of,
    row_of,
)
from eskin.golden.training.crossval import Decided, Piece, Progress, judge_pieces
from eskin.golden.training.datasets import Datasets
from eskin.golden.training.fit import one_thread
from eskin.golden.training.recipe import Recipe, choose_recipe
from eskin.golden.training.splits import held_out, split_folds

FEW, SHUFFLES = 200, 20
"""Recordings up to which labels are shuffled, and how often."""

RIDGE_PENALTY = 1e-2
"""Of the ridge regression that decides the folds left out, of the shuffled labels and beside them of the
right ones."""

Network = Callable[[AcceleratorConfig], tuple[AcceleratorConfig, Recipe]]
"""The network on a front end, and its recipe."""


@dataclass(frozen=True, eq=False)
class Nested:
    """How the choice is made again.

    groups: what the choice leaves out. networks: candidates, the simplest first; a linear one among several
    is judged by the ridge regression that judges the front ends.
    """

    recordings: Recordings
    field: Field
    groups: Sequence[str]
    networks: Sequence[Network]
    folds: int
    seeds: Sequence[int]
    widths: dict[str, Any]
    datasets: Datasets
    progress: Progress | None = None

    def record(self, split: Sequence[str]) -> dict[str, Any]:
        """The figure of one split, and how it came about.

        Returns
        -------
        {groups, folds, seeds, float_accuracy, integer_accuracy, agreement, standard_error (over recordings),
        per_fold: [{held_out, recordings, the three shares, front_end, network}], shuffled (None: many
        recordings; ``_shuffled``), wall_s}.
        """
        begin = time.perf_counter()
        tests = split_folds(self.recordings, list(split), self.folds, None)
        everything = np.arange(len(self.recordings))
        parts = [np.setdiff1d(everything, test) for test in tests]
        known = [np.flatnonzero(~np.isin(self.field.numbers, test)) for test in tests]
        shuffled = shuffles(
            self.recordings.labels,
            [self.recordings.labels if n == "label" else self.recordings.groups[n] for n in split],
        )
        labels = (
            shuffled[:, self.field.numbers]
            if len(self.recordings) <= FEW
            else self.recordings.labels[None, self.field.numbers]
        )
        with one_thread():
            judged = [self.field.judged(rows, self.groups, labels) for rows in known]
        chosen = self._chosen(parts, [of_part[0] for of_part in judged])
        copies = range(len(self.seeds))
        pieces = [
            Piece(*chosen[fold], parts[fold], test, copy)
            for copy in copies
            for fold, test in enumerate(tests)
        ]
        runs = self._decided(pieces)
        shares = [
            [self._shares(test, runs[copy * len(tests) + fold]) for copy in copies]
            for fold, test in enumerate(tests)
        ]
        correct = np.zeros(len(everything))
        for piece, run in zip(pieces, runs, strict=True):
            correct[piece.test] += (run.integer_global == self.recordings.labels[piece.test]) / len(
                self.seeds
            )
        weights = [len(test) for test in tests]
        names = ("float_accuracy", "integer_accuracy", "agreement")
        means = np.array(shares).mean(axis=1)
        return {
            "groups": list(split),
            "folds": len(tests),
            "seeds": list(map(int, self.seeds)),
            **dict(zip(names, np.average(means, axis=0, weights=weights).tolist(), strict=True)),
            "standard_error": float(correct.std(ddof=1) / np.sqrt(len(correct))),
            "per_fold": [
                {
                    "held_out": held_out(self.recordings, split, test),
                    "recordings": len(test),
                    **dict(zip(names, row.tolist(), strict=True)),
                }
                | {
                    "front_end": front_end_words(row_of(config)),
                    "network": network_name(_row(config, recipe)),
                }
                for test, row, (config, recipe) in zip(tests, means, chosen, strict=True)
            ],
            "shuffled": self._shuffled(tests, known, judged, labels) if len(labels) > 1 else None,
            "wall_s": time.perf_counter() - begin,
        }

    def _decided(self, pieces: Sequence[Piece]) -> list[Decided]:
        return judge_pieces(self.datasets, pieces, int(self.seeds[0]), self.widths, self.progress)

    def _shares(self, test: np.ndarray, run: Decided) -> tuple[float, float, float]:
        labels = self.recordings.labels[test]
        right = (
            run.float_global == labels,
            run.integer_global == labels,
            run.float_global == run.integer_global,
        )
        real, exact, same = (float(np.mean(each)) for each in right)
        return real, exact, same

    def _chosen(
        self, parts: Sequence[np.ndarray], judged: Sequence[list[Judged]]
    ) -> list[tuple[AcceleratorConfig, Recipe]]:
        """Configuration and recipe of each training part."""
        first, *others = self.networks
        judged = [[one for one in of_part if fits(first, one.config)] for of_part in judged]
        if not all(judged):
            raise InputError("the network asked for fits none of the front ends; name another")
        best = [choose(of_part) for of_part in judged]
        if not others and not first(best[0].config)[0].recurrent:
            return [first(one.config) for one in best]
        if not others:
            begin = self._recurrent_front_ends(parts, judged, best, first)
            return [first(config or one.config) for config, one in zip(begin, best, strict=True)]
        begin = [
            one.config if fits(others[-1], one.config) and 1 - one.accuracy > one.standard_error else None
            for one in best
        ]
        inner = [self._inner(part) if config else [] for part, config in zip(parts, begin, strict=True)]
        pieces = [
            Piece(*halved(others[-1](config)), *pair)
            for config, pairs in zip(begin, inner, strict=True)
            if config
            for pair in pairs
        ]
        right = iter(
            [
                run.integer_global == self.recordings.labels[p.test]
                for p, run in zip(pieces, self._decided(pieces), strict=True)
            ]
        )
        chosen = []
        for config, one, pairs in zip(begin, best, inner, strict=True):
            recurrent = np.concatenate([next(right) for _ in pairs]) if pairs else np.zeros(1)
            error = max(float(correct.std() / np.sqrt(len(correct))) for correct in (recurrent, one.correct))
            better = recurrent.mean() - one.correct.mean() > error
            chosen.append(others[-1](config) if config and better else first(one.config))
        return chosen

    def _recurrent_front_ends(
        self,
        parts: Sequence[np.ndarray],
        judged: Sequence[list[Judged]],
        best: Sequence[Judged],
        network: Network,
    ) -> list[AcceleratorConfig | None]:
        """For each part the front end of a recurrent network: the linear choice, or the rival that does best
        on the first inner fold; None where the network fits none of them."""
        tried = [
            [config for config in (one.config, *rivals_of(of_part, one)) if fits(network, config)]
            for of_part, one in zip(judged, best, strict=True)
        ]
        several = [configs if len(configs) > 1 else [] for configs in tried]
        inner = [self._inner(part)[0] for part in parts]
        pieces = [
            Piece(*halved(network(config)), *inner[fold])
            for fold, configs in enumerate(several)
            for config in configs
        ]
        right = iter(
            [
                run.integer_global == self.recordings.labels[p.test]
                for p, run in zip(pieces, self._decided(pieces), strict=True)
            ]
        )
        found: list[AcceleratorConfig | None] = []
        for configs, compared in zip(tried, several, strict=True):
            if not compared:
                found.append(configs[0] if configs else None)
                continue
            runs = [Judged(config, next(right), 0) for config in compared]
            top = max(runs, key=lambda one: one.accuracy)
            found.append(runs[0].config if is_level(top, runs[0]) else top.config)
        return found

    def _inner(self, part: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """(training part, test) of each inner fold, recordings of the archive."""
        return [
            (np.setdiff1d(part, part[fold]), part[fold])
            for fold in inner_folds(self.recordings.subset(part), self.groups)
        ]

    def _shuffled(
        self,
        tests: Sequence[np.ndarray],
        known: Sequence[np.ndarray],
        judged: Sequence[list[list[Judged]]],
        labels: np.ndarray,
    ) -> dict[str, Any]:
        """{count, mean, largest (accuracy of the ridge regression on shuffled labels), right (on the right
        ones), as_good (share of labellings, the right one among them, that do as well as the right one)}."""
        classes, right = len(self.recordings.class_names), np.zeros(labels.shape, dtype=bool)
        of_config = {config: (rows, gram) for config, rows, gram in self.field.seen}
        for test, rows, of_part in zip(tests, known, judged, strict=True):
            asked = np.flatnonzero(np.isin(self.field.numbers, test))
            for number, of_labelling in enumerate(of_part):
                seen, gram = of_config[choose(of_labelling).config]
                train, unseen = np.flatnonzero(np.isin(seen, rows)), np.flatnonzero(np.isin(seen, asked))
                if not len(train) or not len(unseen):
                    continue
                targets = np.eye(classes)[labels[number, seen[train]]]
                alpha = RIDGE_PENALTY * float(np.trace(gram)) / len(gram)
                ridge = KernelRidge(alpha=alpha, kernel="precomputed").fit(
                    gram[np.ix_(train, train)], targets
                )
                decided = ridge.predict(gram[np.ix_(unseen, train)]).argmax(axis=1)
                right[number, seen[unseen]] = decided == labels[number, seen[unseen]]
        own, *others = right.mean(axis=1).tolist()
        as_good = (1 + sum(share >= own for share in others)) / (1 + len(others))
        return {
            "count": len(others),
            "mean": float(np.mean(others)),
            "largest": max(others),
            "right": own,
            "as_good": as_good,
        }


def halved(network: tuple[AcceleratorConfig, Recipe]) -> tuple[AcceleratorConfig, Recipe]:
    """With half the recipe's updates, as choices are made."""
    config, recipe = network
    return config, dataclasses.replace(
        recipe, updates=max(recipe.updates // 2, 1)
    ) if config.recurrent else recipe


def fixed_network(
    change: Callable[[AcceleratorConfig], AcceleratorConfig], protocol: str, **recipe: Any
) -> Network:
    """A network that does not depend on the front end, with the recipe that its configuration then has,
    changed as ``recipe`` says."""

    def network(front_end: AcceleratorConfig) -> tuple[AcceleratorConfig, Recipe]:
        config = change(front_end)
        return config, dataclasses.replace(choose_recipe(config, protocol), **recipe)

    return network


def fits(network: Network, config: AcceleratorConfig) -> bool:
    """The network is one that an accelerator has on this front end, and that the recipe trains."""
    try:
        network(config)
    except InputError:
        return False
    return True


def _row(config: AcceleratorConfig, recipe: Recipe) -> dict[str, Any]:
    return {
        "cell": config.network.cell,
        "hidden": config.network.hidden if config.recurrent else 0,
        "recipe": recipe.name,
    }


def shuffles(labels: np.ndarray, columns: Sequence[np.ndarray]) -> np.ndarray:
    """(1 + SHUFFLES, n): the labels, and shuffled ones. What a group's recordings share stays shared: labels
    change places within each group, or, where every group is of one class, between whole groups."""
    rng = np.random.default_rng(0)
    codes = np.array(
        [np.zeros(len(labels), int), *(np.unique(column, return_inverse=True)[1] for column in columns)]
    )
    groups = np.unique(codes, axis=1, return_inverse=True)[1].ravel()
    members = [np.flatnonzero(groups == group) for group in range(groups.max() + 1)]
    whole = all(len(np.unique(labels[rows])) == 1 for rows in members)
    made = np.tile(labels, (1 + SHUFFLES, 1))
    for row in made[1:]:
        if whole:
            for rows, other in zip(members, rng.permutation(len(members)), strict=True):
                row[rows] = labels[members[other][0]]
        else:
            for rows in members:
                row[rows] = rng.permutation(labels[rows])
    return made
