"""Taxels at the end of their range."""

import numpy as np
import pytest

from eskin.pages.inspect_data import held_shares


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
