"""Image networks: accumulators at their ends, in float against torch; integers are held by hardware and C."""

import numpy as np
import torch

from eskin.golden.core import AcceleratorConfig, Conv, Pool
from eskin.golden.model import FloatModel, IntegerModel, float_images, network_shapes, run_images
from eskin.training.made_up import random_images
from tests.support.image_scenes import random_image_model

LISTS = [
    ((7, 9), ("conv 3 4", "pool", "conv 1 3", "dense 2")),
    ((8, 5), ("conv 5 3", "conv 3 2", "pool", "dense 5", "dense 2")),
    ((4, 6), ("dense 2",)),
    ((5, 7), ("conv 5 2", "pool", "conv 5 3", "pool", "conv 3 2", "pool", "dense 2")),
]


def model_of(number: int, seed: int = 0) -> IntegerModel:
    (height, width), layers = LISTS[number]
    return random_image_model(
        AcceleratorConfig.of_image(height, width, layers, ("a", "b"), name=f"list {number}"), seed
    )


def test_sums_stay_within_the_accumulator_at_the_worst_weights():
    model = model_of(0)
    most = 7 if model.config.weight_bits == 4 else 127
    arrays = {
        name: np.full_like(array, most if name.startswith("W") else 2**23 - 1)
        for name, array in model.arrays.items()
    }
    trace = run_images(IntegerModel(model.config, arrays), np.full((1, 7, 9), 255, dtype=np.uint8))
    assert trace.maps[0].max() == 255 and (trace.logits == 2**15 - 1).all()
    assert (trace.decision[0], trace.margin[0]) == (0, 0)


def test_the_float_network_is_torch_s():
    model = model_of(1)
    rng = np.random.default_rng(3)
    arrays = {
        name: rng.normal(0, 0.5, shape) for name, shape in network_shapes(model.config, real=True).items()
    }
    real, images = FloatModel(model.config, arrays), random_images(model.config, 5, 3)
    values = torch.from_numpy(images.astype(np.float64))[:, None] / 256
    for stage in model.config.stages:
        if isinstance(stage.layer, Pool):
            values = torch.nn.functional.max_pool2d(values, 2, ceil_mode=True)
            continue
        weight, bias = (torch.from_numpy(arrays[f"{letter}_{stage.number}"]) for letter in "Wb")
        if isinstance(stage.layer, Conv):
            values = torch.nn.functional.conv2d(
                values, weight.permute(0, 3, 1, 2), bias, padding=stage.layer.kernel // 2
            )
        else:
            values = torch.nn.functional.linear(
                values.permute(0, 2, 3, 1).flatten(1) if values.ndim == 4 else values, weight, bias
            )
        values = values if stage.last else values.relu()
    assert np.allclose(float_images(real, images).logits, values.numpy(), atol=1e-12)
