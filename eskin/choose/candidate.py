"""Candidates, the results of judging them, and the rule that takes one of them.

A *candidate* is a whole design: a front end, a network on it, and how its weights are fitted. It is *judged*
by its decisions on recordings that it has not seen. **The rule** (`choose`): the cheapest of those that tie
with the most accurate. `eskin.training.level` defines a tie, `eskin.choose.cost.CostModel` the cost. The same
rule chooses front ends, which are evaluated with a linear network in closed form (`eskin.choose.front_ends`),
whole networks (`eskin.choose.networks`), and both again inside the training part of every fold.

With a panel (`eskin.study.stability.panel`), networks decide disturbed recordings too; the score is the mean of both accuracies.
Candidates may lose at most CLEAN_LOSS of accuracy against the choice of the rule, take at most DEARER times its
average power and at most ENERGY times its energy of a touch. Of the candidates that tie with the best score, the cheapest is
chosen that is beyond its bounds in hardly more modes than any other (`choose_stable`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from eskin.choose.choice_table import beyond
from eskin.choose.cost import CostModel
from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.core.groups import GROUP_OF
from eskin.training.formats import with_network
from eskin.training.judge import Decisions
from eskin.training.level import TIE, is_level, least_error, paired_shortfall
from eskin.training.recipe import Recipe
from eskin.training.record import Disturbed, FrontEnd, FrontEndRow, Network, WorstMode

if TYPE_CHECKING:
    from eskin.study.stability.panel import Panel

CLEAN_LOSS, DEARER, ENERGY = 0.007, 4 / 3, 4.0
"""Largest loss of accuracy on undisturbed recordings, and largest factors of average power (or of the preferred
cost) and of the energy of a touch, at which a design that does better under disturbance is taken."""

MORE_MODES = 1
"""Number of modes in which the choice may be beyond its bounds more often than the best candidate that ties: with few
recordings, a mode is held or not by chance."""

SCREENED = Recipe(name="ridge regression", squares=True)
"""Recipe by which front ends are judged without a network: closed form, float."""


@dataclass(frozen=True)
class Candidate:
    """A design that may be taken.

    front_end: the configuration that its front end comes from. config: the same with the network; this one is
    built. recipe: how the network is fitted.
    """

    front_end: AcceleratorConfig
    config: AcceleratorConfig
    recipe: Recipe

    @classmethod
    def screened(cls, front_end: AcceleratorConfig) -> Candidate:
        """A front end without a network. Its cost is that with a linear cell, or with its own cell if no
        linear cell has room for the weights."""
        try:
            return cls(front_end, with_network(front_end, cell="linear"), SCREENED)
        except InputError:
            return cls(front_end, front_end, SCREENED)

    @property
    def network(self) -> Network:
        """Cell, hidden units and recipe; trees and their depth."""
        return Network.of(self.config, self.recipe.name)


def mean_told(shares: np.ndarray) -> float | None:
    """The mean without NaN; None if there is nothing else."""
    return None if np.isnan(shares).all() else float(np.nanmean(shares))


@dataclass(frozen=True, eq=False)
class ScoredCandidate:
    """A candidate and its decisions on recordings that it has not seen.

    correct: (recordings) the share of its networks that decided each correctly; without a touch: 0. missed:
    recordings without a touch or a completed window. decisions: of its networks. stress: the disturbances.
    disturbed: function that gives the share of networks that were wrong under each (cases, recordings).
    """

    candidate: Candidate
    correct: np.ndarray
    missed: int = 0
    decisions: Decisions | None = None
    stress: Panel | None = None
    disturbed: Callable[[], np.ndarray] | None = None

    @classmethod
    def of(
        cls, candidate: Candidate, decisions: Decisions, rows: np.ndarray, stress: Panel | None
    ) -> ScoredCandidate:
        """A candidate whose networks decided as ``decisions``, on recordings ``rows``."""
        correct = decisions.correct.reindex(rows, fill_value=0.0).to_numpy()
        disturbed = partial(_wrong, candidate.config, stress, decisions, rows) if stress else None
        return cls(candidate, correct, decisions=decisions, stress=stress, disturbed=disturbed)

    def guarded(self, front_end: AcceleratorConfig, rows: np.ndarray) -> ScoredCandidate:
        """The same networks on ``front_end``, which is theirs with a fault detector. It raises no flag on recordings
        without a disturbance, so that decisions on these stay."""
        config = self.candidate.config.replace(**dataclasses.asdict(front_end.faults))
        candidate = dataclasses.replace(self.candidate, front_end=front_end, config=config)
        return dataclasses.replace(self, candidate=candidate).under(self.stress, rows)

    def under(self, stress: Panel | None, rows: np.ndarray) -> ScoredCandidate:
        """The same networks under another panel."""
        assert self.decisions is not None
        return ScoredCandidate.of(self.candidate, self.decisions, rows, stress)

    @property
    def seeds(self) -> list[int]:
        """Seeds of its networks."""
        return self.decisions.seeds if self.decisions else []

    @cached_property
    def wrong(self) -> np.ndarray | None:
        """Result of ``disturbed``, computed at the first access."""
        return self.disturbed() if self.disturbed else None

    @cached_property
    def config(self) -> AcceleratorConfig:
        """The design; of trees with the sizes of the largest that were fitted."""
        config = self.candidate.config
        if not config.is_forest or self.decisions is None:
            return config
        sizes = [network.integer.config.forest.nodes for _, network in self.decisions.fitted]
        return config.replace(nodes=max(sizes))

    @property
    def is_linear(self) -> bool:
        """True for a linear cell."""
        return self.config.network.cell == "linear"

    @property
    def accuracy(self) -> float:
        """Share of recordings decided correctly, mean over networks."""
        return float(self.correct.mean())

    @property
    def standard_error(self) -> float:
        """Standard error of the accuracy over recordings; no less than ``least_error``."""
        count = len(self.correct)
        return max(float(self.correct.std(ddof=1) / np.sqrt(count)), least_error(count)) if count > 1 else 0.0

    @cached_property
    def stressed(self) -> np.ndarray | None:
        """(recordings) the share of disturbances under which each was decided correctly, or the gate stayed shut as
        it must; NaN: not disturbed."""
        if self.stress is None or self.wrong is None or not len(self.wrong):
            return None
        return self.stress.stressed(self.config, self.wrong, gates=True)

    @property
    def stressed_accuracy(self) -> float | None:
        """Accuracy on disturbed recordings, mean over those that were disturbed; None: only gates were looked at."""
        if self.stress is None or self.wrong is None:
            return None
        return mean_told(self.stress.stressed(self.config, self.wrong))

    @cached_property
    def scores(self) -> np.ndarray:
        """(recordings) the score of each: the mean of its decisions without and with disturbance. Disturbed
        recordings are few and have a higher weight, so the mean over all recordings is the mean of both
        accuracies."""
        if self.stressed is None:
            return self.correct
        told = ~np.isnan(self.stressed)
        return (self.correct + np.where(told, self.stressed, 0.0) / max(told.mean(), 1e-9)) / 2

    @property
    def score(self) -> float:
        """Mean of the accuracy and of ``stressed``."""
        return float(self.scores.mean())

    @property
    def score_standard_error(self) -> float:
        """Standard error of the score over recordings."""
        if self.stressed is None:
            return self.standard_error
        told = self.stressed[~np.isnan(self.stressed)]
        stressed_error = float(told.std(ddof=1) / np.sqrt(len(told))) if len(told) > 1 else 0.0
        return (self.standard_error + stressed_error) / 2

    @cached_property
    def figures(self) -> Disturbed:
        """Figures of the modes, as of `Panel.figures`."""
        stressed = self.stressed
        if self.stress is None or self.wrong is None or stressed is None or np.isnan(stressed).all():
            return Disturbed(stress=[], gate_modes=[])
        told = ~np.isnan(stressed)  # the bounds refer to the accuracy on the same recordings
        cases = self.stress.cases(self.config, self.wrong)
        return self.stress.figures(cases, float(self.correct[told].mean()))

    @property
    def beyond(self) -> int:
        """Number of modes beyond their bounds by more than half of a disturbed recording: few recordings have few
        possible figures, and a bound lies between two."""
        if self.stressed is None:
            return 0
        half = 0.5 / max(int((~np.isnan(self.stressed)).sum()), 1)
        return sum(beyond(row) > half + 1e-9 for row in self.figures.modes)

    @property
    def worst(self) -> WorstMode | None:
        """The mode that is furthest beyond its bound, or nearest to it."""
        row = max(self.figures.modes, key=beyond, default=None)
        return WorstMode(mode=row.mode, figure=row.figure) if row else None

    @property
    def settled(self) -> bool:
        """So near 100 % that no other can be better by more than TIE standard errors."""
        return self.accuracy >= 1.0 - TIE * least_error(len(self.correct))

    def joined(self, other: ScoredCandidate) -> ScoredCandidate:
        """This candidate together with its networks of other seeds."""
        first, more = len(self.seeds), len(other.seeds)

        def mean(one: np.ndarray, another: np.ndarray) -> np.ndarray:
            return (first * one + more * another) / (first + more)

        def wrong() -> np.ndarray:
            assert self.wrong is not None and other.wrong is not None
            return mean(self.wrong, other.wrong)

        correct = mean(self.correct, other.correct)
        decisions = self.decisions and other.decisions and self.decisions.joined(other.decisions)
        return dataclasses.replace(
            self, correct=correct, decisions=decisions, disturbed=self.disturbed and wrong
        )


def _wrong(config: AcceleratorConfig, stress: Panel, decisions: Decisions, rows: np.ndarray) -> np.ndarray:
    """(cases, rows) the share of networks that were wrong under each disturbance, among those that had not
    seen the recording."""
    places = [np.searchsorted(rows, fold.test) for fold, _ in decisions.fitted]
    shares = [stress.wrong(config, network.integer, fold.test) for fold, network in decisions.fitted]
    total, judged = np.zeros((len(shares[0]), len(rows))), np.zeros(len(rows))
    for place, wrong in zip(places, shares, strict=True):
        total[:, place] += wrong
        judged[place] += 1
    return total / np.maximum(judged, 1)


def best_of(judged: Sequence[ScoredCandidate]) -> ScoredCandidate:
    """The first of those with the highest accuracy."""
    return max(judged, key=lambda one: one.accuracy)


def choose(judged: Sequence[ScoredCandidate], prices: CostModel) -> ScoredCandidate:
    """The cheapest of the candidates that tie with the most accurate one; at equal cost the first. Of those
    that tie, one that fits the board goes first; if the user named the board, only candidates that fit it
    count.

    Raises
    ------
    InputError
        Nothing fits the named board.
    """
    usable = [one for one in judged if prices.is_candidate(one.config)]
    if not usable:
        raise InputError(
            f"`fits` {prices.board}: is too small for all {len(judged)} candidates; name a larger board"
        )
    best = best_of(usable)
    return _cheapest([one for one in usable if is_level(best.correct, one.correct)], prices)


def _cheapest(level: Sequence[ScoredCandidate], prices: CostModel) -> ScoredCandidate:
    """The cheapest of tied candidates; one that fits the board goes first."""
    level = prices.sorted(level, lambda scored: scored.config)
    return next((one for one in level if prices.fits(one.config)), level[0])


def affordable(config: AcceleratorConfig, calm: ScoredCandidate, prices: CostModel) -> bool:
    """True if ``config`` costs at most DEARER and ENERGY times as much as ``calm``, the choice of `choose`."""
    own, other = prices.cost_of(config), prices.cost_of(calm.config)
    within = prices.first(own) <= DEARER * (1 + 1e-9) * prices.first(other)
    within &= own.energy_touch_j <= ENERGY * (1 + 1e-9) * other.energy_touch_j
    return prices.is_candidate(config) and within


def in_reach(
    judged: Sequence[ScoredCandidate], calm: ScoredCandidate, prices: CostModel, loss: float = CLEAN_LOSS
) -> list[ScoredCandidate]:
    """Candidates that `choose_stable` may take in place of ``calm``, and ``calm`` itself; the best score first. loss:
    largest loss of accuracy."""
    found = [
        one
        for one in judged
        if one.candidate == calm.candidate
        or (one.accuracy >= calm.accuracy - loss and affordable(one.config, calm, prices))
    ]
    return sorted(found, key=lambda one: -one.score)


def tied(
    judged: Sequence[ScoredCandidate], calm: ScoredCandidate, prices: CostModel
) -> list[ScoredCandidate]:
    """Candidates `in_reach` that tie with the best score, which comes first."""
    best, *others = in_reach(judged, calm, prices)
    return [best] + [one for one in others if is_level(best.scores, one.scores)]


def choose_stable(
    judged: Sequence[ScoredCandidate], calm: ScoredCandidate, prices: CostModel
) -> ScoredCandidate:
    """The cheapest of the candidates that tie with the best score and are beyond their bounds in at most MORE_MODES
    more than the best of these; at equal cost the one in fewer modes, then with the higher score. Candidates are left
    out if, compared with ``calm`` (the choice of `choose`), they lose more than CLEAN_LOSS of accuracy on undisturbed
    recordings or are not `affordable`."""
    level = sorted(tied(judged, calm, prices), key=lambda scored: scored.beyond)
    most = level[0].beyond + MORE_MODES
    return _cheapest([scored for scored in level if scored.beyond <= most], prices)


def front_end_of(config: AcceleratorConfig) -> FrontEnd:
    """A front end in plain values, which `eskin.choose.choice_table.front_end_words` puts into words."""
    used = {name: name in GROUP_OF for name in FrontEnd.model_fields}
    used["onset_threshold"] = config.onset_rule.onset == "baseline"
    used["window_mode"] = config.follows_touch
    used["activity_rule"] = used["activity_block"] = "activity" in config.features.feature_kinds
    values = {name: config.value(name) for name in used if used[name]}
    return FrontEnd(name=config.name, inputs=config.inputs, **values)


def screened_row(one: ScoredCandidate, best: ScoredCandidate, prices: CostModel) -> FrontEndRow:
    """A row of ``front_end`` in training.json."""
    shortfall, error = paired_shortfall(best.correct, one.correct)
    return FrontEndRow(
        **front_end_of(one.candidate.front_end).plain(),
        accuracy=one.accuracy,
        standard_error=one.standard_error,
        missed=one.missed,
        behind=shortfall,
        behind_error=error,
        level=is_level(best.correct, one.correct),
        energy_touch_j=prices.cost_of(one.config).energy_touch_j,
    )
