"""What `eskin inspect` says and draws of images."""

import warnings

import numpy as np

from eskin.golden.data.recordings import image_recordings
from eskin.pages.inspect_data import draw, inspect
from tests.support.image_scenes import SHAPES, shapes
from tests.support.table import each_row


@each_row("labels", [[0], [1, 1], [0, 1, 2]])
def test_a_class_without_an_image_is_drawn_without_a_word(labels, tmp_path):
    images = image_recordings(np.full((len(labels), 6, 7), 9), np.array(labels), SHAPES)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        draw(images, None, tmp_path / "look.png")
    assert (tmp_path / "look.png").stat().st_size > 1000


def test_rows_and_columns_that_never_feel_are_named():
    images = shapes(4, 0, (8, 10))
    images.samples[0::8] = 0
    images.samples[:, 9] = 0
    found = inspect(images)
    assert (found["silent_rows"], found["silent_columns"], found["copies"]) == ([0], [9], 0)
