"""Front ends: candidates for all stages between the samples and the network, and the way in which they are
judged.

Candidates come from the recordings (`eskin.training.derive` measures noise, signal and lengths) and from the
presets of the same sensor. Each is judged by a linear classifier on the features that the INTEGER front end
gives, normaliser included, on recordings that the classifier has not seen:

- *classifier*: ridge regression of the classes' indicators on all windows of a touch at once, and the
  linear discriminants of its values. The penalty of a fold is the one of PENALTIES that does best on the
  OTHER folds. The normaliser's mean and scale come from all recordings looked at, without labels. If
  recordings end before the last window, the classifier also learns from copies of others that are cut short.
- *missed touches*: a recording without an onset, or without a completed window, counts as wrong.

The search (MOVES) varies one property at a time: every gate with two sets of windows on means, and gates that are not
far behind with all sets; kinds of feature and scales on the best SURVIVORS; windows that divide the touch, and kinds on
the best of them; then windows and thresholds again
around the best; then the best with fewer scans; then, starting from the front end that the rule takes,
cheaper neighbours as long as the rule takes one of them. A network may need more features than this
classifier, or fewer: `listed` gives the front ends that networks are tried on.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import solve

from eskin.choose.candidate import Candidate, ScoredCandidate, best_of, choose
from eskin.choose.cost import CostModel
from eskin.choose.first_touches import FirstTouches, cut_windows, first_touches
from eskin.choose.search import Move, Request, Search, search
from eskin.golden.core import EXTREMES, PRESETS, AcceleratorConfig, InputError, Progress, QFormat, Record
from eskin.golden.core.groups import Features
from eskin.golden.data import Recordings
from eskin.golden.data.codes import UNEVEN
from eskin.golden.model import normalise, real_features
from eskin.training.datasets import scaling
from eskin.training.derive import (
    CONVERTERS,
    STEPS,
    fits_sensor,
    for_recordings,
    measure_onset,
    sensor_sizes,
    settling_frames,
)
from eskin.training.formats import normaliser_constants
from eskin.training.judge import Decided, Learner, Rows, folds_of, judge, named
from eskin.training.level import is_level
from eskin.training.linear_fit import PENALTIES, cut_short, discriminants

SURVIVORS, FAR_BEHIND = 3, 3.0
"""Number of pairs of gate and windows on which kinds of feature are tried. A gate that is this many standard
errors behind the best is not tried with further windows."""

WHOLE, UNDOUBLED = ((20, 8), (12, 8), (8, 8), (2, 8), (1, 8)), 8
"""Windows that divide the touch: their number, and the most sums of each. A touch of 1 / UNDOUBLED of the longest
fills the store before the hop doubles."""

LENGTHS = ("touch_frames", "onset_mean_frames", "onset_check_frames", "rearm_frames", "fault_frames")
"""Fields in frames that keep their time in seconds where ``scan_every`` changes; the first one where windows follow."""

FOREST_WINDOWS = (1, 2, 8)
"""Numbers of windows that divide the touch, on which trees are tried."""

DESCENT = 16
"""Highest number of cheaper neighbours that are judged."""

RIVALS, TRIED_RECURRENT, HOPELESS = 2, 4, 0.25
"""Numbers of other gates, and of front ends in all, that a recurrent network is tried on. The accuracy by
which such a front end may be behind the one taken."""

JUDGED_ON, JUDGED_SAMPLES = 800, 1 << 25
"""Highest number of recordings for judging, and of their samples (frames x taxels): these fit into a minute
on two cores."""

INSIDE_ON = 400
"""Highest number of recordings for choices inside training parts, of which there are many."""

MEASURED_ON = 64
"""Recordings from which noise, signal and clip are measured."""

ENDS, LONGER = (0.05, 0.25, 0.5, 0.9), 1.1
"""Quantiles of the touches' lengths at which windows may end, and the smallest ratio of two neighbours."""

LENGTH_TELLS = 0.1
"""Margin above chance up to which the number of completed windows may predict the class."""

KEPT_BYTES = 3 << 28
"""Bytes of touches that are kept to cut other windows from them."""


# ---------------------------------------------------------------------- the classifier
def turned(x: np.ndarray) -> np.ndarray:
    """(n, at most n): ``x`` (n, features), turned if it has more columns than rows. Products of rows stay, and a ridge
    regression sees these alone."""
    return x if x.shape[1] <= len(x) else np.transpose(np.linalg.qr(x.T, mode="r"))


@dataclass(frozen=True, eq=False)
class KnownDecider:
    """Decisions that are made already: class (recordings), -1 none."""

    classes: np.ndarray

    def decide(self, rows: Rows) -> Decided:
        """As `eskin.training.judge.Decider.decide`."""
        return Decided.at_once(self.classes[rows], self.classes[rows])


@dataclass(frozen=True, eq=False)
class RidgeLearner:
    """Ridge regression, as the module describes it, in float.

    x: n rows of features, perhaps `turned`. owner: (n) recording of each row; the first row of a recording
    is its touch, further ones are copies of it, cut short, and serve for learning only. labels: of all recordings.
    """

    x: np.ndarray
    owner: np.ndarray
    labels: np.ndarray
    classes: int

    @classmethod
    def on(cls, x: np.ndarray, labels: np.ndarray, classes: int) -> RidgeLearner:
        """On one row of features for each recording."""
        return cls(x, np.arange(len(x)), labels, classes)

    def fit(
        self, parts: Sequence[Rows], seeds: Sequence[int], progress: Progress | None = None
    ) -> list[KnownDecider]:
        """As `eskin.training.judge.Learner.fit`. The penalty for a part is the one that does best on what the other
        parts leave out."""
        recordings, touch = np.unique(self.owner, return_index=True)
        targets = np.eye(self.classes)[self.labels[self.owner]]
        # the bias input is 3 and not 1: the bias then has a smaller weight, so the penalty hardly affects it
        inputs = turned(np.insert(self.x, 0, 3.0, axis=1))
        unit = (inputs**2).sum() / max(len(targets), 1)
        decided = np.full((len(parts), len(PENALTIES), len(self.labels)), -1)
        for number, part in enumerate(parts):
            train, left_out = np.isin(self.owner, part), ~np.isin(recordings, part)
            if not train.any():
                continue
            x, y = inputs[train], targets[train]
            penalised = x.T @ x + unit * np.reshape(PENALTIES, (-1, 1, 1)) * np.eye(x.shape[1])
            weights = solve(penalised, x.T @ y, assume_a="pos", check_finite=False)
            turn, bias = discriminants(x @ weights, y)
            values = inputs[touch[left_out]] @ weights @ turn + bias[:, None]
            decided[number][:, recordings[left_out]] = values.argmax(axis=2)
        right = (decided == self.labels).sum(axis=2)
        best = (right.sum(axis=0) - right).argmax(axis=1)
        return [KnownDecider(decided[number, row]) for number, row in enumerate(best)]


@dataclass(frozen=True, eq=False)
class EstimatorLearner:
    """A classifier of scikit-learn, made by ``make`` for each part. x: (n, features); owner, labels: as of
    `RidgeLearner`."""

    make: Callable[[], Any]
    x: np.ndarray
    owner: np.ndarray
    labels: np.ndarray

    def fit(
        self, parts: Sequence[Rows], seeds: Sequence[int], progress: Progress | None = None
    ) -> list[KnownDecider]:
        """As `eskin.training.judge.Learner.fit`."""
        recordings, touch = np.unique(self.owner, return_index=True)
        labels, deciders = self.labels[self.owner], []
        for part in parts:
            train, rest = np.isin(self.owner, part), touch[~np.isin(recordings, part)]
            decided = np.full(len(self.labels), -1)
            if train.any() and len(rest):
                x, known = self.x[train], labels[train]
                several = len(np.unique(known)) > 1
                found = self.make().fit(x, known).predict(self.x[rest]) if several else known[0]
                decided[self.owner[rest]] = found
            deciders.append(KnownDecider(decided))
        return deciders


def correct_without(tests: Sequence[Rows], learner: Learner, labels: np.ndarray) -> np.ndarray:
    """(recordings) 1 where ``learner`` decides correctly when each of ``tests`` is left out in turn."""
    everything = np.arange(len(labels))
    correct = judge(learner, folds_of(tests, [0], everything), labels).correct
    return correct.reindex(everything, fill_value=0.0).to_numpy()


def integer_features(config: AcceleratorConfig, touches: Any) -> np.ndarray:
    """Features (n, K x inputs): the codes of the integer front end as real values. The normaliser's constants
    come from these touches.

    Like quantisation, it removes fraction bits from the feature format if the normaliser's scale would not
    fit 16 bits.
    """
    means = real_features(config, touches.sums, touches.lengths)
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
    codes = normalise(filled, touches.sums, touches.completed, mean, scale, lengths=touches.lengths)
    return filled.formats.feature_format.to_real(codes).reshape(len(codes), -1)


def screened(config: AcceleratorConfig, learner: RidgeLearner, tests: Sequence[Rows]) -> ScoredCandidate:
    """A front end, judged by ridge regression; a recording without a row counts as wrong."""
    missed = len(learner.labels) - len(np.unique(learner.owner))
    return ScoredCandidate(
        Candidate.screened(config), correct_without(tests, learner, learner.labels), missed
    )


class Screen:
    """Features of front ends on one set of recordings; the touches of a gate are found once. longest: frames of the
    longest recording, of an archive of which these are a sample."""

    def __init__(self, recordings: Recordings, longest: int | None = None) -> None:
        self.recordings = recordings
        self.longest = longest or int(recordings.lengths.max())
        self._touches: dict[AcceleratorConfig, FirstTouches] = {}
        self._quarters: dict[AcceleratorConfig, np.ndarray] = {}

    def touches(self, config: AcceleratorConfig) -> FirstTouches:
        """First touches with the candidate's rest level and gate, long enough for windows of every
        candidate."""
        network = config.network.replace(decision="vote")
        plain = dataclasses.replace(config, features=Features(), network=network)
        if config.follows_touch:  # every division of a touch needs the same frames
            plain = plain.replace(hop=1, window=2, steps=1, store_per_window=2, name="gate")
        elif config.windows.window_mode == "free":
            hop = int(min(self.recordings.lengths.max(), 65535))
            plain = plain.replace(hop=hop, window=2 * hop, steps=1, name="gate")
        touches = self._touches.pop(plain, None)
        if touches is None or touches.reach < config.last_frame:
            touches = first_touches(plain, self.recordings)
            if len(touches):
                longest = self.ends(touches, config.sensor.scan_every)[-1]
                touches = touches.within(max(longest, config.last_frame))
        self._touches[plain] = touches  # the oldest goes first; it is found again at the next request
        while len(self._touches) > 1 and sum(idle.nbytes for idle in self._touches.values()) > KEPT_BYTES:
            del self._touches[next(iter(self._touches))]
        return touches

    def ends(self, touches: FirstTouches, scan_every: int = 1) -> list[int]:
        """Frames after the onset at which windows may end, ascending: 95, 75, 50 and 10 % of the recordings
        are at least that long."""
        lengths = -(-self.recordings.lengths[touches.recording] // scan_every) - touches.onset_frame
        ends: list[int] = []
        for end in np.quantile(lengths, ENDS, method="lower"):
            if not ends or end >= LONGER * ends[-1]:
                ends.append(int(end))
        return ends

    def length_tells(self, config: AcceleratorConfig, rows: np.ndarray) -> bool:
        """True if the number of windows from `gates` that the recordings ``rows`` complete, in quarters,
        predicts the class; of windows that divide the touch its length, by which extremes grow. A network would
        then learn when recordings were stopped. Each recording is predicted from the others."""
        if config.follows_touch:
            touches = self.touches(config)
            frames = np.zeros(len(self.recordings), dtype=np.int64)
            frames[touches.recording] = [ended.end - ended.start + 1 for ended in touches.ended]
            self._quarters[config] = 4 * frames // (frames.max() + 1)
        if config not in self._quarters:
            return False
        quarters, labels = self._quarters[config][rows], self.recordings.labels[rows]
        table = np.zeros((quarters.max(initial=0) + 1, len(self.recordings.class_names)), dtype=int)
        np.add.at(table, (quarters, labels), 1)
        others = table[quarters]
        others[np.arange(len(rows)), labels] -= 1
        right = (others.argmax(axis=1) == labels).mean()
        return bool(right > table.sum(axis=0).max() / len(rows) + LENGTH_TELLS)

    def features(self, config: AcceleratorConfig) -> tuple[np.ndarray, np.ndarray]:
        """(recordings with a completed window, their features), followed by copies of some of them that are
        cut short; none if features hardly move, because no normaliser can scale them."""
        config = config.replace(feature_shift=(), aligned_means=False)  # the network's arithmetic sets these
        touches = cut_windows(config, self.touches(config))
        rows = np.flatnonzero(touches.completed > 0)
        if len(rows):
            try:
                x = integer_features(config, touches)[rows]
                again, ends = cut_short(touches.completed[rows], config.windows.steps)
                held = np.arange(x.shape[1]) // config.inputs < ends[:, None]
                return touches.recording[rows][np.r_[: len(rows), again]], np.r_[x, x[again] * held]
            except InputError:
                pass
        return np.zeros(0, dtype=np.int64), np.zeros((0, 1))

    def judged(self, config: AcceleratorConfig, tests: Sequence[Rows]) -> ScoredCandidate:
        """Judge one front end, leaving out ``tests`` in turn."""
        owner, x = self.features(config)
        labels, classes = self.recordings.labels, len(self.recordings.class_names)
        return screened(config, RidgeLearner(x, owner, labels, classes), tests)

    def gates(self, base: Record, progress: Callable[[int, int], None]) -> list[list[AcceleratorConfig]]:
        """Candidates with means alone. For each gate: all windows, first those of the longest touch that
        nearly all recordings hold and those of the usual pace. Then one entry for each preset. No label is
        used."""
        recordings, by_gate = self.recordings, list[list[AcceleratorConfig]]()
        rules = gates(recordings.subset(recordings.evenly(MEASURED_ON)), base)
        for number, gate in enumerate(rules):
            progress(number, len(rules))
            single = for_recordings(AcceleratorConfig(), recordings, **base, **gate, hop=1, window=2, steps=1)
            touches = self.touches(single)
            if len(touches) >= 2:
                ends, at_once = self.ends(touches), gate["onset"] == "immediate"
                sets = window_sets(ends, recordings.sample_rate_hz, at_once)
                by_gate.append([single.replace(**windows) for windows in sets])
                held = np.zeros(len(recordings), dtype=np.int64)
                held[touches.recording] = recordings.lengths[touches.recording] - touches.onset_frame
                for config in by_gate[-1]:
                    if config.last_frame > ends[0]:
                        self._quarters[config] = 4 * np.minimum(held, config.last_frame) // config.last_frame
        return by_gate + [
            [for_recordings(PRESETS[name], recordings, name=name)]
            for name in CONVERTERS
            if fits_sensor(PRESETS[name], recordings)
        ]

    def knee(self, config: AcceleratorConfig) -> int:
        """Two to this power is an eighth of the median sum of a taxel's deviations over a touch, codes: below
        it the integral is linear."""
        sums = [np.abs(part.sum(axis=0, dtype=np.int64)) for part in self.touches(config).touched]
        typical = float(np.median(sums)) if sums else 1.0
        return int(np.clip(round(np.log2(max(typical, 1.0))) - 3, 0, 24))


class FrontEnds:
    """The front ends of an archive, to be searched on all recordings looked at, and again on parts of them.

    recordings: the sampled recordings. looked_at: their numbers in the archive. inside: those of them from
    which parts are taken, at most INSIDE_ON.

    Raises
    ------
    InputError
        As ``sensor_sizes``.
    """

    def __init__(self, recordings: Recordings, progress: Progress | None = None):
        self._base, self.reasons = sensor_sizes(recordings)
        low, high = np.quantile(
            recordings.samples[:: max(1, recordings.frames // 100_000)], (0.01, 0.99), axis=0
        )
        moves = (high - low)[high > low]
        self.scales: tuple[str, ...] = ("array", "taxel")
        if len(moves) and (uneven := moves.max() / moves.min()) > UNEVEN:
            self._base["feature_scale"] = "taxel"
            # beyond that ratio one scale leaves the smallest fewer than 2 of a feature's 8 bits
            self.scales = ("array", "taxel") if uneven <= UNEVEN**2 else ("taxel",)
            trial = "is tried first" if len(self.scales) > 1 else "is the only one tried"
            self.reasons.append(f"taxels differ by {uneven:.3g} in range, so one scale per taxel {trial}")
        most = JUDGED_SAMPLES * len(recordings) // (recordings.frames * recordings.taxels)
        most = max(8 * len(recordings.class_names), most)
        self.looked_at = recordings.evenly(min(len(recordings), JUDGED_ON, most))
        self.recordings = recordings.subset(self.looked_at)
        self.inside = self.recordings.evenly(INSIDE_ON)
        self.screen = Screen(self.recordings, int(recordings.lengths.max()))
        self.progress = progress
        self._features: dict[AcceleratorConfig, tuple[np.ndarray, np.ndarray]] = {}

    @cached_property
    def by_gate(self) -> list[list[AcceleratorConfig]]:
        """Result of `Screen.gates`."""
        return self.screen.gates(self._base, named(self.progress, "onset rules looked at"))

    def part(self, numbers: np.ndarray) -> np.ndarray:
        """The sampled recordings that represent a part of the archive."""
        return self.inside[np.isin(self.looked_at[self.inside], numbers)]

    def features(self, config: AcceleratorConfig, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(places in ``rows`` of recordings with a completed window, their features, perhaps `turned`), from
        `Screen.features`. The values that parts need are cached."""
        if config in self._features and len(rows) <= len(self.inside):
            touched, x = self._features[config]
        else:
            touched, x = self.screen.features(config)
            held = np.isin(touched, self.inside)
            self._features[config] = touched[held], turned(x[held]).astype(np.float32)
        seen = np.isin(touched, rows)
        return np.searchsorted(rows, touched[seen]), x[seen].astype(float)


# ---------------------------------------------------------------------- the search
@dataclass(eq=False, kw_only=True)
class FrontEndSearch(Search):
    """The search of a front end.

    rows: of the sampled recordings. folds: left out of them in turn. brief: three sets of windows per gate. descent:
    number of cheaper neighbours that may still be judged.
    """

    front_ends: FrontEnds
    rows: np.ndarray
    folds: Sequence[np.ndarray]
    brief: bool = False
    descent: int = DESCENT

    @cached_property
    def by_gate(self) -> list[list[AcceleratorConfig]]:
        """Front ends with means alone, for each gate; the first two have the most usual windows."""
        screen = self.front_ends.screen
        by_gate = [
            [config for config in configs if not screen.length_tells(config, self.rows)]
            for configs in self.front_ends.by_gate
        ]
        if not self.brief:
            return by_gate
        return [list(dict.fromkeys([*configs[:2], *_longer(configs), configs[-1]])) for configs in by_gate]

    def judge(self, config: AcceleratorConfig) -> ScoredCandidate:
        """Cross-validate a front end."""
        owner, x = self.front_ends.features(config, self.rows)
        recordings = self.front_ends.recordings
        labels, classes = recordings.labels[self.rows], len(recordings.class_names)
        return screened(config, RidgeLearner(x, owner, labels, classes), self.folds)

    def ranked(self, configs: Iterable[AcceleratorConfig] | None = None) -> list[ScoredCandidate]:
        """Front ends that were judged, best first. configs: None: all."""
        wanted = self.tried if configs is None else self.scored(map(Candidate.screened, configs))
        return sorted(wanted, key=lambda one: -one.accuracy)

    def near(self) -> list[AcceleratorConfig]:
        """All windows of gates that are not far behind."""
        best, *_ = self.ranked(config for configs in self.by_gate for config in configs[:2])

        def is_near(config: AcceleratorConfig) -> bool:
            (one,) = self.ranked([config])
            return is_level(best.correct, one.correct, FAR_BEHIND)

        close = [configs for configs in self.by_gate if any(map(is_near, configs[:2]))]
        return [config for configs in close for config in configs]


def usual_windows(search: FrontEndSearch) -> Request:
    """Every gate with two sets of windows."""
    return _screened(config for configs in search.by_gate for config in configs[:2])


def further_windows(search: FrontEndSearch) -> Request:
    """All windows of the gates that are not far behind."""
    return _screened(search.near())


def kinds_of_feature(search: FrontEndSearch) -> Request:
    """Kinds of feature and scales on the best SURVIVORS."""
    front_ends = search.front_ends
    ahead = [one.candidate.front_end for one in search.ranked(search.near())[:SURVIVORS]]
    return _screened(
        config for at in ahead for config in features(at, front_ends.screen.knee(at), front_ends.scales)
    )


def windows_of_the_touch(search: FrontEndSearch) -> Request:
    """Means of windows that divide the whole touch, on the best SURVIVORS gates."""
    gates = first_of_gates(scored.candidate.front_end for scored in search.ranked(search.near()))
    screen = search.front_ends.screen
    return _screened(config for at in gates[:SURVIVORS] for config in whole(at, screen.longest))


def kinds_of_the_touch(search: FrontEndSearch) -> Request:
    """Kinds of feature and scales on the best two of windows that divide the whole touch; extremes where its length
    does not tell the class."""
    screen, scales = search.front_ends.screen, search.front_ends.scales
    dividing = [tried.candidate.front_end for tried in search.ranked() if tried.config.follows_touch]
    return _screened(
        config
        for at in dividing[:2]
        for config in features(at, 0, scales, extremes=not screen.length_tells(at, search.rows))
    )


def around_the_best(search: FrontEndSearch) -> Request:
    """Other windows and thresholds of the best."""
    return _screened(_around(best_of(search.tried).candidate.front_end, search.by_gate))


def fewer_scans(search: FrontEndSearch) -> Request:
    """The choice of the rule with fewer scans; the best, too, unless the search is brief; and the choice among windows
    that divide the touch."""
    chosen = [choose(search.tried, search.prices)] + [best_of(search.tried)] * (not search.brief)
    if dividing := [scored for scored in search.tried if scored.config.follows_touch]:
        chosen.append(choose(dividing, search.prices))
    return _screened(
        config
        for scored in dict.fromkeys(chosen)
        for config in _fewer_scans(scored.candidate.front_end, search.by_gate)
    )


def cheaper_neighbours(search: FrontEndSearch) -> Request:
    """Cheaper neighbours of the one that the rule takes."""
    prices, known = search.prices, {one.candidate for one in search.tried}
    at = choose(search.ranked(), prices).candidate
    neighbours = map(Candidate.screened, _smaller(at.front_end))
    cheaper = [
        one for one in neighbours if one not in known and prices.price(one.config) < prices.price(at.config)
    ][: search.descent]
    search.descent -= len(cheaper)
    return Request(cheaper)


def _screened(configs: Iterable[AcceleratorConfig]) -> Request:
    return Request([*map(Candidate.screened, configs)])


MOVES: tuple[Move[FrontEndSearch], ...] = (
    Move("usual windows of every gate", usual_windows),
    Move("further windows", further_windows),
    Move("kinds of feature", kinds_of_feature),
    Move("windows that divide the touch", windows_of_the_touch),
    Move("kinds of feature of these", kinds_of_the_touch),
    Move("windows and thresholds around the best", around_the_best),
    Move("fewer scans", fewer_scans),
    Move("cheaper neighbours", cheaper_neighbours, repeats=DESCENT),
)
"""Moves of the search of a front end."""

BRIEF_MOVES = tuple(move for move in MOVES if move.request not in (around_the_best, cheaper_neighbours))


def search_front_ends(state: FrontEndSearch, progress: Progress | None = None) -> list[ScoredCandidate]:
    """The front ends judged, best first, in the order of search that the module describes."""

    def judged(requests: Mapping[int, Request]) -> dict[int, list[ScoredCandidate]]:
        outcomes = list[ScoredCandidate]()
        for request in requests.values():
            for number, one in enumerate(request.candidates, len(state.tried)):
                outcomes.append(state.judge(one.front_end))
                if progress:
                    progress("front ends judged", number + 1, 0)
        return {0: outcomes}

    search([state], BRIEF_MOVES if state.brief else MOVES, judged)
    return state.ranked()


@dataclass(frozen=True)
class Listed:
    """Front ends that networks are tried on.

    taken: the one that the rule takes. smaller: that one, the most accurate one, and the one that the rule
    takes for each smaller number of kinds; the cheapest first. rivals: the most accurate ones with other
    gates. for_trees: FOREST_WINDOWS that divide the touch, of the gate that suits these best. during: the same without
    windows that divide the touch; None: there are none of these.
    """

    taken: AcceleratorConfig
    smaller: tuple[AcceleratorConfig, ...]
    rivals: tuple[AcceleratorConfig, ...] = ()
    for_trees: tuple[AcceleratorConfig, ...] = ()
    during: Listed | None = None

    @classmethod
    def alone(cls, config: AcceleratorConfig) -> Listed:
        """The list for a front end that the user named."""
        return cls(config, (config,))

    @property
    def for_recurrent(self) -> list[AcceleratorConfig]:
        """TRIED_RECURRENT at most, the one taken first. A recurrent cell decides during the touch, and can keep an
        extreme in its state: with extremes pvdf lost 3 points at a new speed."""
        at = self.during or self
        order = dict.fromkeys((at.taken, at.smaller[0], *at.rivals, *at.smaller))
        plain = [on for on in order if {*EXTREMES}.isdisjoint(on.features.feature_kinds)]
        return (plain or [*order])[:TRIED_RECURRENT]


def listed(judged: Sequence[ScoredCandidate], prices: CostModel) -> Listed:
    """The front ends to try networks on; none is more than HOPELESS behind the one taken.

    A linear classifier sees all windows at once, so it can remove a level that confuses a recurrent network,
    and may need more kinds of feature than such a network.
    """
    taken, best = choose(judged, prices), best_of(judged)
    near = [one for one in judged if taken.accuracy - one.accuracy <= HOPELESS]
    groups = [[one for one in near if one.config.kinds == kinds] for kinds in range(1, taken.config.kinds)]
    groups += [[one for one in near if one.accuracy == best.accuracy], [taken]]
    smaller = [choose(group, prices) for group in groups if group]
    smaller.sort(key=lambda one: prices.price(one.config))
    best_of_gate: dict[Any, AcceleratorConfig] = {}
    for scored in sorted(near, key=lambda scored: -scored.accuracy):
        best_of_gate.setdefault(_kind_of_gate(scored), scored.candidate.front_end)
    best_of_gate.pop(_kind_of_gate(taken))
    unique = dict.fromkeys(one.candidate.front_end for one in smaller)
    others = [scored for scored in judged if not scored.config.follows_touch]
    during = listed(others, prices) if 0 < len(others) < len(judged) else None
    rivals = tuple(best_of_gate.values())[:RIVALS]
    return Listed(taken.candidate.front_end, tuple(unique), rivals, _for_trees(judged), during)


def _for_trees(judged: Sequence[ScoredCandidate]) -> tuple[AcceleratorConfig, ...]:
    """Means of FOREST_WINDOWS of the gate on which windows that divide the touch are best, and the same with activity,
    which a linear classifier of these has little use for."""
    dividing = [scored for scored in judged if scored.config.follows_touch]
    if not dividing:
        return ()
    best = best_of(dividing).candidate.front_end
    densest = min(scored.config.sensor.scan_every for scored in dividing)
    means = [
        valid(scored.candidate.front_end, feature_scale=best.features.feature_scale)
        for scored in sorted(dividing, key=lambda scored: scored.config.windows.steps)
        if _same_gate(scored.candidate.front_end, best)
        and scored.config.windows.steps in FOREST_WINDOWS
        and scored.config.features.feature_kinds == ("mean",)
        and scored.config.sensor.scan_every == densest
    ]
    active = [on and valid(on, feature_kinds=("mean", "activity"), activity_rule="change") for on in means]
    return tuple(on for on in dict.fromkeys(means + active) if on)


def _kind_of_gate(one: ScoredCandidate) -> tuple[str, bool] | str:
    config = one.candidate.front_end
    return "preset" if config.name in PRESETS else (config.rest_level.rest, config.opens_at_once)


def _longer(configs: Sequence[AcceleratorConfig]) -> list[AcceleratorConfig]:
    """Windows of a gate that have STEPS steps and end later than the first ones."""
    return [one for one in configs if one.windows.steps == STEPS and one.last_frame > configs[0].last_frame]


def _around(best: AcceleratorConfig, by_gate: list[list[AcceleratorConfig]]) -> Iterator[AcceleratorConfig]:
    """The best with all windows of its gate, and with other thresholds."""
    tried: list[AcceleratorConfig | None] = []
    if best.windows.window_mode == "free":
        tried += [
            with_hop(best, config.windows.hop, steps=config.windows.steps)
            for configs in by_gate
            if _same_gate(configs[0], best)
            for config in configs
        ]
    if best.onset_rule.onset == "baseline":
        threshold = best.onset_rule.onset_threshold
        tried += [valid(best, onset_threshold=max(1, round(threshold * factor))) for factor in (0.7, 1.4)]
    return filter(None, tried)


def _smaller(at: AcceleratorConfig) -> Iterator[AcceleratorConfig]:
    """Neighbours with half the scans, fewer kinds, two thirds of the windows, windows of two thirds the length."""
    windows, kinds = at.windows, at.features.feature_kinds
    tried = [scanning_half(at)]
    if len(kinds) > 1:
        tried += [valid(at, feature_kinds=tuple(k for k in kinds if k != kind)) for kind in kinds]
    if windows.window_mode == "free":
        tried.append(valid(at, steps=max(2 * windows.steps // 3, 1)))
        tried.append(with_hop(at, max(2 * windows.hop // 3 // 8 * 8, 4)))
    return filter(None, tried)


def first_of_gates(ons: Iterable[AcceleratorConfig], scans: bool = False) -> list[AcceleratorConfig]:
    """The first front end of each gate, and if ``scans`` of each ``scan_every``."""
    first: dict[Any, AcceleratorConfig] = {}
    for on in ons:
        first.setdefault((on.rest_level, on.onset_rule, scans and on.sensor.scan_every), on)
    return [*first.values()]


def whole(at: AcceleratorConfig, longest: int) -> list[AcceleratorConfig]:
    """``at`` with means of each of WHOLE windows that divide a touch of ``longest`` frames of the source at most."""
    frames = min(-(-longest // at.sensor.scan_every), 65535)
    found = []
    for steps, sums in WHOLE:
        # a touch ends after at least a hop of quiet frames
        hop = max(min(frames // (steps * sums * UNDOUBLED), at.onset_rule.rearm_frames), 1)
        windows = dict(hop=hop, window=2 * hop, steps=steps, store_per_window=sums)
        # a frame more, so that no touch of the recordings is cut
        length = dict(touch_frames=max(min(frames + 1, 65535), hop * steps), activity_block=1)
        found.append(valid(at, window_mode="whole", feature_kinds=("mean",), **windows, **length))
    return [config for config in found if config]


def scanning_half(at: AcceleratorConfig) -> AcceleratorConfig | None:
    """``at`` with half the scans: quantities in frames keep their time in seconds. A rest level for an onset
    is the mean of as many frames as before, because the noise of a frame stays the same. None if the hop or
    the fault detector's block cannot be halved, or if windows begin before the onset."""
    windows, features, rest = at.windows, at.features, at.rest_level
    odd = windows.hop % 2 and not at.follows_touch
    if windows.window_mode == "touch" or odd or at.faults.fault_frames == 2:
        return None
    hop, block = max(windows.hop // 2, 1), features.activity_block
    if block > 1:
        block = block_of(hop) if block % 2 else block // 2
    return valid(
        at,
        scan_every=2 * at.sensor.scan_every,
        rest_frames=-(-rest.rest_frames // 2) if at.opens_at_once else rest.rest_frames,
        **{name: -(-at.value(name) // 2) for name in LENGTHS[not at.follows_touch :]},
        hop=hop,
        window=2 * hop,
        activity_block=block,
        integral_knee=max(features.integral_knee - 1, 0),  # sums of half the frames
    )


def _fewer_scans(
    best: AcceleratorConfig, by_gate: list[list[AcceleratorConfig]]
) -> Iterator[AcceleratorConfig]:
    """The best at every ``scan_every``, also with hops of whole eighths. Means of fewer frames are noisier,
    and a single frame has more weight in them. So each is also tried with every threshold of gates of its
    kind, and with deviations clipped at twice or three times the threshold."""
    rests, onset, hop = best.rest_level, best.onset_rule.onset, best.windows.hop
    rules = [(best.onset_rule.onset_threshold, rests.clip)]
    if onset == "baseline":
        alike = [
            configs[0].onset_rule.onset_threshold
            for configs in by_gate
            if (configs[0].rest_level.rest, configs[0].onset_rule.onset) == (rests.rest, onset)
        ]
        thresholds = dict.fromkeys([best.onset_rule.onset_threshold, *alike])
        rules = [
            (threshold, clip)
            for threshold in thresholds
            for clip in (rests.clip, 2 * threshold, 3 * threshold)
        ]
    for eighths in dict.fromkeys((hop, max(hop - hop % 8, 1))):
        for threshold, clip in rules:
            at = valid(best, onset_threshold=threshold, clip=min(clip, 65535))
            if at and eighths != hop:
                at = with_hop(at, eighths)
            while at and (at := scanning_half(at)):
                yield at


def _same_gate(one: AcceleratorConfig, other: AcceleratorConfig) -> bool:
    def gate(config: AcceleratorConfig) -> tuple:
        rule, rest = config.onset_rule, config.rest_level
        threshold = rule.onset_threshold if rule.onset == "baseline" else 0
        return rule.onset, rest.rest, rest.rest_frames, rest.clip, threshold, config.windows.window_mode

    return gate(one) == gate(other)


# ---------------------------------------------------------------------- candidates
def gates(recordings: Recordings, base: Record) -> list[Record]:
    """Rest level and gate of each candidate: open at once with and without the first frames' level
    subtracted, onset rules on a tracked level (half, once and twice the threshold between noise and signal)
    and on an initial one."""
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


def window_sets(ends: Sequence[int], rate: float, at_once: bool) -> list[dict[str, int]]:
    """Hop, window and steps: 20 and 10 windows over all, half and a quarter of the frames ``ends[0]``, over
    all of each other of ``ends``, and at the usual pace (48 ms after an onset, 200 ms where the gate opens at
    once). The first two are all of ``ends[0]`` and the usual pace."""
    common, *longer = ends
    pace = max(round((0.2 if at_once else 0.048) * rate), 4)
    fit = -(-common // (STEPS + 1))
    tried = [(common, fit, STEPS), (common, min(pace, fit), STEPS)]
    for steps in (STEPS, STEPS // 2):
        tried += [(end, -(-end // (steps + 1)), steps) for end in longer]
        fit = -(-common // (steps + 1))
        tried += [(common, hop, steps) for hop in (fit, fit // 2, fit // 4, min(pace, fit))]
    sets = []
    for available, hop, steps in tried:
        hop = int(np.clip(hop, 1, 65535))
        # blocks of activity divide a hop. A hop is rounded up, which takes fewer windows: rounded down, they
        # would not reach the end
        hop += -hop % (8 if hop >= 32 else 4 if hop >= 8 else 1)
        if available < 2 * hop:
            continue
        steps = max(1, min(steps, available // hop - 1))
        sets.append(dict(hop=hop, window=2 * hop, steps=steps))
    if not sets:
        sets = [dict(hop=1, window=2, steps=max(1, min(STEPS, common - 1)))]
    return [windows for index, windows in enumerate(sets) if windows not in sets[:index]]


def block_of(hop: int) -> int:
    """The longest block of activity, frames, that fits a hop four times: whole blocks, 64 frames at most."""
    return max(block for block in range(1, min(64, max(hop // 4, 1)) + 1) if hop % block == 0)


def with_hop(config: AcceleratorConfig, hop: int, **changes: Any) -> AcceleratorConfig | None:
    """`valid` with another hop, windows twice as long, and blocks of activity that fit them."""
    block = block_of(hop) if config.features.activity_block > 1 else 1
    return valid(config, hop=hop, window=2 * hop, activity_block=block, **changes)


def features(
    config: AcceleratorConfig, knee: int, scales: Sequence[str], *, extremes: bool = True
) -> list[AcceleratorConfig]:
    """``config`` with every kind of feature that the number of inputs allows, on each of the scales."""
    block = block_of(config.windows.hop)
    small, large, middle = ("change", 1), ("sum", block), ("change", block)
    kinds: list[tuple[tuple[str, ...], tuple[str, int]]] = [(("mean",), ("sum", 1))]
    # in windows that divide the touch, activity makes a lost taxel worse
    if config.windows.window % 2 == 0 and config.windows.window_mode == "free":
        kinds += [(("mean", "activity"), rule) for rule in (small, large, middle)]
        kinds += [(("activity",), small)]
        kinds += [(("mean", "activity", "integral"), rule) for rule in (small, large)]
    if extremes:
        kinds += [(("mean", *EXTREMES), ("sum", 1))]
    if not config.follows_touch:
        kinds += [(("mean", "integral"), ("sum", 1))]
    candidates = []
    for kind, (rule, length) in kinds:
        changes: Record = dict(feature_kinds=kind, activity_rule=rule, activity_block=length)
        if "integral" in kind:
            changes["integral_knee"] = knee
        tried = (valid(config, feature_scale=scale, **changes) for scale in scales)
        candidates += [config if one == config.replace(name="derived") else one for one in tried if one]
    return candidates


def valid(config: AcceleratorConfig, **changes: Any) -> AcceleratorConfig | None:
    """``config`` with ``changes`` and the name derived; None if no accelerator has these sizes (for example
    too many inputs)."""
    try:
        return config.replace(name="derived", **changes)
    except InputError:
        return None
