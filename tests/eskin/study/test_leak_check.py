"""eskin/study/leak_check.py: the touch really is taken out, a clean scene passes, and what knows the class
without a touch is found."""

import dataclasses
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from eskin.data import load_recordings
from eskin.golden.core import PRESETS, InputError
from eskin.golden.model import find_onsets, find_touches
from eskin.study.leak_check import leak_check, quiet_enough, without_touches
from eskin.training import recipe as recipes
from tests.support.parts import of_parts
from tests.support.table import each_row
from tests.support.touch_scenes import SMALL, archived, scene

RECIPE = dataclasses.replace(recipes.RECIPES["onset"], updates=80, batch=32)


def checked(recordings, config=SMALL, **options):
    (row,) = leak_check(recordings, config, [["person"]], (0,), recipe=RECIPE, **options)
    return row


RAW = SMALL.replace(rest="none", rest_frames=0, onset="band", band_low=0, band_high=100)
"""A front end that leaves the resting level in."""


def resting(recordings=60, seed=2):
    """Every touch is the same tap; only the resting level, higher on the taxel of the class, tells them
    apart."""
    rng = np.random.default_rng(seed)
    labels = np.arange(recordings) % 3
    parts = []
    for label in labels:
        quiet = int(rng.integers(60, 90))
        course = np.full((quiet + 100, 4), 20.0)
        course[quiet : quiet + 20] = 120.0
        course[:, label] += 40
        parts.append(np.rint(course + rng.normal(0, 2, course.shape)).astype(np.int32))
    return of_parts(scene(recordings), parts, labels=labels)


# ---------------------------------------------------------------------- what is judged
@each_row("left_in", [0, 7, 10**6])
def test_the_lead_in_repeated_stands_where_the_touch_was(left_in):
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
        quiet = onset - SMALL.onset_rule.onset_mean_frames
        for frame, values in enumerate(new, 1):
            first = onset + left_in if left_in else quiet + 1
            source = frame if frame < first else (frame - first) % quiet + 1
            np.testing.assert_array_equal(values, old[source - 1])


def test_no_frame_of_the_touch_stays_in():
    """Not those in whose mean the onset was found, nor the frame that left the band."""
    samples = np.repeat(np.where(np.arange(60) < 41, 10, 500), 4).reshape(60, 4).astype(np.int32)
    touch = dataclasses.replace(scene(1), samples=samples, offsets=np.array([0, 60]), labels=np.array([0]))
    for config in (RAW, SMALL):
        onsets = find_onsets(config, touch)
        assert onsets[0] >= 42 and without_touches(touch, config, onsets).samples.max() == 10


def test_a_forced_gate_opens_where_it_is_told_and_nowhere_else():
    recordings = scene(20, seed=3)
    onsets = find_onsets(SMALL, recordings)
    free, forced = find_touches(SMALL, recordings), find_touches(SMALL, recordings, onsets=onsets)
    first = free.first_touch()[free.first_touch() >= 0]
    assert len(forced) == len(first) < len(free)
    for name in ("recording", "onset_frame", "start_frame", "completed", "partial", "sums"):
        np.testing.assert_array_equal(getattr(forced, name), getattr(free, name)[first])
    empty = without_touches(recordings, SMALL, onsets)
    quiet = find_touches(SMALL, empty, onsets=onsets)
    np.testing.assert_array_equal(quiet.completed, forced.completed)
    assert np.abs(quiet.sums[:, 2:]).max() < 0.1 * np.abs(forced.sums[:, 2:]).max()


# ---------------------------------------------------------------------- the verdict
def test_a_clean_scene_passes_and_touches_left_in_do_not():
    recordings = scene(60, seed=1)
    clean = checked(recordings)
    assert clean["passed"] and clean["without_touch"] <= clean["limit"] == pytest.approx(
        clean["chance"] + 0.1
    )
    assert clean["accuracy"] > 0.75
    assert (
        clean["no_lead_in"] == 60 - np.count_nonzero(quiet_enough(SMALL, find_onsets(SMALL, recordings))) > 0
    )
    assert clean["recordings"] + clean["no_lead_in"] == 60
    for left_in in (40, 10**6):
        leaking = checked(recordings, left_in=left_in)
        assert not leaking["passed"] and leaking["without_touch"] > leaking["limit"]
    assert leaking["without_touch"] == leaking["accuracy"] == clean["accuracy"]


def test_a_class_that_shows_before_the_touch_is_found():
    row = checked(resting(), RAW)
    assert row["accuracy"] > 0.9 and row["without_touch"] > 0.9 and not row["passed"]
    assert row["no_lead_in"] == 0


def test_recordings_without_a_lead_in_are_refused():
    with pytest.raises(InputError, match="field onset"):
        leak_check(scene(20), PRESETS["fabric"], [[]], (0,))
    with pytest.raises(InputError, match="quiet lead-in"):
        checked(scene(20), SMALL.replace(rest_frames=512))


# ---------------------------------------------------------------------- the verb
@each_row(("words", "status"), [([], 0), (["--left-in", "100000"], 1)])
def test_the_verb_says_so_and_its_status_too(tmp_path, monkeypatch, words, status):
    from eskin.cli.main import app

    monkeypatch.setattr(recipes, "RECIPES", {"onset": RECIPE})
    archived(scene(60, seed=1), tmp_path)
    monkeypatch.chdir(tmp_path)
    line = "leak-check --data data.npz --config c.json --group person --seeds 1 --json leak.json"
    done = CliRunner().invoke(app, [*line.split(), *words])
    assert done.exit_code == status, done.output
    assert ("LEAK" in done.output) == bool(status)
    (row,) = json.loads((tmp_path / "leak.json").read_text())
    assert row["passed"] == (status == 0)


# ---------------------------------------------------------------------- the real recordings
@pytest.mark.slow
@pytest.mark.timeout(900)
def test_leaks_stay_out_of_the_indentations(shared_data):
    config = PRESETS["pvdf"]
    recordings = load_recordings(str(shared_data / "pvdf_indent" / "recordings.npz"), config=config)
    splits = [["trial"], ["speed"], ["seq"]]
    for row, least in zip(leak_check(recordings, config, splits, (0,)), (0.98, 0.97, 0.6), strict=True):
        assert row["passed"] and row["accuracy"] > least
    for row in leak_check(recordings, config, splits, (0,), left_in=100):
        assert not row["passed"]
