"""Configurations derived from archives: sizes that work, and the reasons said."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.choose.choice import configure
from eskin.data import load_recordings
from eskin.golden.core import PRESETS
from eskin.golden.data import Recordings
from eskin.golden.model import find_touches
from eskin.training.derive import derive_config
from tests.support.prices import priced
from tests.support.table import each_row, refused


def some(archive, count) -> Recordings:
    recordings = load_recordings(archive / "recordings.npz")
    return recordings.subset(recordings.evenly(count))


@pytest.fixture(scope="module")
def pvdf(shared_data) -> Recordings:
    return some(shared_data / "pvdf_indent", 50)


@pytest.fixture(scope="module")
def fabric(shared_data) -> Recordings:
    return some(shared_data / "fabric_slide", 120)


def cut(recordings: Recordings, *, taxels=None, decimate=1, shift=0, begin=0, end=None) -> Recordings:
    """``recordings`` as another sensor would have given them: fewer taxels, a lower rate, fewer bits, another
    part of the time."""
    parts = [recordings.recording(i)[begin:end:decimate, :taxels] >> shift for i in range(len(recordings))]
    return replace(
        recordings,
        samples=np.concatenate(parts),
        offsets=np.cumsum([0, *map(len, parts)]),
        sample_rate_hz=recordings.sample_rate_hz / decimate,
        sample_bits=recordings.sample_bits - shift,
        volt_per_code=recordings.volt_per_code * 2**shift,
    )


def touched(config, recordings) -> tuple[float, float]:
    """Shares of recordings with a touch and with a touch whose steps all complete."""
    touches = find_touches(config, recordings)
    first = touches.first_touch()
    return (first >= 0).mean(), ((first >= 0) & (touches.completed[first] == config.windows.steps)).mean()


@each_row(
    "change",
    [
        dict(taxels=5, decimate=4),
        dict(taxels=5, decimate=4, shift=4),
        dict(taxels=6),
        dict(decimate=40),
        dict(end=6000),
    ],
)
def test_a_quiet_lead_in_gives_an_onset_rule_that_finds_the_touch(pvdf, change):
    recordings = cut(pvdf, **change)
    config, reasons = derive_config(recordings)
    assert (config.onset_rule.onset, config.rest_level.rest) == ("baseline", "tracked")
    assert config.network.class_names == pvdf.class_names
    for field in ("taxels", "sample_bits", "sample_rate_hz"):
        assert getattr(config.sensor, field) == getattr(recordings, field)
    touching, full = touched(config, recordings)
    assert touching >= 0.9 and full >= 0.75, reasons
    # The axis touches down 0.4 s to 2.8 s into the recording: an onset in the lead-in would be noise.
    touches = find_touches(config, recordings, steps=0)
    onsets = touches.onset_frame[touches.first_touch()[touches.first_touch() >= 0]]
    assert (onsets < 0.3 * recordings.sample_rate_hz).mean() <= 0.05
    assert any("onset when a taxel's mean" in reason for reason in reasons)


@each_row("change", [dict(taxels=12), dict(decimate=2), dict(taxels=5, decimate=3)])
def test_recordings_that_start_in_contact_open_at_once(fabric, change):
    recordings = cut(fabric, **change)
    config, reasons = derive_config(recordings)
    assert (config.onset_rule.onset, config.rest_level.rest) == ("immediate", "initial")
    assert config.name == "derived"
    assert any("start in contact" in reason for reason in reasons)
    assert touched(config, recordings)[1] >= 0.6  # three quarters, of a sample


def test_eight_bits_at_500_hz_with_five_taxels(make_recordings):
    recordings = make_recordings(lengths=[1500] * 20, taxels=5, sample_bits=8)
    samples = np.random.default_rng(5).integers(120, 123, (20, 1500, 5))
    for i in range(20):
        samples[i, 500:, i % 5] += 60
    samples[..., 4] = 7
    recordings = replace(recordings, samples=samples.reshape(-1, 5).astype(np.int32))
    config, reasons = derive_config(recordings)
    assert str(config.sample_format) == "UQ(8,0)" and config.sensor.taxels == 5
    assert config.sensor.masked_taxels == (4,)
    assert any("taxel 4 never changes and is masked" in reason for reason in reasons)
    touching, full = touched(config, recordings)
    assert touching == full == 0.8  # taxel 4 of every fifth recording shows nothing
    onsets = find_touches(config, recordings, steps=0).onset_frame
    assert (onsets > 500).all() and (onsets <= 500 + config.onset_rule.onset_mean_frames).all()


def test_a_preset_takes_the_classes_of_the_recordings_and_a_file_does_not(make_recordings):
    recordings = make_recordings(taxels=8, sample_rate_hz=2000.0)
    front_end = configure(recordings, PRESETS["pvdf"], priced())
    assert front_end.config == PRESETS["pvdf"].replace(class_names=("class0", "class1"))
    assert "class0, class1" in front_end.reasons[1]
    assert front_end.record() is None
    own = PRESETS["pvdf"].replace(name="mine")
    with refused("array class_names: is class0, class1 and configuration 'mine' has Cube3"):
        configure(recordings, own, priced())
    with refused("has 8 taxels and configuration 'fabric', field taxels, has 16"):
        configure(recordings, PRESETS["fabric"], priced())
