"""Splits: which recordings a fold leaves out, by the group arrays of an archive."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from eskin.data.folds import group_numbers, grouped_folds, no_group
from eskin.golden.core import PRESETS, AcceleratorConfig, InputError, Record
from eskin.golden.data import Recordings
from eskin.training.derive import fits_sensor

SPLITS: dict[str, list[list[str]]] = {
    "pvdf": [["trial"], ["speed"], ["seq"]],
    "fabric": [["label", "force_setting", "velocity_mmps"]],
    "synthetic": [["person"]],
}
"""Splits by preset: names of the group arrays that stay on one side; ``label`` is the class itself."""


def default_splits(recordings: Recordings, config: AcceleratorConfig) -> list[list[str]]:
    """The splits that the configuration names; for a derived configuration, the splits of the preset for the same
    sensor. Groups that the recordings lack are ignored. Without any split: one split stratified by class."""
    available = {*recordings.groups, "label"}
    name = config.name
    if name == "derived":
        name = next((preset for preset in SPLITS if fits_sensor(PRESETS[preset], recordings)), "")
    splits = [split for split in SPLITS.get(name, []) if available.issuperset(split)]
    return splits or [[]]


def split_folds(
    recordings: Recordings, groups: Sequence[str], folds: int, seed: int | None
) -> list[np.ndarray]:
    """``grouped_folds`` that also takes ``label`` as a group name."""
    return grouped_folds(_with_label(recordings, groups), groups, folds, seed)


def _with_label(recordings: Recordings, groups: Sequence[str]) -> Recordings:
    if "label" not in groups:
        return recordings
    return dataclasses.replace(recordings, groups={**recordings.groups, "label": recordings.labels})


LEAST_ALONE = 10
"""Fewest recordings of a group whose accuracy says something by itself."""


def over_groups(
    recordings: Recordings, groups: Sequence[str], tests: Sequence[np.ndarray], correct: np.ndarray
) -> Record:
    """{standard_error, range, range_of} of ``correct`` (recordings).

    standard_error: of the mean. Recordings of one group share its mounting or its person, so a group counts as one
    draw (A. C. Cameron, D. L. Miller 2015, A practitioner's guide to cluster-robust inference, of a mean). Without
    groups each recording counts as one.

    range: lowest and highest accuracy of a group by itself, which is what a single new one may have: far more than the
    error of their mean, and more than of folds of several. Folds (``tests``) take the place of groups that have fewer
    than LEAST_ALONE recordings (be it a single group), or where there are none; ``range_of`` says which.
    """
    numbers = group_numbers(_with_label(recordings, groups), groups) if groups else np.arange(len(recordings))
    sizes, sums = np.bincount(numbers), np.bincount(numbers, correct - correct.mean())
    error = np.sqrt(len(sums) / (len(sums) - 1) * (sums**2).sum()) / len(correct)
    shares, parts = correct.mean() + sums / sizes, "groups"
    if sizes.min() < LEAST_ALONE:
        shares, parts = np.array([correct[test].mean() for test in tests if len(test)]), "folds"
    limits = [float(shares.min()), float(shares.max())]
    return {"standard_error": float(error), "range": limits, "range_of": f"{len(shares)} {parts}"}


def check_split(recordings: Recordings, groups: Sequence[str], folds: int) -> None:
    """Refuse groups that cannot be left out, before the work begins.

    Raises
    ------
    InputError
        A group is missing, has one value or is not a group (``no_group``), or the folds cannot be made.
    """
    for name in groups:
        why = no_group(recordings.groups[name], recordings.labels) if name in recordings.groups else ""
        if why and name != "label":
            why = f"array {name} {why.rstrip(',')}: leaving out one of its values would prove nothing"
            raise InputError(
                f"recordings '{recordings.source}', {why}; choose another `group`, or leave it out"
            )
    split_folds(recordings, groups, folds, None)


def held_out(recordings: Recordings, groups: Sequence[str], test: np.ndarray) -> str:
    """Groups that a fold leaves out, in words: ``speed 300``; the number of groups if there are many."""
    if not groups:
        return f"{len(test)} recordings"
    columns = [recordings.labels if name == "label" else recordings.groups[name] for name in groups]
    values = sorted({tuple(str(column[i]) for column in columns) for i in test})
    return (
        f"{' '.join(groups)} {', '.join(' '.join(value) for value in values)}"
        if len(values) <= 3
        else f"{len(values)} groups"
    )
