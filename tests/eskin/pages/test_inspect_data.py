"""Taxels at the end of their range."""

import numpy as np
import pytest

from eskin.pages.inspect_data import inspect


def test_a_taxel_is_saturated_at_an_end_where_it_does_not_rest(make_recordings):
    recordings = make_recordings(lengths=(400, 400), taxels=4)
    samples = recordings.samples
    samples[:] = np.random.default_rng(0).normal(1000, 100, samples.shape)
    samples[:, 0] = np.where(np.arange(800) % 100 < 30, 2000, samples[:, 0])  # clipped
    samples[:, 1] = np.where(np.arange(800) % 100 < 30, samples[:, 1], 2000)  # rests there
    samples[:, 2] = 50 * (np.arange(800) % 3)  # of few codes
    samples[:, 3] = 7
    figures = inspect(recordings)["taxel"]
    assert figures[0]["held"] == pytest.approx(0.3, abs=0.02) and figures[1]["held"] < 0.05
    assert [figure["state"] for figure in figures] == ["saturated", "ok", "ok", "constant"]
