"""Common shapes of failure modes: one disturbance, over recordings, taxels or quiet stretches, at a nominal
level and along a curve of levels.

An experiment is a value with the disturbance in it, called with a bench; ``eskin.study.stability.table`` has one
a row.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from itertools import combinations
from typing import Any, Literal

import numpy as np

from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.data import Recordings
from eskin.golden.model import FloatModel, IntegerModel, Touches, pipeline, preprocess
from eskin.study.stability.core import At, Bench, Case, Change, Outcome, Scene, curve, disturbed, rebuilt
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
    """A case of an experiment: recordings, the configuration that they are played to (a taxel may be masked
    there), and which of the clean ones they come from."""

    config: AcceleratorConfig
    recordings: Recordings
    rows: np.ndarray


@dataclass(frozen=True)
class Experiment:
    """One disturbance, at a nominal level on all recordings and along a curve of levels on the few.

    Parameters
    ----------
    change:
        The disturbance; of quiet stretches it gets the place of a stretch among them.
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

    change: Change
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
        config = scene.config
        if self.masked:
            config = config.replace(masked_taxels=tuple(sorted({*config.sensor.masked_taxels, *taxels})))
        if self.over != "quiet":
            return Played(config, disturbed(scene, self.change, level, taxels), np.arange(len(scene.clean)))
        streams, of = lead_ins(scene)
        count = scene.few if self.sampled else len(of)
        changed = [
            self.change(stream.astype(np.float32), At(scene, level, taxels, i, len(stream), scene.rng(4, i)))
            for i, stream in enumerate(streams[:count])
        ]
        return Played(config, rebuilt(scene.clean, changed, of[:count]), np.array(of[:count]))

    @property
    def gate_only(self) -> bool:
        """The gate alone can go wrong."""
        return self.over == "quiet" or self.early

    def opened(self, scene: Scene, played: Played) -> np.ndarray:
        """(n) bool: the gate opened where it must not: at all, or in a recording with a touch more than a window
        earlier than recorded."""
        touches = preprocess.find_touches(played.config, played.recordings, steps=0)
        first = touches.first_touch()
        if self.over == "quiet":
            return first >= 0
        onsets = pipeline.by_recording(touches.onset_frame, first, none=1 << 30)
        return onsets < scene.onsets - scene.config.windows.window

    # -- what becomes of it
    def figure(self, wrong: Iterable[float]) -> float:
        """The mode's figure of the share of each case that went wrong: a share of false onsets, else accuracy."""
        shares = list(wrong)
        share = float(np.mean(shares) if self.mean else max(shares))
        return share if self.gate_only else 1.0 - share

    def _found(self, bench: Bench, level: float | None = None) -> dict[str, tuple[float, Case]]:
        """Of each case the share that went wrong, and recordings for the hardware, wrong ones first."""
        found = {}
        for name, played in self.cases(bench, level).items():
            recordings = played.recordings
            if self.gate_only:
                wrong = self.opened(bench, played)
            else:
                wrong = bench.decide(recordings, played.config) != recordings.labels
            order = np.argsort(~wrong, kind="stable")[:3]
            model = replace(bench.model, config=played.config)
            found[name] = float(np.mean(wrong)), Case(recordings.subset(np.sort(order)), model)
        return found

    def _curve(self, bench: Bench) -> dict[float, list[float]]:
        """The share of each case that went wrong, by level."""
        counts = range(0, len(bench.live) + 1, 1 if len(bench.live) < 12 else 2)
        levels = bench.thin(self.levels or counts)
        return {level: [wrong for wrong, _ in self._found(bench.sample, level).values()] for level in levels}

    def __call__(self, bench: Bench) -> Outcome:
        found, along = bench.remember(
            replace(self, mean=False), lambda: (self._found(bench), self._curve(bench))
        )
        wrong = {name: share for name, (share, _) in found.items()}
        worst = max(wrong, key=wrong.__getitem__)
        words = self.what if isinstance(self.what, str) else self.what(bench)
        if len(found) > 1:
            mean = 1 - np.mean([*wrong.values()])
            words = f"{worst}: {1 - wrong[worst]:.4f}; mean of {len(found)} {mean:.4f}"
        ylabel = "share with a false onset"
        if not self.gate_only:
            ylabel, words = "accuracy", f"{words}; clean {bench.clean_accuracy:.4f}"
        ways = {"worst": False, "mean": True} if self.over not in ("recordings", "quiet") else {ylabel: False}
        lines = {
            name: [replace(self, mean=mean).figure(shares) for shares in along.values()]
            for name, mean in sorted(ways.items(), key=lambda way: way[1] != self.mean)
        }
        drawn = curve(self.xlabel, ylabel, along, lines, self.log)
        return Outcome(self.figure(wrong.values()), words, drawn, found[worst][1])


def _sets(scene: Scene, count: int) -> list[list[int]]:
    """Every pair of live taxels, PAIRS at most; of another number of them DRAWS sets at random."""
    if count == 2:
        pairs = [list(pair) for pair in combinations(scene.live, 2)]
        return [pairs[i] for i in np.sort(scene.rng(5).permutation(len(pairs))[:PAIRS])]
    return [scene.rng(6, count, k).permutation(scene.live)[:count].tolist() for k in range(DRAWS)]


# ---------------------------------------------------------------------- integers against float
def agreement(model: IntegerModel, real: FloatModel, touches: Touches) -> float:
    """Share of the local decisions of an integer network that are those of a float one."""
    own, ideal = (
        pipeline.decide(each.config, logits, touches.completed)[0]
        for each, logits in (
            (model, model.forward(pipeline.feature_codes(model, touches))[1]),
            (real, real.forward(pipeline.float_features(real, touches))[1]),
        )
    )
    return float(np.mean(own == ideal))


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
        ranges, line = profile(bench.real, bench.touches), dict.fromkeys(self.counts, 0.0)
        for count in self.counts:
            with contextlib.suppress(InputError):  # no format of that width works
                model = quantise_model(bench.real, ranges, **{self.key: count})
                line[count] = agreement(model, bench.real, bench.touches)
        few = min((count for count, share in line.items() if share >= AGREED), default=self.counts[-1])
        drawn = curve(self.xlabel, "share of local decisions as in float", line, {"agreement": line.values()})
        own = agreement(bench.model, bench.real, bench.touches)
        return Outcome(own, f"now {self.now(bench.config)}; {few} would do on these recordings", drawn)
