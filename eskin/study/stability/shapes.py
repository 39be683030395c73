"""Common shapes of failure modes: one disturbance, over recordings, taxels or quiet stretches, at a nominal
level and along a curve of levels.

An experiment is a value with the disturbance in it, called with a bench; ``eskin.study.stability.table`` has one
a row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from itertools import combinations
from typing import Any, Literal

import numpy as np

from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.data import Recordings
from eskin.golden.model import pipeline
from eskin.study.stability.core import Bench, Case, Change, Curve, Outcome, Scene, disturbed, rebuilt
from eskin.training.quantise import profile, quantise_model

PAIRS = 28
"""Pairs of taxels tried at most: all of an array of 8."""
DRAWS = 4
"""Random sets of taxels per point of a curve."""
AGREED = 0.98
"""Share of decisions as in float below which `eskin evaluate` refuses a quantised model."""


# ---------------------------------------------------------------------- quiet stretches
def lead_ins(scene: Scene) -> tuple[list[np.ndarray], list[int]]:
    """The quiet frames before each recording's touch, where there are enough of them, and whose they are."""
    config, streams, origins = scene.config, [], []
    for i, onset in enumerate(scene.onsets):
        end = int(onset) - config.onset_rule.onset_mean_frames - config.windows.pretrigger_frames
        if end > config.rest_level.rest_frames + 2 * config.onset_rule.onset_mean_frames:
            streams.append(scene.clean.recording(i)[:end])
            origins.append(i)
    if not streams:  # recordings that begin in contact: the rest level with its noise, as far as there is any
        streams = [np.repeat(scene.clean.recording(0)[:1], config.rest_level.rest_frames + 512, axis=0)]
        origins = [0]
    return streams, origins


# ---------------------------------------------------------------------- recordings under a disturbance
@dataclass(frozen=True)
class Played:
    """A case of an experiment: recordings, the scene that they are played to (a taxel may be masked there),
    and which of the clean ones they come from."""

    scene: Any
    recordings: Recordings
    rows: np.ndarray


@dataclass(frozen=True)
class Found:
    """Result of a case: the share that went wrong, and recordings for the hardware, wrong ones first."""

    wrong: float
    case: Case


@dataclass(frozen=True)
class Experiment:
    """One disturbance, at a nominal level on all recordings and along a curve of levels on the few.

    Parameters
    ----------
    change:
        (scene, level, taxels) -> the disturbance, or the disturbed recordings. Of quiet stretches it gets the
        place of a stretch among them for the onset.
    levels:
        Of the curve; none: numbers of taxels, from 0 to all.
    what:
        The nominal level in words, or (scene) -> words.
    over:
        What is disturbed: all ``recordings``; each of the ``taxels`` in turn; ``pairs`` of them, PAIRS at most,
        and as many at once as the level says; both ``ways``, level and minus level; the ``quiet`` stretches before
        each touch, in which no onset may be found.
    mean:
        The figure is the mean over what is disturbed in turn, and not the worst.
    masked:
        The taxels' mask bits are set.
    sampled:
        No more recordings than the points of a curve take.
    early:
        Counted are onsets more than a window earlier than recorded.
    """

    change: Callable[[Any, float, Sequence[int]], Change | Recordings]
    nominal: float
    levels: Sequence[float]
    xlabel: str
    what: str | Callable[[Any], str] = ""
    over: Literal["recordings", "taxels", "pairs", "ways", "quiet"] = "recordings"
    _: KW_ONLY
    log: bool = False
    mean: bool = False
    masked: bool = False
    sampled: bool = False
    early: bool = False

    @property
    def averaged(self) -> Experiment:
        """The same, the mean over the taxels. Results that both need are computed once."""
        return replace(self, mean=True)

    # -- what is played
    def cases(self, scene: Scene, level: float | None = None) -> dict[str, Played]:
        """Every case at a level (None: the nominal one), by what is disturbed."""
        level = self.nominal if level is None else level
        if self.over == "ways":
            return {f"{way * level:+.0%}": self._played(scene, way * level, scene.live) for way in (1, -1)}
        if self.over == "taxels":
            return {f"taxel {taxel}": self._played(scene, level, [taxel]) for taxel in scene.in_turn}
        if self.over == "pairs":
            return {f"taxels {some}": self._played(scene, level, some) for some in _sets(scene, int(level))}
        return {self.over: self._played(scene, level, scene.live)}

    def _played(self, scene: Scene, level: float, taxels: Sequence[int]) -> Played:
        masks = tuple(sorted({*scene.config.sensor.masked_taxels, *taxels}))
        where = scene.changed({"masked_taxels": masks}) if self.masked else scene
        change, rows = self.change(scene, level, taxels), np.arange(len(scene.clean))
        if isinstance(change, Recordings):
            return Played(where, change, rows)
        if self.over != "quiet":
            return Played(where, disturbed(scene, change), rows)
        streams, of = lead_ins(scene)
        count = scene.few if self.sampled else len(streams)
        streams = [
            change(stream.astype(np.float32), place, scene.rng(4, place))
            for place, stream in enumerate(streams[:count])
        ]
        return Played(where, rebuilt(scene.clean, streams, of[:count]), np.array(of[:count]))

    @property
    def gate_only(self) -> bool:
        """The gate alone can go wrong."""
        return self.over == "quiet" or self.early

    def wrong_by_gate(self, played: Played) -> np.ndarray | None:
        """(n) bool: the gate opened where it must not; None where a decision has to tell."""
        if not self.gate_only:
            return None
        scene, recordings = played.scene, played.recordings
        if self.over != "quiet":
            return opened_early(played)
        touches = scene.parts.find_touches(scene.config, recordings, steps=0)
        return touches.first_touch() >= 0

    # -- what becomes of it
    def figure(self, wrong: Iterable[float]) -> float:
        """The mode's figure of the share of each case that went wrong: a share of false onsets, else accuracy."""
        shares = list(wrong)
        share = float(np.mean(shares) if self.mean else max(shares))
        return share if self.gate_only else 1.0 - share

    def _found(self, bench: Bench, level: float | None = None) -> dict[str, Found]:
        found = {}
        for name, played in self.cases(bench, level).items():
            recordings, wrong = played.recordings, self.wrong_by_gate(played)
            if wrong is None:
                wrong = played.scene.decide(recordings) != recordings.labels
            order = np.argsort(~wrong, kind="stable")[:3]
            case = Case(recordings.subset(np.sort(order)), played.scene.model)
            found[name] = Found(float(np.mean(wrong)), case)
        return found

    def _curve(self, bench: Bench, accuracy: bool) -> list[Curve]:
        """The curve of the worst and that of the mean."""
        counts = range(0, len(bench.live) + 1, 1 if len(bench.live) < 12 else 2)
        levels = bench.thin(self.levels or counts)
        shares = [[one.wrong for one in self._found(bench.sample, level).values()] for level in levels]
        worst, mean = ([replace(self, mean=way).figure(of) for of in shares] for way in (False, True))
        ylabel = "accuracy" if accuracy else "share with a false onset"
        in_turn = self.over not in ("recordings", "quiet")
        lines = {"worst": worst, "mean": mean} if in_turn else {ylabel: worst}
        backwards = dict(reversed(lines.items()))
        return [Curve(self.xlabel, ylabel, levels, of, self.log) for of in (lines, backwards)]

    def __call__(self, bench: Bench) -> Outcome:
        accuracy = not self.gate_only
        found, curves = bench.remember(
            replace(self, mean=False), lambda: (self._found(bench), self._curve(bench, accuracy))
        )
        worst = max(found, key=lambda name: found[name].wrong)
        words = self.what if isinstance(self.what, str) else self.what(bench)
        if len(found) > 1:
            shares = [one.wrong for one in found.values()]
            words = f"{worst}: {1 - found[worst].wrong:.4f}; mean of {len(found)} {1 - np.mean(shares):.4f}"
        if accuracy:
            words += f"; clean {bench.clean_accuracy:.4f}"
        value = self.figure(one.wrong for one in found.values())
        return Outcome(value, words, curves[self.mean], found[worst].case)


def opened_early(played: Played) -> np.ndarray:
    """(n) bool: an onset was found more than a window earlier than recorded."""
    scene = played.scene
    touches = scene.parts.find_touches(scene.config, played.recordings, steps=0)
    first = touches.first_touch()
    onsets = np.where(first >= 0, touches.onset_frame[first], 1 << 30)
    return onsets < scene.onsets - scene.config.windows.window


def _sets(scene: Scene, count: int) -> list[list[int]]:
    """Every pair of live taxels, PAIRS at most; of another number of them DRAWS sets at random."""
    if count == 2:
        pairs = [list(pair) for pair in combinations(scene.live, 2)]
        return [pairs[i] for i in np.sort(scene.rng(5).permutation(len(pairs))[:PAIRS])]
    return [scene.rng(6, count, k).permutation(scene.live)[:count].tolist() for k in range(DRAWS)]


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
