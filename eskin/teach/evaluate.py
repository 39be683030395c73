"""Benefit of enrolment: each value of a group is left out of the training in turn, then enrolled with a
few of its touches, by training on or by prototypes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from eskin.choose.choice import search_inside
from eskin.choose.cost import CostModel
from eskin.choose.front_ends import FrontEnds
from eskin.data.folds import group_numbers, grouped_folds
from eskin.golden.core import AcceleratorConfig, Arrays, InputError, Record
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel
from eskin.teach.enrol import Pair, fit, right
from eskin.training.datasets import Dataset, find_dataset, touch_rows
from eskin.training.fit import fit_networks, post_training
from eskin.training.prototypes import by_last_step, teach_touches, with_prototypes
from eskin.training.recipe import choose_recipe

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
    """For each value of ``groups`` the front end that is chosen without its recordings.

    Values are dealt to CHOICES parts; what is chosen without a part serves all of its values, and their
    networks train at once. If there are at least two other values, they are left out in turn.
    """
    front_ends, everything = FrontEnds(recordings), np.arange(len(recordings))
    parts = [list(values)[first::CHOICES] for first in range(min(CHOICES, len(values)))]
    chosen: dict[str, AcceleratorConfig] = {}
    for part in parts:
        rest = np.setdiff1d(everything, np.concatenate([values[value] for value in part]))
        chosen |= dict.fromkeys(part, search_inside(front_ends, rest, groups, prices).taken)
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
            "--group: is missing; name the group array whose values are mountings, persons or positions"
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

    Touches enrolled with a smaller k are among those of a larger, and the same recordings judge every k.
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
    recipe = choose_recipe(config)
    data, everything = find_dataset(recordings, config, recipe), np.arange(len(recordings))
    parts = {
        value: touch_rows(data, np.setdiff1d(everything[~aside], members))
        for value, members in values.items()
    }
    models = fit_networks(data, config, recipe, [*parts.values()], trial.seed, lambda done, total: None)
    before = {
        value: Pair(model, post_training(model, data, rows, {}))
        for (value, rows), model in zip(parts.items(), models, strict=True)
    }
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
        after = _taught(recordings, trial, data, parts, before, lessons)
    else:
        old, new = [parts[lesson.value] for lesson in lessons], [lesson.rows for lesson in lessons]
        pairs = [before[lesson.value] for lesson in lessons]
        after = [pair.integer for pair in fit(pairs, data, recipe, new, old, trial.seed)]
    at_first = {value: right(pair.integer, data) for value, pair in before.items()}
    found: list[Record] = []
    for lesson, model in zip(lessons, after, strict=True):
        members, decided = values[lesson.value], (at_first[lesson.value], right(model, data))
        judging = lesson.judged, np.setdiff1d(everything[aside], members)
        shares = [float(of[where].mean()) if len(where) else None for where in judging for of in decided]
        row: Record = {"value": lesson.value, "k": lesson.k, "lacking": lacking(recordings, members)}
        row |= dict(zip(("recordings", "others"), map(len, judging), strict=True))
        found.append(row | dict(zip(FIGURES, shares, strict=True)))
    return found


def _taught(
    recordings: Recordings,
    trial: EnrolmentTrial,
    data: Dataset,
    parts: Arrays,
    networks: Mapping[str, Pair],
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
                f"{most} are to be enrolled; use a smaller k, or another front end (--config)"
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
