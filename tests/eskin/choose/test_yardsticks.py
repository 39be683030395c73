"""Yardsticks: what they see, and that they are judged on recordings left out."""

import dataclasses

import numpy as np

from eskin.choose.yardsticks import PARTS, SupportVectors, raw_features, yardsticks
from tests.support import result_case
from tests.support.result_case import CONFIG


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


def test_short_recordings_and_still_taxels():
    loaded = result_case.recordings(2)
    samples = np.concatenate([loaded.recording(0)[:4], loaded.recording(1)]).copy()
    samples[:, 1] = 7
    short = dataclasses.replace(loaded, samples=samples, offsets=np.array([0, 4, 304]))
    features = raw_features(short)
    assert np.isfinite(features).all() and not features[:, 1 :: loaded.taxels].any()


def test_nothing_of_the_fold_is_learnt():
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 2, 60)
    x = rng.normal(size=(60, 200))  # says nothing of the label
    folds = np.array_split(np.arange(60), 6)
    vectors = SupportVectors()
    assert 0.2 < np.mean(vectors(x, labels, folds, 2) == labels) < 0.8
    assert vectors.multiplies > 20 * 200
    assert (vectors(x + 4 * labels[:, None], labels, folds, 2) == labels).mean() > 0.95


def test_rows_for_the_report():
    loaded = result_case.recordings(12)
    rows = yardsticks(loaded, CONFIG, ["person"], 5)
    assert [row["name"] for row in rows] == [
        "RBF-SVM on the same features",
        "linear classifier on whole recordings",
    ]
    for row in rows:
        assert 0 <= row["accuracy"] <= 1
        assert row["standard_error"] >= 0
        assert row["multiplies"] > 0
        assert not row["hardware"]
