"""Sentences for a result that looks good and may not be: each says what was seen and the one action that
helps."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from eskin.choose.choice_table import left_out, unseen
from eskin.choose.yardsticks import neighbours_alike
from eskin.golden.data import Recordings

MOST_MISSED = 0.02
"""Share of recordings without an onset that goes without a word."""

SIZES = (4, 8, 12, 16, 24, 32)
"""Hidden units that are advised."""

LOST = 0.005
"""Accuracy that integers may lose without a word."""

LUCK = 0.05
"""Share of shuffled labellings that may do as well as the right one without a word."""


def percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def below_baselines(
    split: Mapping[str, Any],
    baselines: Sequence[Mapping[str, Any]],
    *,
    chosen: bool,
    cell: str = "gru",
    hidden: int = 0,
) -> list[str]:
    """A sentence where the best baseline of a split's groups is more than its standard error above the
    network.

    Parameters
    ----------
    split:
        A record of the cross-validation.
    chosen:
        The network was chosen among several sizes.
    cell, hidden:
        The network: the advice is the next larger one.
    """
    rivals = [row for row in baselines if list(row["groups"]) == list(split["groups"])]
    if not rivals:
        return []
    best = max(rivals, key=lambda row: row["accuracy"])
    short = best["accuracy"] - split["integer_accuracy"]
    if short <= best["standard_error"]:
        return []
    if best["name"].endswith("whole recordings"):
        fix = "look at onset and windows with 'eskin inspect', or give a front end of your own with --config"
    else:
        sizes = [size for size in SIZES if size > (hidden if cell != "linear" else 0)]
        larger = f"try --cell {'gru' if cell == 'linear' else cell} --hidden {sizes[0]}" if sizes else ""
        if best.get("hardware", True):
            fix = larger or "record more" if chosen else "try --cell auto"
        else:
            fix = f"no hardware for it here; {larger or 'no larger network is there'}"
    return [
        f"leaving out {left_out(split['groups'])}, the {best['name']} decides {percent(best['accuracy'])} "
        "rightly and the network "
        f"{percent(split['integer_accuracy'])}, {100 * short:.1f} points less: {fix}"
    ]


def by_choice(split: Mapping[str, Any]) -> list[str]:
    """Sentences where the choice of front end and network flatters its own folds, and where shuffled labels
    do as well as right ones."""
    nested, sentences = split["nested"], []
    flattered = split["integer_accuracy"] - nested["integer_accuracy"]
    if flattered > 2 * nested["standard_error"]:
        sentences.append(
            f"leaving out {left_out(split['groups'])}, the network taken decides "
            f"{percent(split['integer_accuracy'])} rightly on the folds "
            "it was chosen on, and one chosen without them, by a cheaper choice, "
            f"{percent(nested['integer_accuracy'])}: expect less than "
            "the first, or record more"
        )
    shuffled = nested["shuffled"]
    if shuffled and shuffled["as_good"] > LUCK:
        sentences.append(
            f"leaving out {left_out(split['groups'])}, shuffled labels are decided rightly up to "
            f"{percent(shuffled['largest'])} "
            f"({percent(shuffled['mean'])} on average), the right ones {percent(shuffled['right'])}: that "
            "may be luck, so record more"
        )
    return sentences


def lost_in_integers(splits: Sequence[dict[str, Any]], evaluated: Mapping[str, Any]) -> list[str]:
    """Sentences where integers decide LOST worse than floats, with the stage that loses most and its fix.

    Parameters
    ----------
    splits:
        Records of the cross-validation.
    evaluated:
        Of `eskin.training.evaluate.evaluate`: the network that was exported.
    """
    stage = evaluated["logit_error"].get("stage")
    fixes = {"features": "--feature-bits 16", "accumulators": "--weight-bits 10", "gates": "--gate-bits 14"}
    fix = fixes.get(stage, "--state-bits 16")
    return [
        f"leaving out {left_out(split['groups'])}, the integer network decides "
        f"{percent(split['integer_accuracy'])} rightly and the float one {percent(split['float_accuracy'])}: most is "
        f"lost in the {stage}; try 'eskin quantise MODEL {fix}'"
        for split in map(unseen, map(dict, splits))
        if split["float_accuracy"] - split["integer_accuracy"] > LOST and stage
    ]


def missed_onsets(touched: int, count: int) -> list[str]:
    """A sentence where more than MOST_MISSED of the recordings show no onset."""
    if count - touched <= MOST_MISSED * count:
        return []
    return [
        f"{count - touched} of {count} recordings show no touch, and count as wrong: look at them with "
        "'eskin inspect'"
    ]


def lost_classes(split: Mapping[str, Any], class_names: Sequence[str]) -> list[str]:
    """A sentence where classes are found no more often than by guessing."""
    table = np.array(split["confusion"], dtype=float)
    shares = np.diag(table) / np.maximum(table.sum(axis=1), 1)
    lost = [
        name
        for name, share, row in zip(class_names, shares, table, strict=True)
        if row.sum() and share <= 1 / len(class_names)
    ]
    if not lost:
        return []
    worst = list(class_names).index(lost[0])
    decided_as = (*class_names, "nothing")[
        int(np.argmax(np.where(np.arange(table.shape[1]) == worst, -1, table[worst])))
    ]
    return [
        f"leaving out {left_out(split['groups'])}, {', '.join(lost)} {'is' if len(lost) == 1 else 'are'} "
        "found no more often than by "
        f"guessing ({lost[0]} is mostly taken for {decided_as}): record more of "
        f"{'it' if len(lost) == 1 else 'them'}, or join the classes"
    ]


def look_alike(recordings: Recordings, groups: Sequence[str], folds: int) -> list[str]:
    """A sentence where no group is left out and neighbours in the archive help each other to be decided."""
    if groups or folds < 2 or np.bincount(recordings.labels).min() < folds:
        return []
    single, blocked, error = neighbours_alike(recordings, folds)
    if single - blocked <= max(2 * error, 0.01):
        return []
    fix = (
        f"--group {next(iter(recordings.groups))}"
        if recordings.groups
        else "an array in the archive that names the session of each"
    )
    return [
        f"no group was given and neighbouring recordings look alike ({percent(single)} of whole recordings "
        "are decided rightly when their "
        f"neighbours are known, {percent(blocked)} when not), so the accuracy may be that of known "
        f"sessions: give {fix}"
    ]
