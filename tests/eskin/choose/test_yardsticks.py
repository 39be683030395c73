"""Yardsticks: what they see, and that they are judged on recordings left out."""

import numpy as np

from eskin.choose.front_ends import EstimatorLearner, correct_without
from eskin.choose.yardsticks import (
    BANDS,
    PARTS,
    STATISTICS,
    forest,
    raw_features,
    statistics,
    support_vectors,
)
from tests.support import result_case


def test_raw_features_are_mean_deviation_and_change_of_each_part():
    loaded = result_case.recordings(3)
    features = raw_features(loaded)
    assert features.shape == (3, 3 * PARTS * loaded.taxels)
    # the second tenth of 300 frames
    part = np.array([loaded.recording(n)[30:60, 2].astype(float) for n in range(3)])
    for kind, values in enumerate(
        (part.mean(axis=1), part.std(axis=1), np.abs(np.diff(part, axis=1)).sum(axis=1) / 30)
    ):
        column = features[:, (kind * PARTS + 1) * loaded.taxels + 2]
        np.testing.assert_allclose(column, (values - values.mean()) / values.std())


def test_nothing_of_the_fold_is_learnt():
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 2, 40)
    x = rng.normal(size=(40, 200))  # says nothing of the label
    folds = np.array_split(np.arange(40), 2)
    for make in (support_vectors, forest):
        learner = EstimatorLearner(make, x + 4 * labels[:, None], np.arange(40), labels)
        assert correct_without(folds, learner, labels).mean() > 0.95
        copies = EstimatorLearner(make, np.r_[x, x], np.tile(np.arange(40), 2), labels)
        assert 0.2 < correct_without(folds, copies, labels).mean() < 0.8  # left out with their recording


def test_statistics_of_the_whole_stand_behind_those_of_the_parts():
    loaded = result_case.recordings(2)
    tables, whole = statistics(loaded), loaded.recording(1).astype(float)
    assert tuple(tables) == STATISTICS
    for name, values in (
        ("mean", whole.mean(axis=0)),
        ("spread", whole.std(axis=0)),
        ("activity", np.abs(np.diff(whole, axis=0)).sum(axis=0) / 300),
        ("first minus last", whole[:30].mean(axis=0) - whole[-30:].mean(axis=0)),
    ):
        np.testing.assert_allclose(tables[name][1, -loaded.taxels :], values)
    spectrum = np.exp(tables["spectrum"][1]).reshape(BANDS, -1).sum(axis=0) - BANDS
    np.testing.assert_allclose(
        spectrum, (np.abs(np.fft.rfft(whole - whole.mean(axis=0), axis=0)) ** 2).sum(axis=0)
    )
