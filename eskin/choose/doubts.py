"""Doubts about a result that may be worse than it looks: each gives its reason and the one action that helps.

The ``code`` of a doubt is the name of the function below that gives it, or ``wrong_rate``.
"""

import math
import shlex
from collections.abc import Sequence

import numpy as np

from eskin.choose.choice_table import left_out, percent
from eskin.choose.yardsticks import neighbours_alike
from eskin.data.folds import likely_groups
from eskin.golden.core import AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.training.evaluate import Evaluation, HeldBack
from eskin.training.level import is_level
from eskin.training.record import Baseline, Doubt, Judged, Nested, NetworkRow, Split

MOST_MISSED = 0.02
"""Largest share of recordings without an onset that raises no doubt."""

SIZES = (4, 8, 12, 16, 24, 32)
"""Numbers of hidden units that an advice may name."""

LEVEL_TELLS = 0.6
"""Largest share of the way from chance to 1 that a classifier of the first frames alone may reach without a
doubt."""

LOST = 0.005
"""Largest loss of accuracy by the integers that raises no doubt."""


SHORTER, CLIMBS, ENOUGH = 0.75, 2.0, 0.95
"""Limits of `still_climbing`: share of the longest windows; standard errors by which front ends within that
share must be behind the best; accuracy from which on there is no doubt."""


SESSIONS = (
    "record every class in several sessions, name these in an array of the archive and give it with `group`"
)


def doubt(code: str, text: str, split: Judged | None = None) -> Doubt:
    """A doubt; with ``split``, it is about this split, and its sentence begins with the groups left out."""
    if split is None:
        return Doubt(code=code, text=text)
    text = f"with {left_out(split.groups)} left out, {text}"
    return Doubt(code=code, text=text, groups=split.groups)


def below_baselines(
    split: Split, baselines: Sequence[Baseline], candidates: Sequence[NetworkRow] | None
) -> list[Doubt]:
    """A doubt if the best baseline of a split is better than the network: by more than one standard error if
    hardware could implement it, otherwise by more than two. A baseline on whole recordings is compared with
    the networks that were chosen without each fold.

    Parameters
    ----------
    split:
        A record of the cross-validation.
    candidates:
        The candidates for the network; None: it was not chosen. The advice does not contradict their results.
    """
    rivals = [row for row in baselines if row.groups == split.groups]
    if not rivals:
        return []

    def accuracy(row: Baseline) -> float:
        # a baseline on whole recordings chose nothing on these folds; one on the network's features uses the
        # chosen front end
        return (split.unseen if row.whole else split).integer_accuracy

    best = max(rivals, key=lambda row: row.accuracy - accuracy(row))
    short = best.accuracy - accuracy(best)
    if short <= best.standard_error * (1 if best.hardware else 2):
        return []
    larger = _larger(candidates or [])
    fix = "try `cell` auto" if candidates is None else larger or "no other candidate is better"
    if not best.hardware:
        lacks = "kinds of feature for all of its statistics" if best.whole else "hardware for it"
        fix = f"eskin has no {lacks}; {fix}"
    text = (
        f"the {best.name} classifies {percent(best.accuracy)} correctly and the network "
        f"{percent(accuracy(best))}, {100 * short:.1f} points less: {fix}"
    )
    return [doubt("below_baselines", text, split)]


def _larger(candidates: Sequence[NetworkRow]) -> str:
    """Advice to take more units, if the largest network that was judged was the best."""
    if not candidates:
        return ""
    best = max(candidates, key=lambda row: row.accuracy)
    larger = [size for size in SIZES if size > best.hidden]
    if not best.hidden or not larger or best.hidden < max(row.hidden for row in candidates):
        return ""
    return f"try `cell` {best.cell} `hidden` {larger[0]}"


def by_choice(split: Split, nested: Nested) -> list[Doubt]:
    """A doubt if the accuracy on the folds that chose front end and network is higher than that of nested
    cross-validation."""
    # both leave out the same groups, so the error of their difference is one over recordings
    accuracy, count = nested.integer_accuracy, sum(fold.recordings for fold in nested.per_fold)
    if split.integer_accuracy - accuracy <= 2 * math.sqrt(accuracy * (1 - accuracy) / count):
        return []
    text = (
        f"the chosen network classifies {percent(split.integer_accuracy)} correctly on the folds that chose "
        f"it, and nested cross-validation gives {percent(accuracy)}: quote the second figure for "
        f"a new {' and '.join(split.groups) or 'recording'}, or record more of them"
    )
    return [doubt("by_choice", text, split)]


def below_range(tested: Evaluation, split: Split) -> list[Doubt]:
    """A doubt if recordings held back (``test`` of run.json) are classified worse than anything that was left out, by
    more than two standard errors over recordings. The error counts one correct and one wrong decision more, so that it
    is never 0."""
    (low, high), count = split.unseen.range, tested.recordings
    share = (tested.integer_accuracy * count + 1) / (count + 2)
    if low - tested.integer_accuracy <= 2 * math.sqrt(share * (1 - share) / count):
        return []
    text = (
        f"the network classifies {percent(tested.integer_accuracy)} of the recordings held back correctly, and cross-"
        f"validation promises {percent(low)} to {percent(high)}: expect the lower figure where recordings differ from those "
        "of `data` as these do (a new session, person or day), and record more of such"
    )
    return [doubt("below_range", text, split)]


def seen_in_training(tested: HeldBack, things: str) -> list[Doubt]:
    """A doubt if recordings, or images, held back are also in the training data."""
    seen, count = tested.seen_in_training, tested.recordings
    text = (
        f"{seen} of the {count} {things} held back ({percent(seen / count)}) are also in the training data and say nothing "
        f"about new ones: give `test` {things} that are not in `data`"
    )
    return [doubt("seen_in_training", text)] if seen else []


def no_unseen_figure(split: Split, why: str) -> Doubt:
    """The doubt that the choice could not be repeated inside the folds of a split."""
    return doubt("no_unseen_figure", f"there is no nested cross-validation: {why}", split)


def lost_in_integers(splits: Sequence[Split], evaluated: Evaluation) -> list[Doubt]:
    """Doubts if the accuracy of the integers is LOST below that of the floats, with the stage that loses most
    and its fix.

    Parameters
    ----------
    splits:
        Records of the cross-validation.
    evaluated:
        Of the network that was exported.
    """
    stage = evaluated.logit_error.stage
    fixes = {
        "features": "`formats` feature_bits=16",
        "accumulators": "`weight_bits` 10",
        "gates": "`formats` gate_bits=14",
    }
    fix = fixes.get(stage or "", "`state_bits` 16")
    alike = evaluated.agreement >= 1 - LOST  # then wider formats do not help
    found = []
    for split in splits:
        judged = split.unseen
        lost, own = (row.float_accuracy - row.integer_accuracy for row in (judged, split))
        if lost > LOST and stage and not (alike and own <= LOST):
            text = (
                f"the integer network classifies {percent(judged.integer_accuracy)} correctly, the float one "
                f"{percent(judged.float_accuracy)}, and the {stage} lose most of it: try 'eskin quantise MODEL {fix}'"
            )
            found.append(doubt("lost_in_integers", text, judged))
    return found


def leaks(recordings: int, accuracy: float, limit: float, frames: int = 0) -> list[Doubt]:
    """A doubt if a network recognises the class although the touch was removed, or although only the first
    ``frames`` are left: ``accuracy`` above ``limit``."""
    if accuracy <= limit:
        return []
    why = (
        "after their touch was removed: the rest level, the time of the onset or the length reveals the class; record "
        "the classes in mixed order under the same conditions"
    )
    if frames:
        why = (
            f"from their first {frames} frames, repeated: if each class has its own session, the network recognises "
            f"the session and not the touch; {SESSIONS}"
        )
    text = f"the network classifies {percent(accuracy)} of {recordings} recordings correctly {why}"
    return [doubt("leaks", text)]


def level_tells(frames: int, share: float, without: float | None, groups: Sequence[str]) -> list[Doubt]:
    """The doubt that the level of the first ``frames`` reveals the class in a ``share`` of the recordings.

    Parameters
    ----------
    without:
        Accuracy of the best front end that subtracts the level; None: none was judged.
    groups:
        What was left out.
    """
    group, fix = " and ".join(groups), SESSIONS
    text = f"the level of the first {frames} frames alone reveals the class of {percent(share)} of the recordings"
    if groups:
        text = f"with {group} left out, {text}"
        fix = f"record every class at every {group}; if you did, the level is part of the touch"
    if without is not None:
        text += f" (a front end that removes this level classifies {percent(without)} correctly)"
    text += f": if each class has its own session, this is the session and not the touch; {fix}"
    return [doubt("level_tells", text)]


def still_climbing(screened: Sequence[tuple[AcceleratorConfig, np.ndarray]]) -> list[Doubt]:
    """A doubt if only the longest of the front ends ``screened`` (configuration, correct; best first) tie
    with the best, and the accuracy of the best is below ENOUGH: longer touches might give a higher accuracy.

    Front ends that end within SHORTER of the longest one have to be more than CLIMBS standard errors behind
    the best. Front ends that scan less often are left out: their rest level takes longer to settle, so their
    touches may begin later; so are windows that divide the touch, which end where it does.
    """
    best, correct = screened[0]
    if best.follows_touch:
        return []
    screened = [
        row
        for row in screened
        if row[0].sensor.scan_every <= best.sensor.scan_every and not row[0].follows_touch
    ]
    longest = max(config.touch_s for config, _ in screened)
    brief = [(config, row) for config, row in screened if config.touch_s <= SHORTER * longest]
    if best.touch_s <= SHORTER * longest or not brief or correct.mean() >= ENOUGH:
        return []
    shorter, most = max(brief, key=lambda pair: pair[1].mean())
    if is_level(correct, most, CLIMBS):
        return []
    long_s, short_s = (config.touch_s for config in (best, shorter))
    text = (
        "accuracy still rises at the end of the recordings (the linear classifier that judges front ends has "
        f"{percent(most.mean())} with windows of {short_s:.3g} s in all and {percent(correct.mean())} with {long_s:.3g} s): "
        "record longer touches"
    )
    return [doubt("still_climbing", text)]


def missed_onsets(touched: int, count: int) -> list[Doubt]:
    """A doubt if no onset is found in more than MOST_MISSED of the recordings."""
    if count - touched <= MOST_MISSED * count:
        return []
    text = (
        f"no touch was found in {count - touched} of {count} recordings, which count as wrong: give a smaller "
        "onset_threshold in `config`, or record stronger touches"
    )
    return [doubt("missed_onsets", text)]


def lost_classes(split: Split, class_names: Sequence[str]) -> list[Doubt]:
    """A doubt if classes are recognised no more often than by guessing. Where the networks of a fold had less than a
    third of the recordings, more of a class would not help."""
    table = np.array(split.confusion, dtype=float)
    shares = np.diag(table) / np.maximum(table.sum(axis=1), 1)
    lost = [
        name
        for name, share, row in zip(class_names, shares, table, strict=True)
        if row.sum() and share <= 1 / len(class_names)
    ]
    if not lost:
        return []
    worst = class_names.index(lost[0])
    table[worst, worst] = -1
    decided_as = (*class_names, "nothing")[table[worst].argmax()]
    tested = [fold.recordings for fold in split.per_fold]
    fix = f"record more of {'it' if len(lost) == 1 else 'them'}, or merge the classes"
    if 3 * max(tested) > 2 * sum(tested):
        fix = (
            f"a fold left out {max(tested)} of {sum(tested)} recordings and was trained on the rest: record more with other "
            f"values of {' and '.join(split.groups)}, or choose another `group`"
        )
    text = (
        f"{', '.join(lost)} {'is' if len(lost) == 1 else 'are'} recognised no more often than by chance ({lost[0]} "
        f"is mostly classified as {decided_as}): {fix}"
    )
    return [doubt("lost_classes", text, split)]


def look_alike(recordings: Recordings, groups: Sequence[str], folds: int) -> list[Doubt]:
    """A doubt if no group is left out and recordings are classified better with their neighbours in the
    archive in training."""
    if groups or folds < 2 or np.bincount(recordings.labels).min() < folds:
        return []
    single, blocked, error = neighbours_alike(recordings, folds)
    if single - blocked <= max(2 * error, 0.01):
        return []
    known = likely_groups(recordings)
    fix = (
        f"`group` {shlex.quote(known[0])}"
        if known
        else "an array in the archive that names the session of each"
    )
    text = (
        f"no group was given and neighbouring recordings look alike (with their neighbours in training, "
        f"{percent(single)} are classified correctly; without, {percent(blocked)}), so the accuracy may hold for known "
        f"sessions only: give {fix}"
    )
    return [doubt("look_alike", text)]
