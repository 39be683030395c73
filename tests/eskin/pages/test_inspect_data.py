"""Taxels at the end of their range."""

import numpy as np
import pytest

from eskin.pages.inspect_data import _state, held_shares


def test_a_taxel_is_saturated_at_an_end_where_it_does_not_rest(make_recordings):
    recordings = make_recordings(lengths=(400, 400), taxels=4)
    samples = recordings.samples
    samples[:] = np.random.default_rng(0).normal(1000, 100, samples.shape)
    samples[:, 0] = np.where(np.arange(800) % 100 < 30, 2000, samples[:, 0])  # clipped
    samples[:, 1] = np.where(np.arange(800) % 100 < 30, samples[:, 1], 2000)  # rests there
    held = held_shares(recordings)
    assert held[0] == pytest.approx(0.3, abs=0.02) and held[1:].max() < 0.05
    assert [_state(span, share) for span, share in ((0, 0.0), (100, 0.3), (8, 0.3), (100, 0.01))] == [
        "constant",
        "saturated",
        "ok",
        "ok",
    ]
