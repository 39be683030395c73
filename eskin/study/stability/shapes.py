"""The shapes that most failure modes have: one disturbance, over taxels or recordings, at a nominal level and
along a curve of levels.

A shape is a value with the disturbance in it, called with a bench; ``eskin.study.stability.table`` has one a
row.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.data import Recordings
from eskin.golden.model import pipeline
from eskin.study.stability.core import Bench, Case, Change, Curve, Outcome, disturbed, rebuilt
from eskin.training.quantise import profile, quantise_model

PAIRS = 28
"""Pairs of taxels tried at most: all of an array of 8."""
DRAWS = 4
"""Sets of so many taxels drawn for a point of a curve."""
AGREED = 0.98
"""Share of decisions as in float below which `eskin evaluate` refuses a quantised model."""


def worst_recordings(bench: Bench, recordings: Recordings, decisions: np.ndarray, count: int = 3) -> Case:
    """Up to ``count`` recordings for the hardware, wrongly decided ones first, with the bench's model."""
    order = np.argsort(decisions == recordings.labels, kind="stable")[:count]
    return Case(recordings.subset(np.sort(order)), bench.model)


# ---------------------------------------------------------------------- recordings under a disturbance
def changed_recordings(bench: Bench, change: Change | Recordings) -> Recordings:
    """The clean recordings of a bench through a disturbance, if it is not recordings already."""
    return change if isinstance(change, Recordings) else disturbed(bench, change)


@dataclass(frozen=True)
class Whole:
    """Accuracy of all recordings at the nominal level, the curve from the few; three wrongly decided
    recordings are the case.

    Parameters
    ----------
    change:
        (bench, level) -> the disturbance, or the disturbed recordings.
    what:
        The nominal level in words, or (bench, its decisions) -> words.
    """

    change: Callable[[Bench, float], Change | Recordings]
    nominal: float
    levels: Sequence[float]
    xlabel: str
    what: str | Callable[[Bench, np.ndarray], str]
    log: bool = False

    def __call__(self, bench: Bench) -> Outcome:
        changed, few = changed_recordings(bench, self.change(bench, self.nominal)), bench.sample
        decisions, levels = bench.decisions(changed), bench.thin(self.levels)
        words = self.what if isinstance(self.what, str) else self.what(bench, decisions)
        line = [few.accuracy(changed_recordings(few, self.change(few, level))) for level in levels]
        curve = Curve(self.xlabel, "accuracy", levels, {"accuracy": line}, self.log)
        accuracy = float(np.mean(decisions == changed.labels))
        return Outcome(
            accuracy,
            f"{words}; clean {bench.clean_accuracy:.4f}",
            curve,
            worst_recordings(bench, changed, decisions),
        )


def _shares(bench: Bench, changes: dict[str, tuple[Bench, Change]]) -> dict[str, tuple[float, Case]]:
    """Accuracy under each disturbance, by what it is called, and its three worst recordings."""
    shares = {}
    for name, (where, change) in changes.items():
        recordings = disturbed(bench, change)
        decisions = where.decisions(recordings)
        shares[name] = (
            float(np.mean(decisions == recordings.labels)),
            worst_recordings(where, recordings, decisions),
        )
    return shares


@dataclass(frozen=True)
class EachTaxel:
    """Each taxel in turn: the one that is missed most, or the ``mean`` over the taxels.

    Parameters
    ----------
    change:
        (bench, taxel, level) -> (the bench that decides, the disturbance).
    """

    change: Callable[[Bench, int, float], tuple[Bench, Change]]
    nominal: float
    levels: Sequence[float]
    xlabel: str
    log: bool = False
    mean: bool = False

    @property
    def averaged(self) -> EachTaxel:
        """The same, the mean over the taxels. What both find is found once."""
        return replace(self, mean=True)

    def __call__(self, bench: Bench) -> Outcome:
        shares, lines = bench.remember(replace(self, mean=False), lambda: self._found(bench))
        worst = min(shares, key=lambda name: shares[name][0])
        average = float(np.mean([share for share, _ in shares.values()]))
        order = ("mean", "worst taxel") if self.mean else ("worst taxel", "mean")
        curve = Curve(
            self.xlabel, "accuracy", bench.thin(self.levels), {name: lines[name] for name in order}, self.log
        )
        words = f"taxel {worst}: {shares[worst][0]:.4f}; mean {average:.4f}, clean {bench.clean_accuracy:.4f}"
        return Outcome(average if self.mean else shares[worst][0], words, curve, shares[worst][1])

    def _found(self, bench: Bench) -> tuple[dict[str, tuple[float, Case]], dict[str, list[float]]]:
        all_of = _shares(bench, {str(taxel): self.change(bench, taxel, self.nominal) for taxel in bench.live})
        lines: dict[str, list[float]] = {"mean": [], "worst taxel": []}
        for level in bench.thin(self.levels):
            few = bench.sample
            shares = [
                share
                for share, _ in _shares(
                    few, {str(taxel): self.change(few, taxel, level) for taxel in bench.live}
                ).values()
            ]
            lines["mean"].append(float(np.mean(shares)))
            lines["worst taxel"].append(min(shares))
        return all_of, lines


@dataclass(frozen=True)
class TaxelPairs:
    """Pairs of taxels, at most ``PAIRS`` of them: mean over the pairs; the curve draws more taxels at once.

    Parameters
    ----------
    change:
        (bench, taxels) -> the disturbance of these.
    step:
        Taxels from one point of the curve to the next; ``up_to`` so many fewer than there are.
    draws:
        Keys of the random numbers, of the pairs and of the curve.
    """

    change: Callable[[Bench, Sequence[int]], Change]
    xlabel: str
    draws: tuple[int, int]
    step: int = 1
    spared: int = 1

    def __call__(self, bench: Bench) -> Outcome:
        pairs = list(combinations(bench.live, 2))
        pairs = [pairs[i] for i in np.sort(bench.rng(self.draws[0]).permutation(len(pairs))[:PAIRS])]
        shares = _shares(bench, {f"{a} and {b}": (bench, self.change(bench, [a, b])) for a, b in pairs})
        worst = min(shares, key=lambda name: shares[name][0])
        counts, line = bench.thin(range(0, len(bench.live) + 1 - self.spared, self.step)), []
        for count in counts:
            some = [
                bench.rng(self.draws[1], int(count), k).permutation(bench.live)[: int(count)].tolist()
                for k in range(DRAWS)
            ]
            line.append(
                float(
                    np.mean(
                        [
                            bench.sample.accuracy(disturbed(bench.sample, self.change(bench, taxels)))
                            for taxels in some
                        ]
                    )
                )
            )
        average = float(np.mean([share for share, _ in shares.values()]))
        words = f"taxels {worst}: {shares[worst][0]:.4f}; mean of {len(pairs)} pairs {average:.4f}"
        return Outcome(
            average, words, Curve(self.xlabel, "accuracy", counts, {"mean": line}), shares[worst][1]
        )


# ---------------------------------------------------------------------- quiet stretches
def lead_ins(bench: Bench) -> tuple[list[np.ndarray], list[int]]:
    """The quiet frames before each recording's touch, where there are enough of them, and whose they are."""
    config, streams, origins = bench.config, [], []
    for i, onset in enumerate(bench.onsets):
        end = int(onset) - config.onset_rule.onset_mean_frames - config.windows.pretrigger_frames
        if end > config.rest_level.rest_frames + 2 * config.onset_rule.onset_mean_frames:
            streams.append(bench.clean.recording(i)[:end])
            origins.append(i)
    if not streams:  # recordings that begin in contact: the rest level with its noise, as far as there is any
        streams = [np.repeat(bench.clean.recording(0)[:1], config.rest_level.rest_frames + 512, axis=0)]
        origins = [0]
    return streams, origins


@dataclass(frozen=True)
class QuietStretches:
    """The quiet frames before each touch, disturbed: share of them in which an onset is found.

    Parameters
    ----------
    change:
        (bench, stream, its place among them, level) -> stream.
    what:
        (bench, streams) -> what was tried, in words.
    sampled:
        No more of them than the points of a curve take.
    """

    change: Callable[[Bench, np.ndarray, int, float], np.ndarray]
    nominal: float
    levels: Sequence[float]
    xlabel: str
    what: Callable[[Bench, Sequence[np.ndarray]], str]
    log: bool = False
    sampled: bool = True

    def __call__(self, bench: Bench) -> Outcome:
        streams, rows = lead_ins(bench)
        if self.sampled:
            streams, rows = streams[: bench.few], rows[: bench.few]

        def found(level: float) -> tuple[float, Recordings]:
            recordings = rebuilt(
                bench.clean, [self.change(bench, stream, i, level) for i, stream in enumerate(streams)], rows
            )
            touches = bench.parts.find_touches(bench.config, recordings, steps=0)
            return len(np.unique(touches.recording)) / len(streams), recordings

        share, recordings = found(self.nominal)
        lines = {"false onsets": [found(level)[0] for level in self.levels]}
        curve = Curve(self.xlabel, "share with a false onset", self.levels, lines, self.log)
        return Outcome(
            share, self.what(bench, streams), curve, Case(recordings.subset(range(min(3, len(streams)))))
        )


def float_decisions(bench: Bench, touches: Any) -> np.ndarray:
    """Local decisions (n, K) of the float network on the window sums of ``touches``."""
    features = pipeline.float_features(bench.real, touches)
    return pipeline.decide(bench.config, bench.real.forward(features)[1], bench.touches.completed)[0]


@dataclass(frozen=True)
class AsInFloat:
    """Share of the integer network's local decisions that are the float network's; the curve: other widths of
    one kind of number.

    Parameters
    ----------
    key:
        Of the width, as eskin.training.quantise.quantise_model takes it.
    now:
        Configuration -> the width it has.
    """

    key: str
    xlabel: str
    counts: Sequence[int]
    now: Callable[[AcceleratorConfig], int]

    def __call__(self, bench: Bench) -> Outcome:
        ideal = float_decisions(bench, bench.touches)
        line = self._agreements(bench, ideal)
        own = float(np.mean(bench.local(bench.codes) == ideal))
        few = min(
            (count for count, share in zip(self.counts, line, strict=True) if share >= AGREED),
            default=self.counts[-1],
        )
        curve = Curve(self.xlabel, "share of local decisions as in float", self.counts, {"agreement": line})
        return Outcome(own, f"now {self.now(bench.config)}; {few} would do on these recordings", curve)

    def _agreements(self, bench: Bench, ideal: np.ndarray) -> list[float]:
        """The share with each width; 0 where no format of that width works."""
        ranges, line = profile(bench.real, bench.touches), []
        for count in self.counts:
            try:
                model = quantise_model(bench.real, ranges, **{self.key: count})
            except InputError:
                line.append(0.0)
                continue
            codes = pipeline.feature_codes(model, bench.touches, bench.parts.normalise)
            logits = model.run(bench.parts.arithmetic(model.config), codes)[1]
            line.append(
                float(np.mean(bench.parts.decide(model.config, logits, bench.touches.completed)[0] == ideal))
            )
        return line
