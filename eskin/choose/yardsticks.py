"""Baselines on the same folds as the network: the accuracy without this front end, or without this network.

- the linear classifier of ``choose_front_end`` on the same integer features: it has the network's front end,
  but not the network;
- an RBF-SVM on the same features: eskin has no hardware for it, so its lead shows what a larger model might
  gain;
- the linear classifier on whole recordings, cut in PARTS equal parts: mean, deviation and change of every
  taxel in each. It has no onset, no windows and no fixed point, and uses the whole recording: its lead shows
  what the front end loses;
- an RBF-SVM and a random forest on `statistics` of whole recordings: the first attempt of a competent person.
"""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from eskin.choose.front_ends import EstimatorLearner, RidgeLearner, Screen, correct_without
from eskin.golden.core import AcceleratorConfig, Progress
from eskin.golden.data import Recordings
from eskin.training.fit import one_thread
from eskin.training.record import Baseline
from eskin.training.splits import split_folds

PARTS = 10
"""Equal parts of a recording."""

PENALTY = 10.0
"""Inverse penalty of the RBF-SVM; its width is scikit-learn's ``scale``."""


BANDS = 8
"""Equal bands of frequency, from above 0 to half of the rate."""

TREES = 100
"""Trees of a random forest."""

JUDGED_ON = 1000
"""Highest number of recordings for judging forests and support vectors on statistics."""


def statistics(recordings: Recordings) -> dict[str, np.ndarray]:
    """Statistics of whole recordings and of PARTS equal parts of each, as a competent person would compute
    them: a table (recordings, columns) per statistic.

    mean, spread (standard deviation) and activity (mean absolute change) of every taxel in the whole and in
    each part; first minus last: the mean of the first part less that of the last; spectrum: the logarithm of
    the energy in BANDS of each taxel. Parts of recordings shorter than PARTS frames share frames.
    """
    rows = []
    for number in range(len(recordings)):
        samples = recordings.recording(number).astype(np.float64)
        edges = np.linspace(0, len(samples), PARTS + 1).astype(int)
        parts = [samples[min(a, len(samples) - 1) : max(b, a + 1)] for a, b in itertools.pairwise(edges)]
        parts = [*parts, samples]
        mean = [part.mean(axis=0) for part in parts]
        change = [np.abs(np.diff(part, axis=0)).sum(axis=0) / len(part) for part in parts]
        energy = np.abs(np.fft.rfft(samples - mean[-1], axis=0)[1:]) ** 2
        bands = [band.sum(axis=0) for band in np.array_split(energy, BANDS)]
        spectrum = np.log(np.array(bands) + 1.0)  # in units of codes: less than one code counts as nothing
        rows.append((mean, [part.std(axis=0) for part in parts], change, mean[0] - mean[-2], spectrum))
    tables = zip(*rows, strict=True)
    return {
        name: np.array(table).reshape(len(rows), -1) for name, table in zip(STATISTICS, tables, strict=True)
    }


STATISTICS = ("mean", "spread", "activity", "first minus last", "spectrum")
"""Names of the statistics, in the order of `statistics`."""


def scaled(features: np.ndarray) -> np.ndarray:
    """Each column with mean 0 and deviation 1 over the recordings."""
    deviation = features.std(axis=0)
    return (features - features.mean(axis=0)) / np.where(deviation > 0, deviation, 1.0)


def raw_features(recordings: Recordings) -> np.ndarray:
    """(recordings, 3 x PARTS x taxels): mean, spread and activity of each part, `scaled`."""
    tables = statistics(recordings)
    own = PARTS * recordings.taxels
    return scaled(np.concatenate([tables[name][:, :own] for name in STATISTICS[:3]], axis=1))


def support_vectors() -> Any:
    """Support vectors with a radial basis function, one against one."""
    from sklearn.svm import SVC

    return SVC(C=PENALTY)


def forest() -> Any:
    """A random forest with a fixed seed."""
    from sklearn.ensemble import RandomForestClassifier

    return RandomForestClassifier(TREES, random_state=0, n_jobs=-1)


def linear_yardsticks(
    recordings: Recordings, config: AcceleratorConfig, splits: Sequence[Sequence[str]], folds: int
) -> list[Baseline]:
    """Accuracy of the linear classifier on the network's own features, a row for each split as in
    ``yardsticks``; the network's hardware could implement it."""
    screen, rows = Screen(recordings), []
    multiplies = config.windows.steps * config.inputs * config.classes
    for groups in splits:
        with one_thread():
            correct = screen.judged(config, split_folds(recordings, groups, folds, None)).correct
        name = "linear classifier on the same features"
        rows.append(_row(name, groups, correct, multiplies, hardware=True))
    return rows


def yardsticks(
    recordings: Recordings,
    config: AcceleratorConfig,
    groups: Sequence[str],
    folds: int,
    progress: Progress = lambda task, done, total: None,
) -> list[Baseline]:
    """Accuracies of other classifiers when ``groups`` are left out: support vectors on the network's
    features, and on whole recordings a linear classifier, support vectors and a random forest."""
    parts, classes = split_folds(recordings, groups, folds, None), len(recordings.class_names)
    labels = recordings.labels
    name = "RBF-SVM on the same features"
    owner, x = Screen(recordings).features(config)
    vectors = EstimatorLearner(support_vectors, x, owner, labels)
    rows = [_row(name, groups, correct_without(parts, vectors, labels))]
    progress(name, 1, 4)
    x, parts = raw_features(recordings), [part for part in parts if len(part)]
    name = "linear classifier on whole recordings"
    correct = correct_without(parts, RidgeLearner.on(x, labels, classes), labels)
    rows.append(_row(name, groups, correct, x.shape[1] * classes, whole=True))
    progress(name, 2, 4)

    few = recordings.subset(recordings.evenly(JUDGED_ON))
    parts = [part for part in split_folds(few, groups, folds, None) if len(part)]

    x = scaled(np.concatenate(list(statistics(few).values()), axis=1))
    kinds = {"RBF-SVM": support_vectors, "random forest": forest}
    for number, (name, make) in enumerate(kinds.items()):
        name = f"{name} on statistics of whole recordings"
        learner = EstimatorLearner(make, x, np.arange(len(x)), few.labels)
        correct = correct_without(parts, learner, few.labels)
        rows.append(_row(name, groups, correct, whole=True))
        progress(name, 3 + number, 4)
    return rows


def _row(
    name: str,
    groups: Sequence[str],
    correct: np.ndarray,
    multiplies: int = 0,
    hardware: bool = False,
    whole: bool = False,
) -> Baseline:
    return Baseline(
        name=name,
        groups=groups,
        accuracy=correct.mean(),
        standard_error=correct.std(ddof=1) / np.sqrt(len(correct)),
        multiplies=multiplies,
        hardware=hardware,
        whole=whole,
    )


def neighbours_alike(recordings: Recordings, folds: int) -> tuple[float, float, float]:
    """Measures of the similarity of neighbouring recordings, such as those of one session: (accuracy on whole
    recordings when single ones are left out, accuracy when blocks of neighbours of a class are left out,
    standard error of the paired difference)."""
    labels, classes = recordings.labels, len(recordings.class_names)
    x = raw_features(recordings)
    blocks = np.zeros(len(labels), dtype=int)
    for label in np.unique(labels):
        members = np.flatnonzero(labels == label)
        blocks[members] = np.arange(len(members)) * folds // len(members)
    neighbours = [part for part in (np.flatnonzero(blocks == k) for k in range(folds)) if len(part)]
    learner = RidgeLearner.on(x, labels, classes)
    single = correct_without(split_folds(recordings, [], folds, 0), learner, labels)
    blocked = correct_without(neighbours, learner, labels)
    difference = single - blocked
    return float(single.mean()), float(blocked.mean()), float(difference.std(ddof=1) / np.sqrt(len(labels)))
