"""Other methods on the touches and folds of our networks: scikit-learn's classifiers, and a GRU in float;
their accuracy on unseen recordings, and their cost.

A *run* is one fold with one seed: trained on the other folds, judged on this one. A recording without a
touch, or without a completed window, counts as wrong. Seconds of training and microseconds of a decision, one
touch at a time, are those of the processor, in one thread. Whoever has another method gives `run` a
`Method` of his own (examples/thesis does).
"""

import inspect
import itertools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from sklearn.base import clone
from sklearn.ensemble import RandomForestClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import GridSearchCV, StratifiedKFold
from sklearn.neighbors import KNeighborsClassifier
from sklearn.svm import SVC

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
from eskin.requests import BaselinesRequest
from eskin.study.touch_ends import touches_and_ends
from eskin.training import LEARNING
from eskin.training.datasets import Datasets, scaling
from eskin.training.fit import fit_networks, one_thread
from eskin.training.formats import with_network
from eskin.training.recipe import Recipe, choose_recipe
from eskin.training.splits import check_split, default_splits, split_folds

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
                f"{recordings.source}: no recording has a touch with a completed window; look with 'eskin inspect'"
            )
        where = np.full(len(recordings), -1)
        where[usable] = np.arange(len(usable))
        means = real_features(config, touches.sums)
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


# ---------------------------------------------------------------------- the methods
def cost_of(model: Any, x: np.ndarray, classes: int) -> tuple[int, int]:
    """Parameters and multiplies of an estimator that was fitted to ``x``: of a logistic regression, a support vector
    machine, k neighbours; of trees feature and threshold of every fork, shares of the classes of every leaf."""
    if hasattr(model, "coef_"):
        return model.coef_.size + model.intercept_.size, model.coef_.size
    if hasattr(model, "support_"):
        vectors, pairs = len(model.support_), classes * (classes - 1) // 2
        return vectors * (x.shape[1] + classes - 1) + pairs, vectors * (x.shape[1] + classes)
    if not hasattr(model, "estimators_"):
        return x.size + len(x), x.size
    leaves = sum(int(tree.get_n_leaves()) for tree in model.estimators_)
    forks = sum(int(tree.tree_.node_count) for tree in model.estimators_) - leaves
    return 2 * forks + classes * leaves, 0


@dataclass(frozen=True)
class Classifier(Method):
    """A classifier of scikit-learn on all windows of a touch.

    model: the classifier; its ``random_state`` becomes the seed. grid: the values of which three stratified inner
    folds choose, fewer where a class is small, none where a class has a single touch; whole numbers there count
    touches.
    """

    model: Any
    grid: Mapping[str, Sequence[Any]] = field(default_factory=dict)

    def fit(self, scene: Scene, parts: Sequence[np.ndarray], seed: int) -> list[Fitted]:
        return [self._fit(scene, part, seed) for part in parts]

    def _fit(self, scene: Scene, part: np.ndarray, seed: int) -> Fitted:
        labels = scene.labels[part]
        counts = np.unique(labels, return_counts=True)[1]
        if len(counts) < 2:  # the one class that the part has
            return Fitted(lambda rows: np.full(len(rows), labels[0]), 1, 0)
        x = scene.windows(part).reshape(len(scene.labels), -1)
        model = clone(self.model)
        if "random_state" in model.get_params():
            model.set_params(random_state=seed)
        # whole numbers count touches: no more than an inner fold leaves
        grid = {
            name: [value for value in values if not isinstance(value, int) or value <= max(1, len(part) // 3)]
            for name, values in self.grid.items()
        }
        if grid and counts.min() > 1:
            inner = StratifiedKFold(min(3, int(counts.min())), shuffle=True, random_state=seed)
            model = GridSearchCV(model, grid, cv=inner).fit(x[part], labels).best_estimator_
        else:
            model.fit(x[part], labels)
        return Fitted(lambda rows: model.predict(x[rows]), *cost_of(model, x[part], scene.classes))


@dataclass(frozen=True)
class Network(Method):
    """A recurrent network in float, trained by our recipe or another; all parts at once.

    ``changed``: configuration -> the one that the network has, and its recipe.
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


def _gru(config: AcceleratorConfig) -> tuple[AcceleratorConfig, Recipe]:
    changed = with_network(config, cell="gru", hidden=12)
    return changed, choose_recipe(changed)


_METHODS: tuple[Method, ...] = (
    Classifier(
        "logistic", "logistic regression", LogisticRegression(max_iter=2000), {"C": (0.1, 1.0, 10.0, 100.0)}
    ),
    Classifier("svm", "RBF-SVM", SVC(), {"C": (1.0, 10.0, 100.0), "gamma": ("auto", "scale")}),
    Classifier("forest", "random forest", RandomForestClassifier(200)),
    Classifier("neighbours", "k nearest neighbours", KNeighborsClassifier(), {"n_neighbors": (1, 3, 5, 9)}),
    Network("gru", "GRU 12, float", _gru),
)
METHODS = {method.name: method for method in _METHODS}
"""Methods of `eskin baselines`, by name."""


# ---------------------------------------------------------------------- judging
def judge(scene: Scene, piece: tuple[Method, Sequence[str], Sequence[int], int]) -> Record:
    """The row of baselines.json of a piece: a method, what is left out, seeds, number of folds.

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
    labels, runs, times = scene.recordings.labels, [], []
    tests = split_folds(scene.recordings, groups, folds, None)
    parts = [scene.where[np.setdiff1d(np.arange(len(labels)), test)] for test in tests]
    parts = [part[part >= 0] for part in parts]
    if not all(map(len, parts)):
        why = "no touch was found in a training part; check the onset rule with 'eskin inspect'"
        return row | {"refused": why}
    seeds = seeds[: 1 if method.one_seed else None]
    for seed in seeds:
        with one_thread():
            begin = time.process_time()
            try:
                models = method.fit(scene, parts, seed)
            except InputError as error:
                return row | {"refused": str(error)}
            seconds = (time.process_time() - begin) / len(parts)
            for test, model in zip(tests, models, strict=True):
                found = scene.where[test] >= 0
                rows = scene.where[test][found]
                right = model.decide(rows) == labels[test][found] if len(rows) else np.zeros(0)
                runs.append((right.sum() / len(test), len(test), model.parameters, model.multiplies, seconds))
                times += timed(model, rows)
    shares, recordings, parameters, multiplies, train_s = np.array(runs).T
    accuracy = float(np.average(shares, weights=recordings))
    return row | {
        "accuracy": accuracy,
        "spread": float(shares.std()),
        "standard_error": math.sqrt(accuracy * (1 - accuracy) / len(labels)),
        "seeds": len(seeds),
        "parameters": round(parameters.mean()),
        "multiplies": round(multiplies.mean()),
        "bytes": FLOAT_BYTES * round(parameters.mean()),
        "train_s": float(train_s.mean()),
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


# ---------------------------------------------------------------------- the verb

CACHE = Path("build/baseline_runs")
"""Finished runs by content, safe to delete."""
CODE = partial(code_version, *LEARNING)
RESULT = "baselines.json"


def run(
    request: BaselinesRequest,
    recordings: Recordings,
    config: AcceleratorConfig,
    *,
    methods: Sequence[Method] = _METHODS,
    folds: int = 5,
    seeds: int = 3,
    progress: Progress | None = None,
) -> Record:
    """Judge the methods on every split, ``folds`` each and ``seeds`` runs of a fold, one job each, and write
    baselines.json.

    ``config``: the front end that finds the touches. Without groups every split that it names is judged.

    Returns
    -------
    rows (`judge`, best first within a split), left_out (method, split, reason), recordings, classes, config,
    seeds, folds, data, wall_s.

    Raises
    ------
    InputError
        A folder or a group that cannot be used, before anything is trained; or no method can be judged.
    """
    begin = time.perf_counter()
    check_target(request.out / RESULT)
    splits = default_splits(recordings, config) if request.groups is None else [request.groups]
    for groups in splits:
        check_split(recordings, groups, folds)
    content = [recordings, CODE(), config, seeds, folds]
    pieces = {
        content_key("baseline", *content, method, list(groups)): (method, groups, range(seeds), folds)
        for method, groups in itertools.product(methods, splits)
    }
    jobs, scene = Jobs(dask=request.dask, progress=progress, version=CODE), Scene.of(recordings, config)
    outcomes = jobs.results(judge, pieces, scene, keep=Memo(CACHE), what="methods judged")
    rows = [row for row in outcomes.values() if "refused" not in row]
    left_out = [
        {"method": row["method"], "split": row["split"], "reason": row["refused"]}
        for row in outcomes.values()
        if "refused" in row
    ]
    if not rows:
        raise InputError(
            f"baselines: no method works on these recordings; the first one reports: {left_out[0]['reason']}"
        )
    order = [list(groups) for groups in splits]
    result = {
        "rows": sorted(rows, key=lambda row: (order.index(row["groups"]), -row["accuracy"])),
        "left_out": left_out,
        "data": str(recordings.source),
        "recordings": len(recordings),
        "classes": len(recordings.class_names),
        "config": config.to_dict(),
        "seeds": seeds,
        "folds": folds,
        "wall_s": time.perf_counter() - begin,
    }
    write_json(request.out / RESULT, result)
    return result
