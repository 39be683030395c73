"""Image networks: accumulators at their ends. Integers are held by hardware and C, the float network by torch's in
tests/eskin/training/test_train_images.py."""

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.model import IntegerModel, run_images
from tests.support.image_scenes import random_image_model


def test_sums_stay_within_the_accumulator_at_the_worst_weights():
    config = AcceleratorConfig.of_image(7, 9, ("conv 3 4", "pool", "conv 1 3", "dense 2"), ("a", "b"))
    model = random_image_model(config, 0)
    worst = {"W": 7 if model.config.weight_bits == 4 else 127, "b": 2**23 - 1}
    arrays = {name: np.full_like(array, worst[name[0]]) for name, array in model.arrays.items()}
    trace = run_images(IntegerModel(model.config, arrays), np.full((1, 7, 9), 255, dtype=np.uint8))
    assert trace.maps[0].max() == 255 and (trace.logits == 2**15 - 1).all()
    assert (trace.decision[0], trace.margin[0]) == (0, 0)
