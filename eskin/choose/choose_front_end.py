"""The front end chosen by evidence: what ``train`` and ``run`` do without ``--config``.

A *front end* is everything between the samples and the network: rest level, gate, windows, kinds of feature
and their scale. Candidates come from the recordings (``eskin.training.derive`` measures noise, signal
and lengths) and from the presets of the same sensor. Each is judged by a linear classifier on the features
that the INTEGER front end gives (``eskin.golden.model.preprocess``, normaliser included), on recordings that
the classifier has not seen:

- *classifier*: kernel ridge regression of the classes' indicators on all windows of a touch at once. The
  penalty of a fold is the one of PENALTIES that does best on the OTHER folds. The normaliser's mean and scale
  come from all recordings looked at; they know no label.
- *missed touches*: a recording without an onset, or without a completed window, counts as wrong.
- *folds*: groups stay together, as ``choose_split`` says.

The search goes by coordinates: every gate with two sets of windows on means, those that are not far behind
with all sets; kinds of feature and scales on the best SURVIVORS; then windows and thresholds again around the
best; then, from the cheapest that is level, fewer kinds and fewer and shorter windows as long as they are
level too. All are judged on the same recordings.

**The choice.** Level with the best are all candidates whose shortfall is at most TIE standard errors of the
paired difference over recordings, and of these the cheapest is taken (`eskin.choose.cost.Market`, with a
linear cell behind it). A network may need more than that classifier saw, or less: the best one and the
cheapest of fewer kinds stand on the shortlist, on which networks are tried too. These accuracies belong to a
selection among many, so they rank front ends and are no figure of unseen recordings;
``eskin.choose.nested`` gives one, from a `Field` of candidates that no label picked.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.linalg import solve

from eskin.choose.choice_table import front_end_words, left_out
from eskin.choose.cost import Market
from eskin.golden.core import PRESETS, AcceleratorConfig, InputError, QFormat, Record
from eskin.golden.core.groups import Features
from eskin.golden.data import Recordings, check_fit, no_group
from eskin.golden.model import first_touches, normalise, normaliser_constants, real_features, with_network
from eskin.golden.model.preprocess import FirstTouches, cut_windows
from eskin.training.datasets import scaling
from eskin.training.derive import (
    CONVERTERS,
    STEPS,
    derive_config,
    fits_sensor,
    for_recordings,
    measure_onset,
    sensor_sizes,
    settling_frames,
)
from eskin.training.fit import one_thread
from eskin.training.splits import split_folds

TIE = 1.0
"""Standard errors of the paired difference up to which two candidates are level."""

DESCENT = 12
"""Cheaper neighbours that are judged at most."""

SURVIVORS = 3
"""Pairs of gate and windows on which kinds of feature and scales are tried."""

FAR_BEHIND = 3.0
"""Standard errors behind the best from which a gate is not tried with further windows."""

PENALTIES = (1e-1, 1e-2, 1e-3, 1e-4)
"""Ridge penalties, as shares of the mean squared length of a touch's feature vector."""

JUDGED_ON, JUDGED_SAMPLES = 800, 1 << 25
"""Recordings judged on at most, and samples (frames x taxels) they hold at most: what fits into a minute on
two cores."""

MEASURED_ON = 64
"""Recordings from which noise, signal and clip are measured."""

LEVEL_TELLS = 0.6
"""Share of the way from chance to 1. When the level of the first frames alone gets that far, a warning says
so."""

RIVALS, HOPELESS = 2, 0.25
"""Rivals that a recurrent network is tried on, and how far they may be behind the chosen one."""

TRIED_RECURRENT = 4
"""Front ends that a recurrent network is tried on."""

Progress = Callable[[str, int, int], None]
"""Called with (what, candidates judged, about how many in all)."""


# ---------------------------------------------------------------------- what is asked for
@dataclass(frozen=True)
class Plan:
    """What a main job and a training plan first and hand on: the front end that was chosen or asked for, and
    the split to choose by.

    reasons: in words. record: of the choice (None: asked for). rivals: of other gates, that a recurrent
    network may do better on (``rivals_of``). shortlist: those that networks are tried on, the cheapest
    first, ``config`` among them (``shortlist_of``). split, split_from: of ``choose_split``. field: candidates
    to choose from inside folds; None unless asked for. market: what candidates cost.
    """

    config: AcceleratorConfig
    reasons: list[str]
    split: list[str]
    split_from: str
    market: Market
    record: Record | None = None
    rivals: tuple[AcceleratorConfig, ...] = ()
    shortlist: tuple[AcceleratorConfig, ...] = ()
    field: Field | None = None

    def with_chosen(self, config: AcceleratorConfig) -> Plan:
        """The same with the rival ``config`` in place of the chosen one, in the record too."""
        if config == self.config or self.record is None:
            return self
        sought = row_of(config)
        chosen = next(row for row in self.record["rivals"] if sought.items() <= row.items())
        rows = [self.record["chosen"], *(row for row in self.record["rivals"] if row is not chosen)]
        rivals = sorted(rows, key=lambda row: -row["accuracy"])
        return dataclasses.replace(
            self, config=config, record=self.record | {"chosen": chosen, "rivals": rivals}
        )


def configure(
    recordings: Recordings,
    requested: AcceleratorConfig | None,
    market: Market,
    *,
    groups: Sequence[str] | None = None,
    folds: int = 5,
    nested: bool = False,
    progress: Progress | None = None,
) -> Plan:
    """The configuration that was asked for, checked against the recordings, or without one the chosen one;
    and the reasons.

    nested: with a field, to choose from inside folds.

    A preset describes a sensor, so it takes over the recordings' class names; a configuration of one's own
    must have them.

    Raises
    ------
    InputError
        As ``check_fit`` and ``choose_front_end``.
    """
    if recordings.image_shape:
        derive_config(recordings)  # which refuses images
    if requested is None:
        return choose_front_end(
            recordings, market, groups=groups, folds=folds, nested=nested, progress=progress
        )
    reasons = [f"'{requested.name}', as asked for"]
    if requested == PRESETS.get(requested.name) and requested.network.class_names != recordings.class_names:
        try:
            requested = requested.replace(class_names=recordings.class_names)
        except InputError as error:
            raise InputError(f"recordings '{recordings.source}', array class_names: {error}") from None
        reasons.append(f"its classes are those of the recordings: {', '.join(recordings.class_names)}")
    check_fit(recordings, requested)
    split, split_from = choose_split(recordings, groups)
    field = None
    if nested:
        looked_at = recordings.evenly(_how_many(recordings))
        field = Field.empty(recordings, looked_at)
        field.add(Judge(recordings.subset(looked_at), []), looked_at, [requested])
    return Plan(requested, reasons, split, split_from, market, shortlist=(requested,), field=field)


def choose_split(recordings: Recordings, groups: Sequence[str] | None) -> tuple[list[str], str]:
    """The groups that stay together while front end and network are chosen, and where they come from, in
    words.

    Those asked for; else the archive's first group array of which every class has two values at least
    (``no_group``: what is none); else none: single recordings.
    """
    if groups is not None:
        return list(groups), "as asked for"
    for name, values in recordings.groups.items():
        seen_twice = all(
            len(np.unique(values[recordings.labels == label])) >= 2 for label in np.unique(recordings.labels)
        )
        if seen_twice and not no_group(values, recordings.labels):
            return [name], "the archive's first group"
    return [], "the archive has no group that can be left out, so single recordings are"


# ---------------------------------------------------------------------- judging
def gram_of(x: np.ndarray) -> np.ndarray:
    """(n, n): products of the rows of ``x`` (n, features) with a constant 3 appended, the bias."""
    # 3 and not 1: its weight is smaller for that, so the penalty hardly touches the bias
    return x @ x.T + 9.0


def ridge_weights(gram: np.ndarray, penalty: float, targets: np.ndarray) -> np.ndarray:
    """(n, targets): weights of the rows in a kernel ridge regression."""
    return solve(gram + penalty * np.eye(len(gram)), targets, assume_a="pos", check_finite=False)


def ridge_decisions(
    gram: np.ndarray, labels: np.ndarray, folds: Sequence[np.ndarray], classes: int
) -> np.ndarray:
    """The class that ridge regression gives each row when the fold it lies in is left out, as the module
    describes it.

    Parameters
    ----------
    gram:
        (n, n), of ``gram_of``.
    labels:
        (labellings, n) 0..classes-1; each is decided by itself.
    folds:
        Rows of each fold; every row lies in one.

    Returns
    -------
    (labellings, n).
    """
    count, n = labels.shape
    targets = (labels.T[..., None] == np.arange(classes)).reshape(n, -1).astype(float)
    unit = float(np.trace(gram)) / n
    decided = np.zeros((len(PENALTIES), count, n), dtype=np.int64)
    for fold in folds:
        train = np.setdiff1d(np.arange(n), fold)
        train_gram, test_gram = gram[np.ix_(train, train)], gram[np.ix_(fold, train)]
        for row, penalty in enumerate(PENALTIES if len(train) else ()):
            values = test_gram @ ridge_weights(train_gram, penalty * unit, targets[train])
            decided[row][:, fold] = values.reshape(len(fold), count, classes).argmax(axis=-1).T
    right = decided == labels
    chosen = np.empty_like(labels)
    for fold in folds:
        # the penalty of a fold by the other folds alone: its own rows must not choose it
        best = (right.sum(axis=-1) - right[..., fold].sum(axis=-1)).argmax(axis=0)
        chosen[:, fold] = decided[best, np.arange(count)][:, fold]
    return chosen


def blocked_ridge(x: np.ndarray, labels: np.ndarray, folds: Sequence[np.ndarray], classes: int) -> np.ndarray:
    """``ridge_decisions`` (n) of rows of features (n, features) and one labelling (n)."""
    return ridge_decisions(gram_of(x), labels[None], folds, classes)[0]


def rightly_decided(
    rows: np.ndarray,
    labels: np.ndarray,
    folds: Sequence[np.ndarray],
    decide: Callable[[np.ndarray, list[np.ndarray]], np.ndarray],
) -> np.ndarray:
    """(labellings, n), bool: which of n recordings ``decide(labels of the rows, folds of the rows)`` gives
    their label.

    rows (ascending) have a touch; the others count as wrong. folds: of the n recordings.
    """
    place = np.full(labels.shape[1], -1)
    place[rows] = np.arange(len(rows))
    correct = np.zeros(labels.shape, dtype=bool)
    if len(rows) >= 2:
        parts = [part for part in (place[fold][place[fold] >= 0] for fold in folds) if len(part)]
        correct[:, rows] = decide(labels[:, rows], parts) == labels[:, rows]
    return correct


def integer_features(config: AcceleratorConfig, touches) -> np.ndarray:
    """Features (n, K x inputs), real values of the integer front end's codes: the normaliser's constants come
    from these touches.

    As quantisation does, it takes fraction bits off the feature format where the normaliser's scale would not
    fit 16 bits.
    """
    means = real_features(config, touches.sums)
    mu, sigma = scaling(config, means, touches.completed)
    while True:
        try:
            filled, mean, scale = normaliser_constants(config, mu, sigma)
            break
        except InputError:
            fmt = config.formats.feature_format
            if fmt.frac_bits < 2:
                raise
            # logits and biases of a linear cell are no finer than features times weights; features do not
            # depend on them
            logit, bias = config.formats.logit_format, config.formats.dense_bias_format
            config = config.replace(
                feature_format=QFormat(fmt.int_bits, fmt.frac_bits - 1),
                logit_format=QFormat(logit.int_bits + 1, logit.frac_bits - 1),
                dense_bias_format=QFormat(bias.int_bits + 1, bias.frac_bits - 1),
            )
    codes = normalise(filled, touches.sums, touches.completed, mean, scale)
    return filled.formats.feature_format.to_real(codes).reshape(len(codes), -1)


KEPT_BYTES = 3 << 28
"""Touches of gates that are kept for other windows on them."""


@dataclass(frozen=True, eq=False)
class Judged:
    """A candidate and whether each recording looked at was decided rightly; missed: recordings without a
    touch or a completed window."""

    config: AcceleratorConfig
    correct: np.ndarray
    missed: int

    @property
    def accuracy(self) -> float:
        """Share of recordings decided rightly."""
        return float(self.correct.mean())

    @property
    def standard_error(self) -> float:
        """Of the accuracy, over recordings."""
        return float(self.correct.std(ddof=1) / np.sqrt(len(self.correct)))


class Judgement(Protocol):
    """Whether each recording was decided rightly, or how often."""

    @property
    def correct(self) -> np.ndarray: ...


def behind(best: Judgement, rival: Judgement) -> tuple[float, float]:
    """(shortfall of ``rival``, standard error of the paired difference over recordings)."""
    difference = best.correct.astype(float) - rival.correct
    return float(difference.mean()), float(difference.std(ddof=1) / np.sqrt(len(difference)))


def is_level(best: Judgement, rival: Judgement) -> bool:
    """The shortfall is none, or at most TIE standard errors of the paired difference."""
    shortfall, error = behind(best, rival)
    return shortfall <= TIE * error * (1 + 1e-9)  # one recording lost, none won: exactly one


def most_accurate(candidates: Sequence[Any]) -> Any:
    """The first of those with the highest accuracy."""
    return max(candidates, key=lambda candidate: candidate.accuracy)


def with_linear(config: AcceleratorConfig) -> AcceleratorConfig:
    """The front end with the network that it is priced with: a linear cell, or its own where that has no room
    for the weights."""
    try:
        return with_network(config, cell="linear")
    except InputError:
        return config


def cheapest(
    judged: Sequence[Any],
    market: Market,
    priced: Callable[[AcceleratorConfig], AcceleratorConfig] = with_linear,
) -> Any:
    """The cheapest of those that are level with the best, ``priced`` as a whole design; of one configuration
    the first that is level with its most accurate."""
    best = most_accurate(judged)
    level = [candidate for candidate in judged if is_level(best, candidate)]
    cheap = market.cheapest(level, lambda candidate: priced(candidate.config))
    alike = [candidate for candidate in level if candidate.config == cheap.config]
    return next(candidate for candidate in alike if is_level(most_accurate(alike), candidate))


def price_of(config: AcceleratorConfig, market: Market) -> tuple[float, ...]:
    """What front ends are ordered by: their price with a linear cell."""
    return market.price(with_linear(config))


def shortlist_of(judged: Sequence[Judged], chosen: Judged, market: Market) -> tuple[AcceleratorConfig, ...]:
    """Front ends to try networks on, the cheapest first: the chosen one; the best, of as many the cheapest;
    and of each smaller number of kinds the cheapest that is level with the best of that number, unless it is
    HOPELESS."""
    best = most_accurate(judged)
    top = [candidate for candidate in judged if candidate.accuracy == best.accuracy]
    listed = [chosen, min(top, key=lambda candidate: price_of(candidate.config, market))]
    for kinds in range(1, chosen.config.kinds):
        fewer = [candidate for candidate in judged if candidate.config.kinds == kinds]
        if fewer and chosen.accuracy - most_accurate(fewer).accuracy <= HOPELESS:
            listed.append(cheapest(fewer, market))
    configs = dict.fromkeys(candidate.config for candidate in listed)
    return tuple(sorted(configs, key=lambda config: price_of(config, market)))


def _common_length(recordings: Recordings, touches: FirstTouches) -> int:
    """Frames after the onset that 95 % of the recordings have: windows reach no further."""
    return int(np.quantile(recordings.lengths[touches.recording] - touches.onset_frame, 0.05, method="lower"))


class Judge:
    """Judges candidates on one set of recordings by ``decide``, of the form of ``blocked_ridge``; the touches
    of a gate are found once."""

    def __init__(
        self,
        recordings: Recordings,
        folds: Sequence[np.ndarray],
        progress: Callable[[int], None] = lambda count: None,
        decide: Callable[[np.ndarray, np.ndarray, Sequence[np.ndarray], int], np.ndarray] | None = None,
    ) -> None:
        self.recordings, self._folds = recordings, folds
        self._progress, self._decide = progress, decide or blocked_ridge
        self._touches: dict[AcceleratorConfig, FirstTouches] = {}
        self.judged: dict[AcceleratorConfig, Judged] = {}

    def touches(self, config: AcceleratorConfig) -> FirstTouches:
        """First touches of the candidate's rest level and gate, long enough for any windows."""
        network = config.network.replace(decision="vote", early_margin=0, early_steps=1)
        plain = dataclasses.replace(config, features=Features(), network=network)
        if config.windows.window_mode == "free":
            hop = int(min(self.recordings.lengths.max(), 65535))
            plain = plain.replace(hop=hop, window=2 * hop, steps=1, name="gate")
        touches = self._touches.pop(plain, None)
        if touches is None or touches.reach < config.last_frame:
            touches = first_touches(plain, self.recordings)
            if len(touches):
                touches = touches.within(max(_common_length(self.recordings, touches), config.last_frame))
        for idle in self._touches.values():
            idle.forget()
        self._touches[plain] = touches  # the oldest goes first; it is found anew where it is asked for again
        while (
            len(self._touches) > 1
            and sum(idle.deviations.nbytes for idle in self._touches.values()) > KEPT_BYTES
        ):
            del self._touches[next(iter(self._touches))]
        return touches

    def __call__(self, config: AcceleratorConfig) -> Judged:
        if config not in self.judged:
            self.judged[config] = self._judge(config)
            self._progress(len(self.judged))
        return self.judged[config]

    def refold(self, folds: Sequence[np.ndarray]) -> None:
        """Judge on other folds from now on; what was judged is forgotten, the touches are not."""
        self._folds, self.judged = folds, {}

    def all(self, configs: Iterable[AcceleratorConfig]) -> list[Judged]:
        """Each judged, best first."""
        return sorted((self(config) for config in configs), key=lambda candidate: -candidate.accuracy)

    def features(self, config: AcceleratorConfig) -> tuple[np.ndarray, np.ndarray]:
        """(recordings with a completed window, their features); none where features hardly move: no
        normaliser makes anything of them."""
        config = config.replace(feature_shift=(), aligned_means=False)  # what the network's arithmetic adds
        touches = cut_windows(config, self.touches(config))
        rows = np.flatnonzero(touches.completed > 0)
        try:
            return touches.recording[rows], integer_features(config, touches)[rows] if len(
                rows
            ) else np.zeros((0, 1))
        except InputError:
            return np.zeros(0, dtype=np.int64), np.zeros((0, 1))

    def _judge(self, config: AcceleratorConfig) -> Judged:
        rows, x = self.features(config)
        decide = lambda labels, folds: self._decide(x, labels[0], folds, len(self.recordings.class_names))
        (correct,) = rightly_decided(rows, self.recordings.labels[None], self._folds, decide)
        return Judged(config, correct, len(correct) - len(rows))


NESTED_ON = 400
"""Recordings of a `Field` at most: choices inside folds are many."""


NESTED_KINDS = (("mean",), ("mean", "activity"), ("mean", "integral"), ("mean", "activity", "integral"))
"""Kinds of feature of a `Field`."""


@dataclass(frozen=True, eq=False)
class Field:
    """Front ends that no label picked, to be chosen from inside folds, and what the ridge regression needs of
    each.

    numbers: the recordings judged on, indices in the archive; recordings: those. seen: configuration, rows of
    them that have a touch, and their ``gram_of``.
    """

    numbers: np.ndarray
    recordings: Recordings
    seen: list[tuple[AcceleratorConfig, np.ndarray, np.ndarray]]

    @classmethod
    def empty(cls, recordings: Recordings, looked_at: np.ndarray) -> Field:
        """Without candidates, on NESTED_ON of the recordings ``looked_at`` at most."""
        numbers = looked_at[recordings.subset(looked_at).evenly(NESTED_ON)]
        return cls(numbers, recordings.subset(numbers), [])

    def add(self, judge: Judge, looked_at: np.ndarray, configs: Iterable[AcceleratorConfig]) -> None:
        """Candidates, seen by a judge of the recordings ``looked_at``."""
        for config in configs:
            rows, x = judge.features(config)
            held = np.isin(looked_at[rows], self.numbers)
            self.seen.append((config, np.searchsorted(self.numbers, looked_at[rows][held]), gram_of(x[held])))

    def judged(
        self, part: np.ndarray, groups: Sequence[str], labels: np.ndarray | None = None
    ) -> list[list[Judged]]:
        """Of each labelling (default: the recordings' own) every candidate, judged by the rows ``part``
        (ascending) alone, on ``inner_folds`` of them."""
        labels = (self.recordings.labels[None] if labels is None else labels)[:, part]
        folds = inner_folds(self.recordings.subset(part), groups)
        place = np.full(len(self.numbers), -1)
        place[part] = np.arange(len(part))
        by_labelling: list[list[Judged]] = [[] for _ in labels]
        for config, rows, gram in self.seen:
            held = place[rows] >= 0
            inside = gram[np.ix_(held, held)]
            decide = lambda labels, folds, inside=inside: ridge_decisions(
                inside, labels, folds, len(self.recordings.class_names)
            )
            correct = rightly_decided(place[rows[held]], labels, folds, decide)
            for of_labelling, right in zip(by_labelling, correct, strict=True):
                of_labelling.append(Judged(config, right, len(part) - int(held.sum())))
        return by_labelling


def inner_folds(recordings: Recordings, groups: Sequence[str], folds: int = 5) -> list[np.ndarray]:
    """Folds inside a training part: by ``groups`` where they have two values there; else by the group that
    ``choose_split`` finds there; else of single recordings, which may be near copies of others."""
    chosen, _ = choose_split(recordings, None)
    for split, count in ((groups, folds), (chosen, folds), ((), min(folds, len(recordings)))):
        try:
            return split_folds(recordings, list(split), count, None)
        except InputError:
            continue
    return [np.arange(len(recordings))]


# ---------------------------------------------------------------------- candidates
def gates(recordings: Recordings, base: Record) -> list[Record]:
    """Rest level and gate of each candidate: open at once with and without the first frames' level taken off,
    onset rules on a tracked level (half, once and twice the threshold between noise and signal) and on an
    initial one."""
    settle = settling_frames(recordings.sample_rate_hz)
    at_once = dict(onset="immediate", clip=0)
    candidates = [
        at_once | dict(rest="none", rest_frames=0),
        at_once | dict(rest="initial", rest_frames=settle),
    ]
    rule = measure_onset(recordings, settle, base["onset_mean_frames"])
    if rule is not None:
        common = dict(onset="baseline", rest_frames=settle, clip=rule.clip)
        thresholds = sorted({max(1, round(rule.threshold * factor)) for factor in (0.5, 1, 2)})
        candidates += [
            common | dict(rest="tracked", onset_threshold=min(threshold, 65535)) for threshold in thresholds
        ]
        candidates.append(common | dict(rest="initial", onset_threshold=rule.threshold))
    return candidates


def window_sets(available: int, rate: float, at_once: bool) -> list[dict[str, int]]:
    """Hop, window and steps: 20 and 10 windows over all, half and a quarter of the ``available`` frames, and
    at the usual pace (48 ms after an onset, 200 ms where the gate opens at once). The first two are the
    longest touch and the usual pace."""
    pace = max(round((0.2 if at_once else 0.048) * rate), 4)
    hops = [(available // (STEPS + 1), STEPS), (min(pace, available // (STEPS + 1)), STEPS)]
    for steps in (STEPS, STEPS // 2):
        fit = available // (steps + 1)
        hops += [(fit, steps), (fit // 2, steps), (fit // 4, steps), (min(pace, fit), steps)]
    sets = []
    for hop, steps in hops:
        hop = int(np.clip(hop, 1, 65535))
        hop -= hop % (8 if hop >= 32 else 4 if hop >= 8 else 1)  # blocks of activity divide a hop
        if available < 2 * hop:
            continue
        steps = max(1, min(steps, available // hop - 1))
        sets.append(dict(hop=hop, window=2 * hop, steps=steps))
    if not sets:
        sets = [dict(hop=1, window=2, steps=max(1, min(STEPS, available - 1)))]
    return [windows for index, windows in enumerate(sets) if windows not in sets[:index]]


def block_of(hop: int) -> int:
    """The longest block of activity, frames, that fits a hop four times: whole blocks, 64 frames at most."""
    return max(block for block in range(1, min(64, max(hop // 4, 1)) + 1) if hop % block == 0)


def features(config: AcceleratorConfig, knee: int) -> list[AcceleratorConfig]:
    """``config`` with every kind of feature and both scales, as far as the network's inputs go."""
    block = block_of(config.windows.hop)
    small, large, middle = ("change", 1), ("sum", block), ("change", block)
    kinds: list[tuple[tuple[str, ...], tuple[str, int]]] = [(("mean",), ("sum", 1))]
    if config.windows.window % 2 == 0 and config.windows.window_mode == "free":
        kinds += [(("mean", "activity"), rule) for rule in (small, large, middle)]
        kinds += [(("activity",), small)]
        kinds += [(("mean", "activity", "integral"), rule) for rule in (small, large)]
    kinds += [(("mean", "integral"), ("sum", 1))]
    candidates = []
    for kind, (rule, length) in kinds:
        changes: Record = dict(feature_kinds=kind, activity_rule=rule, activity_block=length)
        if "integral" in kind:
            changes["integral_knee"] = knee
        for scale in ("array", "taxel"):
            candidate = _valid(config, feature_scale=scale, **changes)
            if candidate is not None:
                same = candidate == config.replace(name="derived")
                candidates.append(config if same else candidate)
    return candidates


def _valid(config: AcceleratorConfig, **changes: Any) -> AcceleratorConfig | None:
    """``config`` with ``changes`` and the name derived; None where no accelerator has these sizes (too many
    inputs, say)."""
    try:
        return config.replace(name="derived", **changes)
    except InputError:
        return None


def knee_of(touches: FirstTouches) -> int:
    """Two to this power is an eighth of the median sum of a taxel's deviations over a touch, codes: below it
    the integral is linear."""
    begin = touches.offsets[:-1] + np.maximum(touches.onset_frame - 1, 0)
    sums = np.abs((touches.running[:, touches.offsets[1:]] - touches.running[:, begin]).astype(np.int64))
    typical = float(np.median(sums)) if sums.size else 1.0
    return int(np.clip(round(np.log2(max(typical, 1.0))) - 3, 0, 24))


# ---------------------------------------------------------------------- the choice
def choose_front_end(
    recordings: Recordings,
    market: Market,
    *,
    groups: Sequence[str] | None = None,
    folds: int = 5,
    nested: bool = False,
    progress: Progress | None = None,
) -> Plan:
    """Judge candidates as the module describes and choose one.

    Parameters
    ----------
    groups:
        Names of group arrays that stay together (``label`` is the class); None: ``choose_split``.
    folds:
        Folds of the judgement; with no more groups than folds each is left out in turn. Below 2: 5.

    Returns
    -------
    Plan with the record for training.json: chosen and rivals (best first), each as ``describe`` gives it;
    split, split_from, folds, recordings_looked_at, recordings, judged_by, tie, wall_s. Where there are too
    few recordings to judge on, the configuration is the first guess of ``eskin.training.derive``, a
    reason says so, and the record is None.

    Raises
    ------
    InputError
        Sizes that no accelerator has: the sentence names the field. Unknown groups.
    """
    began = time.perf_counter()
    split, split_from = choose_split(recordings, groups)
    for name in split:
        if name != "label" and name not in recordings.groups:
            split_folds(recordings, split, max(folds, 2), None)  # says which there are
    base, reasons = sensor_sizes(recordings)
    reasons = [*recordings.notes, *reasons]
    looked_at = recordings.evenly(_how_many(recordings))
    judged_on = recordings.subset(looked_at)
    try:
        parts = split_folds(judged_on, split, folds if folds >= 2 else 5, None)
        enough = all(
            len(np.unique(judged_on.labels[np.setdiff1d(np.arange(len(judged_on)), part)])) >= 2
            for part in parts
        )
    except InputError:
        enough = False
    if not enough:
        guess, why = derive_config(recordings)
        return Plan(
            guess,
            [*why, "too few recordings to judge front ends on, so this is a guess by rules"],
            split,
            split_from,
            market,
            shortlist=(guess,),
        )

    about = 80
    judge = Judge(
        judged_on,
        parts,
        lambda count: progress("front ends judged", count, max(about, count)) if progress else None,
    )
    field = Field.empty(recordings, looked_at) if nested else None
    with one_thread():
        chosen = _search(judge, market, _windows(judge, recordings, base, field, looked_at, progress))
    record = _record(judge, chosen, market, judged_on, split, split_from, len(parts)) | {
        "recordings": len(recordings),
        "wall_s": time.perf_counter() - began,
    }
    reasons += [_in_words(record), *_cautions(judge, chosen, parts, record)]
    candidates = _candidates(judge, market)
    rivals, listed = rivals_of(candidates, chosen), shortlist_of(candidates, chosen, market)
    return Plan(chosen.config, reasons, split, split_from, market, record, rivals, listed, field)


def field_of(recordings: Recordings) -> Field:
    """Front ends that no label picked, for all choices inside folds of these recordings.

    Raises
    ------
    InputError
        As ``sensor_sizes``.
    """
    looked_at = recordings.evenly(_how_many(recordings))
    field = Field.empty(recordings, looked_at)
    with one_thread():
        _windows(
            Judge(recordings.subset(looked_at), []), recordings, sensor_sizes(recordings)[0], field, looked_at
        )
    return field


def _how_many(recordings: Recordings) -> int:
    """Recordings to judge on: all of a small archive."""
    of_one = recordings.frames * recordings.taxels / len(recordings)
    return int(min(len(recordings), JUDGED_ON, max(8 * len(recordings.class_names), JUDGED_SAMPLES / of_one)))


def _windows(
    judge: Judge,
    recordings: Recordings,
    base: Record,
    field: Field | None,
    looked_at: np.ndarray,
    progress: Progress | None = None,
) -> list[list[AcceleratorConfig]]:
    """Candidates with means alone, of each gate all windows, the longest touch and the usual pace first; then
    a preset each.

    What no label picks goes into ``field``: of each gate the first two and the last windows with
    NESTED_KINDS; one scale, of means both.
    """
    judged_on = judge.recordings
    of_gate: list[list[AcceleratorConfig]] = []
    rules = gates(judged_on.subset(judged_on.evenly(MEASURED_ON)), base)
    for number, gate in enumerate(rules):
        if progress:
            progress("onset rules looked at", number, len(rules))
        single = for_recordings(AcceleratorConfig(), recordings, **base, **gate, hop=1, window=2, steps=1)
        touches = judge.touches(single)
        if len(touches) < 2:
            continue
        sets = window_sets(
            _common_length(judged_on, touches), recordings.sample_rate_hz, gate["onset"] == "immediate"
        )
        of_gate.append([single.replace(**windows) for windows in sets])
        if field is not None:
            knee = knee_of(touches)
            first = dict.fromkeys([*of_gate[-1][:2], of_gate[-1][-1]])
            every = [config for windows in first for config in features(windows, knee)]
            plain = [
                config
                for config in every
                if config.features.activity_block == 1 and config.features.feature_kinds in NESTED_KINDS
            ]
            field.add(
                judge, looked_at, [c for c in plain if c.features.feature_scale == "array" or c.kinds == 1]
            )
    presets = [
        for_recordings(PRESETS[name], recordings, name=name)
        for name in CONVERTERS
        if fits_sensor(PRESETS[name], recordings)
    ]
    if field is not None:
        field.add(judge, looked_at, presets)
    return of_gate + [[preset] for preset in presets]


def _search(judge: Judge, market: Market, of_gate: list[list[AcceleratorConfig]]) -> Judged:
    """The search by coordinates; everything judged stays in ``judge``."""
    presets = [configs[0] for configs in of_gate if configs[0].name in PRESETS]
    of_gate = of_gate[: len(of_gate) - len(presets)]
    first = judge.all([config for configs in of_gate for config in configs[:2]] + presets)
    close = [configs for configs in of_gate if any(_near(first[0], judge(config)) for config in configs[:2])]
    means = judge.all([config for configs in close for config in configs] + presets)
    for candidate in means[:SURVIVORS]:
        judge.all(features(candidate.config, knee_of(judge.touches(candidate.config))))

    best = most_accurate(list(judge.judged.values())).config  # once more around the best
    around: list[AcceleratorConfig | None] = []
    if best.windows.window_mode == "free":
        for config in (
            config for configs in of_gate if _gate_of(configs[0]) == _gate_of(best) for config in configs
        ):
            block = 1 if best.features.activity_block == 1 else block_of(config.windows.hop)
            windows = {name: getattr(config.windows, name) for name in ("hop", "window", "steps")}
            around.append(_valid(best, **windows, activity_block=block))
    if best.onset_rule.onset == "baseline":
        threshold = best.onset_rule.onset_threshold
        around += [_valid(best, onset_threshold=max(1, round(threshold * factor))) for factor in (0.7, 1.4)]
    judge.all(config for config in around if config is not None)
    _descend(judge, market)
    return cheapest(_candidates(judge, market), market)


def _candidates(judge: Judge, market: Market) -> list[Judged]:
    """The judged front ends, best first, from the best one on that fits a named board.

    Raises
    ------
    InputError
        Nothing fits the named board.
    """
    ordered = sorted(judge.judged.values(), key=lambda candidate: -candidate.accuracy)
    for number, candidate in enumerate(ordered):
        if market.is_candidate(with_linear(candidate.config)):
            return ordered[number:]
    raise InputError(
        f"--fits {market.board}: holds none of the {len(ordered)} front ends that were judged, not even with "
        "a linear cell; name a larger board"
    )


def _descend(judge: Judge, market: Market) -> None:
    """From the cheapest that is level to its cheaper neighbours, as long as one of them is level: fewer
    kinds, two thirds of the windows, windows of two thirds the length."""
    budget = DESCENT
    while True:
        at = cheapest(_candidates(judge, market), market).config
        windows, kinds = at.windows, at.features.feature_kinds
        tried: list[AcceleratorConfig | None] = []
        if len(kinds) > 1:
            tried += [_valid(at, feature_kinds=tuple(k for k in kinds if k != kind)) for kind in kinds]
        if windows.window_mode == "free":
            shorter = max(2 * windows.hop // 3 // 8 * 8, 4)
            block = block_of(shorter) if at.features.activity_block > 1 else 1
            tried.append(_valid(at, steps=max(2 * windows.steps // 3, 1)))
            tried.append(_valid(at, hop=shorter, window=2 * shorter, activity_block=block))
        new = [
            config
            for config in tried
            if config and config not in judge.judged and price_of(config, market) < price_of(at, market)
        ][:budget]
        budget -= len(new)
        judge.all(new)
        if not new or cheapest(_candidates(judge, market), market).config == at:
            return


def _near(best: Judged, rival: Judged) -> bool:
    shortfall, error = behind(best, rival)
    return shortfall <= FAR_BEHIND * error


def _gate_of(config: AcceleratorConfig) -> tuple:
    return (
        config.onset_rule.onset,
        config.rest_level.rest,
        config.rest_level.rest_frames,
        config.rest_level.clip,
        config.onset_rule.onset_threshold if config.onset_rule.onset == "baseline" else 0,
    )


def rivals_of(judged: Sequence[Judged], chosen: Judged) -> tuple[AcceleratorConfig, ...]:
    """Front ends that a recurrent network is tried on beside the chosen one.

    They are the best preset and the best of every other pair of rest level and gate, best first, RIVALS at
    most, none more than HOPELESS behind. A linear classifier sees all windows at once and can undo a level
    that a recurrent network stumbles over, so the two rank gates differently.
    """
    rivals: dict[Any, Judged] = {}
    for candidate in sorted(judged, key=lambda candidate: -candidate.accuracy):
        preset = candidate.config.name in PRESETS
        kind = "preset" if preset else (candidate.config.rest_level.rest, candidate.config.opens_at_once)
        same = not preset and kind == (chosen.config.rest_level.rest, chosen.config.opens_at_once)
        if candidate is not chosen and not same and chosen.accuracy - candidate.accuracy <= HOPELESS:
            rivals.setdefault(kind, candidate)
    return tuple(candidate.config for candidate in list(rivals.values())[:RIVALS])


def for_recurrent(
    chosen: AcceleratorConfig,
    shortlist: Sequence[AcceleratorConfig],
    rivals: Sequence[AcceleratorConfig],
    works: Callable[[AcceleratorConfig], bool] = lambda config: True,
) -> list[AcceleratorConfig]:
    """Front ends that a recurrent network is tried on, of those where it ``works``: the chosen one, the
    cheapest of the shortlist, the rivals, then the rest of the shortlist."""
    listed = dict.fromkeys((chosen, *shortlist[:1], *rivals, *shortlist))
    return [config for config in listed if works(config)][:TRIED_RECURRENT]


def row_of(config: AcceleratorConfig) -> Record:
    """The fields of a front end in plain values."""
    onset, windows, features = config.onset_rule, config.windows, config.features
    row: Record = {"name": config.name, "rest": config.rest_level.rest, "onset": onset.onset}
    if onset.onset == "baseline":
        row["onset_threshold"] = onset.onset_threshold
    row |= {"hop": windows.hop, "window": windows.window, "steps": windows.steps}
    row["feature_kinds"] = list(features.feature_kinds)
    if "activity" in features.feature_kinds:
        row |= {"activity_rule": features.activity_rule, "activity_block": features.activity_block}
    return row | {"feature_scale": features.feature_scale, "inputs": config.inputs}


def describe(candidate: Judged, best: Judged) -> Record:
    """A row of the record: ``row_of``, accuracy, standard_error (over recordings), missed, behind (the best,
    accuracy), behind_error (of the paired difference), level."""
    shortfall, error = behind(best, candidate)
    return row_of(candidate.config) | {
        "accuracy": candidate.accuracy,
        "standard_error": candidate.standard_error,
        "missed": candidate.missed,
        "behind": shortfall,
        "behind_error": error,
        "level": is_level(best, candidate),
    }


def _record(
    judge: Judge,
    chosen: Judged,
    market: Market,
    recordings: Recordings,
    split: list[str],
    split_from: str,
    folds: int,
) -> Record:
    ordered = sorted(
        judge.judged.values(), key=lambda candidate: (-candidate.accuracy, price_of(candidate.config, market))
    )
    best = ordered[0]
    return {
        "chosen": describe(chosen, best),
        "rivals": [describe(candidate, best) for candidate in ordered if candidate is not chosen],
        "split": split,
        "split_from": split_from,
        "folds": folds,
        "recordings_looked_at": len(recordings),
        "judged_by": "ridge regression on the integer front end's features of all windows, cross-validated",
        "tie": f"shortfall of at most {TIE:g} standard error of the paired difference over recordings; ties "
        f"go to what is least in {market.prefer}",
    }


def _in_words(record: Record) -> str:
    chosen, rivals = record["chosen"], record["rivals"]
    best = max([chosen, *rivals], key=lambda row: row["accuracy"])
    rival = f"; the best, {front_end_words(best)}, has {best['accuracy']:.1%} and is level"
    unseen = left_out(record["split"])
    return (
        f"front end chosen among {len(rivals) + 1} by a linear classifier, leaving out {unseen} "
        f"({record['split_from']}), on "
        f"{record['recordings_looked_at']} recordings: {front_end_words(chosen)}, "
        f"{chosen['accuracy']:.1%}{'' if best is chosen else rival}"
    )


def _cautions(judge: Judge, chosen: Judged, parts: Sequence[np.ndarray], record: Record) -> list[str]:
    """What a reader should know before trusting the figure."""
    cautions = []
    count = len(judge.recordings)
    if chosen.missed > 0.1 * count:
        cautions.append(
            f"{chosen.missed} of {count} recordings show no touch under the chosen front end and count as "
            "wrong: look at them "
            "with 'eskin inspect'"
        )
    frames = settling_frames(judge.recordings.sample_rate_hz)
    levels = np.array([judge.recordings.recording(i)[:frames].mean(axis=0) for i in range(count)])
    levels = (levels - levels.mean(axis=0)) / (levels.std(axis=0) + 1e-9)
    labels, classes = judge.recordings.labels, len(judge.recordings.class_names)
    alone = float((blocked_ridge(levels, labels, parts, classes) == labels).mean())
    record["level_alone"] = alone
    fix = "if so, take the level off (--config with rest 'initial')"
    if chosen.config.rest_level.rest != "none":
        fix = "the front end takes the level off, but not what else a session leaves: record classes in turn"
    if (alone - 1 / classes) > LEVEL_TELLS * (1 - 1 / classes):
        cautions.append(
            f"the level of the first {frames} frames alone tells the class of {alone:.0%}: where each "
            "class was recorded in a session "
            f"of its own that may be the session; {fix}"
        )
    return cautions
