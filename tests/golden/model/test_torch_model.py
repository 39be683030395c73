"""numpy and torch compute the same trace, value by value."""

import numpy as np
import pytest

from eskin.golden.core import AcceleratorConfig
from eskin.golden.model import run, run_images
from eskin.golden.model.torch_model import Int64, on_torch, run_images_on_torch
from eskin.training.formats import with_network
from eskin.training.made_up import random_images, random_recordings
from tests.support.image_scenes import random_image_model
from tests.support.random_models import random_integer_model
from tests.support.small_designs import SMALL
from tests.support.table import each_row

CELLS = [
    {"cell": "gru"},
    {"cell": "gru", "reset": "after"},
    {"cell": "lstm"},
    {"cell": "linear"},
    {"cell": "trees"},
]


def check(first, other) -> int:
    """Equal traces; the number of their logits."""
    assert list(first.streams) == list(other.streams)
    for stage, arrays in first.streams.items():
        for array, its in zip(arrays, other.streams[stage], strict=True):
            assert array.dtype == its.dtype and np.array_equal(array, its), stage
    return len(first.streams["logit"][0])


def recorded(config, lengths, seed) -> int:
    model = random_integer_model(config, seed)
    recordings = random_recordings(model.config, lengths, seed)
    return check(run(model, recordings), run(on_torch(model), recordings))


@each_row("network", CELLS)
def test_random_designs(network):
    for seed in range(2):
        assert recorded(with_network(SMALL, **network), (400, 700), seed) > 20


def test_images_too():
    layers = ["conv 5 6", "pool", "conv 3 5", "pool", "dense 4"]
    config = AcceleratorConfig.of_image(5, 7, layers, ("cone", "cube", "ball", "ring"))
    model = random_image_model(config, seed=3)
    images = random_images(model.config, 12, 1)
    assert check(run_images(model, images), run_images_on_torch(model, images)) > 20


def test_a_fault_in_one_of_them_is_seen(monkeypatch):
    monkeypatch.setattr(Int64, "state", lambda self, products: Int64.value(self, products))
    with pytest.raises(AssertionError, match="state"):
        recorded(SMALL, (400,), 3)
