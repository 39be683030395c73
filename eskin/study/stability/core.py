"""Where the method fails, `eskin stability`: each failure mode a named experiment with a figure, a bound with
its reason, and a curve.

An experiment is a function of a ``Bench`` (a model on a ``Scene`` of recordings): an ``Experiment`` with a
disturbance, or another function.
``eskin.study.stability.table`` has a row for each. With a broken model or front end the same experiment must
report a failure. The tests check this for every mode (tests/support/broken_variants.py). A property that depends
on neither weights nor recordings (a width, a table entry) is not a mode; the tests check it.
"""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any, Literal, NamedTuple, Self

import numpy as np

from eskin.golden.core import AcceleratorConfig, InputError, Record, Result
from eskin.golden.data import Recordings
from eskin.golden.data.codes import UNEVEN
from eskin.golden.model import FloatModel, IntegerModel, Touches, pipeline, preprocess
from eskin.study.touch_ends import touches_and_ends
from eskin.training.datasets import scaling
from eskin.training.derive import find_onsets
from eskin.training.quantise import profile, quantise_model
from eskin.training.record import OTHER_SIGNALS

GROUPS = ("numeric", "stream", "sensor", "memory")

HARMLESS = 0.01
"""Accuracy that a disturbance within the tolerance of a sensor in use may cost."""
ONE_TAXEL_MEAN, ONE_TAXEL_WORST = 0.985, 0.94
"""Share of the undisturbed accuracy that must be left when one taxel is gone: mean over the taxels, and the
worst one."""
COMMON_OFFSET = 0.25
"""Offset of all features by a supply step, in standard deviations of the features."""


def sums_alone(config: AcceleratorConfig) -> AcceleratorConfig:
    """``config`` with the plain window sums as its only feature, before quantisation."""
    return config.replace(
        feature_kinds=("mean",), feature_scale="array", feature_shift=(), aligned_means=False
    )


def per_kind(own: np.ndarray, common: float, told_by: np.ndarray | None = None) -> np.ndarray:
    """(taxels) ``common``, or ``own`` where columns are of different kinds: where those of ``told_by`` (None: own)
    that move by a code differ by more than UNEVEN squared. A common deviation would be many times the whole range
    of a column of small codes."""
    told_by = own if told_by is None else told_by
    moving = told_by[told_by >= 1]
    mixed = len(moving) > 1 and moving.max() > UNEVEN**2 * moving.min()
    return np.maximum(own, 1e-6) if mixed else np.full(len(own), common)


# ---------------------------------------------------------------------- what an experiment works on
@dataclass(frozen=True, kw_only=True)
class Scene:
    """Recordings to disturb under a front end. The inputs of a disturbance depend on the front end only:
    positions of the touches, spread of the features, noise of the taxels at rest.

    config: the front end's. few: recordings (spread evenly) that the points of a curve take; the figure itself
    takes all. points: of a curve at most; 0 = all. turns: taxels that are disturbed in turn at most; 0 = all.
    seed: of all that is random in a disturbance.
    """

    config: AcceleratorConfig
    recordings: Recordings
    few: int = 100
    points: int = 0
    turns: int = 0
    seed: int = 1

    def __post_init__(self) -> None:
        # the frames that reach the chain are disturbed: a converter reads no others, a host sends no others
        scanned = self.recordings.scanned(self.config.sensor.scan_every)
        object.__setattr__(self, "recordings", scanned)

    def __getstate__(self) -> Record:
        """State for another process, which cannot read the keys of the memo."""
        return vars(self) | {"_memo": {}}

    def rng(self, *key: int) -> np.random.Generator:
        """Random numbers that depend on ``key`` and the seed alone."""
        return np.random.default_rng([self.seed, *key])

    def thin(self, levels: Sequence[float]) -> Sequence[float]:
        """The levels of a curve, the first ``points`` of them."""
        return levels[: self.points] if self.points else levels

    def remember(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """``make()``, once: what two modes share."""
        memo = vars(self).setdefault("_memo", {})
        if key not in memo:
            memo[key] = make()
        return memo[key]

    @cached_property
    def clean(self) -> Recordings:
        """The recordings up to the end of their first touch and a hop: what follows cannot change its
        decision. All, without an onset."""
        return self.recordings.until(touches_and_ends(self.config, self.recordings)[1])

    @cached_property
    def sample(self) -> Self:
        """The same on ``few`` of the clean recordings."""
        few = self.clean.subset(self.clean.evenly(self.few))
        return dataclasses.replace(self, recordings=few)

    @cached_property
    def touches(self) -> Touches:
        """First touches (with a completed step) of the clean recordings."""
        touches = touches_and_ends(self.config, self.clean)[0]
        touches = touches.take(touches.completed > 0)
        if not len(touches):
            raise InputError(f"stability: no touch was found in {self.recordings.source}; {OTHER_SIGNALS}")
        return touches

    @cached_property
    def onsets(self) -> np.ndarray:
        """Onset frame (from 1) of the first touch of each clean recording; 1 where the gate opens at once or
        no onset is found."""
        return np.maximum(find_onsets(self.config, self.clean), 1)

    @cached_property
    def touch_frames(self) -> np.ndarray:
        """Frames of the first touch of each clean recording: each different with ``window_mode`` whole, else all alike."""
        frames, touches = np.full(len(self.clean), self.config.last_frame), self.touches
        if touches.ended is not None:
            frames[touches.recording] = touches.ended - touches.start_frame + 1
        return frames

    @cached_property
    def sigma(self) -> np.ndarray:
        """(taxels) standard deviation of the window means, codes: one for all taxels, or with columns of different
        kinds (`per_kind`) one per taxel."""
        plain = sums_alone(self.config)
        touches = preprocess.find_touches(plain, self.clean)
        means = preprocess.real_features(plain, touches.sums, touches.lengths)
        own = means[touches.complete(plain.windows.steps)].std(axis=0)
        return per_kind(own, scaling(plain, means, touches.completed)[1])

    @cached_property
    def rest_noise(self) -> np.ndarray:
        """(taxels) standard deviation of a taxel at rest, codes, from frame to frame: the median over taxels and
        recordings, and of columns of different kinds (`per_kind`) over recordings. A recording's first 32 frames of
        the source count, whatever the onset."""
        ends = np.maximum(self.onsets - 1, max(32 // self.config.sensor.scan_every, 4))
        quiet = [self.clean.recording(i)[:end] for i, end in enumerate(ends)]
        # the difference of two frames has twice the variance of one; slow drift does not count
        spreads = [np.diff(part.astype(np.float64), axis=0).std(axis=0) for part in quiet if len(part) > 2]
        noise = np.array(spreads or [np.zeros_like(self.sigma)]) / np.sqrt(2)
        return per_kind(np.median(noise, axis=0), float(np.median(noise)), self.sigma)

    @property
    def live(self) -> list[int]:
        """Taxels that are not masked."""
        return self.config.sensor.live

    @property
    def in_turn(self) -> list[int]:
        """The taxels that are disturbed in turn."""
        return self.live[:: -(-len(self.live) // self.turns)] if self.turns else self.live


@dataclass(frozen=True, kw_only=True)
class Bench(Scene):
    """A quantised model on a scene, and its float network.

    long: steps of the longest run without a reset. flips: bit flips tried in each memory at most.
    """

    model: IntegerModel
    real: FloatModel
    long: int = 20000
    flips: int = 4000

    @cached_property
    def codes(self) -> np.ndarray:
        """Feature codes (n, K, D) of ``touches``."""
        return pipeline.feature_codes(self.model, self.touches)

    @cached_property
    def clean_accuracy(self) -> float:
        """Accuracy on the undisturbed recordings; a missing decision counts as wrong."""
        return float(np.mean(self.decide(self.clean) == self.clean.labels))

    def decided(
        self, recordings: Recordings, config: AcceleratorConfig | None = None
    ) -> tuple[Touches, pipeline.Decided]:
        """Every touch of recordings and its decisions. config: of another front end; None: the model's."""
        model = dataclasses.replace(self.model, config=config or self.config)
        touches = preprocess.find_touches(model.config, recordings)
        return touches, pipeline.decide_touches(model, touches)

    def decide(self, recordings: Recordings, config: AcceleratorConfig | None = None) -> np.ndarray:
        """Global decision of the first touch of each recording, -1 none."""
        touches, decided = self.decided(recordings, config)
        return pipeline.by_recording(decided.decision, touches.first_touch())


def rebuilt(
    recordings: Recordings, streams: Sequence[np.ndarray], which: Sequence[int] | np.ndarray | None = None
) -> Recordings:
    """``streams`` (frames, taxels) in place of the samples; stream i has the label of recording i, or of
    recording ``which[i]``.

    Samples are rounded and held within the code range, as a converter does.
    """
    which = np.arange(len(recordings)) if which is None else np.asarray(which)
    low, high = recordings.sample_format.min_code, recordings.sample_format.max_code
    samples = np.concatenate(
        [np.clip(np.rint(s), low, high) if s.dtype.kind == "f" else np.clip(s, low, high) for s in streams]
    )
    return dataclasses.replace(
        recordings,
        samples=samples.astype(np.int32),
        offsets=np.cumsum([0, *map(len, streams)]),
        labels=recordings.labels[which],
        groups={name: values[which] for name, values in recordings.groups.items()},
    )


class At(NamedTuple):
    """Where a disturbance acts: a scene, how strong it is, the taxels, the recording's place among the clean ones
    (of a quiet stretch: among them), its onset frame (from 1), separate random numbers."""

    scene: Scene
    level: float
    taxels: Sequence[int]
    place: int
    onset: int
    rng: np.random.Generator

    @property
    def frames(self) -> int:
        """Frames of the recording's touch."""
        return int(self.scene.touch_frames[self.place])


Change = Callable[[np.ndarray, At], np.ndarray]
"""A disturbance: (samples (frames, taxels), float, a copy; where) -> samples."""


def disturbed(scene: Scene, change: Change, level: float, taxels: Sequence[int]) -> Recordings:
    """The clean recordings of a scene, each through ``change``; random numbers depend on the recording's
    place alone."""
    clean = scene.clean
    streams = [
        change(
            clean.recording(i).astype(np.float32), At(scene, level, taxels, i, int(onset), scene.rng(3, i))
        )
        for i, onset in enumerate(scene.onsets)
    ]
    return rebuilt(clean, streams)


# ---------------------------------------------------------------------- what an experiment says
class Curve(Result):
    """Curve of an experiment: ``lines`` (name -> y at each x, in order of severity). The bound holds for the first line;
    log: the x axis is."""

    xlabel: str
    ylabel: str
    x: list[float]
    lines: dict[str, list[float]]
    log: bool


class Confirmed(Result):
    """A mode's golden case, or its experiment, in co-simulation."""

    bit_exact: bool
    recordings: int
    compared_values: int
    mismatches: int
    frames: int
    simulated_cycles: int
    mismatch_list: list[str]


class ModeResult(Result):
    """A failure mode in stability.json.

    room: how far the figure is from its bound. fails_at: where the curve leaves the bound. has_case: it has a golden case
    for the hardware. rtl: the comparison in co-simulation, if one was played.
    """

    name: str
    group: str
    value: float
    bound: float
    unit: str
    passed: bool
    sense: str
    reason: str
    room: float
    fails_at: float | None
    curve: Curve | None
    has_case: bool
    rtl: Confirmed | None
    worst_case: str
    measures: str
    wall_s: float


class NotRun(Result):
    """A mode that this model or call cannot have."""

    name: str
    group: str
    why: str


class Stability(Result):
    """stability.json; weakest: names of modes."""

    model: str
    data: str
    recordings: int
    clean_accuracy: float
    modes: list[ModeResult]
    not_run: list[NotRun]
    weakest: list[str]
    passed: bool
    wall_s: float


def curve(
    xlabel: str, ylabel: str, x: Iterable[float], lines: Mapping[str, Iterable[float]], log: bool = False
) -> Curve:
    """A curve of any numbers."""
    drawn = {name: [*map(float, line)] for name, line in lines.items()}
    return Curve(xlabel=xlabel, ylabel=ylabel, x=[*map(float, x)], lines=drawn, log=log)


@dataclass(frozen=True)
class Case:
    """A golden case for the hardware to confirm: recordings, and the model where it is not the model under
    test."""

    recordings: Recordings
    model: IntegerModel | None = None


@dataclass(frozen=True)
class Outcome:
    """Result of an experiment. worst_case: in words. case: for the hardware, if one can be played. rtl:
    the comparison in co-simulation, if one was played."""

    value: float
    worst_case: str
    curve: Curve | None = None
    case: Case | None = None
    rtl: Confirmed | None = None


Bound = float | Callable[[Any], float]


@dataclass(frozen=True)
class Mode:
    """A failure mode: how it is measured on a bench, its bound and why.

    run: the experiment; a word is the key of one that only the hardware can show
    (eskin/verbs/stability_job.py). at_most, at_least: the bound, one of the two: a number (of an accuracy:
    times the accuracy on undisturbed recordings), or a function of the bench. measures: the figure,
    where ``run`` is a shape and does not say it. needs: what a configuration must have, words of
    NEEDS.
    """

    group: str
    name: str
    run: Callable[[Any], Outcome] | str
    unit: str
    reason: str
    measures: str = ""
    _: dataclasses.KW_ONLY
    at_most: Bound | None = None
    at_least: Bound | None = None
    needs: str = ""

    def __post_init__(self) -> None:
        if (self.at_most is None) == (self.at_least is None) or self.group not in GROUPS:
            raise ValueError(f"mode '{self.name}': give one bound and one of {', '.join(GROUPS)}")

    @property
    def description(self) -> str:
        """Description of the measurement: the first sentence of the function's docstring unless the table
        has one."""
        if isinstance(self.run, str):
            return "Measured in co-simulation."
        return self.measures or (self.run.__doc__ or "").strip().split("\n\n")[0].replace("\n    ", " ")

    def bound(self, bench: Any) -> float:
        """The bound on a bench."""
        bound = self.at_most if self.at_least is None else self.at_least
        assert bound is not None  # as __post_init__ says
        if callable(bound):
            return bound(bench)
        relative = self.unit == "accuracy" and self.at_least is not None
        return round(bound * bench.clean_accuracy, 6) if relative else float(bound)

    def holds(self, value: float, bound: float) -> bool:
        """True if a figure is within a bound, the bound included."""
        return value <= bound if self.at_least is None else value >= bound

    def room(self, value: float, bound: float) -> float:
        """Share of the room left: 1 = perfect, 0 = at the bound, below 0 = beyond it."""
        if self.at_least is not None:
            return (value - bound) / max(1.0 - bound, 1e-9)
        return (bound - value) / bound if bound > 0 else (1.0 if value <= bound else -value)


def harmless(bench: Bench) -> float:
    """Bound of a harmless disturbance: the accuracy on the undisturbed recordings less HARMLESS."""
    return round(bench.clean_accuracy - HARMLESS, 6)


# ---------------------------------------------------------------------- a mode, judged
NEEDS: dict[str, tuple[Callable[[AcceleratorConfig], Any], str]] = {
    "onset": (lambda config: not config.opens_at_once, "the gate opens at once: no onset is looked for"),
    "detector": (
        lambda config: config.faults.fault_frames,
        "the fault detector is off; fault_frames of the configuration switches it on",
    ),
    "state": (lambda config: config.recurrent, "a linear cell has no state, no gates and no tables"),
    "weights": (lambda config: not config.is_forest, "trees have no weights"),
    "loadable": (lambda config: config.hardware.loadable, "weights are in ROM: there is nothing to write"),
}
"""Parts of a configuration that a mode may need, and the sentence for a mode that is not run without them."""


def why_not(mode: Mode, config: AcceleratorConfig, hardware: bool = True) -> str:
    """The reason why a mode is not run; empty if it is. hardware: modes that only the hardware can show may run."""
    if isinstance(mode.run, str) and not hardware:
        return "needs a co-simulation"
    return next((why for holds, why in map(NEEDS.__getitem__, mode.needs.split()) if not holds(config)), "")


def judge(
    mode: Mode, bench: Any, simulate: Callable[[str], Outcome] | None = None
) -> tuple[ModeResult, Case | None]:
    """The result of a mode, and its case for the hardware; ``simulate`` measures what
    has a key for it."""
    begin = time.perf_counter()
    bound = mode.bound(bench)
    if isinstance(mode.run, str):
        assert simulate is not None  # else it is not run
        outcome = simulate(mode.run)
    else:
        outcome = mode.run(bench)
    value, curve, fails_at = float(outcome.value), outcome.curve, None
    if curve:
        points = zip(curve.x, next(iter(curve.lines.values())), strict=True)
        fails_at = next((x for x, y in points if not mode.holds(y, bound)), None)
    record = ModeResult(
        name=mode.name,
        group=mode.group,
        value=value,
        bound=bound,
        unit=mode.unit,
        passed=bool(mode.holds(value, bound)),
        sense="at most" if mode.at_least is None else "at least",
        reason=mode.reason,
        room=mode.room(value, bound),
        fails_at=fails_at,
        curve=curve,
        has_case=outcome.case is not None,
        rtl=outcome.rtl,
        worst_case=outcome.worst_case,
        measures=mode.description,
        wall_s=round(time.perf_counter() - begin, 3),
    )
    return record, outcome.case


def weakest(records: Sequence[ModeResult], count: int = 3) -> list[ModeResult]:
    """The ``count`` modes with the least room to their bounds, failed ones first."""
    return sorted(records, key=lambda record: (record.passed, record.room))[:count]


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
        Disturbed are all ``recordings``; each of the ``taxels`` in turn; ``pairs`` of them, PAIRS at most,
        and as many at once as the level says; both ``ways``, level and minus level; the ``quiet`` stretches before
        each touch, in which no onset may be found.
    mean:
        The figure is the mean over all that are disturbed in turn, and not the worst. Both are taken from the same decisions.
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

    # -- recordings played
    def cases(self, scene: Scene, level: float | None = None) -> dict[str, Played]:
        """Every case at a level (None: the nominal one), by the disturbed part."""
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
    """Share of the local decisions of an integer network that a float network decides alike."""
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
