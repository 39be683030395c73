"""The synthetic scene: deterministic, balanced, detected, and decided by the time course alone."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import GroupKFold, cross_val_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from golden.config import PRESETS
from golden.errors import InputError
from golden.preprocess import Touches, find_onsets, find_touches
from golden.recordings import Recordings, load_recordings
from golden.scene import synthetic_recordings
from golden.train import cross_validate

SYNTHETIC = PRESETS["synthetic"]


@pytest.fixture(scope="module")
def scene() -> Recordings:
    """The default scene: what ``--data synthetic`` means."""
    return load_recordings("synthetic")


@pytest.fixture(scope="module")
def touches(scene: Recordings) -> Touches:
    return find_touches(SYNTHETIC, scene)


def test_shape_and_balance(scene):
    assert scene.samples.shape == (240 * 9000, 16) and scene.samples.dtype == np.int32 and len(scene) == 240
    assert (scene.lengths == 9000).all() and scene.sample_rate_hz == 3000 and scene.class_names == SYNTHETIC.class_names
    assert scene.class_counts.tolist() == [80, 80, 80] and scene.volt_per_code == SYNTHETIC.volt_per_code
    assert set(scene.groups) == {"person", "trial", "direction"}
    for label in range(3):  # every person does every modality in 4 trials, two in each direction
        of_class = np.stack([scene.groups["person"], scene.groups["trial"]])[:, scene.labels == label]
        assert sorted(map(tuple, of_class.T)) == [(person, trial) for person in range(20) for trial in range(4)]
    assert (scene.groups["direction"] == scene.groups["trial"] % 2).all()


def test_codes_lie_in_the_converter_and_rest_is_rest(scene):
    assert scene.samples.min() > 0 and scene.samples.max() < 65535  # nothing is clipped
    quiet = np.stack([scene.recording(i)[:400] for i in range(len(scene))])
    assert abs(quiet.mean() - 1.65 / scene.volt_per_code) < 60
    assert 14 < quiet.std(axis=1).mean() < 30  # 1.2 mV of noise is 19 codes


def test_same_seed_same_scene():
    small = dict(persons=2, trials=1, sample_rate_hz=500.0)
    first = synthetic_recordings(**small)
    assert np.array_equal(first.samples, synthetic_recordings(**small).samples)
    assert not np.array_equal(first.samples, synthetic_recordings(**small, seed=2).samples)
    more = synthetic_recordings(**small | {"persons": 3})
    assert np.array_equal(more.samples[: first.frames], first.samples)
    persons = first.samples.reshape(2, -1)
    assert not np.array_equal(persons[0], persons[1])


def test_every_touch_is_found_and_complete(scene, touches):
    onset = touches.onset_frame[touches.first_touch()]
    assert len(touches) == len(scene) and (touches.completed == 20).all() and not touches.partial.any()
    assert onset.min() > 0.1 * 3000 and onset.max() < 0.9 * 3000
    assert (find_onsets(PRESETS["thesis"], scene) > 0).all()  # the fixed band sees them too


@pytest.mark.parametrize("rows, columns", [(2, 2), (2, 5), (8, 8)])
def test_other_arrays(rows, columns):
    calls: list[tuple[int, int]] = []
    scene = synthetic_recordings(persons=2, trials=2, rows=rows, columns=columns, progress=lambda *call: calls.append(call))
    assert scene.taxels == rows * columns and len(scene) == 12 and calls == [(1, 2), (2, 2)]
    found = find_touches(SYNTHETIC.replace(taxels=rows * columns), scene)
    assert (found.first_touch() >= 0).all() and (found.completed[found.first_touch()] == 20).all()


def test_touch_on_one_row_after_the_other():
    """Taxel = row * columns + column: a roll in direction 0 loads the rows of a column together, in direction 1 the columns of a row."""
    scene = synthetic_recordings(persons=4, trials=2, columns=5)
    for index in np.flatnonzero(scene.labels == 1):
        deviation = scene.recording(index) - scene.recording(index)[:400].mean(axis=0)
        peak = np.argmax(deviation, axis=0).reshape(4, 5) / 3000
        together, apart = (0, 1) if scene.groups["direction"][index] == 0 else (1, 0)
        assert np.ptp(peak, axis=together).mean() < 0.35 * np.ptp(peak, axis=apart).mean()


def test_mean_and_deviation_do_not_tell_the_classes_apart(scene, touches):
    """Logistic regression on per-taxel mean and standard deviation over the touch, unseen persons: below 85 % (seen: 60 %)."""
    statistics = []
    for index, start in zip(touches.recording, touches.start_frame, strict=True):
        touch = scene.recording(index)[start - 1 : start - 1 + SYNTHETIC.touch_frames]
        statistics.append(np.concatenate([touch.mean(axis=0), touch.std(axis=0)]))
    deviation = [np.mean([s[16:] for s, label in zip(statistics, scene.labels, strict=True) if label == c]) for c in range(3)]
    assert max(deviation) < 1.25 * min(deviation)
    for strength in (0.1, 1.0, 10.0):
        model = make_pipeline(StandardScaler(), LogisticRegression(C=strength, max_iter=5000))
        accuracy = cross_val_score(model, np.array(statistics), scene.labels, groups=scene.groups["person"], cv=GroupKFold(5)).mean()
        assert 1 / 3 < accuracy < 0.75


def test_the_time_course_does(scene):
    """A GRU of 12 units on the window means, unseen persons: 92 % or more (seen: 99 %)."""
    record = cross_validate(scene, SYNTHETIC, [["person"]], [0], folds=3)[0]
    assert SYNTHETIC.hidden == 12 and record["float_accuracy"] >= 0.95 and record["integer_accuracy"] >= 0.95


@pytest.mark.parametrize("field, value", [("persons", 0), ("trials", 0), ("rows", 1), ("columns", 9), ("sample_rate_hz", 0)])
def test_what_cannot_be_made_is_refused(field, value):
    with pytest.raises(InputError, match=f"synthetic scene, {field}: is {value}; it must lie in"):
        synthetic_recordings(**{field: value})
