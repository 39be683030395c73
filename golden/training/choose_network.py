"""The smallest network that is enough, chosen by evidence: ``--cell auto``, and what ``train`` and ``run`` do
without --cell and --config.

Candidates are the linear cell and GRUs of 4, 8 and 12 units, and of 16 where 12 is not level: where it lies
more than a standard error below the best, or is still that much better than 8. Each is cross-validated on the
chosen front end, all folds at once, in the integers that it would be quantised to, with one seed, and with
two more where it can still be taken. Taken is the one with the fewest multiplies a touch (steps times
multiplies a step) of those within one standard error of the best. The standard error is that of the best
one's accuracy over recordings, each recording's being the mean over seeds: it says how far the figure would
move with other recordings like these, not how far it would with other groups.

The front end was chosen by a linear classifier, which sees all windows at once; where rivals of another gate
are not hopeless, a GRU 12 is cross-validated on the best of each (``recurrent_front_end``), and the recurrent
candidates stand on the one it does best on.

A linear cell is fitted as a logistic regression and by least squares (``eskin.golden.training.linear_fit``):
which one does better depends on how many touches there are for its weights. Where the recipe augments
touches, which helps or harms by what tells the classes apart, both are fitted to touches as they were
recorded too; and a logistic regression of these with a weaker penalty. All cost the same. Of equal cost the
first in this order that is level with the most accurate is taken, so logistic regressions, whose margins are
logarithms of odds, come before least squares.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.core.images import NETWORKS
from eskin.golden.data.rate import wrong_rate
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.model import check_model_target, with_network
from eskin.golden.training import doubts
from eskin.golden.training.choice_table import front_end_words, left_out, network_name
from eskin.golden.training.choose_front_end import Judge, Judged, Plan, configure, is_level, row_of
from eskin.golden.training.crossval import Decided, Folds, Progress
from eskin.golden.training.datasets import Datasets
from eskin.golden.training.fit import one_thread
from eskin.golden.training.image_models import train_image_model
from eskin.golden.training.nested import Nested, fits, fixed_network
from eskin.golden.training.recipe import Recipe, choose_recipe
from eskin.golden.training.splits import default_splits, split_folds
from eskin.golden.training.train import TrainingRequest, train

GRU_UNITS, LARGER_UNITS = (4, 8, 12), 16
LEVEL = 1.0
"""Standard errors within which a smaller network is enough."""

OUT_OF_REACH = 3.0
"""Standard errors behind another candidate, with one seed, from which a network is not looked at any
further."""

AS_RECORDED: dict[str, Any] = {
    "noise": 0.0,
    "warp": 1.0,
    "gain": 1.0,
    "speed_gain": 0.0,
    "channel_dropout": 0.0,
    "taxel_failure": 0.0,
}
"""Changes to a recipe that then trains on touches as they were recorded."""

WEAK_PENALTY = 10.0
"""Inverse penalty of a logistic regression beside that of the recipe, 1: on fabric_slide it reaches 97.7 %
where 1 reaches 97.2 %, leaving conditions out, and 92.6 against 89.0 % leaving forces out; 0.1 is behind on
both, 100 level."""

AUTO = "auto"


@dataclass(frozen=True)
class Candidate:
    """A network on the front end: the configuration, the recipe, and whether each recording was decided
    rightly, (recordings), mean over seeds; record: its cross-validation."""

    config: AcceleratorConfig
    recipe: Recipe
    correct: np.ndarray
    record: dict[str, Any]
    front_end: AcceleratorConfig

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

    def row(self, chosen: bool) -> dict[str, Any]:
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
            "multiplies_touch": self.multiplies_touch,
            "multiplies_step": config.multiplies,
            "parameters": config.parameter_count,
            "seeds": len(self.record["seeds"]),
            "decision_time_s": self.record["decision_time_s"],
            "front_end": front_end_words(row_of(self.front_end)),
            "chosen": chosen,
        }


def least_error(count: int) -> float:
    """Standard error of an accuracy of 100 % over ``count`` recordings: that of (count + 1) / (count + 2),
    what Laplace's rule of succession makes of it. Recordings without a single error do not show that the next
    one will have none."""
    return float(np.sqrt((count + 1) / (count + 2) ** 2 / count))


def network(config: AcceleratorConfig, cell: str, hidden: int | None) -> AcceleratorConfig:
    """``config`` with another network; the global decision of a linear cell, whose logits add up, is that of
    its last step."""
    changed = with_network(config, cell=cell, hidden=hidden)
    return changed if changed.recurrent else changed.replace(decision="last")


def smallest_enough(candidates: Sequence[Candidate]) -> Candidate:
    """The fewest multiplies a touch of those within LEVEL standard errors of the best; of as many, the first
    that is level with the most accurate (``eskin.golden.training.choose_front_end.is_level``)."""
    best = max(candidates, key=lambda candidate: candidate.accuracy)
    enough = [
        candidate
        for candidate in candidates
        if candidate.accuracy >= best.accuracy - LEVEL * best.standard_error
    ]
    least = min(candidate.multiplies_touch for candidate in enough)
    alike = [
        Judged(candidate.config, candidate.correct, 0)
        for candidate in enough
        if candidate.multiplies_touch == least
    ]
    top = max(alike, key=lambda candidate: candidate.accuracy)
    level = next(number for number, candidate in enumerate(alike) if is_level(top, candidate))
    return [candidate for candidate in enough if candidate.multiplies_touch == least][level]


def goes_on(candidates: Sequence[Candidate]) -> bool:
    """GRU 12, the last of ``candidates``, is not level: below the best, or still better than GRU 8, by more
    than a standard error."""
    *_, eight, twelve = candidates
    best = max(candidates, key=lambda candidate: candidate.accuracy)
    below = best.accuracy - twelve.accuracy > LEVEL * best.standard_error
    rising = twelve.accuracy - eight.accuracy > LEVEL * max(eight.standard_error, twelve.standard_error)
    return below or rising


def settled(candidate: Candidate) -> bool:
    """So near 100 % that no other can be better by more than LEVEL standard errors."""
    return candidate.accuracy >= 1.0 - LEVEL * least_error(len(candidate.correct))


def cross_validate_network(
    recordings: Recordings,
    config: AcceleratorConfig,
    recipe: Recipe,
    groups: Sequence[str],
    seeds: Sequence[int],
    folds: int,
    widths: dict[str, Any],
    progress: Progress | None = None,
    *,
    datasets: Datasets | None = None,
    goes_on: Callable[[Candidate], bool] = lambda first: True,
) -> Candidate:
    """One candidate, judged on recordings left out: with the first seed, and where that ``goes_on`` with the
    others too."""
    datasets = datasets or Datasets(recordings)

    def judged(of_seeds: Sequence[int]) -> list[Decided]:
        work = Folds(recordings, config, recipe, [list(groups)], of_seeds, folds, datasets)
        models = work.fit(progress)
        return work.decided(models, work.quantise(models, widths))

    def candidate(of_seeds: Sequence[int], decided: list[Decided]) -> Candidate:
        work = Folds(recordings, config, recipe, [list(groups)], of_seeds, folds, datasets)
        correct = np.zeros(len(recordings))
        for test, run in zip(work.tests, decided, strict=True):
            correct[test] += (run.integer_global == recordings.labels[test]) / len(of_seeds)
        (record,) = work.records_of(decided)
        return Candidate(config, recipe, correct, record, config)

    decided = judged(seeds[:1])
    first = candidate(seeds[:1], decided)
    if len(seeds) < 2 or not goes_on(first):
        return first
    return candidate(seeds, decided + judged(seeds[1:]))


def recurrent_front_end(
    recordings: Recordings,
    front_ends: Sequence[AcceleratorConfig],
    groups: Sequence[str],
    *,
    seed: int = 0,
    folds: int = 5,
    protocol: str = "default",
    datasets: Datasets | None = None,
    progress: Progress | None = None,
) -> tuple[AcceleratorConfig, list[dict[str, Any]]]:
    """The front end for a recurrent network: of these the one on which it does best, and a row for each that
    was tried.

    Each trains the configuration's network, a GRU 12 as it is derived, one seed, half the recipe's updates.
    The first one stays where it is level with the best, by
    ``eskin.golden.training.choose_front_end.is_level``, or so near 100 % that none can be better by a
    standard error; of the others the best is taken.
    """
    tried = []
    for number, config in enumerate(front_ends):
        named: Progress | None = None
        if progress:
            named = lambda task, done, total, number=number: progress(
                f"{task}, front end {number + 1} of {len(front_ends)}", done, total
            )
        recipe = choose_recipe(config, protocol)
        recipe = dataclasses.replace(recipe, updates=max(recipe.updates // 2, 1))
        tried.append(
            cross_validate_network(
                recordings, config, recipe, groups, [seed], folds, {}, named, datasets=datasets
            )
        )
        if settled(tried[0]):
            break
    judged = [Judged(candidate.config, candidate.correct, 0) for candidate in tried]
    best = max(judged, key=lambda candidate: candidate.accuracy)
    taken = judged[0] if is_level(best, judged[0]) else best
    rows = [
        {
            "front_end": front_end_words(row_of(candidate.config)),
            "cell": candidate.config.network.cell,
            "hidden": candidate.config.network.hidden,
            "accuracy": candidate.accuracy,
            "standard_error": candidate.standard_error,
            "chosen": candidate is taken,
        }
        for candidate in judged
    ]
    return taken.config, rows


def choose_network(
    recordings: Recordings,
    config: AcceleratorConfig,
    groups: Sequence[str],
    *,
    recurrent: AcceleratorConfig | None = None,
    seeds: Sequence[int] = (0, 1, 2),
    folds: int = 5,
    protocol: str = "default",
    widths: dict[str, Any] | None = None,
    datasets: Datasets | None = None,
    progress: Progress | None = None,
) -> tuple[Candidate, list[dict[str, Any]]]:
    """Judge the candidates and take one: it, and the rows of training.json, in the order of size. The linear
    cell stands on ``config``'s front end, the others on that of ``recurrent`` where there is one.

    One that cannot be taken is judged with the first seed alone: it is OUT_OF_REACH behind another, or one
    that is smaller is ``settled``.

    Raises
    ------
    InputError
        As ``split_folds``; where no candidate fits an accelerator.
    """
    candidates: list[Candidate] = []

    def judge(cell: str, hidden: int | None, **changes: Any) -> bool:
        on = config if cell == "linear" or recurrent is None else recurrent
        try:
            tried = network(on, cell, hidden)
            recipe = choose_recipe(tried, protocol)
        except InputError:
            return False  # too wide for an accelerator, or a recipe that this cell has not
        recipe = dataclasses.replace(recipe, **changes)
        called = f"{cell} {hidden}" if hidden else cell
        named: Progress | None = (
            (lambda task, done, total: progress(f"{task}, {called}", done, total)) if progress else None
        )
        try:
            candidate = cross_validate_network(
                recordings,
                tried,
                recipe,
                groups,
                seeds,
                folds,
                widths or {},
                named,
                datasets=datasets,
                goes_on=in_reach,
            )
        except InputError:
            if cell != "linear":
                raise
            return False  # its formats find no room
        candidates.append(dataclasses.replace(candidate, front_end=on))
        return True

    def in_reach(first: Candidate) -> bool:
        if any(
            settled(candidate) and candidate.multiplies_touch < first.multiplies_touch
            for candidate in candidates
        ):
            return False
        best = max((candidate.accuracy for candidate in candidates), default=0.0)
        return best - first.accuracy <= OUT_OF_REACH * first.standard_error

    datasets = datasets or Datasets(recordings)
    if judge("linear", None):
        augments = candidates[-1].recipe.augments
        if augments:  # which is no gain where classes differ by their timing
            judge("linear", None, name="as recorded", **AS_RECORDED)
        judge(
            "linear",
            None,
            name="as recorded, weak penalty" if augments else "weak penalty",
            penalty=WEAK_PENALTY,
            **AS_RECORDED,
        )
        judge("linear", None, name="least squares", squares=True)
        if augments:
            judge("linear", None, name="least squares, as recorded", squares=True, **AS_RECORDED)
    units = [hidden for hidden in GRU_UNITS if judge("gru", hidden)]
    if not candidates:
        raise InputError(
            f"configuration '{config.name}': no network of the candidates fits it; name one with --cell and "
            "--hidden"
        )
    if len(units) > 1 and goes_on(candidates):
        judge("gru", LARGER_UNITS)
    chosen = smallest_enough(candidates)
    return chosen, [candidate.row(candidate is chosen) for candidate in candidates]


def splits_to_report(
    recordings: Recordings, config: AcceleratorConfig, groups: Sequence[str]
) -> list[list[str]]:
    """What the network taken is cross-validated over: ``default_splits`` and the split it was chosen on."""
    splits = [split for split in default_splits(recordings, config) if split]
    return splits if list(groups) in splits else [*splits, list(groups)]


def train_chosen(
    recordings: Recordings,
    asked: AcceleratorConfig | None,
    *,
    out: str | Path,
    cell: str | None = None,
    hidden: int | None = None,
    weight_sets: str | None = None,
    group: Sequence[str] | None = None,
    folds: int = 5,
    seed: int = 0,
    seeds: int | None = None,
    protocol: str = "default",
    quantisation_aware: bool = False,
    widths: dict[str, Any] | None = None,
    plan: Plan | None = None,
    progress: Progress | None = None,
    of_images: dict[str, Any] | None = None,
    **network_changes: Any,
) -> dict[str, Any]:
    """Choose what was not asked for, train it, and write the model folder.

    Parameters
    ----------
    asked:
        The configuration that was asked for; None: the front end is chosen (``choose_front_end``).
    cell, hidden:
        ``auto``: the network is chosen. None: as ``auto`` where neither configuration nor ``hidden`` was
        asked for, else the configuration's own (a GRU where there is none).
    weight_sets:
        Of a linear cell: ``one`` or ``window``; None: as the configuration has it.
    plan:
        What ``configure`` gave for these recordings, when it is at hand; with a field, for figures of folds
        that chose nothing.
    seeds:
        Networks of each fold; None: 3, and 1 of images, which take minutes each.
    of_images:
        ``keep`` and ``workers`` of `eskin.golden.training.image_models.train_image_model`; of recordings they
        say nothing.
    network_changes:
        ``reset`` and ``steps``, as for ``train``.

    All else as for ``eskin.golden.training.train.train``, whose record it returns, with ``front_end`` (where
    it was chosen), ``candidates`` (where the network was), ``reasons``, ``baselines`` (a linear classifier on
    the same features, for each split) and ``warnings`` (sentences).

    Raises
    ------
    InputError
        As ``train``; ``hidden`` with a cell that has none or is chosen.
    """
    check_model_target(out)
    check_units(cell, hidden, weight_sets)
    if recordings.image_shape:
        return _train_on_images(
            recordings,
            asked,
            {
                "hidden": hidden,
                "weight_sets": weight_sets,
                "reset": network_changes.get("reset"),
                "steps": network_changes.get("steps"),
            },
            protocol,
            dict(widths or {}),
            {
                "out": out,
                "cell": cell,
                "group": group,
                "folds": folds,
                "seed": seed,
                "quantisation_aware": quantisation_aware,
            }
            | {"seeds": seeds or 1}
            | (of_images or {}),
            progress,
        )
    if cell in NETWORKS:
        raise InputError(
            f"--cell {cell}: takes images, and '{recordings.source}' holds recordings; use gru, lstm, "
            "linear or auto"
        )
    seeds = seeds or 3
    begin = plan or configure(recordings, asked, groups=group, folds=folds, nested=True, progress=progress)
    if weight_sets is not None:
        begin = dataclasses.replace(begin, config=begin.config.replace(weight_sets=weight_sets))
    config, reasons, begin_config = begin.config, list(begin.reasons), begin.config
    split, split_from, steps = begin.split, begin.split_from, network_changes.get("steps")
    config = with_network(config, steps=steps) if steps is not None else config
    chooses = cell == AUTO or (
        cell is None and hidden is None and asked is None and network_changes.get("reset") is None
    )
    if cell == AUTO and not folds:
        raise InputError(
            "--cell auto: needs folds to judge networks on; leave --folds 0 out or name --cell gru, lstm or "
            "linear"
        )
    datasets = Datasets(recordings)
    changes: dict[str, Any] = {}
    known: list[dict[str, Any]] = []
    recipe: Recipe | None = None
    recurrent = config
    of_recurrent: list[dict[str, Any]] = []

    def on(
        front_end: AcceleratorConfig, cell: str | None = cell, hidden: int | None = hidden
    ) -> AcceleratorConfig:
        """The network asked for on a front end."""
        sized = front_end if steps is None else with_network(front_end, steps=steps)
        sized = sized if weight_sets is None else sized.replace(weight_sets=weight_sets)
        made = network(sized, cell, hidden) if cell else with_network(sized, hidden=hidden)
        return with_network(made, reset=network_changes.get("reset")) if made.recurrent else made

    fixed = (
        config if chooses else network(config, cell, hidden) if cell else with_network(config, hidden=hidden)
    )
    if weight_sets is not None and fixed.recurrent and not chooses:
        raise InputError(
            f"--weight-sets {weight_sets}: only a linear cell has them; leave it out, or name --cell linear"
        )
    if (
        begin.rivals
        and folds
        and fixed.recurrent
        and network_changes.get("reset") is None
        and config == begin.config
    ):
        like: dict[str, Any] = {"cell": fixed.network.cell, "hidden": fixed.network.hidden}
        front_ends = [with_network(one, **like) for one in (config, *begin.rivals)]
        found, of_recurrent = recurrent_front_end(
            recordings,
            front_ends,
            split,
            seed=seed,
            folds=folds,
            protocol=protocol,
            datasets=datasets,
            progress=progress,
        )
        recurrent = (config, *begin.rivals)[front_ends.index(found)]
    if chooses and folds:
        chosen, rows = choose_network(
            recordings,
            config,
            split,
            recurrent=recurrent,
            seeds=range(seed, seed + seeds),
            folds=folds,
            protocol=protocol,
            widths=widths,
            datasets=datasets,
            progress=progress,
        )
        begin = begin.with_chosen(chosen.front_end)
        config, recipe, changes["candidates"] = chosen.config, chosen.recipe, rows
        left = left_out(split)
        reasons.append(
            f"network chosen among {len(rows)}, leaving out {left} ({split_from}): "
            f"{network_name(chosen.row(True))} needs the fewest "
            f"multiplies a touch ({chosen.multiplies_touch}) of those within one standard error (over "
            "recordings) of the best"
        )
        known = [] if quantisation_aware else [chosen.record]
    elif cell not in (None, AUTO):
        begin, config = begin.with_chosen(recurrent), network(recurrent, cell, hidden)
    elif hidden is not None:
        begin, config = begin.with_chosen(recurrent), with_network(recurrent, hidden=hidden)
    if begin.record:
        changes["front_end"] = begin.record | {"for_recurrent": of_recurrent}
        if row_of(begin.config) != row_of(begin_config):
            reasons.append(
                "the network stands on another front end than the linear classifier's: "
                f"{front_end_words(row_of(begin.config))}"
            )
    if group is not None:
        splits: list[list[str]] | None = [list(group)]
    elif protocol == "thesis":
        splits = None
    else:
        splits = (
            default_splits(recordings, config)
            if asked is not None and not chooses
            else splits_to_report(recordings, config, split)
        )
    nested, chose = None, bool(begin.record or chooses)
    if folds and begin.field and begin.field.seen and chose:
        squares = {"squares": True, "name": "least squares", **AS_RECORDED}
        candidates = [
            fixed_network(lambda front_end: on(front_end, "linear", None), protocol, **squares),
            fixed_network(lambda front_end: on(front_end, "gru", 8), protocol),
        ]
        networks = (
            [one for one in candidates if fits(one, begin_config)]
            if chooses
            else [fixed_network(on, protocol)]
        )
        nested = Nested(
            recordings,
            begin.field,
            split,
            networks,
            folds,
            range(seed, seed + seeds),
            dict(widths or {}),
            datasets,
            progress,
        )
    return train(
        recordings,
        with_network(config, reset=network_changes.get("reset")),
        TrainingRequest(
            folds=folds,
            splits=splits,
            seed=seed,
            seeds=seeds,
            protocol=protocol,
            recipe=recipe,
            quantisation_aware=quantisation_aware,
            widths=widths or {},
            known=known,
        ),
        out=out,
        datasets=datasets,
        progress=progress,
        notes=lambda record: (
            _compared(recordings, config, folds, record, changes, nested, chose)
            | changes
            | {"reasons": reasons}
        ),
    )


def _train_on_images(
    recordings: Recordings,
    requested: AcceleratorConfig | None,
    not_of_images: dict[str, Any],
    protocol: str,
    widths: dict[str, Any],
    options: dict[str, Any],
    progress: Progress | None,
) -> dict[str, Any]:
    """`eskin.golden.training.image_models.train_image_model`, where nothing was asked for that networks for
    images do not have."""
    bits = widths.pop("weight_bits", None)
    options_set = [name for name, value in (not_of_images | widths).items() if value is not None]
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


def _compared(
    recordings: Recordings,
    config: AcceleratorConfig,
    folds: int,
    record: dict[str, Any],
    changes: dict[str, Any],
    nested: Nested | None,
    chose: bool,
) -> dict[str, Any]:
    """baselines and warnings (``doubts``): a linear classifier on the same integer features and folds beside
    every split; each split that something was chosen on gets its ``nested`` figure."""
    baselines, warnings = [], []
    judge = Judge(recordings, [])
    for split in record["cross_validation"]:
        judge.refold(split_folds(recordings, split["groups"], folds, None))
        with one_thread():
            judged = judge(config)
        multiplies = config.windows.steps * config.inputs * config.classes
        baselines.append(
            {
                "name": "linear classifier on the same features",
                "groups": split["groups"],
                "accuracy": judged.accuracy,
                "standard_error": judged.standard_error,
                "multiplies": multiplies,
                "hardware": True,
            }
        )
        warnings += doubts.below_baselines(split, baselines, chosen="candidates" in changes)
        warnings += doubts.lost_classes(split, recordings.class_names)
        if chose:
            try:
                if nested is None:
                    raise InputError("recordings are too few; record more")
                split["nested"] = nested.record(split["groups"])
                warnings += doubts.by_choice(split)
            except (
                InputError
            ) as error:  # a front end that a fold chose has no room for its network, or no touch
                split["nested"] = None
                warnings.append(
                    f"leaving out {left_out(split['groups'])}, there is no figure of folds that chose "
                    f"nothing: {error}"
                )
    warnings += wrong_rate(recordings)
    warnings += doubts.missed_onsets(record["touched"], record["recordings"])
    warnings += doubts.look_alike(
        recordings, record["cross_validation"][0]["groups"] if record["cross_validation"] else ["none"], folds
    )
    return {"baselines": baselines, "warnings": warnings}
