"""A declared sample rate that cannot be right is doubted; any that can be is not."""

import numpy as np

from eskin.data.rate import wrong_rate
from eskin.golden.data import Recordings
from eskin.pages.inspect_data import in_rows, inspect
from eskin.pages.views import words
from tests.support.table import each_row


def recordings(rate: float, frames: int = 600, groups: dict | None = None) -> Recordings:
    samples = np.random.default_rng(1).integers(0, 100, (10, frames, 4))
    return Recordings.of(samples, np.arange(10) % 2, sample_rate_hz=rate, groups=groups)


@each_row("rate", [0.5, 50, 100, 3000, 10_000])
def test_a_rate_that_may_be_right_is_not_doubted(rate):
    assert wrong_rate(recordings(rate)) == []
    assert wrong_rate(recordings(rate, groups={"duration_s": np.full(10, 600 / rate * 1.04)})) == []


def test_recordings_that_no_touch_takes_so_long_for():
    assert "lasts only 20 ms: check sample_rate_hz" in wrong_rate(recordings(30_000))[0]
    assert "lasts 40 minutes" in wrong_rate(recordings(0.25))[0]


@each_row("name, unit", [("duration_ms", 1e3), ("duration_s", 1.0)])
def test_the_archives_own_durations_are_believed(name, unit):
    (sentence,) = wrong_rate(recordings(1000, groups={name: np.full(10, 6.0 * unit)}))
    assert "declares 1000 frames a second" in sentence and f"{name} makes it 100:" in sentence
    assert wrong_rate(recordings(1000, groups={name: np.full(10, 0.6 * unit)})) == []
    assert wrong_rate(recordings(1000, groups={name: np.zeros(10)})) == []  # not filled in


def test_inspect_says_it_first():
    odd = recordings(30_000)
    figures = inspect(odd)
    assert (
        "check sample_rate_hz" in words("advice", **figures, **in_rows(odd, figures, "x.npz")).splitlines()[0]
    )
