"""Enrolment: a trained model learns a new mounting, person or object position from a few labelled touches,
its formats unchanged.

A new mounting shifts the signal of every taxel in a way that other mountings do not predict. One to five
touches of each class do. Quantisation-aware training goes on with them: configuration and formats stay, so
that the host loads the new weights into the bitstream of the old model. Two measures preserve what the
network has learned: the recordings of the first training, if available (new touches are then a quarter of the
draws), and a penalty on the distance to the old weights. A model whose readout is prototypes is taught: touches are
stored. The benefit: each value of a group is left out of the training in turn, then enrolled with a few of its
touches.
"""

import dataclasses
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import torch

from eskin.choose.choice import search_inside
from eskin.choose.cost import CostModel
from eskin.choose.front_ends import FrontEnds
from eskin.data.fit import for_model
from eskin.data.folds import group_numbers, grouped_folds
from eskin.golden.core import AcceleratorConfig, Arrays, InputError, Record
from eskin.golden.data import Recordings
from eskin.golden.model import (
    FloatModel,
    IntegerModel,
    check_model_target,
    load_config,
    network_formats,
    network_shapes,
    run,
)
from eskin.golden.model.prototypes import check_teachable, taught_in_use
from eskin.training.batches import Batches, drawn_rows
from eskin.training.datasets import Dataset, Datasets, find_dataset, touch_rows
from eskin.training.fit import Loss, train_integers
from eskin.training.judge import FittedNetwork, NetworkLearner, Rows
from eskin.training.losses import Progress, class_loss
from eskin.training.prototypes import by_last_step, teach_recordings, teach_touches, with_prototypes
from eskin.training.quantise import IntegerNetwork, profile, range_records
from eskin.training.recipe import Recipe, choose_recipe, noted_recipe
from eskin.training.record import OTHER_SIGNALS, Enrolled, SignalRange, Taught, training_of


@dataclass(frozen=True, kw_only=True)
class Enrolment:
    """Settings of training on.

    updates, learning_rate: gradient steps and the largest rate of their one-cycle schedule, Adam. share: of
    the draws that are new touches, where old recordings are at hand. pull: weight of the sum of squared
    distances of all weights to the old ones, beside the mean cross-entropy.
    """

    updates: int
    learning_rate: float
    share: float
    pull: float


SETTINGS: dict[bool, Enrolment] = {
    True: Enrolment(updates=300, learning_rate=0.01, share=0.25, pull=0.0),
    False: Enrolment(updates=150, learning_rate=0.005, share=1.0, pull=0.1),
}
"""By whether old recordings are at hand. With them it is as first thought of: a quarter of the draws, a third of
the first training's rate. The penalty without them was chosen on seeds 0 to 2 of pvdf_indent's sequences, as
the smallest tried (0.01, 0.03, 0.1) that costs the other sequences less than half a point."""


def _of_weights(before: FloatModel, weights: Arrays) -> FloatModel:
    """The float network of other ``weights`` (by the integer network's names) that is else as ``before``."""
    # a second bias row that the hardware adds to the first is 0: the first holds the sum
    shapes = network_shapes(before.config, real=True)
    real = {name: weights[name] if name in weights else np.zeros(shape) for name, shape in shapes.items()}
    return FloatModel(before.config, {**before.arrays, **real})


def load_network(folder: str | Path, data: Dataset) -> FittedNetwork:
    """Both forms of the model in a folder, for the touches of ``data``. If the integers were trained themselves
    (quantisation-aware), training continues from them, otherwise from the float weights.

    Raises
    ------
    InputError
        The folder is not a quantised model folder.
    """
    real, integer = FloatModel.load(folder), IntegerModel.load(folder)
    if training_of(folder).quantisation_aware:
        formats = network_formats(integer.config)
        weights = {name: formats[name].to_real(integer.arrays[name]) for name in formats}
        real = _of_weights(real, weights)
    return FittedNetwork(real, integer, data)


def fit(
    networks: Sequence[FittedNetwork],
    recipe: Recipe,
    new: Sequence[np.ndarray],
    old: Sequence[np.ndarray] | None,
    seed: int,
    progress: Progress = lambda done, total: None,
) -> list[FittedNetwork]:
    """Train each network on with its new touches, in integer arithmetic; networks of the same formats at once;
    deterministic by ``seed``.

    Parameters
    ----------
    recipe:
        Loss and augmentation, as in their first training.
    new, old:
        For each network the rows of its touches to enrol, and the rows of the old recordings; None: there are none.
    """
    setting = SETTINGS[old is not None]

    def batches_of(config: AcceleratorConfig, members: list[int]) -> Batches:
        generator, new_ones = torch.Generator().manual_seed(seed), [new[number] for number in members]

        def draw(batch: int) -> torch.Tensor:
            """A fixed share from the new touches, the rest from the old ones."""
            if old is None:
                return drawn_rows(new_ones, batch, generator)
            count, before = max(1, round(batch * setting.share)), [old[number] for number in members]
            rows = drawn_rows(new_ones, count, generator), drawn_rows(before, batch - count, generator)
            return torch.cat(rows, dim=-1)

        real = [networks[number].real.arrays for number in members]
        scales = [(arrays["mu"].tolist(), arrays["sigma"].tolist()) for arrays in real]
        return Batches(data, config, recipe, new_ones, generator, scales=scales, draw=draw)

    def loss_of(network: IntegerNetwork) -> Loss:
        begin = {name: weight.detach().clone() for name, weight in network.weights.items()}

        def loss(features: torch.Tensor, labels: torch.Tensor, counts: torch.Tensor) -> torch.Tensor:
            of_labels = class_loss(recipe, network(network.feature_codes(features)), labels, counts)
            if not setting.pull:
                return of_labels
            return of_labels + setting.pull * sum(
                ((weight - begin[name]) ** 2).flatten(1).sum(1) for name, weight in network.weights.items()
            )

        return loss

    data = networks[0].data
    models, integers = [each.real for each in networks], [each.integer for each in networks]
    trained = train_integers(
        models, integers, batches_of, loss_of, setting.updates, setting.learning_rate, progress
    )
    return [
        FittedNetwork(_of_weights(model, weights), integer, data)
        for model, (integer, weights) in zip(models, trained, strict=True)
    ]


# ---------------------------------------------------------------------- recordings
def joined(few: Recordings, old: Recordings | None) -> Recordings:
    """``few``, and after them ``old``, as one set without groups."""
    if old is None:
        return few
    return dataclasses.replace(
        few,
        samples=np.concatenate([few.samples, old.samples]),
        offsets=np.concatenate([few.offsets, few.frames + old.offsets[1:]]),
        labels=np.concatenate([few.labels, old.labels]),
        groups={},
    )


# ---------------------------------------------------------------------- the verb
MAX_LOSS = 0.01
"""Accuracy on the old recordings that enrolment may cost."""


OF_RECORDINGS = ("feature", "state", "logit", "sigmoid pre-activation", "tanh pre-activation")
"""Signals whose ranges depend on the recordings, not on the weights alone."""


def check_other_folder(model_dir: str | Path, out: str | Path) -> None:
    """Refuse (InputError) to write a model over the model it comes from, or over another folder."""
    if Path(out).resolve() == Path(model_dir).resolve():
        raise InputError(
            f"model '{out}': is the model to start from, which enrol does not change; name another folder"
        )
    check_model_target(out)


def enrol(
    model_dir: str | Path,
    few: Recordings,
    out: str | Path,
    *,
    old: Recordings | None = None,
    seed: int = 0,
    progress: Progress = lambda done, total: None,
) -> Enrolled:
    """Continue training the model in ``model_dir`` with ``few`` touches of a new mounting, and write it to
    ``out``; the configuration does not change.

    Parameters
    ----------
    few:
        Recordings of the new mounting, 1 to 5 touches of each class; the first touch of each recording
        counts.
    old:
        Recordings that the model was trained on, to be remembered.

    Returns
    -------
    What training.json keeps in ``enrolments``; ``passed``: no fewer of the new recordings right than before, and at most
    MAX_LOSS of the old ones lost.

    Raises
    ------
    InputError
        Recordings of another sensor, an unknown class, a class without a touch, or a folder that must not be
        written.
    """
    begin = time.perf_counter()
    check_other_folder(model_dir, out)
    if load_config(model_dir).has_prototypes:
        raise InputError(
            f"model '{model_dir}', field readout: is 'prototypes', which would not fit the new weights; "
            "give `teach` in place of `data`, or quantise it without `readout` first"
        )
    record, config = training_of(model_dir), IntegerModel.load(model_dir).config
    few = for_model(few, config)
    old = None if old is None else for_model(old, config)
    recipe = noted_recipe(record, config)
    everything = joined(few, old)
    data = find_dataset(everything, config, recipe)
    is_new = np.arange(len(everything)) < len(few)
    new, former = (touch_rows(data, np.flatnonzero(part)) for part in (is_new, ~is_new))
    counts = np.bincount(everything.labels[data.touches.recording][new], minlength=config.classes)
    touches = dict(zip(config.network.class_names, counts.tolist(), strict=True))
    for name, count in touches.items():
        if not count:  # the network's outputs for this class would be undefined
            raise InputError(
                f"recordings '{few.source}': have no touch of class {name}; enrolment needs 1 to 5 of each class: "
                + OTHER_SIGNALS
            )
    if old is not None and not len(former):
        raise InputError(f"recordings '{old.source}': have no touch; leave `with_` out, or {OTHER_SIGNALS}")
    network = load_network(model_dir, data)
    (enrolled,) = fit([network], recipe, [new], None if old is None else [former], seed, progress)

    def share(of: FittedNetwork, part: np.ndarray) -> float | None:
        return share_right(of, everything.labels, np.flatnonzero(part))

    before, after = share(network, is_new) or 0.0, share(enrolled, is_new) or 0.0
    old_before, old_after = share(network, ~is_new), share(enrolled, ~is_new)
    result = Enrolled(
        data=str(few.source),
        old_data=None if old is None else str(old.source),
        seed=seed,
        touches=touches,
        setting=dataclasses.asdict(SETTINGS[old is not None]),
        before=before,
        after=after,
        old_before=old_before,
        old_after=old_after,
        wall_s=time.perf_counter() - begin,
        passed=after >= before and (old_after or 0.0) >= (old_before or 0.0) - MAX_LOSS,
    )
    record.enrolments = [*record.enrolments, result]
    ranges = profile(enrolled.real, data.touches)
    for entry in record.ranges or ():  # of the old recordings, which may not be at hand
        if isinstance(entry, SignalRange) and (signal := entry.signal) in OF_RECORDINGS and signal in ranges:
            low, high = ranges[signal]
            ranges[signal] = (min(low, entry.min), max(high, entry.max))
    record.ranges, record.quantisation_aware = range_records(config, ranges), False
    enrolled.real.save(out, record, enrolled.integer)
    return result


def share_right(network: FittedNetwork, labels: np.ndarray, rows: Rows) -> float | None:
    """The share of ``rows`` that the integers decide as labelled; no decision is wrong. None: no rows."""
    return float((network.decide(rows).integer == labels[rows]).mean()) if len(rows) else None


def teach_folder(model_dir: str | Path, few: Recordings, out: str | Path) -> Taught:
    """Teach the model in ``model_dir`` the touches of ``few`` and write it to ``out``; config.json and all
    weights stay.

    Returns
    -------
    What training.json keeps in ``taught``; ``passed``: no fewer of ``few`` right than before.

    Raises
    ------
    InputError
        As `teach_recordings`; recordings of another sensor, a folder that must not be written.
    """
    begin = time.perf_counter()
    check_other_folder(model_dir, out)
    model, record = IntegerModel.load(model_dir), training_of(model_dir)
    check_teachable(model.config)
    few = for_model(few, model.config)
    after, counts = teach_recordings(model, few)
    names = model.config.network.class_names
    right, right_after = (run(each, few).accuracy(few.labels) for each in (model, after))
    result = Taught(
        data=str(few.source),
        touches=dict(zip(names, counts.tolist(), strict=True)),
        in_use=dict(zip(names, taught_in_use(after).tolist(), strict=True)),
        places=model.config.readout_rule.taught,
        before=right,
        after=right_after,
        wall_s=time.perf_counter() - begin,
        passed=right_after >= right,
    )
    record.taught = [*record.taught, result]
    FloatModel.load(model_dir).save(out, record, after)
    return result


# ---------------------------------------------------------------------- the benefit
DRAWS = {"dense": 1, "prototypes": 10}
"""Number of draws of the touches to enrol, by readout; figures are means."""
SET_ASIDE = 5
"""One recording in this number, of a class in a group, is set aside, to judge the cost of enrolment on the
other groups."""
CHOICES = 5
"""Front ends chosen at most, each without a part of the values: one a value took most of the time."""
FIGURES = ("before", "after", "others_before", "others_after")


@dataclass(frozen=True)
class EnrolmentTrial:
    """Input of ``judge`` for one seed. It measures, for each value of ``groups``, the accuracy of a network
    that was not trained on this value, before and after k touches per class are enrolled (k in ``ks``).
    configs: one per value, in the order of ``group_values``. readout: ``dense`` trains further,
    ``prototypes`` stores the touches (also k = 0)."""

    groups: tuple[str, ...]
    ks: tuple[int, ...]
    configs: tuple[AcceleratorConfig, ...]
    seed: int
    readout: str = "dense"


def front_ends_without(
    recordings: Recordings, values: Arrays, groups: Sequence[str], prices: CostModel
) -> list[AcceleratorConfig]:
    """For each value of ``groups`` the front end that is most accurate without its recordings. A cheaper one that
    ties on the other values, with fewer scans or a tight clip, holds too little of what is new about this one.

    Values are dealt to CHOICES parts; the choice without a part serves all of its values, and their
    networks train at once. If there are at least two other values, they are left out in turn.
    """
    front_ends, everything = FrontEnds(recordings), np.arange(len(recordings))
    parts = [list(values)[first::CHOICES] for first in range(min(CHOICES, len(values)))]
    chosen: dict[str, AcceleratorConfig] = {}
    for part in parts:
        rest = np.setdiff1d(everything, np.concatenate([values[value] for value in part]))
        best, *_ = search_inside(front_ends, rest, groups, prices)
        chosen |= dict.fromkeys(part, best.candidate.front_end)
    return [chosen[value] for value in values]


def group_values(recordings: Recordings, groups: Sequence[str], ks: Sequence[int]) -> Arrays:
    """The recordings of each value of ``groups``, by its name.

    Raises
    ------
    InputError
        An unknown group, one with a single value, or a value with too few recordings of a class; a class
        without any is left out of that value (`lacking`).
    """
    if not groups:
        raise InputError(
            "`group`: is missing; name the group array whose values are mountings, persons or positions"
        )
    of_value = {}
    for members in grouped_folds(recordings, groups, max(2, len(recordings)), None):
        name = " ".join(str(recordings.groups[group][members[0]]) for group in groups)
        of_value[name] = members
        counts = np.bincount(recordings.labels[members], minlength=len(recordings.class_names))
        label = int(np.argmin(np.where(counts, counts, len(members) + 1)))
        if counts[label] <= max(ks):
            raise InputError(
                f"recordings '{recordings.source}', group {' and '.join(groups)}: value {name} has "
                f"{counts[label]} recordings of class "
                f"{recordings.class_names[label]}, and enrolling {max(ks)} leaves none to test; use a smaller k or another group"
            )
    return of_value


def lacking(recordings: Recordings, members: np.ndarray) -> list[str]:
    """Classes without a recording among ``members``: nobody can enrol them, and they are not judged."""
    present = np.unique(recordings.labels[members])
    return [name for label, name in enumerate(recordings.class_names) if label not in present]


def set_aside(recordings: Recordings, values: Arrays) -> np.ndarray:
    """(R) bool: the recordings that no network of the evaluation is trained on, one in SET_ASIDE of each
    class of each value, in the archive's order, beginning with the third."""
    aside = np.zeros(len(recordings), dtype=bool)
    for members in values.values():
        for label in range(len(recordings.class_names)):
            aside[members[recordings.labels[members] == label][2::SET_ASIDE]] = True
    return aside


def judge(recordings: Recordings, trial: EnrolmentTrial) -> list[Record]:
    """For each value left out, each k and each draw: value, k, before, after (integer accuracy on the recordings of
    that value that no k enrols), others_before, others_after (on recordings of the other values that were set
    aside from both trainings; None: there are none), recordings, others (how many judge), lacking (classes
    that the value has no recording of).

    Touches enrolled with a smaller k are among the touches of a larger, and the same recordings judge every k.
    """
    values = group_values(recordings, trial.groups, trial.ks)
    aside, rows = set_aside(recordings, values), []
    for config in dict.fromkeys(trial.configs):  # networks of one design train at once
        pairs = zip(values, trial.configs, strict=True)
        of_config = {value: values[value] for value, its_own in pairs if its_own == config}
        rows += _judge_values(recordings, config, of_config, aside, trial)
    order = list(values)
    return sorted(rows, key=lambda row: (row["k"], order.index(row["value"])))


class Lesson(NamedTuple):
    """A draw of ``k`` touches a class of a ``value``: rows to enrol, recordings that judge."""

    value: str
    k: int
    rows: np.ndarray
    judged: np.ndarray


def _judge_values(
    recordings: Recordings,
    config: AcceleratorConfig,
    values: Arrays,
    aside: np.ndarray,
    trial: EnrolmentTrial,
) -> list[Record]:
    learner = NetworkLearner(Datasets(recordings), config, choose_recipe(config))
    data, everything = learner.data, np.arange(len(recordings))
    parts = {value: np.setdiff1d(everything[~aside], members) for value, members in values.items()}
    networks = learner.fit([*parts.values()], [trial.seed] * len(parts))
    before = dict(zip(parts, networks, strict=True))
    trained_on = {value: touch_rows(data, part) for value, part in parts.items()}
    ks = sorted({*trial.ks} | ({0} if trial.readout == "prototypes" else set()))
    lessons = []
    for value, members in values.items():
        generator = np.random.default_rng([trial.seed, *value.encode()])
        for _ in range(DRAWS[trial.readout]):
            drawn = _draw(recordings, data, members, max(ks), value, trial, generator)
            judged = np.setdiff1d(members, np.concatenate(drawn))
            for k in ks:
                rows = touch_rows(data, np.concatenate([of_class[:k] for of_class in drawn]))
                lessons.append(Lesson(value, k, rows, judged))
    if trial.readout == "prototypes":
        models = _taught(recordings, trial, data, trained_on, before, lessons)
        after = [
            dataclasses.replace(before[lesson.value], integer=m)
            for lesson, m in zip(lessons, models, strict=True)
        ]
    else:
        old, new = [trained_on[lesson.value] for lesson in lessons], [lesson.rows for lesson in lessons]
        after = fit([before[lesson.value] for lesson in lessons], learner.recipe, new, old, trial.seed)
    others = [np.setdiff1d(everything[aside], values[lesson.value]) for lesson in lessons]
    found: list[Record] = []
    for number, (lesson, aside_of_others) in enumerate(zip(lessons, others, strict=True)):
        row: Record = {"value": lesson.value, "k": lesson.k}
        row["lacking"] = lacking(recordings, values[lesson.value])
        row |= {"recordings": len(lesson.judged), "others": len(aside_of_others)}
        for name, rows in (("", lesson.judged), ("others_", aside_of_others)):
            for when, network in (("before", before[lesson.value]), ("after", after[number])):
                row[f"{name}{when}"] = share_right(network, recordings.labels, rows)
        found.append(row)
    return found


def _taught(
    recordings: Recordings,
    trial: EnrolmentTrial,
    data: Dataset,
    parts: Arrays,
    networks: Mapping[str, FittedNetwork],
    lessons: Sequence[Lesson],
) -> list[IntegerModel]:
    """For each lesson the network with prototypes of what it was trained on, taught the lesson's touches."""
    groups, labels = group_numbers(recordings, trial.groups), recordings.labels
    where, ready = data.touches.recording, {}
    for value, part in parts.items():
        integer = networks[value].integer
        whole = part[data.touches.completed[part] == integer.config.windows.steps]
        rows = where[whole]
        ready[value] = with_prototypes(
            by_last_step(integer),
            data.touches.take(whole),
            labels[rows],
            groups[rows],
            taught=max(1, *trial.ks),
            source=f"recordings '{recordings.source}'",
        )
    return [
        teach_touches(ready[lesson.value], data.touches.take(lesson.rows), labels[where[lesson.rows]])
        for lesson in lessons
    ]


def _draw(
    recordings: Recordings,
    data: Dataset,
    members: np.ndarray,
    most: int,
    value: str,
    trial: EnrolmentTrial,
    generator: np.random.Generator,
) -> list[np.ndarray]:
    """``most`` recordings to enrol of each class that is among ``members``, such as show a touch: a user would
    see it and touch again. A partial touch cannot be stored as a prototype."""
    drawn, lacks = [], lacking(recordings, members)
    least = 1 if trial.readout == "dense" else data.touches.sums.shape[1]
    for label, name in enumerate(recordings.class_names):
        if name in lacks:
            continue
        of_class = members[(recordings.labels[members] == label) & (data.index[members] >= 0)]
        of_class = of_class[data.touches.completed[data.index[of_class]] >= least]
        if len(of_class) < most:
            raise InputError(
                f"recordings '{recordings.source}': of value {value} only {len(of_class)} recording(s) of "
                f"class {name} show a touch, and "
                f"{most} are to be enrolled; use a smaller k, or another front end (`config`)"
            )
        drawn.append(generator.permutation(of_class)[:most])
    return drawn


def summary(group: Sequence[str], by_seed: Sequence[Sequence[Record]]) -> Record:
    """The result of ``enrol --evaluate`` from the rows of ``judge`` for each seed.

    Returns
    -------
    rows: {group, value, k, layers, before, after, others_before, others_after, recordings, others, lacking}, means
    over draws and seeds; mean: k -> the four over all values, weighted by their recordings.
    """
    table = pd.DataFrame([row for rows in by_seed for row in rows]).astype(dict.fromkeys(FIGURES, float))
    head, rows = {"group": " and ".join(group), "layers": "all"}, []
    for _, same in table.groupby(["k", "value"], sort=False):
        rows.append(head | same.iloc[0].to_dict() | same[[*FIGURES]].mean().to_dict())
    mean = {}
    for k, of_k in pd.DataFrame(rows).groupby("k"):
        weights = of_k[["recordings", "recordings", "others", "others"]].to_numpy()
        figures = of_k[[*FIGURES]].to_numpy(dtype=float)
        whole = (figures * weights).sum(axis=0) / np.maximum(weights.sum(axis=0), 1)
        mean[str(k)] = dict(zip(FIGURES, whole.tolist(), strict=True))
    for row in (*rows, *mean.values()):
        row |= {name: None for name in FIGURES if np.isnan(row[name])}
    return {"rows": rows, "mean": mean}
