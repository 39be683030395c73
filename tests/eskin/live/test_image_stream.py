"""Images row by row: the decisions of whole images, in whatever pieces the rows come."""

import numpy as np
import pytest

from eskin.golden.core import AcceleratorConfig
from eskin.golden.model import run_images
from eskin.live.image_stream import ImageStream
from eskin.training.made_up import random_images
from tests.support.image_scenes import random_image_model
from tests.support.table import each_row


@pytest.fixture(scope="module")
def model():
    config = AcceleratorConfig.of_image(
        5, 7, ("conv 3 4", "pool", "conv 1 3", "dense 3"), ("cup", "ball", "ring")
    )
    made = random_image_model(config, seed=3)
    return type(made)(made.config.replace(margin_threshold=40), made.arrays)


@each_row("pieces", [(5,), (1,) * 5, (2, 3, 4), (7,), (4, 0, 1)])
def test_rows_in_pieces_give_what_whole_images_do(model, pieces):
    images = random_images(model.config, 6, seed=2)
    streams = run_images(model, images).streams
    stream = ImageStream(model)
    for number, image in enumerate(images):
        stream.arm()
        assert (stream.decision, stream.touches, stream.onset_frame) == (-1, 0, None)
        rows, found, at = np.concatenate([image, np.full((4, 7), 9, dtype=np.uint8)]), [], 0
        for count in pieces:
            found += stream.push(rows[at : at + count])
            at += count
            assert (len(found) == 2) == (at >= 5) and stream.touches == 1
            assert (stream.onset_frame, stream.start_frame) == ((0, 1) if at < 5 else (None, None))
        local, whole = found
        rows_of = streams["decision"][0][2 * number : 2 * number + 2].tolist()
        assert [list(made.row()) for made in found] == rows_of and stream.decision == whole.label
        assert (local.frame, local.is_global, whole.is_global) == (5, False, True)
        maps = [streams[name][0].reshape(6, -1)[number] for name in ("map_1", "map_2")]
        np.testing.assert_array_equal(local.stages["map"], np.concatenate(maps))
        np.testing.assert_array_equal(local.stages["logit"], streams["logit"][0].reshape(6, -1)[number])
        assert not stream.push(image) and not stream.finish(), "what comes behind the image does nothing"


def test_an_image_cut_short_has_no_decision(model):
    stream = ImageStream(model)
    assert not stream.push(np.zeros((4, 7), dtype=np.uint8)) and not stream.finish() and stream.decision == -1
