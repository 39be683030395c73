"""Splits of recordings that keep groups apart."""

import re
from collections.abc import Sequence

import numpy as np

from eskin.golden.core import InputError
from eskin.golden.data.recordings import Recordings


def no_group(values: np.ndarray, labels: np.ndarray) -> str:
    """Why ``values``, one a recording, are no group to leave out; empty: they are one.

    Groups within one class each would leave out the whole class, and groups of one recording each are no
    better than single recordings.
    """
    _, keys = np.unique(values, return_inverse=True)
    count, classes = int(keys.max(initial=0)) + 1, len(np.unique(labels))
    pairs = len(np.unique([keys, labels], axis=1).T)
    in_one_class = classes > 1 and pairs == count
    if in_one_class and count == classes:
        return "tells the class, too,"
    if count == len(values) > 1:
        return "has another value in each recording, so is not a group,"
    if in_one_class:
        return "has each of its values in one class alone, so is not a group,"
    if count > 1 and pairs == classes:
        return "has one value in each class, so is not a group,"
    return ""


PEOPLE = re.compile("person|subject|participant|people|user|operator|volunteer|patient", re.IGNORECASE)
REPEATED = re.compile("trial|rep|take|attempt|iteration|run|index|number|block", re.IGNORECASE)
"""Names of groups that a sensor meets anew, and of those that count one touch after another."""


def likely_groups(recordings: Recordings) -> list[str]:
    """Groups of an archive that can be left out: people first, repetitions last, otherwise as they stand there.

    They have two values or more in every class, else a class may be missing where the rest trains; and no comma in
    their names, where `group` takes the next name.
    """
    labels = recordings.labels
    names = [
        name
        for name, values in recordings.groups.items()
        if "," not in name
        and not no_group(values, labels)
        and all(len(np.unique(values[labels == label])) > 1 for label in np.unique(labels))
    ]
    return sorted(names, key=lambda name: bool(REPEATED.search(name)) - 2 * bool(PEOPLE.search(name)))


def group_numbers(recordings: Recordings, groups: Sequence[str]) -> np.ndarray:
    """(recordings) the number of each one's group: those that share all values of ``groups`` are one, so without
    groups all are.

    Raises
    ------
    InputError
        An unknown group.
    """
    for name in groups:
        if name not in recordings.groups:
            listed = ", ".join(sorted(recordings.groups)) or "none"
            raise InputError(
                f"recordings '{recordings.source}': has no group array '{name}'; it has {listed}"
            )
    keys = np.zeros(len(recordings), dtype=np.int64)
    for name in groups:
        _, codes = np.unique(recordings.groups[name], return_inverse=True)
        # made dense after each array, so that the product never grows beyond an integer
        _, keys = np.unique(keys * (codes.max() + 1) + codes, return_inverse=True)
    return keys


def grouped_folds(
    recordings: Recordings, groups: Sequence[str], folds: int, seed: int | None
) -> list[np.ndarray]:
    """Test indices (ascending) of each fold; together they are all recordings, each once.

    Parameters
    ----------
    recordings:
        What to split.
    groups:
        Names of group arrays: recordings that share all their values are never on both sides. Empty: every
        recording is a group, and folds are stratified by class.
    folds:
        Number of folds, at least 2. With no more groups than folds each group is left out in turn (so there
        may be fewer folds).
    seed:
        Order in which groups are dealt; None: as they stand in the archive.

    Raises
    ------
    InputError
        An unknown group, a single group, or a number of folds that cannot be made.
    """
    if folds < 2:
        raise InputError(f"{folds} folds are too few; cross-validation needs at least 2")
    keys = group_numbers(recordings, groups) if groups else np.arange(len(recordings))
    count = int(keys.max()) + 1
    if count < 2:
        reason = f"group {' and '.join(groups)} has one value" if groups else "there is one recording"
        raise InputError(
            f"recordings '{recordings.source}': {reason}; cross-validation needs two; choose another group or add recordings"
        )
    if groups and count <= folds:
        return [np.flatnonzero(keys == key) for key in range(count)]
    if count < folds:
        raise InputError(
            f"recordings '{recordings.source}': {folds} folds need as many recordings and there are {count}; "
            f"use fewer, --folds {count} of eskin train, or add recordings"
        )

    table = np.zeros((count, len(recordings.class_names)), dtype=np.int64)
    np.add.at(table, (keys, recordings.labels), 1)
    order = np.arange(count) if seed is None else np.random.default_rng(seed).permutation(count)
    # the largest groups first, while folds have room to even them out; a stable sort keeps the seed's order
    order = order[np.argsort(-table[order].max(axis=1), kind="stable")]
    even = np.maximum(recordings.class_counts, 1) / folds
    filled = np.zeros((folds, table.shape[1]))
    fold_of = np.zeros(count, dtype=np.int64)
    for group in order:
        # The fold that this group leaves closest to an even share of every class; ties go to the emptiest,
        # then the first.
        unevenness = (((filled + table[group]) / even) ** 2).sum(axis=1) - ((filled / even) ** 2).sum(axis=1)
        # rounded: equal folds would else differ in the last bits and not be ties
        fold = np.lexsort((filled.sum(axis=1), np.round(unevenness, 9)))[0]
        fold_of[group] = fold
        filled[fold] += table[group]
    return [np.flatnonzero(fold_of[keys] == fold) for fold in range(folds)]
