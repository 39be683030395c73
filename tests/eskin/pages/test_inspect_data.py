"""The picture of an archive: lines of few taxels, a heat map of many, in which a short event stays
visible."""

import numpy as np
import pytest

from eskin.pages.inspect_data import _thinned, held_shares


def test_a_short_event_survives_thinning():
    values = np.random.default_rng(1).normal(0, 1, (10_007, 3))
    values[5003, 1], values[10_006, 2] = -50, 40
    shown = _thinned(values, 1500)
    assert len(shown) <= 1500 and shown[:, 1].min() == -50 and shown[-1, 2] == 40
    assert np.array_equal(_thinned(values[:1500], 1500), values[:1500])


def test_held_needs_a_stretch_and_others_that_move(make_recordings):
    recordings = make_recordings(lengths=(400, 400), taxels=4)
    samples = recordings.samples
    samples[:, 0] = np.where(np.arange(800) % 100 < 30, 2000, samples[:, 0])  # clipped, others move as usual
    samples[:, 1] = np.where(np.arange(800) % 2, 2000, samples[:, 1])  # no stretch
    held = held_shares(recordings)
    assert held[0] == pytest.approx(0.3, abs=0.15) and held[1] == 0
    # now the others stand still there
    samples[:, 1:] = np.where((np.arange(800) % 100 < 30)[:, None], 1000, samples[:, 1:])
    assert held_shares(recordings)[0] == 0
