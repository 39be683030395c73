"""The synthetic scene: deterministic, nothing but the turn tells the class, and larger networks do better."""

import hashlib

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import GroupKFold, cross_val_predict
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from eskin.data import load_recordings, turns
from eskin.data.fit import check_fit
from eskin.data.turns import turn_recordings
from eskin.golden.core import PRESETS
from eskin.golden.data import Recordings
from eskin.golden.model import Touches, find_touches
from eskin.training.derive import derive_config, find_onsets
from tests.support.table import each_row, refused

SETTLE = 13


@pytest.fixture(scope="module")
def scene() -> Recordings:
    """What ``--data synthetic`` means."""
    return load_recordings("synthetic")


@pytest.fixture(scope="module")
def config(scene):
    """Means of 20 windows that hold every touch, behind an onset rule."""
    return derive_config(scene)[0].replace(hop=24, window=48)


def touches_of(scene: Recordings, config) -> Touches:
    touches = find_touches(config, scene)
    return touches.take(touches.first_touch())


def test_shape_and_balance(scene):
    assert scene.samples.shape == (512 * 600, 9) and scene.sample_rate_hz == 200
    assert scene.class_names == ("on", "left", "back", "right") and scene.class_counts.tolist() == [128] * 4
    assert set(scene.groups) == {"person", "trial"} and 0 < scene.samples.min() < scene.samples.max() < 65535
    assert all((np.bincount(scene.labels[scene.groups["person"] == n]) == 8).all() for n in range(16))
    digest = hashlib.sha256(scene.samples.astype("<i4").tobytes()).hexdigest()[:16]
    assert digest == "94978977a8c68a23"  # figures that were published on it must not move


def test_the_second_stroke_turns_as_the_class_says(monkeypatch):
    """Eastward first, on taxels that see static force: where it lies in the last tenth of the touch."""
    monkeypatch.setattr(turns, "MIRRORED", 0.0)
    monkeypatch.setattr(turns, "CORNER_HZ", 1e-4)
    scene = turn_recordings(persons=3, trials=2)
    ends = {"on": [1, 0], "left": [0, -1], "back": [-1, 0], "right": [0, 1]}
    for number in range(len(scene)):
        moved = np.abs(scene.recording(number) - scene.recording(number)[:20].mean(axis=0))
        touching = np.flatnonzero(moved.max(axis=1) > 0.1 * moved.max())
        last = moved[touching[-len(touching) // 10 :]].mean(axis=0).reshape(3, 3)
        place = np.array([last[:, 2] - last[:, 0], last[2] - last[0]]).sum(axis=1) / last.sum()
        end = np.array(ends[scene.class_names[scene.labels[number]]])
        assert place @ end > 0.2 and abs(place @ end[::-1]) < 0.6 * (place @ end), (number, place)


def test_length_level_and_lead_in_tell_nothing(scene, config):
    """Logistic regression on rest levels, frame of the onset, frames of the touch and mean, deviation of each
    taxel over it: no better than chance on the first two, far below networks on all."""
    touches = touches_of(scene, config)
    rows = []
    for number, onset in enumerate(touches.onset_frame):
        samples = scene.recording(number).astype(float)
        rest = samples[:SETTLE].mean(axis=0)
        moved = np.abs(samples - rest).max(axis=1)
        last = np.flatnonzero(moved > 0.2 * moved.max())[-1]
        touch = samples[onset : last + 1] - rest
        rows.append([*rest, onset, last - onset, *touch.mean(axis=0), *touch.std(axis=0)])

    def accuracy(columns: int) -> float:
        model = make_pipeline(StandardScaler(), LogisticRegression(max_iter=5000))
        groups = scene.groups["person"]
        predicted = cross_val_predict(
            model, np.array(rows)[:, :columns], scene.labels, groups=groups, cv=GroupKFold(5)
        )
        return float((predicted == scene.labels).mean())

    assert accuracy(9) < 0.32 and accuracy(10) < 0.32 and accuracy(11) < 0.32
    assert accuracy(29) < 0.75


def test_the_scene_of_a_model_has_its_array(scene, config, monkeypatch):
    same = load_recordings("synthetic", config=config)
    assert np.array_equal(same.samples, scene.samples)
    check_fit(same, config)
    with monkeypatch.context() as patch:
        patch.setattr(turns, "turn_recordings", lambda **sizes: sizes)
        for taxels, rows in ((4, 2), (8, 2), (12, 3), (36, 6)):
            sizes = turns.scene_of(config.replace(taxels=taxels, sample_rate_hz=100.0))
            array = {"rows": rows, "columns": taxels // rows, "sample_rate_hz": 100.0}
            assert sizes == {"persons": 16, "trials": 8, **array}
        sizes = turns.scene_of(PRESETS["thesis"])
        assert sizes["persons"] == 16 and sizes["trials"] == 2
    monkeypatch.setattr(turns, "CODES", 1 << 22)
    fast = load_recordings("synthetic", config=PRESETS["thesis"])
    assert 2 * 4 < len(fast) < 16 * 4 and fast.samples.size <= turns.CODES
    found = find_onsets(PRESETS["thesis"].replace(class_names=fast.class_names), fast)
    assert (found >= 0).all()


@each_row(
    "changes, match",
    [
        ({"taxels": 7}, "field taxels: is 7; the synthetic scene has 2 to 8 rows and columns"),
        ({"taxels": 160}, "field taxels: is 160; the synthetic scene has 2 to 8 rows"),
        ({"sample_rate_hz": 35.6}, "synthetic scene, sample_rate_hz: is 35.6; it must lie in 100..20000"),
    ],
)
def test_configurations_without_a_scene_are_refused(changes, match):
    with refused(match):
        load_recordings("synthetic", config=PRESETS["synthetic"].replace(**changes))
