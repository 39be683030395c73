"""The picture of an archive: lines of few taxels, a heat map of many, in which a short event stays
visible."""

import matplotlib.image
import numpy as np
import pytest

from eskin.pages.inspect_data import MANY_TAXELS, _thinned, draw, held_shares, in_rows, inspect
from eskin.pages.views import words
from tests.support.table import each_row


def test_a_short_event_survives_thinning():
    values = np.random.default_rng(1).normal(0, 1, (10_007, 3))
    values[5003, 1], values[10_006, 2] = -50, 40
    shown = _thinned(values, 1500)
    assert len(shown) <= 1500 and shown[:, 1].min() == -50 and shown[-1, 2] == 40
    assert np.array_equal(_thinned(values[:1500], 1500), values[:1500])


@each_row("taxels", [4, MANY_TAXELS])
def test_many_taxels_are_a_heat_map(make_recordings, tmp_path, taxels):
    recordings = make_recordings(lengths=(200, 300), taxels=taxels)
    recordings.samples[100:150, 2] += 300
    draw(recordings, [20, -1], tmp_path / "p.png", count=2)
    picture = matplotlib.image.imread(tmp_path / "p.png")[..., :3]
    # the far end of the map's colours
    red = (picture[..., 0] > 0.35) & (picture[..., 1] < 0.15) & (picture[..., 2] < 0.25)
    assert bool(red.sum() > 100) == (taxels == MANY_TAXELS)


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


def test_of_many_recordings_those_without_an_onset_the_earliest_and_the_latest_are_listed(make_recordings):
    recordings = make_recordings(lengths=[40] * 14)
    figures = inspect(recordings) | {"onset_frames": [9, 8, 7, -1, 6, 5, 4, 3, 2, -1, 11, 12, 13, 14]}
    rows = in_rows(recordings, figures, "mine.npz")
    assert [row[0] for row in rows["of_recordings"]] == [0, 3, 4, 5, 6, 7, 8, 9, 10, 11]
    assert rows["lost"] == 2 and [row["lost"] for row in rows["of_classes"]] == [0, 2]
    assert [row["span"] for row in rows["of_classes"]] == [[2, 7, 13], [3, 8, 14]]


def test_of_many_classes_with_few_recordings_ten_are_named_and_the_others_counted(make_recordings):
    recordings = make_recordings(lengths=[40] * 26, classes=13)
    figures = inspect(recordings)
    text = words("inspect", **figures, **in_rows(recordings, figures, "mine.npz"), picture="mine.png")
    assert "class9 and 3 other classes: record more" in text
