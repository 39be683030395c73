"""The cheapest front end and network that are enough, chosen by evidence: ``--cell auto``, and what ``train``
and ``run`` do without --cell and --config.

Candidates are the linear cell on each front end of the plan's shortlist and GRUs of 4, 8 and 12 units on one,
and of 16 where 12 is not level: where it lies more than a standard error below the best, or is still that
much better than 8. Each is cross-validated, all folds at once, in the integers that it would be quantised to,
with one seed, and with two more where it can still be taken. The cheapest, by the plan's `Market`, of those
that are level with the best is taken. Level means behind by at most one standard error of the paired
difference over recordings, seeds averaged. That error says how far the difference would move with other
recordings like these, not with other groups.

The shortlist was made by a linear classifier, which sees all windows at once; a recurrent network may do with
fewer kinds of feature, or better with another gate. A GRU 12 is cross-validated on the shortlist and on the
best of each other gate that is not hopeless (``recurrent_front_end``); the recurrent candidates stand on the
cheapest of those that are level.

A linear cell is fitted as a logistic regression and by least squares (``eskin.training.linear_fit``):
which one does better depends on how many touches there are for its weights. Where the recipe augments
touches, which helps or harms by what tells the classes apart, both are fitted to touches as they were
recorded too; and a logistic regression of these with a weaker penalty. All cost the same, so all are tried on
the cheapest front end and the best of them on the others. Of those that are level with the most accurate the
first in this order is taken. So logistic regressions, whose margins are logarithms of odds, come before least
squares.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eskin.choose import doubts
from eskin.choose.choice_table import front_end_words, left_out, network_name
from eskin.choose.choose_front_end import (
    Judge,
    Judged,
    Plan,
    cheapest,
    configure,
    for_recurrent,
    most_accurate,
    row_of,
)
from eskin.choose.cost import Market
from eskin.choose.nested import Nested, fits, fixed_network, shortened
from eskin.golden.core import NETWORKS, AcceleratorConfig, InputError, Record
from eskin.golden.data import Recordings
from eskin.golden.data.rate import wrong_rate
from eskin.golden.model import FloatModel, IntegerModel, check_model_target, with_network
from eskin.training.crossval import FoldDecisions, Folds, Progress, Terms, share_right
from eskin.training.datasets import Datasets
from eskin.training.fit import one_thread
from eskin.training.image_models import train_image_model
from eskin.training.losses import Callback
from eskin.training.recipe import AS_RECORDED, Recipe, choose_recipe
from eskin.training.splits import default_splits, split_folds
from eskin.training.train import TrainingRequest, train

GRU_UNITS, LARGER_UNITS = (4, 8, 12), 16
LEVEL = 1.0
"""Standard errors of an accuracy by which a larger network must be better to be tried further."""

OUT_OF_REACH = 3.0
"""Standard errors behind another candidate, with one seed, from which a network is not looked at any
further."""

WEAK_PENALTY = 10.0
"""Inverse penalty of a logistic regression beside that of the recipe, 1: on fabric_slide it reaches 97.7 %
where 1 reaches 97.2 %, leaving conditions out, and 92.6 against 89.0 % leaving forces out; 0.1 is behind on
both, 100 level."""

AUTO = "auto"

STAND_INS = ("linear", None), ("gru", 8)
"""Networks that inner folds choose among."""

LEAST = {
    "energy": "takes the least energy a touch ({energy_touch_j:.3g} J)",
    "cells": "takes the fewest logic cells ({cells})",
    "latency": "has the shortest way from the last sample to the decision ({latency_s:.3g} s)",
}
"""What a preference is, in words."""


@dataclass(frozen=True)
class Candidate:
    """A network on the front end: the configuration, the recipe, and whether each recording was decided
    rightly, (recordings), mean over seeds; record: its cross-validation; integer: the configuration with its
    formats; loses_in: the stage where integers lose more than LOST of accuracy."""

    config: AcceleratorConfig
    recipe: Recipe
    correct: np.ndarray
    record: Record
    front_end: AcceleratorConfig
    integer: AcceleratorConfig
    loses_in: str | None = None

    @property
    def accuracy(self) -> float:
        """Share of recordings that the integer network decided rightly, mean over seeds."""
        return float(self.correct.mean())

    @property
    def standard_error(self) -> float:
        """Of the accuracy, over recordings; no less than ``least_error``."""
        count = len(self.correct)
        return max(float(self.correct.std(ddof=1) / np.sqrt(count)), least_error(count)) if count > 1 else 0.0

    @property
    def multiplies_touch(self) -> int:
        """Multiplies of all steps."""
        return self.config.windows.steps * self.config.multiplies

    def row(self, chosen: bool, market: Market) -> Record:
        """What training.json says of it."""
        config = self.config
        return {
            "cell": config.network.cell,
            "hidden": config.network.hidden if config.recurrent else 0,
            "recipe": self.recipe.name,
            "accuracy": self.accuracy,
            "standard_error": self.standard_error,
            "float_accuracy": self.record["float_accuracy"],
            "agreement": self.record["agreement"],
            "loses_in": self.loses_in,
            **market.row(self.integer),
            "multiplies_touch": self.multiplies_touch,
            "multiplies_step": config.multiplies,
            "parameters": config.parameter_count,
            "seeds": len(self.record["seeds"]),
            "decision_time_s": self.record["decision_time_s"],
            "front_end": front_end_words(row_of(self.front_end)),
            "chosen": chosen,
        }


def least_error(count: int) -> float:
    """Standard error of an accuracy of 100 % over ``count`` recordings.

    It is that of (count + 1) / (count + 2), Laplace's rule of succession: recordings without an error do not
    show that the next one will have none.
    """
    return float(np.sqrt((count + 1) / (count + 2) ** 2 / count))


def network(config: AcceleratorConfig, cell: str, hidden: int | None) -> AcceleratorConfig:
    """``config`` with another network; the global decision of a linear cell, whose logits add up, is that of
    its last step."""
    changed = with_network(config, cell=cell, hidden=hidden)
    return changed if changed.recurrent else changed.replace(decision="last")


def goes_on(candidates: Sequence[Candidate]) -> bool:
    """GRU 12, the last of ``candidates``, is not level: below the best, or still better than GRU 8, by more
    than a standard error."""
    *_, eight, twelve = candidates
    best = most_accurate(candidates)
    below = best.accuracy - twelve.accuracy > LEVEL * best.standard_error
    rising = twelve.accuracy - eight.accuracy > LEVEL * max(eight.standard_error, twelve.standard_error)
    return below or rising


def settled(candidate: Candidate) -> bool:
    """So near 100 % that no other can be better by more than LEVEL standard errors."""
    return candidate.accuracy >= 1.0 - LEVEL * least_error(len(candidate.correct))


def cross_validate_network(
    terms: Terms,
    config: AcceleratorConfig,
    recipe: Recipe,
    goes_on: Callable[[Candidate], bool] = lambda first: True,
) -> Candidate:
    """One candidate, judged on recordings left out: with the first seed, and where that ``goes_on`` with the
    others too."""
    recordings, groups = terms.recordings, [list(terms.groups)]

    def folds_of(seeds: Sequence[int]) -> Folds:
        return Folds(recordings, config, recipe, groups, seeds, terms.folds, terms.datasets)

    def trained(work: Folds) -> tuple[list[FloatModel], list[IntegerModel]]:
        models = work.fit(terms.progress)
        return models, work.quantise(models, terms.widths)

    def candidate(work: Folds, runs: list[FoldDecisions]) -> Candidate:
        (record,) = work.records_of(runs)
        lost = record["float_accuracy"] - record["integer_accuracy"] > doubts.LOST
        stage = alone.loses_in(*networks) if lost else None
        correct = share_right(recordings.labels, work.tests, runs)
        return Candidate(config, recipe, correct, record, config, networks[1][0].config, stage)

    alone = folds_of(terms.seeds[:1])
    networks = trained(alone)
    runs = alone.decided(*networks)
    first = candidate(alone, runs)
    if len(terms.seeds) < 2 or not goes_on(first):
        return first
    further = folds_of(terms.seeds[1:])
    return candidate(folds_of(terms.seeds), runs + further.decided(*trained(further)))


def recurrent_front_end(
    terms: Terms, front_ends: Sequence[AcceleratorConfig], market: Market
) -> tuple[AcceleratorConfig, list[Record]]:
    """The front end for a recurrent network, and a row for each that was tried: of ``front_ends`` the
    cheapest that is level with the best.

    Each trains the configuration's network, a GRU 12 as it is derived, the first seed, half the recipe's
    updates; the cheapest first, and none behind one that is so near 100 % that no other can be better by a
    standard error.
    """
    tried: list[Candidate] = []
    for number, config in enumerate(sorted(front_ends, key=market.price), 1):
        recipe = shortened((config, choose_recipe(config, terms.protocol)), 2)[1]
        progress = terms.called(f"front end {number} of {len(front_ends)}")
        own = dataclasses.replace(terms, seeds=terms.seeds[:1], widths={}, progress=progress)
        tried.append(cross_validate_network(own, config, recipe))
        if settled(tried[-1]):
            break
    judged = [Judged(candidate.config, candidate.correct, 0) for candidate in tried]
    cheap = cheapest(judged, market, lambda config: config)
    rows = [
        {
            "front_end": front_end_words(row_of(candidate.config)),
            "cell": candidate.config.network.cell,
            "hidden": candidate.config.network.hidden,
            "accuracy": candidate.accuracy,
            "standard_error": candidate.standard_error,
            "chosen": candidate is cheap,
        }
        for candidate in judged
    ]
    return cheap.config, rows


def _linear_recipes(augments: bool) -> list[Record]:
    """How linear cells differ from the configuration's recipe, in the order of preference."""
    squares: Record = {"name": "least squares", "squares": True}
    weak: Record = {"penalty": WEAK_PENALTY, **AS_RECORDED}
    if not augments:
        return [{}, {"name": "weak penalty", **weak}, squares]
    # augmenting is no gain where classes differ by their timing
    return [
        {},
        {"name": "not augmented", **AS_RECORDED},
        {"name": "not augmented, weak penalty", **weak},
        squares,
        {**squares, "name": "least squares, not augmented", **AS_RECORDED},
    ]


def choose_network(
    terms: Terms,
    front_ends: Sequence[AcceleratorConfig],
    market: Market,
    recurrent: AcceleratorConfig | None = None,
) -> tuple[Candidate, list[Record]]:
    """Judge the candidates and take one: it, and the rows of training.json. Linear cells stand on each of
    ``front_ends``, the cheapest first, the others on ``recurrent``, by default the first of them.

    One that cannot be taken is judged with the first seed alone: it is OUT_OF_REACH behind another, or one
    that is cheaper is ``settled``. A dearer front end is then not tried at all, nor what does not fit a board
    that was named.

    Raises
    ------
    InputError
        As ``split_folds``; where no candidate fits an accelerator, or the named board.
    """
    candidates: list[Candidate] = []
    recurrent = recurrent or front_ends[0]

    def judge(
        cell: str, on: AcceleratorConfig, hidden: int | None = None, **changes: Any
    ) -> Candidate | None:
        """The candidate; None: it is too wide for an accelerator or the board, or has no such recipe."""
        try:
            tried = network(on, cell, hidden)
            recipe = dataclasses.replace(choose_recipe(tried, terms.protocol), **changes)
        except InputError:
            return None
        if not market.is_candidate(tried):
            return None
        progress = terms.called(f"{cell} {hidden}" if hidden else cell)
        own = dataclasses.replace(terms, progress=progress)
        try:
            candidate = cross_validate_network(own, tried, recipe, goes_on=in_reach)
        except InputError:
            if cell != "linear":
                raise
            return None  # its formats find no room
        candidates.append(dataclasses.replace(candidate, front_end=on))
        return candidate

    def in_reach(first: Candidate) -> bool:
        if any(
            settled(candidate) and market.price(candidate.config) < market.price(first.config)
            for candidate in candidates
        ):
            return False
        best = max((candidate.accuracy for candidate in candidates), default=0.0)
        return best - first.accuracy <= OUT_OF_REACH * first.standard_error

    recipes: list[Record] = []
    for on in front_ends:
        if any(map(settled, candidates)):
            break
        if recipes:
            judge("linear", on, **recipes[candidates.index(most_accurate(candidates[: len(recipes)]))])
        elif linear := judge("linear", on):
            recipes = [{}]
            for changes in _linear_recipes(linear.recipe.augments)[1:]:
                recipes += [changes] if judge("linear", on, **changes) else []
    units = [hidden for hidden in GRU_UNITS if judge("gru", recurrent, hidden)]
    if not candidates:
        fits = f" and the board {market.board}" if market.named else ""
        raise InputError(
            f"configuration '{front_ends[0].name}': no network of the candidates fits it{fits}; name one "
            "with --cell and --hidden"
        )
    if len(units) > 1 and goes_on(candidates):
        judge("gru", recurrent, LARGER_UNITS)
    chosen = cheapest(candidates, market, lambda config: config)
    return chosen, [candidate.row(candidate is chosen, market) for candidate in candidates]


def splits_to_report(
    recordings: Recordings, config: AcceleratorConfig, groups: Sequence[str]
) -> list[list[str]]:
    """What the network taken is cross-validated over: ``default_splits`` and the split it was chosen on."""
    splits = [split for split in default_splits(recordings, config) if split]
    return splits if list(groups) in splits else [*splits, list(groups)]


@dataclass(frozen=True, kw_only=True)
class Wish:
    """What was said of the network; None: nothing. ``train_chosen`` says what each means."""

    cell: str | None = None
    hidden: int | None = None
    weight_sets: str | None = None
    reset: str | None = None
    steps: int | None = None

    @property
    def is_open(self) -> bool:
        """True where the network is chosen, unless a configuration was given."""
        return self.cell is None and self.hidden is None and self.reset is None

    def front_end(self, config: AcceleratorConfig) -> AcceleratorConfig:
        """``config`` with the steps that were asked for."""
        return config if self.steps is None else with_network(config, steps=self.steps)

    def with_weight_sets(self, plan: Plan) -> Plan:
        """The plan with ``weight_sets`` on every front end, where they were asked for."""
        if self.weight_sets is None:
            return plan
        config, *listed = (
            config.replace(weight_sets=self.weight_sets) for config in (plan.config, *plan.shortlist)
        )
        return dataclasses.replace(plan, config=config, shortlist=tuple(listed))

    def on(self, config: AcceleratorConfig) -> AcceleratorConfig:
        """The network asked for on a front end."""
        config = self.front_end(config)
        config = config if self.weight_sets is None else config.replace(weight_sets=self.weight_sets)
        if self.cell not in (None, AUTO):
            config = network(config, self.cell, self.hidden)
        elif self.hidden is not None:
            config = with_network(config, hidden=self.hidden)
        return with_network(config, reset=self.reset) if config.recurrent else config


class _Choice:
    """The steps of ``train_chosen``: the plan's front end, perhaps another one for a recurrent network, the
    network, the splits to report, and what is said of it all."""

    def __init__(self, terms: Terms, plan: Plan, wish: Wish, chooses: bool) -> None:
        self.terms, self.wish, self.chooses = terms, wish, chooses
        self.linear = plan.config
        self.config = wish.front_end(plan.config) if chooses else wish.on(plan.config)
        if wish.weight_sets is not None and self.config.recurrent and not chooses:
            raise InputError(
                f"--weight-sets {wish.weight_sets}: only a linear cell has them; leave it out, or name "
                "--cell linear"
            )
        self.plan, self.reasons = plan, list(plan.reasons)
        self.notes: Record = {}
        self.recipe: Recipe | None = None
        self.judged: list[Record] = []

    def take_network(self) -> None:
        """Choose the front end of a recurrent network among the plan's rivals, and the network."""
        recurrent, of_recurrent = self._recurrent_front_end()
        if self.chooses and self.terms.folds:
            self._choose_network(recurrent)
        elif not self.chooses:
            self.plan, self.config = self.plan.with_chosen(recurrent), self.wish.on(recurrent)
        if not self.plan.market.is_candidate(self.config):
            raise InputError(
                f"--fits {self.plan.market.board}: does not hold {self.config.network.cell} on the front end "
                "asked for or chosen; name a larger board, or leave the network open"
            )
        if self.plan.record:
            self.notes["front_end"] = self.plan.record | {"for_recurrent": of_recurrent}
            if row_of(self.plan.config) != row_of(self.linear):
                self.reasons.append(
                    "the network stands on another front end than the linear classifier's: "
                    f"{front_end_words(row_of(self.plan.config))}"
                )

    def splits(self, group: Sequence[str] | None, configured: bool) -> list[list[str]] | None:
        """The splits to report; None: those of the protocol. ``configured``: the configuration was asked
        for."""
        recordings, config = self.terms.recordings, self.config
        if group is not None:
            return [list(group)]
        if self.terms.protocol == "thesis":
            return None
        if configured and not self.chooses:
            return default_splits(recordings, config)
        return splits_to_report(recordings, config, self.terms.groups)

    def _recurrent_front_end(self) -> tuple[AcceleratorConfig, list[Record]]:
        plan, wish = self.plan, self.wish
        front_ends = for_recurrent(plan.config, plan.shortlist, plan.rivals)
        resized = wish.front_end(plan.config) != plan.config
        fixed = self.config.network
        if len(front_ends) < 2 or not self.terms.folds or not self.config.recurrent or wish.reset or resized:
            return plan.config, []
        tried = [with_network(config, cell=fixed.cell, hidden=fixed.hidden) for config in front_ends]
        config, rows = recurrent_front_end(self.terms, tried, plan.market)
        return front_ends[tried.index(config)], rows

    def _choose_network(self, recurrent: AcceleratorConfig) -> None:
        on = {self.wish.front_end(config): config for config in (*self.plan.shortlist, recurrent)}
        listed = list(dict.fromkeys(map(self.wish.front_end, self.plan.shortlist)))
        chosen, rows = choose_network(self.terms, listed, self.plan.market, self.wish.front_end(recurrent))
        self.plan = self.plan.with_chosen(on[chosen.front_end])
        self.config, self.recipe, self.notes["candidates"] = chosen.config, chosen.recipe, rows
        self.judged = [chosen.record]
        row = next(row for row in rows if row["chosen"])
        self.reasons.append(
            f"network chosen among {len(rows)}, leaving out {left_out(self.plan.split)} "
            f"({self.plan.split_from}): {network_name(row)} {LEAST[self.plan.market.prefer].format(**row)} of "
            "those within one standard error (of the paired difference over recordings) of the best"
        )

    def nested(self) -> Nested | None:
        """What makes the choice again inside folds; None where nothing was chosen."""
        field = self.plan.field
        if not (self.terms.folds and field and field.seen and self.chose):
            return None
        protocol = self.terms.protocol
        networks = [fixed_network(self.wish.on, protocol)]
        if self.chooses:
            on = [dataclasses.replace(self.wish, cell=cell, hidden=hidden).on for cell, hidden in STAND_INS]
            recipes = {"squares": True, "name": "least squares"}, {"penalty": WEAK_PENALTY}
            linears = [fixed_network(on[0], protocol, **recipe, **AS_RECORDED) for recipe in recipes]
            networks = [network for network in linears if fits(network, self.linear)]
            networks.append(fixed_network(on[1], protocol))
        return Nested(self.terms, field, networks, self.plan.market)

    @property
    def chose(self) -> bool:
        """Whether front end or network were chosen."""
        return bool(self.plan.record or self.chooses)

    def compared(self, nested: Nested | None, record: Record) -> Record:
        """What training.json says beside ``train``'s record; ``doubts`` has the warnings. A linear classifier
        on the same integer features and folds stands beside every split; each split that something was chosen
        on gets its ``nested`` figure."""
        recordings, config, folds = self.terms.recordings, self.config, self.terms.folds
        baselines, warnings = [], []
        judge = Judge(recordings, [])
        for split in record["cross_validation"]:
            judge.refold(split_folds(recordings, split["groups"], folds, None))
            with one_thread():
                judged = judge(config)
            baselines.append(
                {
                    "name": "linear classifier on the same features",
                    "groups": split["groups"],
                    "accuracy": judged.accuracy,
                    "standard_error": judged.standard_error,
                    "multiplies": config.windows.steps * config.inputs * config.classes,
                    "hardware": True,
                }
            )
            network: Record = {"cell": config.network.cell, "hidden": config.network.hidden}
            warnings += doubts.below_baselines(split, baselines, chosen="candidates" in self.notes, **network)
            warnings += doubts.lost_classes(split, recordings.class_names)
            if not self.chose:
                continue
            try:
                if nested is None:
                    raise InputError("recordings are too few; record more")
                split["nested"] = nested.record(split["groups"])
                warnings += doubts.by_choice(split)
            # a front end that a fold chose has no room for its network, or no touch
            except InputError as error:
                split["nested"] = None
                warnings.append(
                    f"leaving out {left_out(split['groups'])}, there is no figure of folds that chose "
                    f"nothing: {error}"
                )
        warnings += wrong_rate(recordings)
        warnings += doubts.missed_onsets(record["touched"], record["recordings"])
        groups = record["cross_validation"][0]["groups"] if record["cross_validation"] else ["none"]
        warnings += doubts.look_alike(recordings, groups, folds)
        return self.notes | {"reasons": self.reasons, "baselines": baselines, "warnings": warnings}


def train_chosen(
    recordings: Recordings,
    asked: AcceleratorConfig | None,
    market: Market,
    *,
    out: str | Path,
    group: Sequence[str] | None = None,
    folds: int = 5,
    seed: int = 0,
    seeds: int | None = None,
    protocol: str = "default",
    quantisation_aware: bool = False,
    widths: Record | None = None,
    plan: Plan | None = None,
    progress: Progress | None = None,
    callback: Callback | None = None,
    of_images: Record | None = None,
    **of_network: Any,
) -> Record:
    """Choose what was not asked for, train it, and write the model folder.

    Parameters
    ----------
    asked:
        The configuration that was asked for; None: the front end is chosen (``choose_front_end``).
    market:
        What candidates cost, and what is wished of the one that is taken.
    plan:
        What ``configure`` gave for these recordings, when it is at hand; with a field, for figures of folds
        that chose nothing.
    seeds:
        Networks of each fold; None: 3, and 1 of images, which take minutes each.
    of_images:
        ``keep`` and ``workers`` of `eskin.training.image_models.train_image_model`; of recordings they
        say nothing.
    of_network:
        cell, hidden: ``auto``: the network is chosen. None: as ``auto`` where neither configuration nor
        ``hidden`` was asked for, else the configuration's own (a GRU where there is none). weight_sets: of a
        linear cell, ``one`` or ``window``; None: as the configuration has it. reset, steps: as
        ``with_network`` takes them.

    All else as for ``eskin.training.train.train``, whose record it returns, with ``front_end`` (where
    it was chosen), ``candidates`` (where the network was), ``reasons``, ``baselines`` (a linear classifier on
    the same features, for each split) and ``warnings`` (sentences).

    Raises
    ------
    InputError
        As ``train``; ``hidden`` with a cell that has none or is chosen.
    """
    wish = Wish(**of_network)
    check_model_target(out)
    check_units(wish.cell, wish.hidden, wish.weight_sets)
    common: Record = {"folds": folds, "seed": seed, "quantisation_aware": quantisation_aware}
    if recordings.image_shape:
        if callback:
            raise InputError("fit, callback: is for networks that read recordings; leave it out for images")
        options = (
            common | {"out": out, "cell": wish.cell, "group": group, "seeds": seeds or 1} | (of_images or {})
        )
        return _train_on_images(
            recordings, asked, market, wish, protocol, dict(widths or {}), options, progress
        )
    if wish.cell in NETWORKS:
        raise InputError(
            f"--cell {wish.cell}: takes images, and '{recordings.source}' holds recordings; use gru, lstm, "
            "linear or auto"
        )
    plan = plan or configure(
        recordings, asked, market, groups=group, folds=folds, nested=True, progress=progress
    )
    if wish.cell == AUTO and not folds:
        raise InputError(
            "--cell auto: needs folds to judge networks on; leave --folds 0 out or name --cell gru, lstm or "
            "linear"
        )
    terms = Terms(
        recordings=recordings,
        groups=plan.split,
        datasets=Datasets(recordings),
        seeds=range(seed, seed + (seeds or 3)),
        folds=folds,
        protocol=protocol,
        widths=dict(widths or {}),
        progress=progress,
    )
    choice = _Choice(
        terms, wish.with_weight_sets(plan), wish, wish.cell == AUTO or (asked is None and wish.is_open)
    )
    choice.take_network()
    splits = choice.splits(group, asked is not None)
    nested = choice.nested()
    return train(
        recordings,
        with_network(choice.config, reset=wish.reset),
        TrainingRequest(
            **common,
            splits=splits,
            seeds=len(terms.seeds),
            protocol=protocol,
            recipe=choice.recipe,
            widths=terms.widths,
            known=[] if quantisation_aware else choice.judged,
        ),
        out=out,
        datasets=terms.datasets,
        progress=progress,
        callback=callback,
        notes=lambda record: choice.compared(nested, record),
    )


def _train_on_images(
    recordings: Recordings,
    requested: AcceleratorConfig | None,
    market: Market,
    wish: Wish,
    protocol: str,
    widths: Record,
    options: Record,
    progress: Progress | None,
) -> Record:
    """`eskin.training.image_models.train_image_model`, where nothing was asked for that networks for
    images do not have."""
    bits = widths.pop("weight_bits", None)
    not_of_images = dataclasses.asdict(dataclasses.replace(wish, cell=None)) | widths
    not_of_images |= {"fits": market.named or None, "prefer": market.prefer != "energy" or None}
    options_set = [name for name, value in not_of_images.items() if value is not None]
    if options_set or protocol != "default":
        name = options_set[0].replace("_", "-") if options_set else "protocol"
        raise InputError(
            f"--{name}: networks for images have none, and '{recordings.source}' holds images; leave it out"
        )
    return train_image_model(recordings, requested, weight_bits=bits, progress=progress, **options)


def check_units(cell: str | None, hidden: int | None, weight_sets: str | None = None) -> None:
    """Refuse a number of units with a cell that has none, or that is to be chosen, and sets of weights with a
    cell that has one."""
    if hidden is not None and cell in (AUTO, "linear", *NETWORKS):
        raise InputError(
            f"--hidden {hidden}: --cell {cell} takes no number of units; leave --hidden out, or name --cell "
            "gru or lstm"
        )
    if weight_sets is not None and (hidden is not None or cell not in (None, AUTO, "linear")):
        raise InputError(
            f"--weight-sets {weight_sets}: only a linear cell has them; leave it out, or name --cell linear"
        )
