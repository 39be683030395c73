"""Choice of front end and network by evidence: ``train`` and ``run`` choose whatever the user did not name.

First front ends are searched with a linear classifier (`eskin.choose.front_ends`), then networks are tried on
the best of them (`eskin.choose.networks`). Both times the rule of `eskin.choose.candidate` takes one.

Cross-validation on the folds of the choice overstates the accuracy: on pure noise of 60 recordings and two classes
the best of eighty front ends is 60 to 75 % correct. So the choice is made again inside the training part of every
fold (`unseen`): the same rule after a shorter search, on fewer recordings and with fewer networks. The network
taken is then trained on the whole training part with the full recipe, and judged on the fold. Thresholds and scales
of the candidates are measured on all recordings, without their labels.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from eskin.choose import doubts
from eskin.choose.candidate import Candidate, ScoredCandidate, choose, front_end_of, screened_row
from eskin.choose.choice_table import front_end_words, left_out, network_name
from eskin.choose.cost import CostModel
from eskin.choose.front_ends import (
    FrontEnds,
    FrontEndSearch,
    Listed,
    RidgeLearner,
    correct_without,
    listed,
    search_front_ends,
)
from eskin.choose.networks import (
    AUTO,
    INSIDE,
    ROBUST,
    Effort,
    NetworkSearch,
    SearchOptions,
    check_units,
    choose_networks,
    learns_from_one_group,
)
from eskin.choose.sturdy import Hardening
from eskin.choose.yardsticks import linear_yardsticks
from eskin.data.fit import check_fit
from eskin.data.folds import likely_groups
from eskin.data.rate import wrong_rate
from eskin.golden.core import NETWORKS, PRESETS, AcceleratorConfig, InputError, Progress
from eskin.golden.data import Recordings
from eskin.golden.model import check_model_target
from eskin.jobs import beside
from eskin.memo import Memo
from eskin.training.datasets import Datasets
from eskin.training.derive import derive_config, settling_frames
from eskin.training.fit import one_thread
from eskin.training.image_models import train_image_model
from eskin.training.judge import (
    CrossValidationSettings,
    FittedNetwork,
    NetworkLearner,
    Rows,
    cross_validate,
    folds_of,
    judge,
    named,
)
from eskin.training.losses import Callback
from eskin.training.record import (
    CandidateRow,
    Disturbed,
    Doubt,
    FrontEndRows,
    Nested,
    SameGroups,
    Screening,
    Split,
    Training,
)
from eskin.training.settings import TrainingSettings
from eskin.training.splits import check_split, default_splits, over_groups, split_folds
from eskin.training.times import step_times
from eskin.training.train import train

if TYPE_CHECKING:
    from eskin.study.stability.panel import Panel

LEAST = {
    "energy": "needs the least energy per touch ({energy_touch_j:.3g} J)",
    "cells": "needs the fewest logic cells ({cells})",
    "latency": "has the shortest time from the last sample to the decision ({latency_s:.3g} s)",
}
"""Reason for the choice, for each preference."""


# ---------------------------------------------------------------------- the front end
@dataclass(frozen=True, eq=False)
class Plan:
    """The requested or chosen front end, and the split for the choice.

    config: the configuration. reasons: sentences. split, split_from: result of ``choose_split``. prices:
    costs of candidates. front_ends: candidates for the choice inside folds; None if there is no choice to
    make. screened: the front ends judged, best first; empty if the user named one. facts: figures of the
    judging, for training.json. guessed: True if there were too few recordings to choose on. doubts: doubts
    about the recordings that the judging raised.
    """

    config: AcceleratorConfig
    reasons: list[str]
    split: list[str]
    split_from: str
    prices: CostModel
    front_ends: FrontEnds | None = None
    screened: tuple[ScoredCandidate, ...] = ()
    facts: Screening | None = None
    guessed: bool = False
    doubts: tuple[Doubt, ...] = ()

    @property
    def listed(self) -> Listed:
        """Front ends that networks are tried on."""
        return listed(self.screened, self.prices) if self.screened else Listed.alone(self.config)

    def hardening(self, stress: Panel | None) -> Hardening | None:
        """Sturdier front ends and networks; None if networks are not judged under disturbance."""
        return Hardening(stress, self.front_ends.screen if self.front_ends else None) if stress else None

    def record(self, taken: AcceleratorConfig | None = None) -> FrontEndRows | None:
        """``front_end`` of training.json; None if no front end was chosen.

        taken: the front end of the network taken; None: the one chosen.
        """
        if not self.facts:
            return None
        taken = taken or self.config
        judged = {one.candidate.front_end: one for one in self.screened}
        if taken not in judged and self.front_ends:  # a sturdier front end, which the search did not judge
            screen = self.front_ends.screen
            parts = split_folds(screen.recordings, self.split, self.facts.folds, None)
            judged[taken] = screen.judged(taken, parts)
        rows = {config: screened_row(one, self.screened[0], self.prices) for config, one in judged.items()}
        chosen = rows.pop(taken)
        return FrontEndRows(chosen=chosen, rivals=[*rows.values()], **dict(self.facts))


def configure(
    recordings: Recordings,
    requested: AcceleratorConfig | None,
    prices: CostModel,
    *,
    groups: Sequence[str] | None = None,
    folds: int = 5,
    progress: Progress | None = None,
) -> Plan:
    """The requested configuration, checked against the recordings, or the chosen one if none was requested;
    and the reasons.

    A preset describes a sensor, so it takes over the recordings' class names; the user's own configuration
    must have them.

    Raises
    ------
    InputError
        As ``check_fit`` and ``choose_front_end``.
    """
    if recordings.image_shape:
        derive_config(recordings)  # which refuses images
    if requested is None:
        return choose_front_end(recordings, prices, groups=groups, folds=folds, progress=progress)
    reasons = [f"'{requested.name}', as asked for"]
    if requested == PRESETS.get(requested.name) and requested.network.class_names != recordings.class_names:
        try:
            requested = requested.replace(class_names=recordings.class_names)
        except InputError as error:
            raise InputError(f"recordings '{recordings.source}', array class_names: {error}") from None
        reasons.append(f"its classes are those of the recordings: {', '.join(recordings.class_names)}")
    check_fit(recordings, requested)
    split, split_from = choose_split(recordings, groups)
    return Plan(requested, reasons, split, split_from, prices)


def choose_split(recordings: Recordings, groups: Sequence[str] | None) -> tuple[list[str], str]:
    """The groups that stay together while front end and network are chosen, and where they come from, in
    words.

    The requested groups; otherwise the first of ``likely_groups``; otherwise none, which leaves out single recordings.
    """
    if groups is not None:
        return list(groups), "as asked for"
    if known := likely_groups(recordings):
        return known[:1], "the archive's first group"
    return [], "the archive has no group to leave out, so single recordings are left out"


def choose_front_end(
    recordings: Recordings,
    prices: CostModel,
    *,
    groups: Sequence[str] | None = None,
    folds: int = 5,
    progress: Progress | None = None,
) -> Plan:
    """Search the front ends and choose one. With too few recordings for a comparison, it is the first guess
    of `eskin.training.derive`, and a reason is recorded.

    Parameters
    ----------
    groups:
        Names of group arrays that stay together (``label`` is the class); None: ``choose_split``.
    folds:
        Number of folds; if there are no more groups than folds, each group is left out in turn. Below 2: 5.

    Raises
    ------
    InputError
        No accelerator has these sizes (the sentence names the field), or a group is unknown.
    """
    began = time.perf_counter()
    split, split_from = choose_split(recordings, groups)
    for name in split:
        if name != "label" and name not in recordings.groups:
            split_folds(recordings, split, max(folds, 2), None)  # raises an error that lists the groups
    front_ends = FrontEnds(recordings, progress)
    judged_on = front_ends.recordings
    try:
        parts = split_folds(judged_on, split, folds if folds >= 2 else 5, None)
        rests = [judged_on.labels[np.setdiff1d(np.arange(len(judged_on)), part)] for part in parts]
        enough = all(len(np.unique(labels)) >= 2 for labels in rests)
    except InputError:
        enough = False
    if not enough:
        guess, why = derive_config(recordings)
        why.append("there are too few recordings to compare front ends, so rules derived this one")
        return Plan(guess, why, split, split_from, prices, guessed=True)
    with one_thread():
        state = FrontEndSearch(
            prices=prices,
            front_ends=front_ends,
            rows=np.arange(len(judged_on)),
            folds=parts,
            brief=learns_from_one_group(judged_on, parts),
        )
        screened = search_front_ends(state, progress)
    front_ends.progress = None  # which no other process can have
    chosen, best = choose(screened, prices), screened[0]
    alone, frames = _level_alone(judged_on, parts)
    facts = Screening(
        split=split,
        split_from=split_from,
        folds=len(parts),
        recordings_looked_at=len(judged_on),
        recordings=len(recordings),
        judged_by="ridge regression on the integer front end's features of all windows, cross-validated",
        tie="at most one standard error of the paired difference over recordings worse than the best; a tie goes "
        f"to the least {prices.prefer}",
        level_alone=alone,
        wall_s=time.perf_counter() - began,
    )
    words, best_words = (front_end_words(front_end_of(one.candidate.front_end)) for one in (chosen, best))
    level = f"; the best, {best_words}, has {best.accuracy:.1%}, a tie"
    reasons = [
        *recordings.notes,
        *front_ends.reasons,
        f"front end chosen among {len(screened)} by a linear classifier, leaving out {left_out(split)} "
        f"({split_from}), on {len(judged_on)} recordings: {words}, {chosen.accuracy:.1%}"
        f"{'' if best is chosen else level}",
    ]
    config, classes, found = chosen.candidate.front_end, len(recordings.class_names), list[Doubt]()
    if alone - 1 / classes > doubts.LEVEL_TELLS * (1 - 1 / classes):
        without = [one.accuracy for one in screened if one.config.rest_level.rest != "none"]
        found += doubts.level_tells(frames, alone, max(without, default=None), split)
    return Plan(
        config, reasons, split, split_from, prices, front_ends, tuple(screened), facts, doubts=tuple(found)
    )


def _level_alone(recordings: Recordings, folds: Sequence[np.ndarray]) -> tuple[float, int]:
    """Accuracy of a classifier that sees only the level of the first frames, and the number of these
    frames."""
    frames = settling_frames(recordings.sample_rate_hz)
    levels = np.array([recordings.recording(i)[:frames].mean(axis=0) for i in range(len(recordings))])
    levels = (levels - levels.mean(axis=0)) / (levels.std(axis=0) + 1e-9)
    learner = RidgeLearner.on(levels, recordings.labels, len(recordings.class_names))
    return float(correct_without(folds, learner, recordings.labels).mean()), frames


# ---------------------------------------------------------------------- the choice again inside folds
def inner_folds(recordings: Recordings, groups: Sequence[str]) -> list[np.ndarray]:
    """Folds inside a training part: by ``groups`` if they have two values there; otherwise by the group that
    ``choose_split`` finds there; otherwise of single recordings, which may be near copies of others."""
    chosen, _ = choose_split(recordings, None)
    for split, count in ((groups, 5), (chosen, 5), ((), min(5, len(recordings)))):
        try:
            return split_folds(recordings, list(split), count, None)
        except InputError:
            continue
    return [np.arange(len(recordings))]


def search_inside(
    front_ends: FrontEnds, part: np.ndarray, groups: Sequence[str], prices: CostModel
) -> list[ScoredCandidate]:
    """The front ends that a search on ``part`` (recordings) alone judges, best first."""
    rows = front_ends.part(part)
    with one_thread():
        folds = inner_folds(front_ends.recordings.subset(rows), groups)
        state = FrontEndSearch(prices=prices, front_ends=front_ends, rows=rows, folds=folds, brief=True)
        return search_front_ends(state)


@dataclass(frozen=True, eq=False)
class Searched:
    """The whole choice, as a learner: front end and network are searched inside each part, and the network taken is
    trained on the whole part.

    settings: their groups are left out inside the parts, too. chosen: the candidate of each part that was fitted, in
    their order.
    """

    plan: Plan
    settings: CrossValidationSettings
    search_options: SearchOptions
    chosen: list[Candidate] = dataclasses.field(default_factory=list)

    def choose(self, parts: Sequence[Rows]) -> list[Candidate]:
        """Choices that each see only one of ``parts``."""
        plan, settings = self.plan, self.settings
        recordings, searches = settings.recordings, list[NetworkSearch]()
        hardening = plan.hardening(settings.stress)  # once: folds ask for the same sturdier front ends
        for number, part in enumerate(parts):
            if settings.progress:
                settings.progress("front ends chosen without the fold that judges them", number, len(parts))
            folds = [part[rows] for rows in inner_folds(recordings.subset(part), settings.groups)]
            front_ends = Listed.alone(plan.config)
            if plan.front_ends:
                judged = search_inside(plan.front_ends, part, settings.groups, plan.prices)
                front_ends = listed(judged, plan.prices)
            searches.append(
                NetworkSearch(
                    prices=plan.prices,
                    front_ends=front_ends,
                    options=self.search_options,
                    effort=INSIDE.by(recordings, folds),
                    rows=part,
                    tests=folds,
                    hardening=hardening,
                )
            )
        return choose_networks(searches, settings)

    def fit(
        self, parts: Sequence[Rows], seeds: Sequence[int], progress: Progress | None = None
    ) -> list[FittedNetwork]:
        """As `eskin.training.judge.Learner.fit`. Networks of one candidate train at once."""
        unique = {part.tobytes(): part for part in parts}
        of_part = dict(zip(unique, self.choose([*unique.values()]), strict=True))
        self.chosen[:] = [of_part[part.tobytes()] for part in parts]
        fitted: dict[int, FittedNetwork] = {}
        for candidate in dict.fromkeys(self.chosen):
            own = [number for number, taken in enumerate(self.chosen) if taken == candidate]
            learner = NetworkLearner(self.settings.datasets, candidate.config, candidate.recipe)
            networks = learner.fit([parts[n] for n in own], [seeds[0] for _ in own], progress)
            fitted |= dict(zip(own, networks, strict=True))
        return [fitted[number] for number in range(len(parts))]


def unseen(
    plan: Plan, settings: CrossValidationSettings, search_options: SearchOptions, split: Sequence[str]
) -> Nested:
    """Accuracy when each fold of ``split`` is left out of every step that uses a label, and the choices that
    led to it."""
    begin, recordings, seeds = time.perf_counter(), settings.recordings, list(map(int, settings.seeds))
    tests = split_folds(recordings, list(split), settings.folds, None)
    brief = dataclasses.replace(settings, stress=settings.stress and settings.stress.brief)
    folds = folds_of(tests, seeds, np.arange(len(recordings)))
    learner = Searched(plan, brief, search_options)
    decisions = judge(learner, folds, recordings.labels, settings.progress)
    per_fold = decisions.per_fold(recordings, split)
    for fold, candidate in zip(per_fold, learner.chosen, strict=False):  # of the first seed
        fold.front_end = front_end_of(candidate.config)
        fold.front_end_words = front_end_words(fold.front_end)
        fold.network = network_name(candidate.network)
    return Nested(
        groups=split,
        folds=len(tests),
        seeds=seeds,
        **decisions.shares(),
        **over_groups(recordings, split, tests, decisions.correct.to_numpy()),
        per_fold=per_fold,
        disturbed=settings.stress.unseen(decisions) if settings.stress else Disturbed(),
        wall_s=time.perf_counter() - begin,
    )


BESIDE = 100
"""Fewest recordings with which the choice inside folds gets another process, whose start takes seconds."""


@contextmanager
def unseen_by_split(
    plan: Plan, settings: CrossValidationSettings, search_options: SearchOptions
) -> Iterator[Callable[[Sequence[str]], Nested]]:
    """`unseen` as a function of the split. It does not depend on the main choice. With many recordings, another process
    computes it for the plan's split meanwhile."""
    here = partial(unseen, plan, settings, search_options)
    chosen = settings.folds and (plan.screened or search_options.open)
    if not chosen or len(settings.recordings) < BESIDE:
        yield here
        return
    silent = dataclasses.replace(settings, progress=None)
    with beside(unseen, plan, silent, search_options, plan.split) as result:

        def there(split: Sequence[str]) -> Nested:
            if list(split) == plan.split:
                named(settings.progress, "waiting for the choices inside folds")(0, 0)
                with suppress(BrokenExecutor):  # it died, perhaps without memory for two
                    return result()
            return here(split)

        yield there


# ---------------------------------------------------------------------- the network
def candidate_row(
    one: ScoredCandidate, split: Split, taken: Candidate, search: NetworkSearch
) -> CandidateRow:
    """A row of ``candidates`` in training.json. split: its cross-validation."""
    prices, calm = search.prices, search.calm
    config, front_end = one.config, front_end_of(one.candidate.front_end)
    assert one.decisions is not None
    faults = dataclasses.asdict(config.faults)  # networks were fitted without a detector
    integer = one.decisions.fitted[0][1].integer.config.replace(**faults)
    return CandidateRow(
        **one.candidate.network.plain(),
        **prices.cost_of(integer).plain(),
        accuracy=one.accuracy,
        standard_error=one.standard_error,
        score=one.score,
        score_standard_error=one.score_standard_error,
        stressed_accuracy=one.stressed_accuracy,
        worst=one.worst,
        stress=one.figures.stress,
        gate_modes=one.figures.gate_modes,
        robust=one.candidate.recipe.robust,
        calm=calm is not None and one.candidate == calm.candidate,
        float_accuracy=split.float_accuracy,
        agreement=split.agreement,
        block_memories=prices.blocks_of(integer),
        fits=prices.board if prices.fits(integer) else None,
        multiplies_touch=config.windows.steps * config.multiplies,
        multiplies_step=config.multiplies,
        parameters=config.parameter_count,
        seeds=len(split.seeds),
        decision_time_s=split.decision_time_s,
        scan_every=config.sensor.scan_every,
        front_end=front_end,
        front_end_words=front_end_words(front_end),
        chosen=one.candidate == taken,
    )


def splits_to_report(
    recordings: Recordings, config: AcceleratorConfig, groups: Sequence[str]
) -> list[list[str]]:
    """Splits over which the chosen network is cross-validated: ``default_splits`` and the split on which
    it was chosen."""
    splits = [split for split in default_splits(recordings, config) if split]
    return splits if list(groups) in splits else [*splits, list(groups)]


# ---------------------------------------------------------------------- training what was chosen
def train_chosen(
    recordings: Recordings,
    asked: AcceleratorConfig | None,
    prices: CostModel,
    wanted: TrainingSettings,
    *,
    plan: Plan | None = None,
    stress: Panel | None = None,
    keep: Memo | None = None,
    progress: Progress | None = None,
    callback: Callback | None = None,
) -> Training:
    """Choose front end and network unless they were requested, train the network, and write the model folder.

    Parameters
    ----------
    asked:
        The requested configuration; None: the front end is chosen (``choose_front_end``).
    prices:
        Costs of candidates, and the user's preference.
    wanted:
        Its ``cell`` ``auto``: the network is chosen; None: as ``auto`` if neither a configuration nor ``hidden`` nor
        ``reset`` was requested, otherwise the configuration's own cell (a GRU without a configuration).
    plan:
        Result of ``configure`` for these recordings, if it is known already.
    stress:
        Disturbances that candidates are judged under; None: none.
    keep:
        Folder in which judged networks for images are cached.
    callback:
        As for ``eskin.training.train.train``.

    The result is the record of ``eskin.training.train.train`` with all that the choice found.

    Raises
    ------
    InputError
        As ``train``; or ``hidden`` is given with a cell that has no hidden units or is chosen.
    """
    began = time.perf_counter()
    cell, hidden, reset, folds = wanted.cell, wanted.hidden, wanted.reset, wanted.folds
    check_model_target(wanted.out)
    check_units(cell, hidden)
    if recordings.image_shape:
        if callback:
            raise InputError("fit, callback: is for networks that read recordings; leave it out for images")
        return train_image_model(recordings, asked, wanted, keep=keep, progress=progress)
    if cell in NETWORKS:
        raise InputError(
            f"`cell` {cell}: takes images, and '{recordings.source}' holds recordings; use gru, lstm, "
            "linear or auto"
        )
    if cell == AUTO and not folds:
        raise InputError(
            "`cell` auto: needs cross-validation; leave `folds` 0 out or name `cell` gru, lstm or linear"
        )
    plan = plan or configure(recordings, asked, prices, groups=wanted.groups, folds=folds, progress=progress)
    is_open = cell == AUTO or (asked is None and (cell, hidden, reset) == (None,) * 3)
    search_options = SearchOptions(
        cell=cell, hidden=hidden, reset=reset, robust=wanted.protocol == ROBUST, open=bool(is_open and folds)
    )
    settings = CrossValidationSettings(
        recordings=recordings,
        groups=plan.split,
        datasets=Datasets(recordings),
        seeds=range(wanted.seed, wanted.seed + (wanted.seeds or 3)),
        folds=folds,
        progress=progress,
        stress=stress if search_options.open else None,
    )
    tests = split_folds(recordings, plan.split, folds, None) if folds else []
    effort = Effort(seeds=len(settings.seeds)).by(recordings, tests)
    network_search = NetworkSearch(
        prices=prices,
        front_ends=plan.listed if folds else Listed.alone(plan.config),
        options=search_options,
        effort=effort,
        rows=np.arange(len(recordings)),
        tests=tests,
        hardening=plan.hardening(settings.stress),
    )
    with unseen_by_split(plan, settings, search_options) as nested:
        (taken,) = choose_networks([network_search], settings)
        tried = network_search.reported
        judged = {
            one.candidate: one.decisions.record(
                recordings, settings.groups, step_times(one.config, data.touches)
            )
            for one in tried
            if one.decisions and (data := settings.datasets.of(one.config, one.candidate.recipe))
        }
        rows = [candidate_row(one, judged[one.candidate], taken, network_search) for one in tried]
        if wanted.groups is not None:
            splits = [wanted.groups]
        elif asked is None or is_open:
            splits = splits_to_report(recordings, taken.config, settings.groups)
        else:
            splits = default_splits(recordings, taken.config)
        validated = _cross_validated(taken, splits if folds else [], settings, judged.get(taken))
        touches = settings.datasets.of(taken.config, taken.recipe).touches
        ended = _ended_early(int(touches.partial.sum()), len(recordings), taken.config)
        notes = _compared(validated, len(touches), plan, settings, search_options, taken, rows, nested)
    notes.reasons = [*plan.reasons, *_reasons(plan, taken, rows), *network_search.remarks, *ended]
    if plan.screened:
        notes.front_end = plan.record(taken.front_end)
    if rows:
        notes.candidates = [*rows]
    notes.wall_s = time.perf_counter() - began
    return train(
        recordings,
        taken.config,
        out=wanted.out,
        recipe=taken.recipe,
        seed=wanted.seed,
        datasets=settings.datasets,
        notes=notes,
        progress=progress,
        callback=callback,
    )


def _cross_validated(
    taken: Candidate, splits: Sequence[list[str]], settings: CrossValidationSettings, known: Split | None
) -> list[Split]:
    """The record of each split; ``known``: of the choice's split, with all seeds or some."""
    for groups in splits:
        check_split(settings.recordings, groups, settings.folds)
    records = {tuple(known.groups): known} if known and len(known.seeds) == len(settings.seeds) else {}
    missing = [groups for groups in splits if tuple(groups) not in records]
    fresh = cross_validate(
        settings.recordings,
        taken.config,
        missing,
        settings.seeds,
        folds=settings.folds,
        recipe=taken.recipe,
        datasets=settings.datasets,
        progress=settings.progress,
    )
    records |= {tuple(split.groups): split for split in fresh}
    return [records[tuple(groups)] for groups in splits]


def _reasons(plan: Plan, taken: Candidate, rows: Sequence[CandidateRow]) -> list[str]:
    """Reasons for this network and for its front end."""
    reasons = []
    for row in rows:
        if row.chosen:
            reasons.append(
                f"network chosen among {len(rows)}, leaving out {left_out(plan.split)} ({plan.split_from}): "
                f"{network_name(row)} {LEAST[plan.prices.prefer].format(**dict(row))} of those within one standard "
                "error (of the paired difference over recordings) of the best"
            )
    if plan.screened and taken.front_end != plan.config:
        reasons.append(
            "the network uses another front end than the linear classifier: "
            f"{front_end_words(front_end_of(taken.front_end))}"
        )
    return reasons


def _ended_early(count: int, recordings: int, config: AcceleratorConfig) -> list[str]:
    """A sentence about recordings that end before the last window."""
    if not count or config.follows_touch:
        return []
    return [
        f"{count} of {recordings} recordings end before the last window, {config.touch_s:.3g} s after the first begins, "
        "and use the windows that are complete"
    ]


def _same_groups(settings: CrossValidationSettings, taken: Candidate) -> SameGroups | None:
    """Accuracy to expect on new recordings of known groups: the chosen network with single recordings left
    out, one seed. None without groups, or with too few recordings of a class."""
    if not settings.groups or not settings.folds:
        return None
    try:
        (single,) = cross_validate(
            settings.recordings,
            taken.config,
            [[]],
            settings.seeds[:1],
            folds=settings.folds,
            recipe=taken.recipe,
            datasets=settings.datasets,
            progress=settings.called("single recordings left out"),
        )
    except InputError:
        return None
    return SameGroups.model_validate(single.plain())


def _compared(
    validated: list[Split],
    touched: int,
    plan: Plan,
    settings: CrossValidationSettings,
    search_options: SearchOptions,
    taken: Candidate,
    rows: Sequence[CandidateRow],
    nested: Callable[[Sequence[str]], Nested],
) -> Training:
    """Comparisons for training.json: for every split a linear classifier on the same integer features and folds,
    and its figure of ``nested`` if something was chosen."""
    recordings, config = settings.recordings, taken.config
    splits = [split.groups for split in validated]
    baselines = linear_yardsticks(recordings, config, splits, settings.folds)
    same_groups = _same_groups(settings, taken)
    found = list(plan.doubts)
    if plan.screened and not config.recurrent:  # front ends are judged with a linear network
        found += doubts.still_climbing([(one.config, one.correct) for one in plan.screened])
    for split in validated:
        found += doubts.below_baselines(split, baselines, rows if search_options.open else None)
        found += doubts.lost_classes(split, recordings.class_names)
        if plan.screened or search_options.open:
            split.nested = None
            try:
                if plan.guessed:
                    raise InputError("recordings are too few; record more")
                split.nested = nested(split.groups)
                found += doubts.by_choice(split, split.nested)
            # a front end that a fold chose has no room for its network, or no touch
            except InputError as error:
                found.append(doubts.no_unseen_figure(split, str(error)))
    found += [doubts.doubt("wrong_rate", sentence) for sentence in wrong_rate(recordings)]
    found += doubts.missed_onsets(touched, len(recordings))
    found += doubts.look_alike(recordings, splits[0] if splits else ["none"], settings.folds)
    return Training(
        cross_validation=validated,
        baselines=baselines,
        same_groups=same_groups,
        doubts=found,
        warnings=[doubt.text for doubt in found],
    )
