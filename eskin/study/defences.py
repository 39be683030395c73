"""Defences against a failing sensor: the accuracy that they save, cross-validated; and the margin of a
confident decision.

The defences: the fault detector and M-of-K onset of docs/specification.md, training with failing taxels
(``robust``), a margin below which a decision is not confident. All is judged on recordings that a network has
not seen, through the whole integer front end.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, Record
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, Touches, decide_touches, find_touches
from eskin.golden.model.pipeline import by_recording
from eskin.golden.model.preprocess import activity
from eskin.study.stability.core import Scene
from eskin.study.stability.sensor import stuck
from eskin.study.stability.shapes import Experiment
from eskin.training.crossval import fold_jobs, train_folds
from eskin.training.datasets import Datasets
from eskin.training.recipe import Recipe, choose_recipe
from eskin.training.splits import split_folds

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
FAILURES = {
    "dead": Experiment(stuck("rest"), -10.0, (), "", over="taxels"),
    "stuck": Experiment(stuck("high"), 0.25, (), "", over="taxels"),
    "stuck, masked": Experiment(stuck("high"), 0.25, (), "", over="taxels", masked=True),
}
"""Failures of one taxel: at its rest level all along; at the highest code from a quarter of the touch on; the
same with its mask bit set."""


@dataclass(frozen=True)
class Variant:
    """A row of the comparison: its name, configuration, and recipe."""

    name: str
    config: AcceleratorConfig
    recipe: Recipe


def smallest_activity(recordings: Recordings, config: AcceleratorConfig, block: int) -> int:
    """Smallest activity (docs/specification.md, section 10) of a whole block after settling, any recording,
    any live taxel, codes."""
    live, least = config.sensor.live, []
    for index in range(len(recordings)):
        stream = recordings.recording(index).astype(np.int64)[:, live]
        first = -(-config.rest_level.rest_frames // block) * block
        blocks = (len(stream) - first) // block
        if blocks > 0:
            least.append(
                int(
                    activity(
                        config,
                        stream[first : first + blocks * block].reshape(blocks, block, -1).swapaxes(0, 1),
                    ).min()
                )
            )
    return min(least, default=0)


def recommended(recordings: Recordings, config: AcceleratorConfig) -> AcceleratorConfig:
    """``config`` with the recommended defences: the fault detector with its limit from the training
    recordings, a lower onset threshold that must be met ONSET_HITS times in ONSET_SPAN (where the rule is
    judged on a rest level), and ROBUST_HIDDEN units."""
    block = max(
        FAULT_FRAMES, config.onset_rule.onset_check_frames if config.onset_rule.onset == "baseline" else 2
    )
    activity = min(smallest_activity(recordings, config, block) // QUIET_SHARE, 65535)
    onset: dict[str, int] = {}
    if config.onset_rule.onset == "baseline":
        onset = {
            "onset_threshold": max(1, round(THRESHOLD_SHARE * config.onset_rule.onset_threshold)),
            "onset_hits": ONSET_HITS,
            "onset_span": ONSET_SPAN,
        }
    return config.replace(
        fault_frames=block, fault_activity=activity, hidden=max(config.network.hidden, ROBUST_HIDDEN), **onset
    )


def variants(recordings: Recordings, config: AcceleratorConfig) -> list[Variant]:
    """The rows: undefended; each defence on top of the one before; the recommended set."""
    plain = config.replace(fault_frames=0, fault_activity=0, onset_hits=1, onset_span=1, margin_threshold=0)
    full = recommended(recordings, plain)
    default, robust = choose_recipe(config), choose_recipe(config, "robust")
    detector = plain.replace(fault_frames=full.faults.fault_frames, fault_activity=full.faults.fault_activity)
    onset = " and onset" if full.onset_rule.onset_threshold != plain.onset_rule.onset_threshold else ""
    return [
        Variant(f"none, {config.network.hidden} units", plain, default),
        Variant("fault detector", detector, default),
        Variant("fault detector, training with failing taxels", detector, robust),
        Variant(
            f"the same{onset}, {config.network.hidden} units",
            full.replace(hidden=config.network.hidden),
            robust,
        ),
        Variant(f"recommended: the same{onset}, {full.network.hidden} units", full, robust),
    ]


# ---------------------------------------------------------------------- failing taxels
FrontEnd = dict[str, tuple[AcceleratorConfig, np.ndarray, Touches]]
"""Name of a disturbance -> (configuration, row of each recording's first touch or -1, touches). ``clean``,
and ``NAME, taxel T`` of ``FAILURES``."""


def front_end(recordings: Recordings, config: AcceleratorConfig) -> FrontEnd:
    """The touches of sound recordings, and of those in which one taxel fails, for every failure and live
    taxel."""
    scene = Scene(config=config, recordings=recordings)
    found = find_touches(config, scene.recordings)
    touches_of = {"clean": (config, found.first_touch(), found)}
    for name, failure in FAILURES.items():
        for case, played in failure.cases(scene).items():
            touches = find_touches(played.scene.config, played.recordings)
            touches_of[f"{name}, {case}"] = (played.scene.config, touches.first_touch(), touches)
    return touches_of


def _decisions(
    model: IntegerModel, config: AcceleratorConfig, rows: np.ndarray, touches: Touches
) -> tuple[np.ndarray, np.ndarray]:
    """(decision, margin) for each row of touches; -1 and 0 for a row of -1. ``config``: masks and decision
    rule."""
    if not (rows >= 0).any():
        return np.full(len(rows), -1, dtype=np.int64), np.zeros(len(rows), dtype=np.int64)
    own = dataclasses.replace(model, config=model.config.replace(masked_taxels=config.sensor.masked_taxels))
    decided = decide_touches(own, touches.take(rows[rows >= 0]))
    placed = np.where(rows >= 0, np.cumsum(rows >= 0) - 1, -1)
    return by_recording(decided.decision, placed), by_recording(decided.lead, placed, none=0)


# ---------------------------------------------------------------------- the comparison
def judge_defences(
    recordings: Recordings,
    variant: Variant,
    splits: Sequence[Sequence[str]],
    seeds: Sequence[int] = (0, 1, 2),
    *,
    folds: int = 5,
    front_ends: dict[str, FrontEnd] | None = None,
) -> Record:
    """Benefit of a set of defences, on recordings that a network has not seen, in integers, through the whole
    front end.

    Parameters
    ----------
    splits:
        Group names of each split; failing taxels are judged on the first one.
    seeds, folds:
        As for ``eskin.training.crossval.cross_validate``.
    front_ends:
        Kept between calls: touches by configuration.

    Returns
    -------
    name, hidden, recipe, fault_frames, fault_activity, clean ([{groups, accuracy, spread}] for each split), and
    for dead, stuck, ``stuck, masked``: {mean, worst, worst_taxel}; margin: the figures of ``margin_record`` for
    each split.
    """
    front_ends = {} if front_ends is None else front_ends
    key = variant.config.replace(hidden=4).to_json()  # the front end does not know the network
    if key not in front_ends:
        front_ends[key] = front_end(recordings, variant.config)
    found, config, labels = front_ends[key], variant.config, recordings.labels
    tests = [
        (number, test)
        for number, groups in enumerate(splits)
        for test in split_folds(recordings, groups, folds, None)
    ]
    pieces = fold_jobs(config, variant.recipe, len(recordings), [test for _, test in tests], seeds)
    trained = train_folds(Datasets(recordings), pieces, int(seeds[0]))
    networks = [*zip([number for number, _ in tests] * len(seeds), pieces, trained, strict=True)]

    def judged(key: str, number: int) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        """For each network of a split: its test recordings, their decisions and margins, and training margins."""
        changed, rows, touches = found[key]
        outcome = []
        for of, piece, network in networks:
            if of == number:
                decision, margin = _decisions(network.integer, changed, rows, touches)
                outcome.append((piece.test, decision[piece.test], margin[piece.test], margin[piece.train]))
        return outcome

    record: Record = {
        "name": variant.name,
        "hidden": config.network.hidden,
        "recipe": dataclasses.asdict(variant.recipe),
        "fault_frames": config.faults.fault_frames,
        "fault_activity": config.faults.fault_activity,
        "clean": [],
        "margin": [],
    }
    for number, groups in enumerate(splits):
        of_split = judged("clean", number)
        right = [decisions == labels[test] for test, decisions, *_ in of_split]
        accuracy, spread = float(np.mean(np.concatenate(right))), float(np.std([np.mean(r) for r in right]))
        record["clean"].append({"groups": list(groups), "accuracy": accuracy, "spread": spread})
        record["margin"].append(margin_record(list(groups), labels, of_split))
    for name in FAILURES:
        by_taxel = {}
        for taxel in config.sensor.live:
            right = [decided == labels[test] for test, decided, *_ in judged(f"{name}, taxel {taxel}", 0)]
            by_taxel[taxel] = float(np.mean(np.concatenate(right)))
        worst = min(by_taxel, key=by_taxel.__getitem__)
        mean = float(np.mean(list(by_taxel.values())))
        record[name] = {"mean": mean, "worst": by_taxel[worst], "worst_taxel": worst}
    return record


# ---------------------------------------------------------------------- the margin
def choose_margin(margins: np.ndarray, coverage: float = COVERAGE) -> int:
    """The largest threshold with which at least ``coverage`` of the margins are confident (>= threshold)."""
    ordered = np.sort(np.asarray(margins))[::-1]
    return int(ordered[max(int(np.ceil(coverage * len(ordered))) - 1, 0)])


def margin_record(groups: list[str], labels: np.ndarray, outcome: Any, coverage: float = COVERAGE) -> Record:
    """The threshold chosen on training margins, and its effect on unseen recordings.

    Returns
    -------
    groups, threshold (median over the networks), coverage and accuracy (share of unseen decisions that are
    confident, and right among them, each network with its own threshold), without (accuracy of all).
    """
    thresholds, confident, right_confident, right, count = [], 0, 0, 0, 0
    for test, decisions, touches, training in outcome:
        threshold = choose_margin(training, coverage)
        thresholds.append(threshold)
        good, sure = decisions == labels[test], (decisions >= 0) & (touches >= threshold)
        confident, right_confident = confident + int(sure.sum()), right_confident + int((good & sure).sum())
        right, count = right + int(good.sum()), count + len(test)
    return {
        "groups": groups,
        "threshold": int(np.median(thresholds)),
        "coverage": confident / count,
        "accuracy": right_confident / max(confident, 1),
        "without": right / count,
    }
