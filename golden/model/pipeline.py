"""Recordings through a whole model: preprocessing, cell, decisions; the integer run keeps every stage for
co-simulation.

Decisions: docs/specification.md, section 7.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.model.model import FloatModel, IntegerModel
from eskin.golden.model.preprocess import Touches, find_touches, normalise, real_features
from eskin.golden.model.prototypes import class_distances, real_trajectory, trajectory_codes

STAGES = ("sum", "fault", "feature", "state", "logit", "decision")
"""Stages of a trace, in the order of the chain."""

DECISION_FIELDS = ("is_global", "step", "class", "margin", "partial", "unsure")
"""Columns of the rows of stage ``decision``."""

Stream = tuple[np.ndarray, np.ndarray]
"""(values, offsets): the values of stage s for recording i are ``values[offsets[i]:offsets[i+1]]``."""


class Decisions:
    """Decisions for recordings or images, (R); -1: none."""

    decision: np.ndarray

    def accuracy(self, labels: np.ndarray) -> float:
        """Share of decisions that equal the label; no decision counts as wrong."""
        return float(np.mean(self.decision == labels))

    def agreement(self, other: Decisions) -> float:
        """Share of recordings with the same decision in both; no decision in both counts as the same."""
        return float(np.mean(self.decision == other.decision))


@dataclass(frozen=True)
class Trace(Decisions):
    """All values that a model computes from a set of recordings; n touches of R recordings, K steps.

    touches: where they are, and their windowed sums. decision (R): global decision of the first touch, -1
    none. not_touched (R), bool: no onset was found. first (R): index of the first touch, -1 none. local (n,
    K): class decided at each step, -1 for a step that was not completed. margin (n, K): its margin.
    global_decision, global_margin (n): of each touch, -1 and 0 without a completed step. global_step (n): the
    step after which it was given, -1 none; global_partial (n), bool: it was given because the recording
    ended. unsure (n), bool: of each touch, as in `decide_touches`. scores (n, K, C): per-step class scores
    whose largest is the decision (logits, or negative prototype distances). streams (integer runs): stage ->
    (values int64, offsets (R + 1)): ``sum`` and ``feature`` flat, step by step, inputs in order, and with a
    fault detector ``fault``: 1 where the taxel is masked or its flag counts; ``state`` flat, h' step by step,
    units in order; ``logit`` flat, step by step, classes in order; ``decision`` rows (events, 6) of
    DECISION_FIELDS: a row per step, and after the row of global_step the global row (step = global_step).
    Touches of a recording in order of time.
    """

    config: AcceleratorConfig
    touches: Touches
    decision: np.ndarray
    not_touched: np.ndarray
    first: np.ndarray
    local: np.ndarray
    margin: np.ndarray
    global_decision: np.ndarray
    global_margin: np.ndarray
    global_step: np.ndarray
    unsure: np.ndarray
    features: np.ndarray = field(repr=False)
    hidden: np.ndarray = field(repr=False)
    logits: np.ndarray = field(repr=False)
    scores: np.ndarray = field(repr=False)
    streams: dict[str, Stream] = field(default_factory=dict, repr=False)

    @property
    def partial(self) -> np.ndarray:
        """(n), bool: the recording ended before the touch did."""
        return self.touches.partial

    @property
    def global_partial(self) -> np.ndarray:
        """(n), bool: the recording ended before the touch did, and before its global decision was given."""
        return self.partial & ~early_steps(self.config, self.local, self.margin, self.touches.completed)[1]

    def offered(self) -> np.ndarray:
        """(n, K + 1), bool: True for each decision that a touch has; the local ones and then the global
        one."""
        return np.concatenate(
            [self.touches.complete(self.local.shape[1]), self.touches.completed[:, None] > 0], axis=1
        )

    def decision_order(self) -> np.ndarray:
        """(n, K + 1) columns of ``offered`` in the order of time: the global decision follows the local one
        of global_step."""
        steps = np.broadcast_to(np.arange(self.local.shape[1]), self.local.shape)
        # + 0.5: after the local decision of its step and before the decision of the next step
        return np.argsort(
            np.concatenate([steps, self.global_step[:, None] + 0.5], axis=1), axis=1, kind="stable"
        )

    def first_local(self) -> np.ndarray:
        """(R, K) local decisions of each recording's first touch, -1 where there is none."""
        return by_recording(self.local, self.first)


def first_maximum(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(index of the largest value, lowest at a tie; largest minus second largest) along the last axis."""
    index = np.argmax(values, axis=-1)
    ordered = np.sort(values, axis=-1)
    return index, ordered[..., -1] - ordered[..., -2]


def decide(config: AcceleratorConfig, logits: np.ndarray, completed: np.ndarray):
    """Decisions of docs/specification.md section 7 from logits (n, K, C), of which ``completed`` (n) steps
    count.

    Returns
    -------
    (local (n, K), margin (n, K), global (n), global margin (n)):
        -1 and 0 where there is no decision.
    """
    steps, classes = logits.shape[-2:]
    local, margin = first_maximum(logits)
    complete = np.arange(steps) < completed[:, None]
    local, margin = np.where(complete, local, -1), np.where(complete, margin, 0)
    if config.network.decision == "vote":
        # -1 of a step that was not completed is not a class, so it has no vote
        votes = (local[..., None] == np.arange(classes)).sum(axis=1)
        decision, lead = first_maximum(votes)
    else:
        # a touch without a step, -1, looks up the last one and is overwritten below
        last = global_steps(config, local, margin, completed)
        rows = np.arange(len(logits))
        decision, lead = local[rows, last], margin[rows, last]
    return local, margin, np.where(completed > 0, decision, -1), np.where(completed > 0, lead, 0)


def early_steps(
    config: AcceleratorConfig, local: np.ndarray, margin: np.ndarray, completed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(first step (n) at which the last ``early_steps`` local decisions agree with enough margin, 0 if none;
    whether there is one (n)).

    Parameters
    ----------
    local, margin:
        (n, K); a margin is codes, or real where the logits are.
    """
    if config.network.decision != "early":
        return np.zeros(len(local), dtype=np.int64), np.zeros(len(local), dtype=bool)
    real = np.issubdtype(margin.dtype, np.floating)
    enough = margin >= (
        config.formats.logit_format.to_real(config.network.early_margin)
        if real
        else config.network.early_margin
    )
    enough &= np.arange(local.shape[1]) < completed[:, None]
    holds = np.zeros(local.shape, dtype=bool)
    for k in range(config.network.early_steps - 1, local.shape[1]):
        run = slice(k - config.network.early_steps + 1, k + 1)
        holds[:, k] = enough[:, run].all(axis=1) & (local[:, run] == local[:, k, None]).all(axis=1)
    return np.argmax(holds, axis=1), np.asarray(holds.any(axis=1))


def global_steps(
    config: AcceleratorConfig, local: np.ndarray, margin: np.ndarray, completed: np.ndarray
) -> np.ndarray:
    """(n) the step after which a touch's global decision is given, -1 none; parameters as for
    ``early_steps``."""
    step, early = early_steps(config, local, margin, completed)
    return np.where(early, step, completed - 1)


def feature_codes(model: IntegerModel, touches: Touches) -> np.ndarray:
    """Feature codes (n, K, D) of touches, 0 where a taxel is masked, by the host or by the fault detector."""
    constants = model.arrays["mean"], model.arrays["scale"]
    return normalise(
        model.config, touches.sums, touches.completed, *constants, touches.faults, touches.lengths
    )


def float_features(model: FloatModel, touches: Touches) -> np.ndarray:
    """Real features (n, K, D) of touches, 0 where a taxel is masked, by the host or by the fault detector."""
    features = model.features(real_features(model.config, touches.sums, touches.lengths))
    if touches.faults is not None:
        features[touches.faults] = 0.0
    return features


@dataclass(frozen=True)
class Decided:
    """All values that a network computes from n touches, K steps: features (n, K, D), hidden (n, K, H) and
    logits (n, K, C), codes, or real numbers of a float network; local and margin (n, K), decision, lead and
    step (n): class and margin of each step and of the touch (-1 and 0: none), and the step after which the
    touch's decision is given (-1: none); unsure (n), bool: the touch's margin is too small, or its nearest
    prototype too far; scores (n, K, C): per-step class scores whose largest is the decision (logits, or
    negative prototype distances)."""

    features: np.ndarray
    hidden: np.ndarray
    logits: np.ndarray
    local: np.ndarray
    margin: np.ndarray
    decision: np.ndarray
    lead: np.ndarray
    step: np.ndarray
    unsure: np.ndarray
    scores: np.ndarray


def decide_touches(
    model: IntegerModel | FloatModel,
    touches: Touches,
    *,
    config: AcceleratorConfig | None = None,
    readout: IntegerModel | None = None,
) -> Decided:
    """Decisions of a network on touches, masks included. All decisions from windowed sums are made here.

    Parameters
    ----------
    config:
        Configuration whose decision rule applies; None: the model's.
    readout:
        Model whose prototypes decide on the states of a float network; None: its logits decide.
    """
    config = config or model.config
    features = (
        feature_codes(model, touches) if isinstance(model, IntegerModel) else float_features(model, touches)
    )
    hidden, logits = model.forward(features)
    scores = logits
    if isinstance(model, IntegerModel) and config.has_prototypes:
        scores = -class_distances(model, trajectory_codes(config, hidden, logits))
    elif readout is not None and readout.config.has_prototypes:
        config = readout.config
        scores = -class_distances(readout, real_trajectory(config, hidden, logits))
    local, margin, decision, lead = decide(config, scores, touches.completed)
    step = global_steps(config, local, margin, touches.completed)
    unsure = lead < config.network.margin_threshold
    if scores is not logits and config.readout_rule.unknown_above:
        nearest = -scores.max(axis=-1)[np.arange(len(step)), step]
        unsure |= nearest > config.readout_rule.unknown_above * (step + 1)
    return Decided(features, hidden, logits, local, margin, decision, lead, step, unsure, scores)


def by_recording(values: np.ndarray, rows: np.ndarray, none: int = -1) -> np.ndarray:
    """``values`` (n, ...) of touches by recording: for recording r the value of row ``rows[r]``, or ``none``
    if that is -1."""
    placed = np.full((len(rows), *values.shape[1:]), none, dtype=np.int64)
    placed[rows >= 0] = values[rows[rows >= 0]]
    return placed


def run(
    model: IntegerModel | FloatModel,
    recordings: Recordings,
    *,
    touches: Touches | None = None,
    progress: Callable[[int, int], None] | None = None,
    readout: IntegerModel | None = None,
) -> Trace:
    """Run a model over recordings. An integer model runs in exact integers and keeps every stage; a float
    model runs in real arithmetic on the same exact sums, without streams.

    Parameters
    ----------
    touches:
        Result of ``find_touches(model.config, recordings)``, if it is known already.
    progress:
        Called with (recordings done, recordings in all).
    readout:
        For a float model: as `decide_touches`.

    Raises
    ------
    InputError
        When the recordings do not have the model's taxels.
    """
    config = model.config
    touches = find_touches(config, recordings, progress=progress) if touches is None else touches
    first, decided = touches.first_touch(), decide_touches(model, touches, readout=readout)
    trace = Trace(
        config,
        touches,
        by_recording(decided.decision, first),
        first < 0,
        first,
        decided.local,
        decided.margin,
        decided.decision,
        decided.lead,
        decided.step,
        decided.unsure,
        decided.features,
        decided.hidden,
        decided.logits,
        decided.scores,
    )
    if isinstance(model, IntegerModel):
        stages = (touches.sums, decided.features, decided.hidden, decided.logits)
        for stage, values in zip(("sum", "feature", "state", "logit"), stages, strict=True):
            trace.streams[stage] = _flat_stream(touches, values)
        trace.streams["fault"] = _fault_stream(config, touches)
        trace.streams["decision"] = _decision_stream(trace)
    return trace


def _flat_stream(touches: Touches, values: np.ndarray) -> Stream:
    """The completed steps of (n, K, width) values, flat, with offsets by recording."""
    steps, width = values.shape[1:]
    counts = np.bincount(
        touches.recording, weights=touches.completed * width, minlength=touches.recordings
    ).astype(np.int64)
    return values[touches.complete(steps)].reshape(-1).astype(np.int64), np.cumsum([0, *counts])


def _fault_stream(config: AcceleratorConfig, touches: Touches) -> Stream:
    """1 for each taxel of each window that is out of use, masked or failed; nothing without a fault
    detector."""
    if touches.faults is None:
        return np.zeros(0, dtype=np.int64), np.zeros(touches.recordings + 1, dtype=np.int64)
    out_of_use = touches.faults.copy()
    out_of_use[..., list(config.input_mask)] = True
    return _flat_stream(touches, out_of_use)


def _decision_stream(trace: Trace) -> Stream:
    """Rows of DECISION_FIELDS: the local rows of each touch, its global row after the row of global_step."""
    touches, (n, steps) = trace.touches, trace.local.shape
    rows = np.zeros((n, steps + 1, len(DECISION_FIELDS)), dtype=np.int64)
    # columns are DECISION_FIELDS; until they are ordered a touch's local rows come first, its global one last
    rows[:, :steps, 1] = np.arange(steps)
    rows[:, :steps, 2] = trace.local
    rows[:, :steps, 3] = trace.margin
    rows[:, steps, 0] = 1
    rows[:, steps, 1] = trace.global_step
    rows[:, steps, 2] = trace.global_decision
    rows[:, steps, 3] = trace.global_margin
    rows[:, steps, 4] = trace.global_partial
    rows[:, steps, 5] = trace.unsure
    order = trace.decision_order()
    offered = np.take_along_axis(trace.offered(), order, axis=1)
    rows = np.take_along_axis(rows, order[..., None], axis=1)
    counts = np.bincount(touches.recording, weights=offered.sum(axis=1), minlength=touches.recordings).astype(
        np.int64
    )
    return rows[offered], np.cumsum([0, *counts])
