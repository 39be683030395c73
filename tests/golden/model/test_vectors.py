"""Vectors: which live frame completes which window, the file, and stimulus that exercises a configuration."""

from __future__ import annotations

import numpy as np
import pytest

from eskin.golden.core.config import PRESETS, AcceleratorConfig
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.model import random_integer_model
from eskin.golden.model.pipeline import STAGES, run
from eskin.golden.model.vectors import completing_frames, random_recordings, write_vectors
from tests.support.table import each_row

CONFIG = AcceleratorConfig.of(
    taxels=4,
    hidden=4,
    band_low=25920,
    band_high=26880,
    hop=4,
    window=9,
    touch_frames=60,
    steps=6,
    pretrigger_frames=20,
    rearm_frames=40,
)


def one_touch(onset: int, frames: int, config: AcceleratorConfig = CONFIG) -> Recordings:
    """At rest but for one sample in frame ``onset``."""
    samples = np.full((frames, config.sensor.taxels), 26400, dtype=np.int32)
    samples[onset - 1, 1] = 30000
    return Recordings(
        samples=samples,
        offsets=np.array([0, frames]),
        labels=np.array([0]),
        class_names=config.network.class_names,
        sample_rate_hz=3000.0,
    )


def test_windows_of_replayed_frames_are_completed_by_the_frame_of_the_onset():
    model = random_integer_model(CONFIG, 1)
    frames = completing_frames(run(model, one_touch(50, 90)))
    # start frame 30: windows end in 38, 42, 46, 50, 54, 58; the first three were over before the onset was
    # seen
    assert frames.tolist() == [50, 50, 50, 50, 54, 58, 58]


def test_a_partial_touch_is_decided_at_the_end_by_no_frame():
    model = random_integer_model(CONFIG, 1)
    trace = run(model, one_touch(50, 55))
    assert trace.partial.all() and completing_frames(trace).tolist() == [50, 50, 50, 50, 54, 0]


def test_an_early_decision_has_the_frame_of_its_step_and_a_time():
    model = random_integer_model(CONFIG.replace(decision="early", early_steps=5, early_margin=0), 1)
    for frames in (90, 55):  # 55: partial, decided before its end
        trace = run(model, one_touch(50, frames))
        if len(set(trace.local[0, :5])) == 1:
            assert (
                completing_frames(trace).tolist() == [50, 50, 50, 50, 54, 54, 58][: 7 if frames == 90 else 6]
            )
            assert trace.streams["decision"][0][5].tolist()[:2] == [1, 4] and not trace.global_partial.any()
            assert trace.decision_time_s().tolist() == [4 / 3000.0]
        else:
            pytest.fail("the model changes its mind: choose another seed")


def test_the_file_holds_what_goes_in_and_what_must_come_out(tmp_path):
    model = random_integer_model(
        CONFIG.replace(sample_signed=True, sample_bits=12, band_low=-300, band_high=300), 2
    )
    recordings = random_recordings(model.config, [80, 200, 3], seed=5)
    trace = run(model, recordings)
    path = write_vectors(tmp_path / "new" / "vectors.npz", trace, recordings, numbers=[7, 2, 9])
    assert [file.name for file in path.parent.iterdir()] == ["vectors.npz"]
    with np.load(path) as archive:
        assert archive["numbers"].tolist() == [7, 2, 9] and archive["offsets"].tolist() == [0, 80, 280, 283]
        assert archive["samples"].dtype == np.uint16
        assert np.array_equal(archive["samples"].view(np.int16), recordings.samples)
        for stage in STAGES:
            assert np.array_equal(archive[stage], trace.streams[stage][0])
            assert np.array_equal(archive[f"{stage}_offsets"], trace.streams[stage][1])
        assert archive["touches"].sum() == len(trace.touches) and len(archive["decision_frame"]) == len(
            archive["decision"]
        )


@each_row("name", PRESETS)
def test_random_recordings_touch_and_repeat(name):
    config = PRESETS[name].replace(taxels=4)
    length = 3 * config.last_frame + config.rest_level.rest_frames
    first, again, other = (random_recordings(config, [length, 50], seed) for seed in (1, 1, 2))
    assert np.array_equal(first.samples, again.samples) and not np.array_equal(first.samples, other.samples)
    assert (
        first.samples.min() >= config.sample_format.min_code
        and first.samples.max() <= config.sample_format.max_code
    )
    model = random_integer_model(config, 1)
    decided = [
        len(run(model, random_recordings(model.config, [length], seed)).streams["decision"][0])
        for seed in range(4)
    ]
    assert sum(count > config.windows.steps for count in decided) >= 2
