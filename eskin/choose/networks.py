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

Recurrent candidates stand on the front end on which a GRU 12, tried with half of the updates, is best.

If networks are judged under disturbance, the one that the rule takes by undisturbed recordings is then tried
on sturdier front ends (`eskin.choose.sturdy`). Linear cells fitted to disturbed touches and GRUs trained with
failing taxels are tried too, as far as the rule could take them in its place.

`network_choice` is a choice on one set of recordings. The main choice is one of them, and so is each choice
inside the training part of a fold: these run `side_by_side`, so that their networks train together.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

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
)
from eskin.choose.choice_table import network_name
from eskin.choose.cost import CostModel
from eskin.choose.front_ends import Listed
from eskin.choose.sturdy import Hardening
from eskin.golden.core import NETWORKS, AcceleratorConfig, InputError, Record
from eskin.golden.data import Recordings
from eskin.training.crossval import CrossValidationSettings, FoldJob, Trained, share_right, train_folds
from eskin.training.formats import with_network
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

STURDY: dict[str, Record] = {
    f"sturdy {strength:g}": {"squares": True, "sturdy": strength} for strength in (0.3, 0.1, 0.03)
}
"""Fits of a linear cell that are tried if it is judged under disturbance."""
ROBUST, ROBUST_UPDATES = "robust", 800
"""Recipe of recurrent cells that are judged under disturbance, and its updates."""
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

    fits, units: of linear cells and of GRUs. share: divisor of a recurrent network's number of updates.
    probe, probe_share: units and share of the GRU that finds the front end of recurrent networks. seeds:
    number for candidates that can still be taken. brief: nothing dearer is tried once no other can be better
    by a standard error. sturdy, robust: fits of linear and of recurrent cells under disturbance. ends: number
    of front ends that are made sturdier. rounds: number of rounds of longer windows.
    """

    fits: tuple[str, ...] = tuple(fit for fit in FITS if fit not in STURDY)
    units: tuple[int, ...] = GRU_UNITS
    share: int = 1
    probe: int = 12
    probe_share: int = 2
    seeds: int = 1
    brief: bool = False
    sturdy: tuple[str, ...] = tuple(STURDY)
    robust: tuple[str, ...] = (ROBUST,)
    ends: int = 3
    rounds: int = 2

    def by(self, recordings: Recordings, parts: Sequence[np.ndarray]) -> Effort:
        """Effort that suits leaving out ``parts`` in turn. If ``learns_from_one_group``, results do not show
        which fit is better: only the first fit and no sturdier one is tried, and GRUs have the units that are
        tried inside folds."""
        if not learns_from_one_group(recordings, parts):
            return self
        return dataclasses.replace(self, fits=self.fits[:1], units=INSIDE.units, sturdy=())


def learns_from_one_group(recordings: Recordings, parts: Sequence[np.ndarray]) -> bool:
    """True if there are two folds and each is one group. A network then learns from a single group and nothing about
    differences between groups, so the best for one group need not be the best for both."""
    values = [[np.unique(group[part]).tolist() for part in parts] for group in recordings.groups.values()]
    return len(parts) == 2 and any(len(one) == len(two) == 1 and one != two for one, two in values)


INSIDE = Effort(
    fits=(AVERAGED, "weak penalty", "least squares, not augmented", "ridge 0.01"),
    units=(8,),
    share=4,
    probe=8,
    probe_share=4,
    brief=True,
    sturdy=("sturdy 0.1",),
    robust=(),
    ends=2,
    rounds=0,
)
"""Effort inside folds, where there are many choices."""


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """The user's request about the network; None: no request. `eskin.requests.TrainRequest` defines each
    field. open: True if the network is chosen."""

    cell: str | None = None
    hidden: int | None = None
    reset: str | None = None
    robust: bool = False
    open: bool = False

    def candidate(
        self, on: AcceleratorConfig, cell: str | None = None, hidden: int | None = None, fit: str = ""
    ) -> Candidate:
        """The network asked for on a front end, or another one in its place, with its recipe.

        Raises
        ------
        InputError
            No accelerator has this network, or there is no such recipe.
        """
        cell, hidden = cell or (None if self.cell == AUTO else self.cell), hidden or self.hidden
        config = network(on, cell, hidden) if cell else with_network(on, hidden=hidden)
        if config.recurrent:
            config = with_network(config, reset=self.reset)
        recipe = choose_recipe(config, self.robust)
        if fit == ROBUST:
            wary = choose_recipe(config, robust=True)
            return Candidate(on, config, dataclasses.replace(wary, name=ROBUST, updates=ROBUST_UPDATES))
        fit = fit if recipe.augments else ALIKE.get(fit, fit)
        return Candidate(on, config, dataclasses.replace(recipe, **FITS[fit]) if fit else recipe)

    def possible(self, on: AcceleratorConfig, *network: Any) -> Candidate | None:
        """Result of ``candidate``, or None if it would raise an error."""
        try:
            return self.candidate(on, *network)
        except InputError:
            return None


def network(config: AcceleratorConfig, cell: str, hidden: int | None) -> AcceleratorConfig:
    """``config`` with another network. A linear cell, whose logits add up, takes its global decision from the
    last step."""
    changed = with_network(config, cell=cell, hidden=hidden)
    return changed if changed.recurrent else changed.replace(decision="last")


@dataclass(frozen=True, eq=False)
class Part:
    """Recordings that a choice is made on (rows), and the sets of them that are left out in turn (tests), as
    numbers in the archive."""

    rows: np.ndarray
    tests: Sequence[np.ndarray]


@dataclass(frozen=True)
class Round:
    """Candidates that a choice wants judged next: with 1/``share`` of a recurrent network's updates, on the
    first seed, or on all others."""

    candidates: Sequence[Candidate]
    share: int = 1
    other_seeds: bool = False


Result = TypeVar("Result")
Choosing = Generator[Round, list[ScoredCandidate], Result]
"""Yields rounds and receives the judged candidates (a linear fit whose formats do not fit is left out)."""
NetworkChoice = Choosing[tuple[Candidate, list[ScoredCandidate]]]
"""Returns the candidate taken and all candidates of the choice; the list is empty if the network was not
open."""


def network_choice(
    front_ends: Listed,
    options: SearchOptions,
    prices: CostModel,
    effort: Effort,
    hardening: Hardening | None = None,
) -> NetworkChoice:
    """Choose a network on one of the front ends listed. hardening: networks are judged under disturbance,
    too.

    Raises
    ------
    InputError
        No candidate fits an accelerator, or the named board.
    """
    choice = _Choice(front_ends, options, prices, effort)
    if not options.open:
        return (yield from choice.requested_network()), []
    calm = yield from choice.by_accuracy()
    if hardening is None:
        return calm.candidate, choice.tried
    return (yield from choice.under_stress(calm, hardening)), choice.tried


@dataclass(eq=False)
class _Choice:
    """A choice in progress. tried: all candidates that it judged; known: these and the probes, by candidate
    and share."""

    front_ends: Listed
    options: SearchOptions
    prices: CostModel
    effort: Effort
    tried: list[ScoredCandidate] = field(default_factory=list)
    known: dict[tuple[Candidate, int], ScoredCandidate] = field(default_factory=dict)

    # -- rounds
    def usable(self, candidates: Iterable[Candidate | None]) -> list[Candidate]:
        fitting = [one for one in candidates if one and self.prices.is_candidate(one.config)]
        return [one for one in dict.fromkeys(fitting) if not (self.effort.brief and self.beaten(one))]

    def beaten(self, candidate: Candidate) -> bool:
        price = self.prices.price(candidate.config)
        return any(one.settled and self.prices.price(one.config) < price for one in self.tried)

    def asked(self, candidates: Sequence[Candidate], share: int) -> Choosing[list[ScoredCandidate]]:
        fresh = [candidate for candidate in candidates if (candidate, share) not in self.known]
        for one in (yield Round(fresh, share)) if fresh else []:
            self.known[one.candidate, share] = one
        return [self.known[one, share] for one in candidates if (one, share) in self.known]

    def judged(self, candidates: Iterable[Candidate]) -> Choosing[list[ScoredCandidate]]:
        """Those of the candidates that were not tried before."""
        before = {one.candidate for one in self.tried}
        fresh = [one for one in candidates if one not in before]
        outcomes = yield from self.asked(fresh, self.effort.share)
        self.tried.extend(outcomes)
        return outcomes

    def with_other_seeds(self, near: Sequence[ScoredCandidate]) -> Choosing[None]:
        if self.effort.seeds > 1 and near:
            more = yield Round([one.candidate for one in near], self.effort.share, other_seeds=True)
            further = {one.candidate: one for one in more}
            self.tried = [
                one.joined(further[one.candidate]) if one.candidate in further else one for one in self.tried
            ]

    def best_probe(self, probes: Sequence[Candidate]) -> Choosing[Candidate]:
        # the best, not the cheapest that ties: after few updates short touches look better than they are
        outcomes = yield from self.asked(probes, self.effort.probe_share)
        outcomes.sort(key=lambda one: self.prices.price(one.config))
        return best_of(outcomes).candidate

    # -- choices
    def requested_network(self) -> Choosing[Candidate]:
        """The requested network, on the best front end for it."""
        probes = self.usable(map(self.options.possible, self.front_ends.for_recurrent))
        if not probes:
            cell = self.options.candidate(self.front_ends.taken).config.network.cell  # or says why not
            raise InputError(
                f"--fits {self.prices.board}: does not hold {cell} on the requested or chosen front end; name a "
                "larger board, or leave the network open"
            )
        if len(probes) < 2 or not probes[0].config.recurrent:
            return probes[0]
        return (yield from self.best_probe(probes))

    def by_accuracy(self) -> Choosing[ScoredCandidate]:
        """Choose by undisturbed recordings alone."""
        options, effort, front_ends = self.options, self.effort, self.front_ends
        probes = self.usable(options.possible(on, "gru", effort.probe) for on in front_ends.for_recurrent)
        cheapest, *others = front_ends.smaller
        fits = {fit: options.possible(cheapest, "linear", None, fit) for fit in effort.fits}
        first = yield from self.judged(self.usable(fits.values()))
        if first and not any(one.settled for one in first):
            best = best_of(first)
            near = [one for one in first if is_level(best.correct, one.correct, OUT_OF_REACH)]
            kinds = [
                [one for one in near if (one.candidate.recipe.averaged, one.candidate.recipe.squares) == kind]
                for kind in ((True, False), (False, False), (False, True))
            ]
            taken = [best_of(kind).candidate for kind in kinds if kind]
            kept = [fit for fit, candidate in fits.items() if candidate in taken]
            further = [options.possible(on, "linear", None, fit) for on in others for fit in kept]
            yield from self.judged(self.usable(further))
        on, probes = front_ends.taken, self.usable(probes)
        if len(probes) > 1 and not any(one.settled for one in self.tried):
            on = (yield from self.best_probe(probes)).front_end
        grus = self.usable(options.possible(on, "gru", count) for count in effort.units)
        units = yield from self.judged(grus)
        if len(units) > 1 and goes_on(self.tried):
            yield from self.judged(self.usable([options.possible(on, "gru", LARGER_UNITS)]))
        if not self.tried:
            board = f" and the board {self.prices.board}" if self.prices.named else ""
            raise InputError(
                f"configuration '{front_ends.taken.name}': no candidate network fits it{board}; name one "
                "with --cell and --hidden"
            )
        most = best_of(self.tried).accuracy
        near = [
            one
            for one in self.tried
            if most - one.accuracy <= OUT_OF_REACH * one.standard_error and not self.beaten(one.candidate)
        ]
        yield from self.with_other_seeds(near)
        return choose(self.tried, self.prices)

    def under_stress(self, calm: ScoredCandidate, hardening: Hardening) -> Choosing[Candidate]:
        """Try the network ``calm`` on sturdier front ends, fitted to disturbances, and with more units, as
        far as these are in reach of it."""
        prices, effort, front_ends = self.prices, self.effort, self.front_ends
        recurrent, network = calm.config.recurrent, calm.config.network
        units = network.hidden if recurrent else None

        def possible(on: AcceleratorConfig, fit: str = "") -> Candidate | None:
            return self.options.possible(on, network.cell, units, fit)

        on = calm.candidate.front_end
        every = dict.fromkeys([on, *hardening.denser(on), *front_ends.smaller, *front_ends.rivals])
        # a recurrent network takes seconds
        ends = [on for on in every if self.in_price([possible(on)], calm)][: 1 if recurrent else effort.ends]
        ends += [one for on in ends for one in hardening.sturdier(on)]
        fits = dict.fromkeys((fit_of(calm), *(effort.robust if recurrent else effort.sturdy)))
        yield from self.judged(self.in_price([possible(on, fit) for on in ends for fit in fits], calm))
        for _ in range(effort.rounds):
            # longer windows regain some of the accuracy that a sturdier fit loses
            ahead = max(in_reach(self.tried, calm, prices, 2 * CLEAN_LOSS), key=lambda one: one.score)
            on, fit = ahead.candidate.front_end, fit_of(ahead)
            if recurrent:
                further = [self.options.possible(on, network.cell, network.hidden + 4, fit)]
            else:
                further = [possible(longer, fit) for longer in hardening.longer(on)]
            if not (yield from self.judged(self.in_price(further, calm))):
                break
        ranked = sorted(in_reach(self.tried, calm, prices), key=lambda one: -one.score)
        behind = [one for one in ranked if len(one.runs) < len(calm.runs)]
        level = [one for one in behind if is_level(ranked[0].scores, one.scores)]
        yield from self.with_other_seeds(level[:AGAIN])
        stablest = choose_stable(self.tried, calm, prices)
        # of the networks out of reach only the most accurate is judged under disturbance, fitted to it if it is
        # recurrent: it shows what a higher cost would gain
        dearer = [best_of(self.tried)]
        if dearer[0].config.recurrent:
            network, on = dearer[0].config.network, stablest.candidate.front_end
            robust = [self.options.possible(on, network.cell, network.hidden, fit) for fit in effort.robust]
            dearer += yield from self.judged(self.usable(robust))
        told = {one.candidate for one in (*in_reach(self.tried, calm, prices), dearer[-1])}
        self.tried = [
            dataclasses.replace(one, calm=one.candidate == calm.candidate)
            if one.candidate in told
            else dataclasses.replace(one, stress=None, disturbed=None)
            for one in self.tried
        ]
        return stablest.candidate

    def in_price(self, candidates: Iterable[Candidate | None], calm: ScoredCandidate) -> list[Candidate]:
        unique = dict.fromkeys(candidates)
        return [one for one in unique if one and affordable(one.config, calm, self.prices)]


def fit_of(one: ScoredCandidate) -> str:
    """Name of the fit of a candidate, as in `SearchOptions.candidate`."""
    name = one.candidate.recipe.name
    if one.config.recurrent:
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


def side_by_side(
    choices: Sequence[NetworkChoice], parts: Sequence[Part], settings: CrossValidationSettings
) -> list[tuple[Candidate, list[ScoredCandidate]]]:
    """Result of each choice on its entry of ``parts``. Networks of one candidate train at once."""
    waiting, answers = dict(enumerate(choices)), dict[int, list[ScoredCandidate]]()
    outcomes: dict[int, tuple[Candidate, list[ScoredCandidate]]] = {}
    while waiting:
        asked = {}
        for number, choice in list(waiting.items()):
            try:
                asked[number] = choice.send(answers[number]) if answers else next(choice)
            except StopIteration as end:
                outcomes[number] = end.value
                del waiting[number]
        answers = _judged(asked, parts, settings)
    return [outcomes[number] for number in range(len(choices))]


def _judged(
    asked: Mapping[int, Round], parts: Sequence[Part], settings: CrossValidationSettings
) -> dict[int, list[ScoredCandidate]]:
    """Judge the rounds that these choices request."""
    together: dict[tuple[Candidate, int, bool], list[int]] = {}
    for number, wanted in asked.items():
        for candidate in wanted.candidates:
            together.setdefault((candidate, wanted.share, wanted.other_seeds), []).append(number)
    answers: dict[int, list[ScoredCandidate]] = {number: [] for number in asked}
    for (candidate, share, others), numbers in together.items():
        recipe = shortened(candidate, share)
        seeds = settings.seeds[1:] if others else settings.seeds[:1]
        owners = [number for _ in seeds for number in numbers for _ in parts[number].tests]
        pieces = [
            FoldJob(candidate.config, recipe, np.setdiff1d(parts[number].rows, test), test, copy)
            for copy in range(len(seeds))
            for number in numbers
            for test in parts[number].tests
        ]
        called = settings.called(network_name(candidate.network))
        try:
            trained = train_folds(settings.datasets, pieces, int(seeds[0]), called)
        except InputError:
            if candidate.config.recurrent:
                raise
            continue  # its formats do not fit
        for number in numbers:
            own = [network for owner, network in zip(owners, trained, strict=True) if owner == number]
            runs, rows = [network.decided() for network in own], parts[number].rows
            right = share_right(settings.recordings.labels, [network.job.test for network in own], runs)
            disturbed = partial(_wrong, candidate, own, settings, rows) if settings.stress else None
            answers[number].append(
                ScoredCandidate(
                    candidate, right[rows], runs=tuple(runs), stress=settings.stress, disturbed=disturbed
                )
            )
    return answers


def _wrong(
    candidate: Candidate, networks: Sequence[Trained], settings: CrossValidationSettings, rows: np.ndarray
) -> np.ndarray:
    """(cases, rows) the share of networks that were wrong under each disturbance, among those that had not
    seen the recording."""
    told = [settings.stress.wrong(candidate.config, one.integer, one.job.test) for one in networks]
    total, judged = np.zeros((len(told[0]), len(settings.recordings))), np.zeros(len(settings.recordings))
    for wrong, network in zip(told, networks, strict=True):
        total[:, network.job.test] += wrong
        judged[network.job.test] += 1
    return (total / np.maximum(judged, 1))[:, rows]


def shortened(candidate: Candidate, share: int) -> Recipe:
    """The candidate's recipe with 1/``share`` of the updates if it is recurrent, for use in a choice."""
    recipe = candidate.recipe
    if not candidate.config.recurrent:
        return recipe
    return dataclasses.replace(recipe, updates=max(recipe.updates // share, 1))


def check_units(cell: str | None, hidden: int | None) -> None:
    """Raise InputError for a number of units with a cell that has no units, or with a cell that is still to
    be chosen."""
    if hidden is not None and cell in (AUTO, "linear", *NETWORKS):
        raise InputError(
            f"--hidden {hidden}: --cell {cell} has no hidden units; leave --hidden out, or name --cell "
            "gru or lstm"
        )
