"""Other methods on the touches and folds of our networks, examples/thesis for one: their accuracy on unseen
recordings, and their cost.

A *run* is one fold with one seed: trained on the other folds, judged on this one. A recording without a
touch, or without a completed window, counts as wrong. Seconds of training and microseconds of a decision, one
touch at a time, are of the processor, in one thread.
"""

import inspect
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from eskin.golden.core import (
    AcceleratorConfig,
    InputError,
    Progress,
    Record,
    check_target,
    content_key,
    write_json,
)
from eskin.golden.data import Recordings
from eskin.golden.model import FloatModel, Touches, decide_touches, real_by_input, real_features
from eskin.jobs import Jobs
from eskin.memo import Memo, code_version
from eskin.study.touch_ends import touches_and_ends
from eskin.training import LEARNING
from eskin.training.datasets import Datasets, scaling
from eskin.training.fit import fit_networks, one_thread
from eskin.training.judge import Decided, Rows, folds_of, judge
from eskin.training.recipe import Recipe
from eskin.training.splits import check_split, split_folds

FLOAT_BYTES = 4
"""Bytes of a parameter."""
TIMED, TIMED_S = 40, 0.5
"""Decisions of a run that are timed at most, and seconds that this may take."""


@dataclass(frozen=True, eq=False)
class Scene:
    """First touches with a completed window at least, n of them; row i of everything is one touch, from the
    onset to the end of the last window, with the resting level removed.

    recordings, config: where they come from. touches: their windows. where (recordings): row of each
    recording's touch, -1 none. means (n, K, D): what windows say, before mean and scale are removed. labels
    (n). known: what methods found once for all their runs.
    """

    recordings: Recordings
    config: AcceleratorConfig
    touches: Touches
    where: np.ndarray
    means: np.ndarray
    labels: np.ndarray
    known: Record = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, recordings: Recordings, config: AcceleratorConfig) -> "Scene":
        """The touches that ``config`` finds.

        Raises
        ------
        InputError
            No recording has a touch.
        """
        touches = touches_and_ends(config, recordings)[0]
        touches = touches.take(touches.completed > 0)
        if not len(usable := touches.recording):
            raise InputError(
                f"{recordings.source}: no recording has a touch with a completed window; use a smaller onset_threshold or window"
            )
        where = np.full(len(recordings), -1)
        where[usable] = np.arange(len(usable))
        means = real_features(config, touches.sums, touches.lengths)
        return cls(recordings, config, touches, where, means, recordings.labels[usable])

    @property
    def classes(self) -> int:
        """Classes of the task."""
        return len(self.recordings.class_names)

    def windows(self, part: np.ndarray) -> np.ndarray:
        """(n, K, D): windows of all touches with the mean and scale of the rows ``part`` alone; 0 where there
        is no window or a fault."""
        seen = self.touches.take(part)
        mu, sigma = scaling(self.config, self.means[part], seen.completed, seen.faults)
        windows = (self.means - real_by_input(self.config, mu)) / real_by_input(self.config, sigma)
        if self.touches.faults is not None:
            windows[self.touches.faults] = 0.0
        windows[np.arange(self.config.windows.steps) >= self.touches.completed[:, None]] = 0.0
        return windows


@dataclass(frozen=True)
class Fitted:
    """A classifier and its cost.

    decide: rows of the scene -> their classes, (rows). parameters: numbers that it keeps. multiplies: of one
    decision, from windows of the touch on; normalisation, exponentials and comparisons are not counted. alone:
    decides one row with all that a decision takes, where ``decide`` knows parts of it already.
    """

    decide: Callable[[np.ndarray], np.ndarray]
    parameters: int
    multiplies: int
    alone: Callable[[int], Any] | None = None


@dataclass(frozen=True)
class Method:
    """A way to fit classifiers to touches of a scene. hardware: eskin can build it. one_seed: further seeds
    would change nothing, or cost too much."""

    name: str
    label: str
    hardware: ClassVar[bool] = False
    one_seed: ClassVar[bool] = False

    @property
    def content(self) -> str:
        """Key of all that its results depend on beside `LEARNING`: the code in its folder, which may be of another
        project, its fields and the files that they name."""
        code = code_version(str(Path(inspect.getfile(type(self))).parent))
        return content_key(
            code, *(each for each in vars(self).values() if isinstance(each, str | int | Path))
        )

    def fit(self, scene: Scene, parts: Sequence[np.ndarray], seed: int) -> list[Fitted]:
        """A classifier for each of ``parts``, rows of the scene: it sees windows and labels of these alone."""
        raise NotImplementedError


@dataclass(frozen=True)
class Network(Method):
    """A recurrent network in float, trained by our recipe or another; all parts at once.

    ``changed``: configuration -> the configuration that the network has, and its recipe.
    """

    changed: Callable[[AcceleratorConfig], tuple[AcceleratorConfig, Recipe]]
    hardware = True

    def fit(self, scene: Scene, parts: Sequence[np.ndarray], seed: int) -> list[Fitted]:
        config, recipe = self.changed(scene.config)
        data = Datasets(scene.recordings).of(config, recipe)
        row_of = data.index[scene.touches.recording]
        rows = [row_of[part][row_of[part] >= 0] for part in parts]
        models = fit_networks(data, config, recipe, rows, seed, lambda done, total: None)
        multiplies = config.windows.steps * config.multiplies

        def decide(model: FloatModel, which: np.ndarray) -> np.ndarray:
            found, decided = row_of[which], np.full(len(which), -1)
            decided[found >= 0] = decide_touches(model, data.touches.take(found[found >= 0])).decision
            return decided

        return [Fitted(partial(decide, model), model.config.parameter_count, multiplies) for model in models]


# ---------------------------------------------------------------------- judging
@dataclass(frozen=True, eq=False)
class MethodDecider:
    """A fitted method on the recordings of a scene."""

    scene: Scene
    fitted: Fitted

    def decide(self, rows: Rows) -> Decided:
        """As `eskin.training.judge.Decider.decide`."""
        place, decided = self.scene.where[rows], np.full(len(rows), -1)
        if len(found := place[place >= 0]):
            decided[place >= 0] = self.fitted.decide(found)
        return Decided.at_once(decided, decided)


@dataclass(frozen=True, eq=False)
class MethodLearner:
    """A method as a learner. seconds: of the processor, of one part's fit, for each seed."""

    scene: Scene
    method: Method
    seconds: list[float] = field(default_factory=list)

    def fit(
        self, parts: Sequence[Rows], seeds: Sequence[int], progress: Progress | None = None
    ) -> list[MethodDecider]:
        """As `eskin.training.judge.Learner.fit`, for parts in the order of their seeds."""
        fitted: list[Fitted] = []
        for seed in dict.fromkeys(seeds):
            places = [self.scene.where[part] for part, own in zip(parts, seeds, strict=True) if own == seed]
            rows = [place[place >= 0] for place in places]
            if not all(map(len, rows)):
                raise InputError(
                    "no touch was found in a training part; use a smaller onset_threshold or window"
                )
            begin = time.process_time()
            fitted += self.method.fit(self.scene, rows, seed)
            self.seconds.append((time.process_time() - begin) / len(rows))
        return [MethodDecider(self.scene, each) for each in fitted]


def method_row(scene: Scene, piece: tuple[Method, Sequence[str], Sequence[int], int]) -> Record:
    """The row of baselines.json of a piece: a method, the groups left out, seeds, number of folds.

    Returns
    -------
    method, label, split, groups, accuracy (mean over seeds of the share of all recordings), spread (standard
    deviation over folds and seeds), standard_error (over recordings), seeds; parameters, multiplies, bytes and
    train_s (means over folds and seeds); decision_us (median of all timed decisions); hardware. In place of figures
    ``refused``, where the method cannot see these touches.
    """
    method, groups, seeds, folds = piece
    row: Record = {"method": method.name, "label": method.label, "hardware": method.hardware}
    row |= {"split": " and ".join(groups) or "recordings", "groups": list(groups)}
    labels, learner = scene.recordings.labels, MethodLearner(scene, method)
    seeds = seeds[: 1 if method.one_seed else None]
    tests = split_folds(scene.recordings, groups, folds, None)
    with one_thread():
        try:
            decisions = judge(learner, folds_of(tests, seeds, np.arange(len(labels))), labels)
        except InputError as error:
            return row | {"refused": str(error)}
        times = [
            time_us
            for fold, decider in decisions.fitted
            for time_us in timed(decider.fitted, scene.where[fold.test][scene.where[fold.test] >= 0])
        ]
    fitted = [decider.fitted for _, decider in decisions.fitted]
    share = decisions.shares()["integer_accuracy"]
    parameters = round(np.mean([each.parameters for each in fitted]))
    return row | {
        "accuracy": share,
        "spread": float(decisions.accuracy(["fold", "seed"])["integer_accuracy"].std(ddof=0)),
        "standard_error": math.sqrt(share * (1 - share) / len(labels)),
        "seeds": len(seeds),
        "parameters": parameters,
        "multiplies": round(np.mean([each.multiplies for each in fitted])),
        "bytes": FLOAT_BYTES * parameters,
        "train_s": float(np.mean(learner.seconds)),
        "decision_us": float(np.median(times)) if times else None,
    }


def timed(model: Fitted, rows: np.ndarray) -> list[float]:
    """Microseconds per decision without the first one, over at most TIMED rows and TIMED_S seconds."""
    decide = model.alone or (lambda row: model.decide(np.array([row])))
    microseconds: list[float] = []
    for number, row in enumerate(rows[: TIMED + 1]):
        begin = time.thread_time()
        decide(int(row))
        if number:
            microseconds.append(1e6 * (time.thread_time() - begin))
        if sum(microseconds) > 1e6 * TIMED_S:
            break
    return microseconds


CACHE = Path("build/baseline_runs")
"""Finished runs by content, safe to delete."""
CODE = partial(code_version, str(Path(__file__).resolve().parent), *LEARNING)
RESULT = "baselines.json"


def run(
    recordings: Recordings,
    config: AcceleratorConfig,
    methods: Sequence[Method],
    groups: Sequence[str],
    out: Path,
    *,
    folds: int = 5,
    seeds: int = 3,
    progress: Progress | None = None,
) -> Record:
    """Judge the methods with ``groups`` left out (none: random folds), ``folds`` and ``seeds`` runs of a fold, one
    job each, and write baselines.json into the folder ``out``.

    ``config``: the front end that finds the touches.

    Returns
    -------
    rows (`method_row`, best first), left_out (method, split, reason), recordings, classes, config,
    seeds, folds, data, wall_s.

    Raises
    ------
    InputError
        A folder or a group that cannot be used, before anything is trained; or no method can be judged.
    """
    begin = time.perf_counter()
    check_target(out / RESULT)
    check_split(recordings, groups, folds)
    content = [recordings, CODE(), config, seeds, folds, list(groups)]
    pieces = {
        content_key("baseline", *content, method): (method, groups, range(seeds), folds) for method in methods
    }
    jobs, scene = Jobs(progress=progress, version=CODE), Scene.of(recordings, config)
    outcomes = jobs.results(method_row, pieces, scene, keep=Memo(CACHE), what="methods judged").values()
    left_out = [
        {"method": row["method"], "split": row["split"], "reason": row["refused"]}
        for row in outcomes
        if "refused" in row
    ]
    rows = [row for row in outcomes if "refused" not in row]
    if not rows:
        raise InputError(
            f"baselines: no method works on these recordings; the first one reports: {left_out[0]['reason']}"
        )
    result = {
        "rows": sorted(rows, key=lambda row: -row["accuracy"]),
        "left_out": left_out,
        "data": str(recordings.source),
        "recordings": len(recordings),
        "classes": len(recordings.class_names),
        "config": config.to_dict(),
        "seeds": seeds,
        "folds": folds,
        "wall_s": time.perf_counter() - begin,
    }
    write_json(out / RESULT, result)
    return result
