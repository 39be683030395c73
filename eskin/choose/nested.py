"""Accuracy on recordings that chose nothing: front end and network are chosen again inside the training part
of every fold.

What is cross-validated on the folds it was chosen on looks better than it is: on pure noise of 60 recordings
and two classes the best of eighty front ends is 60 to 75 % right. Here each fold is left out of everything
that looks at a label, by a cheaper choice of the same kind:

- *front end*: of a `eskin.choose.choose_front_end.Field`, which no label picked, by ridge regression
  on folds of the training part, NESTED_ON recordings at most: the cheapest that is level with the best.
- *network*: the one that was asked for; else of the linear cell, by least squares and as a logistic
  regression of a weak penalty, on that front end and on the best one, and a GRU 8 the cheapest that is level
  with the best on the inner folds, in integers. A GRU stands on each front end that the choice itself would
  try one on, with a part of the updates and one seed; so does a recurrent network that was asked for. It is
  not tried where it can be neither better by a standard error nor cheaper.
- the network chosen is trained on the whole training part with the full recipe, quantised, and judged on the
  fold.

Inner folds (``inner_folds``) leave out what the choice itself leaves out; where a part has one value of it, a
group that can be left out there. Thresholds and scales of the candidates are measured
on all recordings, without a label.

Where recordings are few, the ridge regression does the same with SHUFFLES shufflings of the labels: what luck
alone reaches.
"""

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from eskin.choose.choice_table import front_end_words, network_name
from eskin.choose.choose_front_end import (
    Field,
    Judged,
    cheapest,
    for_recurrent,
    inner_folds,
    most_accurate,
    ridge_weights,
    rivals_of,
    row_of,
    shortlist_of,
)
from eskin.choose.cost import Market
from eskin.golden.core import AcceleratorConfig, InputError, Record
from eskin.training.crossval import (
    FoldDecisions,
    Piece,
    Terms,
    fold_records,
    judge_pieces,
    over_folds,
    share_right,
)
from eskin.training.fit import one_thread
from eskin.training.recipe import Recipe, choose_recipe
from eskin.training.splits import held_out, split_folds

FEW, SHUFFLES = 200, 20
"""Recordings up to which labels are shuffled, and how often."""

RIDGE_PENALTY = 1e-2
"""Of the ridge regression that decides the folds left out, of the shuffled labels and beside them of the
right ones."""

SHARE = 4
"""Of the updates that a recurrent network has on inner folds: one part in so many."""

Network = Callable[[AcceleratorConfig], tuple[AcceleratorConfig, Recipe]]
"""The network on a front end, and its recipe."""


@dataclass(frozen=True, eq=False)
class Nested:
    """How the choice is made again.

    terms: with the groups that the choice leaves out. networks: the one asked for, or linear ones and a
    recurrent one. market: what they cost.
    """

    terms: Terms
    field: Field
    networks: Sequence[Network]
    market: Market

    def record(self, split: Sequence[str]) -> Record:
        """The figure of one split, and how it came about.

        Returns
        -------
        {groups, folds, seeds, float_accuracy, integer_accuracy, agreement, standard_error (over recordings),
        per_fold: [{held_out, recordings, the three shares, front_end, network}], shuffled (None: many
        recordings; ``_shuffled``), wall_s}.
        """
        begin = time.perf_counter()
        recordings = self.terms.recordings
        seeds = list(map(int, self.terms.seeds))
        tests = split_folds(recordings, list(split), self.terms.folds, None)
        parts = [np.setdiff1d(np.arange(len(recordings)), test) for test in tests]
        train_rows = [np.flatnonzero(~np.isin(self.field.numbers, test)) for test in tests]
        shuffled = shuffles(
            recordings.labels,
            [recordings.labels if name == "label" else recordings.groups[name] for name in split],
        )
        labels = shuffled[: None if len(recordings) <= FEW else 1, self.field.numbers]
        with one_thread():
            judged = [self.field.judged(rows, self.terms.groups, labels) for rows in train_rows]
        chosen = self._chosen(parts, [of_part[0] for of_part in judged])
        folds = range(len(tests))
        pieces = [
            Piece(*chosen[fold], parts[fold], tests[fold], copy)
            for copy in range(len(seeds))
            for fold in folds
        ]
        runs = self._decided(pieces)
        correct = share_right(recordings.labels, [piece.test for piece in pieces], runs)
        names = [held_out(recordings, split, test) for test in tests]
        per_fold = fold_records(names, tests, [runs[fold :: len(tests)] for fold in folds], recordings.labels)
        for fold, (config, recipe) in zip(per_fold, chosen, strict=True):
            del fold["by_seed"]
            fold |= {
                "front_end": front_end_words(row_of(config)),
                "network": network_name(_row(config, recipe)),
            }
        return {
            "groups": list(split),
            "folds": len(tests),
            "seeds": seeds,
            **over_folds(per_fold),
            "standard_error": float(correct.std(ddof=1) / np.sqrt(len(correct))),
            "per_fold": per_fold,
            "shuffled": self._shuffled(tests, train_rows, judged, labels) if len(labels) > 1 else None,
            "wall_s": time.perf_counter() - begin,
        }

    def _decided(self, pieces: Sequence[Piece]) -> list[FoldDecisions]:
        terms = self.terms
        return judge_pieces(terms.datasets, pieces, int(terms.seeds[0]), terms.widths, terms.progress)

    def _right(
        self,
        networks: Sequence[tuple[AcceleratorConfig, Recipe]],
        inner: Sequence[tuple[np.ndarray, np.ndarray]],
    ) -> Iterator[np.ndarray]:
        """Of each network on its inner fold which recordings it decides rightly; 1/SHARE of the updates."""
        pieces = [
            Piece(*shortened(network, SHARE), *pair) for network, pair in zip(networks, inner, strict=True)
        ]
        for piece, run in zip(pieces, self._decided(pieces), strict=True):
            yield run.integer_global == self.terms.recordings.labels[piece.test]

    def _chosen(
        self, parts: Sequence[np.ndarray], judged: Sequence[list[Judged]]
    ) -> list[tuple[AcceleratorConfig, Recipe]]:
        """Of each training part the cheapest configuration and recipe of those level with the best on the
        inner folds."""
        tried = [self._tried(of_part) for of_part in judged]
        if not all(tried):
            raise InputError("the network asked for fits none of the front ends; name another")
        inner = [
            self._inner(part) if len(networks) > 1 else []
            for part, networks in zip(parts, tried, strict=True)
        ]
        work = [
            (network, pair)
            for networks, pairs in zip(tried, inner, strict=True)
            for network in networks
            for pair in pairs
        ]
        right = self._right([network for network, _ in work], [pair for _, pair in work])
        chosen = []
        for networks, pairs in zip(tried, inner, strict=True):
            outcomes = [np.concatenate([next(right) for _ in pairs]) for _ in networks if pairs]
            candidates = [
                Judged(config, outcome, 0) for (config, _), outcome in zip(networks, outcomes, strict=False)
            ]
            cheap = cheapest(candidates, self.market, lambda config: config) if candidates else None
            chosen.append(networks[candidates.index(cheap) if cheap else 0])
        return chosen

    def _tried(self, judged: list[Judged]) -> list[tuple[AcceleratorConfig, Recipe]]:
        """The networks of one part that inner folds decide on, by what the ridge regression ``judged``."""
        first, (*linears, last) = self.networks[0], self.networks
        judged = [
            candidate
            for candidate in judged
            if fits(first, candidate.config) and self.market.is_candidate(first(candidate.config)[0])
        ]
        if not judged:
            return []
        ridge = cheapest(judged, self.market)
        if not linears and not last(ridge.config)[0].recurrent:
            return [last(ridge.config)]
        listed = shortlist_of(judged, ridge, self.market)
        best = most_accurate([candidate for candidate in judged if candidate.config in listed])
        on = for_recurrent(ridge.config, listed, rivals_of(judged, ridge), lambda config: fits(last, config))
        recurrent = [last(config) for config in on]
        if not linears:
            return recurrent
        networks = [
            linear(config) for config in dict.fromkeys((ridge.config, best.config)) for linear in linears
        ]
        better, least = 1 - best.accuracy > best.standard_error, self.market.price(networks[0][0])
        networks += [gru for gru in recurrent if better or self.market.price(gru[0]) < least]
        return [network for network in networks if self.market.is_candidate(network[0])]

    def _inner(self, part: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """(training part, test) of each inner fold, recordings of the archive."""
        return [
            (np.setdiff1d(part, part[fold]), part[fold])
            for fold in inner_folds(self.terms.recordings.subset(part), self.terms.groups)
        ]

    def _shuffled(
        self,
        tests: Sequence[np.ndarray],
        seen: Sequence[np.ndarray],
        judged: Sequence[list[list[Judged]]],
        labels: np.ndarray,
    ) -> Record:
        """{count, mean, largest (accuracy of the ridge regression on shuffled labels), right (on the right
        ones), as_good (share of labellings, the right one among them, that do as well as the right one)}."""
        classes, right = len(self.terms.recordings.class_names), np.zeros(labels.shape, dtype=bool)
        of_config = {config: (rows, gram) for config, rows, gram in self.field.seen}
        for test, rows, of_part in zip(tests, seen, judged, strict=True):
            test_rows = np.flatnonzero(np.isin(self.field.numbers, test))
            for number, of_labelling in enumerate(of_part):
                touched, gram = of_config[cheapest(of_labelling, self.market).config]
                train = np.flatnonzero(np.isin(touched, rows))
                unseen = np.flatnonzero(np.isin(touched, test_rows))
                if not len(train) or not len(unseen):
                    continue
                targets = np.eye(classes)[labels[number, touched[train]]]
                alpha = RIDGE_PENALTY * float(np.trace(gram)) / len(gram)
                weights = ridge_weights(gram[np.ix_(train, train)], alpha, targets)
                decided = (gram[np.ix_(unseen, train)] @ weights).argmax(axis=1)
                right[number, touched[unseen]] = decided == labels[number, touched[unseen]]
        own, *shuffled = right.mean(axis=1).tolist()
        as_good = (1 + sum(share >= own for share in shuffled)) / (1 + len(shuffled))
        return {
            "count": len(shuffled),
            "mean": float(np.mean(shuffled)),
            "largest": max(shuffled),
            "right": own,
            "as_good": as_good,
        }


def shortened(network: tuple[AcceleratorConfig, Recipe], share: int) -> tuple[AcceleratorConfig, Recipe]:
    """With 1/``share`` of the updates of a recurrent network's recipe, as choices are made."""
    config, recipe = network
    updates = max(recipe.updates // share, 1) if config.recurrent else recipe.updates
    return config, dataclasses.replace(recipe, updates=updates)


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


def _row(config: AcceleratorConfig, recipe: Recipe) -> Record:
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
    labellings = np.tile(labels, (1 + SHUFFLES, 1))
    for row in labellings[1:]:
        if whole:
            for rows, source in zip(members, rng.permutation(len(members)), strict=True):
                row[rows] = labels[members[source][0]]
        else:
            for rows in members:
                row[rows] = rng.permutation(labels[rows])
    return labellings
