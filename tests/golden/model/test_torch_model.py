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
    {"cell": "gru", "reset": "before"},
    {"cell": "gru", "reset": "after"},
    {"cell": "lstm"},
    {"cell": "linear"},
]


def check(model, recordings) -> int:
    numpy_, torch_ = run(model, recordings).streams, run(on_torch(model), recordings).streams
    assert list(numpy_) == list(torch_)
    for stage, arrays in numpy_.items():
        for array, other in zip(arrays, torch_[stage], strict=True):
            assert array.dtype == other.dtype and np.array_equal(array, other), stage
    return len(numpy_["logit"][0])


@each_row("network", CELLS)
def test_random_designs(network):
    for seed in range(4):
        model = random_integer_model(with_network(SMALL, **network), seed)
        assert check(model, random_recordings(model.config, (400, 700), seed)) > 20


def test_images_too():
    layers = ["conv 5 6", "pool", "conv 3 5", "pool", "dense 4"]
    config = AcceleratorConfig.of_image(5, 7, layers, ("cone", "cube", "ball", "ring"))
    model = random_image_model(config, seed=3)
    images = random_images(model.config, 12, 1)
    numpy_, torch_ = run_images(model, images).streams, run_images_on_torch(model, images).streams
    assert list(numpy_) == list(torch_)
    for stage, arrays in numpy_.items():
        assert all(map(np.array_equal, arrays, torch_[stage])), stage


def test_a_fault_in_one_of_them_is_seen(monkeypatch):
    model = random_integer_model(SMALL, 3)
    recordings = random_recordings(model.config, (400,), 3)
    monkeypatch.setattr(Int64, "state", lambda self, products: Int64.value(self, products))
    with pytest.raises(AssertionError, match="state"):
        check(model, recordings)
