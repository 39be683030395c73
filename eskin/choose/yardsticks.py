"""Classifiers that the network is measured with, on the same folds: what one would get without this front
end, or without this network.

- the linear classifier of ``choose_front_end`` on the same integer features: the front end is the network's,
  the network is not;
- an RBF-SVM on the same features: no hardware for it here, so a gap to it is what a larger model might bring;
- the linear classifier on whole recordings, cut in PARTS equal parts: mean, deviation and change of every
  taxel in each. It knows no onset, no window and no fixed point, and sees the whole recording: a gap to it is
  what the front end loses.
"""

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from eskin.choose.front_ends import Screen, blocked_ridge, others
from eskin.golden.core import AcceleratorConfig, Record
from eskin.golden.data import Recordings
from eskin.training.fit import one_thread
from eskin.training.splits import split_folds

PARTS = 10
"""Equal parts of a recording."""

PENALTY = 10.0
"""Inverse penalty of the RBF-SVM; its width is scikit-learn's ``scale``."""


def raw_features(recordings: Recordings) -> np.ndarray:
    """(recordings, 3 x PARTS x taxels): mean, standard deviation and mean absolute change of each taxel in
    each part, each column of mean 0 and deviation 1 over the recordings. Parts of recordings shorter than
    PARTS frames share frames."""
    rows = []
    for number in range(len(recordings)):
        samples = recordings.recording(number).astype(np.float64)
        edges = np.linspace(0, len(samples), PARTS + 1).astype(int)
        parts = [samples[min(a, len(samples) - 1) : max(b, a + 1)] for a, b in itertools.pairwise(edges)]
        change = [np.abs(np.diff(part, axis=0)).sum(axis=0) / len(part) for part in parts]
        rows.append(
            np.concatenate(
                [part.mean(axis=0) for part in parts] + [part.std(axis=0) for part in parts] + change
            )
        )
    features = np.array(rows)
    deviation = features.std(axis=0)
    return (features - features.mean(axis=0)) / np.where(deviation > 0, deviation, 1.0)


class SupportVectors:
    """Support vectors with a radial basis function, one against one, in the place of ``blocked_ridge``;
    multiplies: of a decision, mean over the fits so far."""

    def __init__(self) -> None:
        self._multiplies: list[int] = []

    @property
    def multiplies(self) -> int:
        return round(float(np.mean(self._multiplies or [0])))

    def __call__(
        self,
        x: np.ndarray,
        labels: np.ndarray,
        folds: Sequence[np.ndarray],
        classes: int,
        owner: np.ndarray | None = None,
    ) -> np.ndarray:
        from sklearn.svm import SVC

        decided = np.empty(len(x), dtype=np.int64)
        for fold in folds:
            train = others(np.arange(len(x)) if owner is None else owner, fold)
            if len(np.unique(labels[train])) < 2:
                decided[fold] = labels[train][0] if len(train) else -1
                continue
            model = SVC(C=PENALTY).fit(x[train], labels[train])
            decided[fold] = model.predict(x[fold])
            self._multiplies.append(len(model.support_) * (x.shape[1] + classes))
        return decided


def linear_yardsticks(
    recordings: Recordings, config: AcceleratorConfig, splits: Sequence[Sequence[str]], folds: int
) -> list[Record]:
    """What the linear classifier on the network's own features reaches, a row for each split as of
    ``yardsticks``; the network's hardware could hold it."""
    screen, rows = Screen(recordings), []
    multiplies = config.windows.steps * config.inputs * config.classes
    for groups in splits:
        with one_thread():
            correct = screen.judged(config, split_folds(recordings, groups, folds, None)).correct
        name = "linear classifier on the same features"
        rows.append(_row(name, groups, correct, multiplies) | {"hardware": True})
    return rows


def yardsticks(
    recordings: Recordings,
    config: AcceleratorConfig,
    groups: Sequence[str],
    folds: int,
    progress: Callable[[str, int, int], None] = lambda task, done, total: None,
) -> list[Record]:
    """What RBF-SVM and whole recordings reach when ``groups`` are left out.

    Returns
    -------
    {name, groups, accuracy, standard_error (over recordings), multiplies (of a touch), hardware (False), whole
    (it sees whole recordings)} each.
    """
    parts = split_folds(recordings, groups, folds, None)
    vectors = SupportVectors()
    by_vectors = Screen(recordings).judged(config, parts, vectors).correct
    progress("judged", 1, 2)
    x, classes = raw_features(recordings), len(recordings.class_names)
    whole = blocked_ridge(x, recordings.labels, [part for part in parts if len(part)], classes)
    progress("judged", 2, 2)
    correct, multiplies = whole == recordings.labels, x.shape[1] * classes
    return [
        _row("RBF-SVM on the same features", groups, by_vectors, vectors.multiplies),
        _row("linear classifier on whole recordings", groups, correct, multiplies) | {"whole": True},
    ]


def _row(name: str, groups: Sequence[str], correct: np.ndarray, multiplies: int) -> Record:
    return {
        "name": name,
        "groups": list(groups),
        "accuracy": float(correct.mean()),
        "standard_error": float(correct.std(ddof=1) / np.sqrt(len(correct))),
        "multiplies": multiplies,
        "hardware": False,
        "whole": False,
    }


def neighbours_alike(recordings: Recordings, folds: int) -> tuple[float, float, float]:
    """Whether recordings that stand side by side look alike, as those of one session do: (accuracy on whole
    recordings leaving out single ones, the same leaving out blocks of neighbours of a class, standard error
    of the paired difference)."""
    labels, classes = recordings.labels, len(recordings.class_names)
    x = raw_features(recordings)
    blocks = np.zeros(len(labels), dtype=int)
    for label in np.unique(labels):
        members = np.flatnonzero(labels == label)
        blocks[members] = np.arange(len(members)) * folds // len(members)
    neighbours = [part for part in (np.flatnonzero(blocks == k) for k in range(folds)) if len(part)]
    single = blocked_ridge(x, labels, split_folds(recordings, [], folds, 0), classes) == labels
    blocked = blocked_ridge(x, labels, neighbours, classes) == labels
    difference = single.astype(float) - blocked
    return float(single.mean()), float(blocked.mean()), float(difference.std(ddof=1) / np.sqrt(len(labels)))
