"""Networks on front ends: the candidates, and the way in which they are judged.

Candidates are the linear cell on each front end listed, and on one front end GRUs of 4, 8 and 12 units, and
of 16 if 12 is not level. Each is cross-validated, all folds at once, in the integers that it would be
quantised to: with one seed, and with more seeds if it can still be taken.

A linear cell is fitted as a logistic regression and by least squares (`eskin.training.linear_fit`): which one
does better depends on how many touches there are for its weights. Augmentation helps or harms, depending on
the difference between the classes. So if the recipe augments touches, both are also fitted to the touches as
recorded. Further candidates are logistic regression of the touches as recorded with a weaker penalty, and
least squares with each of RIDGES. All cost the same, so all are tried on the cheapest front end; on the
others only the best of either kind, if it is not out of reach. First comes the mean of a logistic regression
and least squares, then logistic regressions, whose margins are logarithms of odds.

Recurrent candidates stand on the front end on which a GRU 12, tried with half of the updates, is best. Trees are
tried on windows that divide the touch, with FORESTS[PROBED] on each of `Listed.for_trees` and with the other sizes on the best.

If networks are judged under disturbance, the one that the rule takes by undisturbed recordings is then tried
on sturdier front ends (`eskin.choose.sturdy`). Linear cells fitted to disturbed touches and GRUs trained with
failing taxels are tried too, and the best of all with a fault detector, as far as the rule could take them in its place.

Each of these steps is a row of MOVES (`eskin.choose.search`). A `NetworkSearch` is a choice on one set of
recordings. The main choice is one of them, and so is each choice inside the training part of a fold: these make
their moves together, so that their networks train together.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import wraps
from typing import Any

import numpy as np

from eskin.choose.candidate import (
    CLEAN_LOSS,
    Candidate,
    ScoredCandidate,
    affordable,
    best_of,
    choose,
    choose_stable,
    in_reach,
    tied,
)
from eskin.choose.choice_table import network_name
from eskin.choose.front_ends import Listed, first_of_gates
from eskin.choose.search import Move, Request, Search, search
from eskin.choose.sturdy import SPREAD, Hardening
from eskin.golden.core import NETWORKS, AcceleratorConfig, InputError, Record
from eskin.golden.data import Recordings
from eskin.training.formats import with_network
from eskin.training.judge import CrossValidationSettings, NetworkLearner, Rows, folds_of, judge
from eskin.training.level import is_level
from eskin.training.recipe import AS_RECORDED, Recipe, choose_recipe

AUTO = "auto"

GRU_UNITS, LARGER_UNITS = (4, 8, 12), 16
"""Numbers of units that are tried, and the one that is tried if 12 is not level."""

OUT_OF_REACH = 3.0
"""A network that is this many standard errors behind the best, with one seed, is not tried further."""

WEAK_PENALTY = 10.0
"""Inverse penalty of a logistic regression beside that of the recipe, 1: on fabric_slide it reaches 97.7 %
where 1 reaches 97.2 %, leaving conditions out, and 92.6 against 89.0 % leaving forces out; 0.1 is behind on
both, 100 level."""

FORESTS, PROBED = ((16, 8), (32, 10), (64, 12)), 2
"""Trees of a forest and their depth; the place of those that find the front end."""

MOST_FOREST_VALUES = 250_000
"""Most features of all touches that trees are tried on: a forest of more takes tens of seconds in each choice."""

TREES_GAIN = 0.1
"""About what trees gain by learning from a second group, beyond what a linear cell gains: 4 to 11 points on pvdf_indent, biotac_slide
and sign_glove."""
LEFT_OUT = (
    f"linear cells are left out: trees are at most {TREES_GAIN:.0%} of the recordings behind them, each fold learns from one "
    "group alone, and a second group helps trees more"
)

STURDY: dict[str, Record] = {
    f"sturdy {strength:g}": {"squares": True, "sturdy": strength} for strength in (0.1, 0.3, 1.0)
}
"""Fits of a linear cell that are tried if it is judged under disturbance."""
ROBUST, ROBUST_UPDATES = "robust", 800
"""Recipe of recurrent cells that are judged under disturbance, and its updates."""
GATES_AHEAD, RECURRENT = 2, 6
"""Numbers of front ends that recurrent cells are tried on under disturbance, and of these cells."""
RESCANNED = 3
"""Number of front ends on which more scans are tried under disturbance."""
DIVIDED = 4
"""Number of gates on which windows that divide the touch are tried under disturbance."""
GUARDED = 3
"""Number of candidates that are tried with a fault detector."""
FINALISTS = 3
"""Number of candidates with the best scores, and of those beyond the fewest bounds, that are disturbed on all recordings."""
AGAIN = 2
"""Maximum number of candidates under disturbance that are scored with other seeds."""

RIDGES = (0.1, 0.01, 0.001)
"""Penalties of least squares beside the one that each training part chooses by leaving touches out. With few
groups, these touches are near copies of others: from two sessions of sign_glove the penalty chosen classifies
60.7 % of the third correctly, and 0.01 classifies 67.9 %."""

SQUARES: Record = {"name": "least squares", "squares": True}
AVERAGED = "mean of both"
FITS: dict[str, Record] = {
    AVERAGED: {"name": AVERAGED, "averaged": True, "ridge": 0.01, **AS_RECORDED},
    "linear": {},
    "not augmented": {"name": "not augmented", **AS_RECORDED},
    "weak penalty": {"name": "weak penalty", "penalty": WEAK_PENALTY, **AS_RECORDED},
    "least squares": SQUARES,
    "least squares, not augmented": {**SQUARES, "name": "least squares, not augmented", **AS_RECORDED},
    **{
        f"ridge {share:g}": {**SQUARES, "name": f"ridge {share:g}", "ridge": share, **AS_RECORDED}
        for share in RIDGES
    },
    **{fit: {"name": fit, **changes, **AS_RECORDED} for fit, changes in STURDY.items()},
}
"""Fits of a linear cell, as changes to the configuration's recipe, in the order of preference."""
ALIKE = {"not augmented": "linear", "least squares, not augmented": "least squares"}
"""Fits that equal another fit if the recipe augments nothing, and that other fit."""


@dataclass(frozen=True, kw_only=True)
class Effort:
    """Amount of work for the choice.

    fits, units, forests: of linear cells, of GRUs and of trees. share: divisor of a recurrent network's number of updates.
    probe, probe_share: units and share of the GRU that finds the front end of recurrent networks. seeds:
    number for candidates that can still be taken. brief: nothing dearer is tried once no other can be better
    by a standard error. sturdy, robust: fits of linear and of recurrent cells under disturbance. ends: number
    of front ends that are made sturdier. few_groups: as ``by`` says.
    """

    fits: tuple[str, ...] = tuple(fit for fit in FITS if fit not in STURDY)
    units: tuple[int, ...] = GRU_UNITS
    forests: tuple[tuple[int, int], ...] = FORESTS
    share: int = 1
    probe: int = 12
    probe_share: int = 2
    seeds: int = 1
    brief: bool = False
    sturdy: tuple[str, ...] = tuple(STURDY)
    robust: tuple[str, ...] = (ROBUST,)
    ends: int = 3
    few_groups: bool = False

    def by(self, recordings: Recordings, parts: Sequence[np.ndarray]) -> Effort:
        """Effort that suits leaving out ``parts`` in turn. If ``learns_from_one_group``, results do not show
        which fit is better: only the first fit and no sturdier one is tried, GRUs have the units that are
        tried inside folds, and linear cells give way to trees."""
        if not learns_from_one_group(recordings, parts):
            return self
        return dataclasses.replace(self, fits=self.fits[:1], units=INSIDE.units, sturdy=(), few_groups=True)


def learns_from_one_group(recordings: Recordings, parts: Sequence[np.ndarray]) -> bool:
    """True if there are two folds and each is one group. A network then learns from a single group and nothing about
    differences between groups, so the best for one group need not be the best for both."""
    values = [[np.unique(group[part]).tolist() for part in parts] for group in recordings.groups.values()]
    return len(parts) == 2 and any(len(one) == len(two) == 1 and one != two for one, two in values)


INSIDE = Effort(
    fits=(AVERAGED, "weak penalty", "least squares, not augmented", "ridge 0.01"),
    units=(8,),
    forests=(),
    share=4,
    probe=8,
    probe_share=4,
    brief=True,
    sturdy=("sturdy 0.1", "sturdy 1"),
    ends=2,
)
"""Effort inside folds, where there are many choices."""


MOST_STURDY_INPUTS = 2048
"""Most inputs, over all windows, of a linear cell that is fitted under disturbance, as 256 taxels in 8 windows have:
the time of a fit grows with their third power."""


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """The user's request about the network; None: no request. `eskin.training.settings.TrainingSettings` defines each
    field. open: True if the network is chosen."""

    cell: str | None = None
    hidden: int | None = None
    reset: str | None = None
    robust: bool = False
    open: bool = False

    def candidate(
        self,
        on: AcceleratorConfig,
        cell: str | None = None,
        hidden: int | None = None,
        fit: str = "",
        **changes: Any,
    ) -> Candidate:
        """The network asked for on a front end, or another one in its place, with its recipe; ``changes``: of other fields.

        Raises
        ------
        InputError
            No accelerator has this network, or there is no such recipe.
        """
        cell, hidden = cell or (None if self.cell == AUTO else self.cell), hidden or self.hidden
        config = (network(on, cell, hidden) if cell else with_network(on, hidden=hidden)).replace(**changes)
        if config.recurrent:
            config = with_network(config, reset=self.reset)
        recipe = choose_recipe(config, self.robust)
        if fit == ROBUST:
            wary = choose_recipe(config, robust=True)
            updates = ROBUST_UPDATES if config.recurrent else wary.updates
            return Candidate(on, config, dataclasses.replace(wary, name=ROBUST, updates=updates))
        if fit in STURDY and config.sets * config.inputs > MOST_STURDY_INPUTS:
            raise InputError(
                f"{config.sets * config.inputs} inputs: are too many for a fit under disturbance"
            )
        fit = fit if recipe.augments else ALIKE.get(fit, fit)
        return Candidate(on, config, dataclasses.replace(recipe, **FITS[fit]) if fit else recipe)

    def forest(self, on: AcceleratorConfig, trees: int, depth: int, fit: str = "") -> Candidate | None:
        """So many trees on a front end; None: no accelerator has them."""
        return self.possible(on, "trees", None, fit, trees=trees, depth=depth)

    def possible(self, on: AcceleratorConfig, *network: Any, **changes: Any) -> Candidate | None:
        """Result of ``candidate``, or None if it would raise an error."""
        try:
            return self.candidate(on, *network, **changes)
        except InputError:
            return None


def network(config: AcceleratorConfig, cell: str, hidden: int | None) -> AcceleratorConfig:
    """``config`` with another network. A linear cell, whose logits add up, takes its global decision from the
    last step."""
    changed = with_network(config, cell=cell, hidden=hidden)
    return changed if changed.recurrent else changed.replace(decision="last")


@dataclass(eq=False, kw_only=True)
class NetworkSearch(Search):
    """The search of a network on the front ends listed.

    rows, tests: recordings of the choice, and those that are left out in turn. hardening: networks are judged under
    disturbance, too. calm: the choice by undisturbed recordings; None: not made yet. dearest: the candidate that
    shows what a higher cost would gain. finalists: the candidates that were disturbed on all recordings; empty: none yet.
    """

    front_ends: Listed
    options: SearchOptions
    effort: Effort
    rows: Rows
    tests: Sequence[Rows]
    hardening: Hardening | None = None
    calm: ScoredCandidate | None = None
    dearest: Candidate | None = None
    finalists: list[ScoredCandidate] = field(default_factory=list)

    @property
    def taken(self) -> Candidate:
        """The network to take, after all moves.

        Raises
        ------
        InputError
            No candidate fits an accelerator, or the named board.
        """
        if not self.options.open:
            return self.best_probe()
        return self.stablest.candidate

    @property
    def stablest(self) -> ScoredCandidate:
        """The choice under disturbance; ``calm`` without any."""
        assert self.calm is not None
        judged = self.finalists or self.comparable
        return choose_stable(judged, self.calm, self.prices) if self.hardening else self.calm

    @property
    def comparable(self) -> list[ScoredCandidate]:
        """Candidates that the rule compares. If folds learn from one group each, linear cells are left out where trees are
        at most TREES_GAIN behind."""
        linear = [scored for scored in self.tried if scored.is_linear]
        others = [scored for scored in self.tried if not scored.is_linear]
        forests = [scored for scored in others if scored.config.is_forest]
        if not (self.effort.few_groups and linear and forests):
            return self.tried
        return others if best_of(linear).accuracy - best_of(forests).accuracy <= TREES_GAIN else self.tried

    @property
    def remarks(self) -> list[str]:
        """A sentence if the rule leaves linear cells out."""
        return [LEFT_OUT] if len(self.comparable) < len(self.tried) else []

    def usable(self, candidates: Iterable[Candidate | None]) -> list[Candidate]:
        """Those that fit the board and that the rule could still take."""
        fitting = [one for one in candidates if one and self.prices.is_candidate(one.config)]
        return [one for one in dict.fromkeys(fitting) if not (self.effort.brief and self.beaten(one))]

    def beaten(self, candidate: Candidate) -> bool:
        """True if a cheaper one is settled."""
        price = self.prices.price(candidate.config)
        return any(one.settled and self.prices.price(one.config) < price for one in self.tried)

    def request(self, candidates: Iterable[Candidate]) -> Request:
        """Candidates of the choice."""
        return Request([*candidates], self.effort.share)

    def fits(self, on: AcceleratorConfig) -> dict[str, Candidate | None]:
        """Linear cells on a front end, by their fit."""
        return {fit: self.options.possible(on, "linear", None, fit) for fit in self.effort.fits}

    @property
    def probes(self) -> list[Candidate]:
        """Networks that find the front end of recurrent ones: the network asked for, or a GRU."""
        options, on = self.options, self.front_ends.for_recurrent
        if options.open:
            return self.usable(options.possible(config, "gru", self.effort.probe) for config in on)
        return self.usable(map(options.possible, on))

    def best_probe(self) -> Candidate:
        """The most accurate probe, if they were judged; otherwise the first.

        Raises
        ------
        InputError
            The board does not hold the network asked for.
        """
        probes = self.probes
        if not probes:
            cell = self.options.candidate(self.front_ends.taken).config.network.cell  # or says why not
            raise InputError(
                f"`fits` {self.prices.board}: does not hold {cell} on the requested or chosen front end; name a "
                "larger board, or leave the network open"
            )
        # the best, not the cheapest that ties: after few updates short touches look better than they are
        judged = self.scored(probes, self.effort.probe_share)
        judged.sort(key=lambda one: self.prices.price(one.config))
        return best_of(judged).candidate if judged else probes[0]

    def in_price(self, candidates: Iterable[Candidate | None]) -> list[Candidate]:
        """Those that cost little enough to be taken in place of ``calm``."""
        calm = self.calm
        unique = dict.fromkeys(candidates)
        return [one for one in unique if one and calm and affordable(one.config, calm, self.prices)]

    def within_price(self, candidates: Iterable[Candidate | None]) -> Request:
        """A request for those `in_price`."""
        return self.request(self.in_price(candidates))

    def with_calm(self, front_ends: Iterable[AcceleratorConfig], fits: Iterable[str]) -> Request:
        """A request for the network of ``calm`` on each front end with each fit."""
        return self.within_price(self.like_calm(on, fit) for on in front_ends for fit in fits)

    @property
    def reported(self) -> list[ScoredCandidate]:
        """``tried``; candidates out of reach but ``dearest`` without figures under disturbance."""
        if self.calm is None or self.hardening is None:
            return self.tried
        shown = {one.candidate for one in in_reach(self.tried, self.calm, self.prices)} | {self.dearest}
        return [one if one.candidate in shown else one.under(None, self.rows) for one in self.tried]

    def like_calm(self, on: AcceleratorConfig, fit: str = "") -> Candidate | None:
        """The network of ``calm`` on another front end, with another fit."""
        assert self.calm is not None
        config = self.calm.config
        if config.is_forest:
            return self.options.forest(on, config.forest.trees, config.forest.depth, fit)
        units = config.network.hidden if config.recurrent else None
        return self.options.possible(on, config.network.cell, units, fit)


# ---------------------------------------------------------------------- moves
def linear_fits(search: NetworkSearch) -> Request:
    """Every fit of a linear cell on the cheapest front end."""
    return search.request(search.usable(search.fits(search.front_ends.smaller[0]).values()))


def fits_elsewhere(search: NetworkSearch) -> Request:
    """The best fit of each kind on the other front ends, if it is not out of reach."""
    cheapest, *others = search.front_ends.smaller
    fits = search.fits(cheapest)
    first = search.scored(search.usable(fits.values()), search.effort.share)
    if not first or any(one.settled for one in first):
        return Request()
    best = best_of(first)
    near = [one for one in first if is_level(best.correct, one.correct, OUT_OF_REACH)]
    kinds = [
        [one for one in near if (one.candidate.recipe.averaged, one.candidate.recipe.squares) == kind]
        for kind in ((True, False), (False, False), (False, True))
    ]
    ahead = [best_of(kind).candidate for kind in kinds if kind]
    names = [fit for fit, candidate in fits.items() if candidate in ahead]
    return search.request(search.usable(search.fits(on)[fit] for on in others for fit in names))


def forest_probes(search: NetworkSearch) -> Request:
    """Trees on each front end that may suit them, unless no other network can be better."""
    if any(scored.settled for scored in search.tried):
        return Request()
    most = MOST_FOREST_VALUES / len(search.rows)
    ons = [on for on in search.front_ends.for_trees if on.windows.steps * on.inputs <= most]
    return search.request(search.usable(search.options.forest(on, *FORESTS[PROBED]) for on in ons))


def forest_sizes(search: NetworkSearch) -> Request:
    """Trees of other numbers and depths on the best of these front ends."""
    forests = [scored for scored in search.tried if scored.config.is_forest]
    if not forests:
        return Request()
    on = best_of(forests).candidate.front_end
    return search.request(search.usable(search.options.forest(on, *size) for size in search.effort.forests))


def front_end_probes(search: NetworkSearch) -> Request:
    """A network on each front end that may suit recurrent ones, with few updates."""
    probes = search.probes
    needless = len(probes) < 2 or not probes[0].config.recurrent or any(one.settled for one in search.tried)
    return Request(() if needless else probes, search.effort.probe_share, probe=True)


def gru_units(search: NetworkSearch) -> Request:
    """GRUs of several sizes on the front end that the probes found."""
    probes = search.scored(search.probes, search.effort.probe_share)
    on = search.best_probe().front_end if probes else search.front_ends.taken
    grus = (search.options.possible(on, "gru", count) for count in search.effort.units)
    return search.request(search.usable(grus))


def larger_gru(search: NetworkSearch) -> Request:
    """A GRU of LARGER_UNITS, if fewer units are not enough."""
    grus = [one for one in search.tried if one.config.recurrent]
    if len(grus) < 2 or not goes_on(search.tried):
        return Request()
    on = grus[-1].candidate.front_end
    return search.request(search.usable([search.options.possible(on, "gru", LARGER_UNITS)]))


def other_seeds(search: NetworkSearch) -> Request:
    """Further seeds of the candidates that can still be taken."""
    if not search.tried:
        board = f" and the board {search.prices.board}" if search.prices.named else ""
        raise InputError(
            f"configuration '{search.front_ends.taken.name}': no candidate network fits it{board}; name one "
            "with `cell` and `hidden`"
        )
    most = best_of(search.tried).accuracy
    near = [
        one.candidate
        for one in search.tried
        if most - one.accuracy <= OUT_OF_REACH * one.standard_error and not search.beaten(one.candidate)
    ]
    return Request(near if search.effort.seeds > 1 else (), search.effort.share, other_seeds=True)


def hardened(
    move: Callable[[NetworkSearch, ScoredCandidate, Hardening], Request],
) -> Callable[[NetworkSearch], Request]:
    """A move that is made only if networks are judged under disturbance: ``move`` of a search, its choice by undisturbed
    recordings, and sturdier front ends."""

    @wraps(move)
    def request(search: NetworkSearch) -> Request:
        if search.calm is None or search.hardening is None:
            return Request()
        return move(search, search.calm, search.hardening)

    return request


def sturdier_networks(search: NetworkSearch) -> Request:
    """The network of the choice by undisturbed recordings, on sturdier front ends and fitted to disturbances."""
    search.calm = choose(search.comparable, search.prices)
    calm, hardening, effort = search.calm, search.hardening, search.effort
    if hardening is None:
        return Request()
    listed = search.front_ends
    on = calm.candidate.front_end
    every = dict.fromkeys([on, *hardening.denser(on), *listed.smaller, *listed.rivals])
    # other networks take seconds
    ends = [on for on in every if search.in_price([search.like_calm(on)])]
    ends = ends[: effort.ends if calm.is_linear else 1]
    ends += [one for on in ends for one in hardening.sturdier(on)]
    fits = dict.fromkeys((fit_of(calm), *(effort.sturdy if calm.is_linear else effort.robust)))
    return search.with_calm(ends, fits)


@hardened
def means_alone(search: NetworkSearch, plain: ScoredCandidate, hardening: Hardening) -> Request:
    """The best recurrent cell so far with means alone, on its sturdiest front ends: a spike moves other features more."""
    if not plain.config.recurrent:
        return Request()
    means = hardening.means(ahead_of(search)[0].candidate.front_end)
    return search.with_calm(means[-1 if search.effort.brief else 0 :], search.effort.robust)


@hardened
def more_windows(search: NetworkSearch, plain: ScoredCandidate, hardening: Hardening) -> Request:
    """The best linear cells so far with more windows, which regain some of the accuracy that a sturdier fit loses."""
    if not plain.is_linear:
        return Request()
    ahead = ahead_of(search)[0].candidate.front_end
    spread = search.in_price(search.like_calm(on) for on in hardening.spread(ahead))
    ons = [candidate.front_end for candidate in spread][:: 2 if search.effort.brief else 1]
    return search.with_calm(ons, search.effort.sturdy)


@hardened
def more_scans(search: NetworkSearch, plain: ScoredCandidate, hardening: Hardening) -> Request:
    """The best linear cells so far with up to four times the scans: means of more frames have less noise."""
    if not plain.is_linear:
        return Request()
    ahead = [*dict.fromkeys(scored.candidate.front_end for scored in ahead_of(search))]
    denser = list[AcceleratorConfig]()
    for on in ahead[: 1 if search.effort.brief else RESCANNED]:
        twice = hardening.denser(on)
        denser += [four_times for config in twice for four_times in hardening.denser(config)] or twice
    return search.with_calm(denser, search.effort.sturdy)


@hardened
def windows_of_the_touch(search: NetworkSearch, plain: ScoredCandidate, hardening: Hardening) -> Request:
    """Sturdy linear cells on windows that divide the touch, on the best gates so far and on the choice's own."""
    gates = first_of_gates((scored.candidate.front_end for scored in [*ahead_of(search), plain]), scans=True)
    ends = gates[: 2 if search.effort.brief else DIVIDED]
    return search.within_price(
        search.options.possible(divided, "linear", None, fit)
        for on in ends
        for divided in hardening.dividing(on)
        for fit in search.effort.sturdy
    )


@hardened
def robust_trees(search: NetworkSearch, plain: ScoredCandidate, hardening: Hardening) -> Request:
    """The best trees fitted to disturbances, on their front end and on sturdier ones, if they are level without any."""
    forests = [
        scored for scored in search.tried if scored.config.is_forest and not scored.candidate.recipe.robust
    ]
    if plain.config.is_forest or not forests:
        return Request()
    best = best_of(forests)
    if not is_level(best_of(search.tried).correct, best.correct):
        return Request()
    on, size = best.candidate.front_end, best.config.forest
    ons = [on, *hardening.sturdier(on)[-1:]]
    fitted = (
        search.options.forest(at, size.trees, size.depth, fit) for at in ons for fit in search.effort.robust
    )
    return search.within_price(fitted)


@hardened
def robust_recurrent(search: NetworkSearch, plain: ScoredCandidate, hardening: Hardening) -> Request:
    """GRUs trained with failing taxels, on the sturdiest front ends."""
    ranked = (
        scored.candidate.front_end for scored in sorted(search.tried, key=lambda scored: -scored.accuracy)
    )
    gates = first_of_gates(on for on in ranked if not on.opens_at_once)
    threshold = plain.candidate.front_end.onset_rule.onset_threshold
    sturdiest = sorted(gates, key=lambda gate: hardening.false_onsets(gate, threshold))[:GATES_AHEAD]
    ons = [ahead_of(search)[0].candidate.front_end, *sturdiest]
    few = [on for gate in ons for on in hardening.spread(gate) if on.windows.steps == SPREAD[0]]
    units = search.effort.units[-2:]
    fitting = search.in_price(
        search.options.possible(on, "gru", count, fit)
        for on in few
        if on.features.feature_kinds == ("mean",)
        for fit in search.effort.robust
        for count in reversed(units)
    )
    return search.request(fitting[: 1 if search.effort.brief else RECURRENT])


def ahead_of(search: NetworkSearch) -> list[ScoredCandidate]:
    """Those that lose at most twice CLEAN_LOSS, by their score."""
    assert search.calm is not None
    return in_reach(search.tried, search.calm, search.prices, 2 * CLEAN_LOSS)


@hardened
def fault_detectors(search: NetworkSearch, _: ScoredCandidate, hardening: Hardening) -> Request:
    """The best candidates so far with a fault detector. Their networks stay, so nothing is fitted."""
    for scored in ahead_of(search)[:GUARDED]:
        on = hardening.guarded(scored.candidate.front_end)
        guarded = on and scored.guarded(on, search.rows)
        if guarded and search.in_price([guarded.candidate]):
            search.tried.append(guarded)
    return Request()


@hardened
def seeds_under_stress(search: NetworkSearch, plain: ScoredCandidate, _: Hardening) -> Request:
    """Further seeds of the candidates that are level under disturbance."""
    if search.effort.seeds < 2:
        return Request()
    level = tied(search.tried, plain, search.prices)
    fewer = [one.candidate for one in level if len(one.seeds) < len(plain.seeds)]
    return Request(fewer[:AGAIN], search.effort.share, other_seeds=True)


@hardened
def all_recordings(search: NetworkSearch, plain: ScoredCandidate, hardening: Hardening) -> Request:
    """The candidates that tie for the best, disturbed on all recordings: with few of them a bound is held or not by chance."""
    if search.effort.brief:
        return Request()
    level = tied(search.comparable, plain, search.prices)
    fewest = sorted(level, key=lambda scored: scored.beyond)
    for scored in {id(scored): scored for scored in [*level[:FINALISTS], *fewest[:FINALISTS]]}.values():
        finalist = scored.under(hardening.stress.whole, search.rows)
        search.tried[search.tried.index(scored)] = finalist
        search.finalists.append(finalist)
    return Request()


def robust_dearer(search: NetworkSearch) -> Request:
    """Of the networks out of reach the most accurate, fitted to disturbance if it is recurrent: it shows what a
    higher cost would gain."""
    best, tried = best_of(search.tried), {one.candidate for one in search.tried}
    search.dearest = best.candidate
    if search.hardening is None or not best.config.recurrent:
        return Request()
    network, on = best.config.network, search.stablest.candidate.front_end
    robust = search.usable(
        search.options.possible(on, network.cell, network.hidden, fit) for fit in search.effort.robust
    )
    for fresh in robust:
        search.dearest = fresh if fresh not in tried else search.dearest
    return search.request(robust)


PROBES = Move("front ends for recurrent networks", front_end_probes)

MOVES: tuple[Move[NetworkSearch], ...] = (
    Move("fits of a linear cell", linear_fits),
    Move("the best fits on other front ends", fits_elsewhere),
    Move("trees on front ends for them", forest_probes),
    Move("trees of other sizes", forest_sizes),
    PROBES,
    Move("units of a GRU", gru_units),
    Move("a larger GRU", larger_gru),
    Move("further seeds", other_seeds),
    Move("sturdier designs", sturdier_networks),
    Move("means alone", means_alone),
    Move("more windows", more_windows),
    Move("more scans", more_scans),
    Move("windows that divide the touch", windows_of_the_touch),
    Move("trees fitted to disturbances", robust_trees),
    Move("recurrent cells trained under disturbance", robust_recurrent),
    Move("fault detectors", fault_detectors),
    Move("further seeds under disturbance", seeds_under_stress),
    Move("disturbances of all recordings", all_recordings),
    Move("what a higher cost gains", robust_dearer),
)
"""Moves of the search of a network."""

AS_REQUESTED = (PROBES,)
"""Moves for a network that the user named."""


def choose_networks(searches: Sequence[NetworkSearch], settings: CrossValidationSettings) -> list[Candidate]:
    """The network that each search takes; its ``tried`` holds what it judged. Networks of one candidate train at
    once.

    Raises
    ------
    InputError
        As `NetworkSearch.taken`.
    """
    moves = MOVES if searches[0].options.open else AS_REQUESTED
    search(searches, moves, lambda requests: _judged(requests, searches, settings))
    return [state.taken for state in searches]


def fit_of(one: ScoredCandidate) -> str:
    """Name of the fit of a candidate, as in `SearchOptions.candidate`."""
    name = one.candidate.recipe.name
    if not one.is_linear:
        return ROBUST if name == ROBUST else ""
    return name if name in FITS else "linear"


def goes_on(tried: Sequence[ScoredCandidate]) -> bool:
    """GRU 12, the last of ``tried``, is not level: below the best, or still better than GRU 8, by more than a
    standard error."""
    *_, eight, twelve = tried
    best = best_of(tried)
    below = best.accuracy - twelve.accuracy > best.standard_error
    rising = twelve.accuracy - eight.accuracy > max(eight.standard_error, twelve.standard_error)
    return below or rising


def _judged(
    requests: Mapping[int, Request], searches: Sequence[NetworkSearch], settings: CrossValidationSettings
) -> dict[int, list[ScoredCandidate]]:
    """Judge what the searches request."""
    together: dict[tuple[Candidate, int, bool], list[int]] = {}
    for number, request in requests.items():
        for candidate in request.candidates:
            together.setdefault((candidate, request.share, request.other_seeds), []).append(number)
    answers: dict[int, list[ScoredCandidate]] = {number: [] for number in requests}
    for (candidate, share, others), numbers in together.items():
        learner = NetworkLearner(settings.datasets, candidate.config, shortened(candidate, share))
        folds = [
            fold
            for seed in (settings.seeds[1:] if others else settings.seeds[:1])
            for number in numbers
            for fold in folds_of(searches[number].tests, [seed], searches[number].rows, number)
        ]
        try:
            decisions = judge(
                learner, folds, settings.recordings.labels, settings.called(network_name(candidate.network))
            )
        except InputError:
            if candidate.config.recurrent:
                raise
            continue  # its formats do not fit
        for number in numbers:
            own = decisions.of_split(number)
            answers[number].append(ScoredCandidate.of(candidate, own, searches[number].rows, settings.stress))
    return answers


def shortened(candidate: Candidate, share: int) -> Recipe:
    """The candidate's recipe with 1/``share`` of the updates if it is recurrent, for use in a choice."""
    recipe = candidate.recipe
    if not candidate.config.recurrent:
        return recipe
    return dataclasses.replace(recipe, updates=max(recipe.updates // share, 1))


def check_units(cell: str | None, hidden: int | None) -> None:
    """Raise InputError for a number of units with a cell that has no units, or with a cell that is still to
    be chosen."""
    if hidden is not None and cell in (AUTO, "linear", "trees", *NETWORKS):
        raise InputError(
            f"`hidden` {hidden}: `cell` {cell} has no hidden units; leave `hidden` out, or name `cell` "
            "gru or lstm"
        )
