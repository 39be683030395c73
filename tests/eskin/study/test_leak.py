"""eskin/study/leak.py: the touch really is taken out, a clean scene passes, and what knows the class
without a touch is found."""

import dataclasses

import numpy as np

from eskin.choose import doubts
from eskin.golden.data import Recordings
from eskin.golden.model.pipeline import run
from eskin.study.leak import known_from_first_frames, known_without_touch, without_touches
from eskin.training import recipe as recipes
from eskin.training.datasets import Datasets
from eskin.training.derive import find_onsets
from eskin.training.fit import fit_networks
from eskin.training.quantise import profile, quantise_model
from tests.support.random_models import random_integer_model
from tests.support.table import each_row
from tests.support.touch_scenes import SMALL, scene

RECIPE = dataclasses.replace(recipes.RECIPES["onset"], updates=80, batch=32)


def trained(recordings, config=SMALL):
    """A network trained on half of the recordings, and the other half."""
    halves = [recordings.subset(np.arange(begin, len(recordings), 2)) for begin in (0, 1)]
    data = Datasets(halves[0]).of(config, RECIPE)
    (model,) = fit_networks(data, config, RECIPE, [np.arange(len(data.touches))], 0, lambda done, total: None)
    return quantise_model(model, profile(model, data.touches)), halves[1]


RAW = SMALL.replace(rest="none", rest_frames=0, onset="band", band_low=0, band_high=100)
"""A front end that leaves the resting level in."""


def resting(recordings=60, seed=2):
    """Every touch is the same tap; only the resting level, higher on the taxel of the class, tells them
    apart."""
    rng, parts, labels = np.random.default_rng(seed), [], np.arange(recordings) % 3
    for label in labels:
        quiet = int(rng.integers(60, 90))
        course = np.full((quiet + 100, 4), 20.0)
        course[quiet : quiet + 20] = 120.0
        course[:, label] += 40
        parts.append(np.rint(course + rng.normal(0, 2, course.shape)))
    return Recordings.of(parts, labels, sample_rate_hz=SMALL.sensor.sample_rate_hz)


# ---------------------------------------------------------------------- what is judged
@each_row("left_in", [0, 7, 10**6])
def test_the_lead_in_repeated(left_in):
    recordings = scene(20)
    onsets = find_onsets(SMALL, recordings)
    replaced = without_touches(recordings, SMALL, onsets, left_in)
    np.testing.assert_array_equal(replaced.offsets, recordings.offsets)
    assert onsets[0] == -1
    for index, onset in enumerate(onsets):
        old, new = recordings.recording(index), replaced.recording(index)
        if onset < 0:
            np.testing.assert_array_equal(new, old)
            continue
        quiet, frame = onset - SMALL.onset_rule.onset_mean_frames, np.arange(1, len(new) + 1)
        first = onset + left_in if left_in else quiet + 1
        source = np.where(frame < first, frame, (frame - first) % quiet + 1)
        np.testing.assert_array_equal(new, old[source - 1])


# ---------------------------------------------------------------------- the verdict
def test_a_clean_scene_passes_and_touches_left_in_do_not():
    integer, others = trained(scene(90, seed=1))
    clean = known_without_touch(integer, others)
    assert clean.accuracy <= clean.limit < 0.5 and 30 < clean.recordings < 45
    assert doubts.leaks(**vars(clean)) == []
    leaking = known_without_touch(integer, others, left_in=40)
    (doubt,) = doubts.leaks(**vars(leaking))
    assert leaking.accuracy > leaking.limit and "reveals the class" in doubt.text


def test_a_class_that_shows_before_the_touch_is_found():
    leak = known_without_touch(*trained(resting(), RAW))
    assert leak.accuracy > 0.9 > leak.limit and leak.recordings == 30


def test_recordings_without_a_lead_in_say_nothing():
    model = random_integer_model(SMALL.replace(rest_frames=512), 1)
    assert known_without_touch(model, scene(20)) is None


def test_a_gate_that_opens_at_once_is_checked_by_the_first_frames():
    """The first 64 frames are the resting level: left in it tells the class, taken off it does not."""
    at_once = SMALL.replace(onset="immediate", rest="initial", clip=0)
    leak = known_from_first_frames(*trained(resting(), at_once.replace(rest="none", rest_frames=0)))
    assert leak.frames == 64 and leak.accuracy > leak.limit and leak.recordings == 30
    assert "from their first 64 frames, repeated" in doubts.leaks(**vars(leak))[0].text
    clean = known_from_first_frames(*trained(resting(), at_once))
    assert clean.frames == 64 and clean.accuracy <= clean.limit
    # the touches tell it, and begin about there
    integer, others = trained(scene(90, seed=1), at_once.replace(steps=16))
    whole = run(integer, others).accuracy(others.labels)
    assert whole > 0.65 > known_from_first_frames(integer, others).accuracy
