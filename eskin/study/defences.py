"""Defences against a failing sensor: the accuracy that they save, cross-validated; and the margin of a
confident decision.

The defences: the fault detector and M-of-K onset of docs/specification.md, training with failing taxels
(``robust``), a margin below which a decision is not confident. All is judged on recordings that a network has
not seen, through the whole integer front end.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, Record
from eskin.golden.data import Recordings
from eskin.golden.model import decide_touches, find_touches
from eskin.golden.model.pipeline import by_recording
from eskin.golden.model.preprocess import activity
from eskin.study.stability.core import Change, Experiment, Mode
from eskin.study.stability.disturbances import stuck
from eskin.study.stability.panel import Panel
from eskin.training.crossval import fold_jobs, train_folds
from eskin.training.datasets import Datasets
from eskin.training.recipe import Recipe
from eskin.training.splits import split_folds

FOLDS = 5
FAULT_FRAMES = 64
"""Block of the recommended fault detector, frames; raised to onset_check_frames where that is longer."""
QUIET_SHARE = 4
"""The recommended activity limit is the smallest block activity of a sound taxel in the training recordings
over this."""
ROBUST_HIDDEN = 16
"""Hidden units of the recommended defended network: what a missing taxel asks for on top of the default
12."""
COVERAGE = 0.95
"""Share of the training decisions that stay confident."""
THRESHOLD_SHARE = 2 / 3
"""The recommended onset threshold over the configured one: without the taxel that is pressed first the others
must find the touch."""
ONSET_HITS, ONSET_SPAN = 3, 4
"""With that lower threshold the rule must hold in 3 of 4 judged frames, or a noisy taxel opens the gate."""


def _failure(name: str, change: Change, since: float, masked: bool = False) -> Mode:
    shape = Experiment(change, since, (), "", over="taxels", masked=masked)
    return Mode("sensor", name, shape, "accuracy", "", at_least=0.0)


FAILURES = {
    "dead": _failure("dead", partial(stuck, end="rest"), -10.0),
    "stuck": _failure("stuck", stuck, 0.25),
    "stuck, masked": _failure("stuck, masked", stuck, 0.25, True),
}
"""Failures of one taxel: at its rest level all along; at the highest code from a quarter of the touch on; the
same with its mask bit set."""


def smallest_activity(recordings: Recordings, config: AcceleratorConfig, block: int) -> int:
    """Smallest activity (docs/specification.md, section 10) of a whole block after settling, any recording,
    any live taxel, codes."""
    live, least = config.sensor.live, []
    first = -(-config.rest_level.rest_frames // block) * block
    for index in range(len(recordings)):
        stream = recordings.recording(index)[first:, live]
        blocks = stream[: len(stream) // block * block].reshape(-1, block, len(live))
        if len(blocks):
            least.append(int(activity(config, blocks.swapaxes(0, 1)).min()))
    return min(least, default=0)


def recommended(recordings: Recordings, config: AcceleratorConfig) -> AcceleratorConfig:
    """``config`` with the recommended defences: the fault detector with its limit from the training
    recordings, a lower onset threshold that must be met ONSET_HITS times in ONSET_SPAN (where the rule is
    judged on a rest level), and ROBUST_HIDDEN units."""
    rule, onset = config.onset_rule, dict[str, int]()
    block = FAULT_FRAMES
    if rule.onset == "baseline":
        block = max(FAULT_FRAMES, rule.onset_check_frames)
        onset["onset_threshold"] = max(1, round(THRESHOLD_SHARE * rule.onset_threshold))
        onset |= {"onset_hits": ONSET_HITS, "onset_span": ONSET_SPAN}
    activity = min(smallest_activity(recordings, config, block) // QUIET_SHARE, 65535)
    return config.replace(
        fault_frames=block, fault_activity=activity, hidden=max(config.network.hidden, ROBUST_HIDDEN), **onset
    )


# ---------------------------------------------------------------------- the comparison
def judge_defences(
    shared: tuple[Recordings, Sequence[str], int], piece: tuple[str, AcceleratorConfig, Recipe]
) -> Record:
    """Benefit of a set of defences on recordings that a network has not seen, in integers, through the whole front
    end.

    Parameters
    ----------
    shared:
        Recordings, the groups that are left out in FOLDS folds, number of seeds.
    piece:
        Name of the set, the configuration with it, and the recipe.

    Returns
    -------
    name, hidden; accuracy of sound recordings; of each of FAILURES {mean,
    worst, worst_taxel}; margin: as of `margin_record`.
    """
    (recordings, groups, seeds), (name, config, recipe) = shared, piece
    tests = split_folds(recordings, groups, FOLDS, None)
    jobs = fold_jobs(config, recipe, len(recordings), tests, range(seeds))
    trained = train_folds(Datasets(recordings), jobs, 0)
    panel = Panel(recordings, dict.fromkeys(FAILURES, 1.0), len(recordings), 0, FAILURES)
    touches, labels = find_touches(config, recordings), recordings.labels
    first, outcome, right, wrong = touches.first_touch(), [], [], []
    for job, network in zip(jobs, trained, strict=True):
        found = decide_touches(network.integer, touches)
        decision, lead = by_recording(found.decision, first), by_recording(found.lead, first, none=0)
        outcome.append((job.train, job.test, decision, lead))
        right.append(decision[job.test] == labels[job.test])
        wrong.append(panel.wrong(config, network.integer, job.test))
    record: Record = {
        "name": name,
        "hidden": config.network.hidden,
        "accuracy": float(np.concatenate(right).mean()),
        "margin": margin_record(labels, outcome),
    }
    live = config.sensor.live
    shares = 1 - np.concatenate(wrong, axis=1).reshape(len(FAILURES), len(live), -1).mean(axis=2)
    for failure, by_taxel in zip(FAILURES, shares, strict=True):
        worst = int(np.argmin(by_taxel))
        figures = {"mean": float(by_taxel.mean()), "worst": float(by_taxel[worst])}
        record[failure] = figures | {"worst_taxel": f"taxel {live[worst]}"}
    return record


# ---------------------------------------------------------------------- the margin
def choose_margin(margins: np.ndarray, coverage: float = COVERAGE) -> int:
    """The largest threshold with which at least ``coverage`` of the margins are confident (>= threshold)."""
    ordered = np.sort(np.asarray(margins))[::-1]
    return int(ordered[max(int(np.ceil(coverage * len(ordered))) - 1, 0)])


def margin_record(labels: np.ndarray, outcome: Any, coverage: float = COVERAGE) -> Record:
    """The threshold chosen on training margins, and its effect on unseen recordings.

    outcome: of each network the recordings of its training and test, its decisions, and their margins.

    Returns
    -------
    threshold (median over the networks), coverage and accuracy (share of unseen decisions that are confident, and
    right among them, each network with its own threshold).
    """
    thresholds, right = [], []
    for train, test, decision, margin in outcome:
        thresholds.append(choose_margin(margin[train], coverage))
        sure = (decision[test] >= 0) & (margin[test] >= thresholds[-1])
        right.append(np.where(sure, decision[test] == labels[test], np.nan))
    told = np.concatenate(right)
    sure = ~np.isnan(told)
    return {
        "threshold": int(np.median(thresholds)),
        "coverage": float(sure.mean()),
        "accuracy": float(told[sure].mean()) if sure.any() else 0.0,
    }
