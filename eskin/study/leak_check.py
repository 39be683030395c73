"""Leak check: trained networks must know nothing of a recording whose touch was taken out.

A class can leak through what is no touch: the resting level, when the touch begins, how long the recording
goes on. So the frames of each recording behind its quiet lead-in are replaced by that lead-in, repeated; the
gate is forced open at the onset that was found in the recording as it was; length and onset stay.
Cross-validated networks, trained on the touches as recorded, then decide unseen groups.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from eskin.golden.core import AcceleratorConfig, InputError, Record
from eskin.golden.data import Recordings
from eskin.golden.model import find_onsets
from eskin.training import crossval
from eskin.training import recipe as recipes

MARGIN = 0.10
"""Accuracy above chance that is still no leak."""


def without_touches(
    recordings: Recordings, config: AcceleratorConfig, onsets: np.ndarray, left_in: int = 0
) -> Recordings:
    """Every recording with what follows its quiet lead-in replaced by that lead-in, repeated.

    The lead-in ends before the first frame that the onset's verdict saw: the touch may have begun there. A
    recording without an onset (-1) is left as it is.

    Parameters
    ----------
    onsets:
        (R) frames, from 1; those of ``quiet_enough``.
    left_in:
        Frames from the onset on that stay, with those between lead-in and onset: 0, for the check, leaves
        neither; more shows what a leak looks like.
    """
    samples = recordings.samples.copy()
    for index, onset in enumerate(onsets):
        if onset < 0:
            continue
        begin, end = recordings.offsets[index], recordings.offsets[index + 1]
        quiet = samples[begin : begin + onset - _judged_frames(config)]
        first = min(begin + onset - 1 + left_in, end) if left_in else begin + len(quiet)
        samples[first:end] = np.resize(quiet, (end - first, samples.shape[1]))
    return dataclasses.replace(recordings, samples=samples)


def quiet_enough(config: AcceleratorConfig, onsets: np.ndarray) -> np.ndarray:
    """(R) bool: an onset was found, and the lead-in before it is longer than the settling frames."""
    return onsets - _judged_frames(config) > config.rest_level.rest_frames


def _judged_frames(config: AcceleratorConfig) -> int:
    return config.onset_rule.onset_mean_frames if config.onset_rule.onset == "baseline" else 1


def leak_check(
    recordings: Recordings,
    config: AcceleratorConfig,
    splits: Sequence[Sequence[str]],
    seeds: Sequence[int],
    *,
    folds: int = 5,
    left_in: int = 0,
    recipe: recipes.Recipe | None = None,
    progress: crossval.Progress | None = None,
) -> list[Record]:
    """Accuracy of cross-validated integer networks on unseen recordings, as recorded and without their
    touches.

    Recordings without an onset or without a quiet lead-in (``quiet_enough``) are left out of all of it.

    Parameters
    ----------
    left_in:
        As for ``without_touches``.
    splits, seeds, folds, recipe, progress:
        As for ``eskin.training.crossval.cross_validate``.

    Returns
    -------
    A row for each split: groups, recordings, no_lead_in (recordings left out), accuracy (as recorded),
    without_touch (accuracy), by_seed (of without_touch), chance (share of the largest class), limit (chance +
    MARGIN), passed (without_touch within the limit).

    Raises
    ------
    InputError
        The gate opens at once, so that a recording has no lead-in; or no recording has one.
    """
    if config.opens_at_once:
        raise InputError(
            f"leak check: the gate of configuration '{config.name}', field onset, is open from the first "
            "frame, so no recording has a "
            "quiet lead-in to put in place of the touch; use recordings that begin before the touch"
        )
    onsets = find_onsets(config, recordings)
    quiet = np.flatnonzero(quiet_enough(config, onsets))
    if not len(quiet):
        raise InputError(
            f"{recordings.source}: no recording has a quiet lead-in before its onset; look with 'eskin "
            "inspect'"
        )
    whole, onsets = recordings.subset(quiet), onsets[quiet]
    work = crossval.Folds(whole, config, recipe or recipes.choose_recipe(config), splits, seeds, folds)
    models = work.fit(progress)
    integers = work.quantise(models, {})
    as_recorded = work.records(models, integers)
    work.judge_on(without_touches(whole, config, onsets, left_in), onsets)
    chance = float(whole.class_counts.max() / len(whole))
    rows = []
    for record, before in zip(work.records(models, integers), as_recorded, strict=True):
        rows.append(
            {
                "groups": record["groups"],
                "recordings": len(whole),
                "no_lead_in": len(recordings) - len(whole),
                "accuracy": before["integer_accuracy"],
                "without_touch": record["integer_accuracy"],
                "by_seed": record["integer_by_seed"],
                "chance": chance,
                "limit": chance + MARGIN,
                "passed": record["integer_accuracy"] <= chance + MARGIN,
            }
        )
    return rows
