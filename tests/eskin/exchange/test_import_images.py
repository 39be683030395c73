"""Networks for images trained elsewhere: torch's own forward pass, batch norm folded, the way on to integers,
every refusal."""

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from eskin.exchange.import_network import import_network
from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.model import FloatModel, float_images, run_images
from eskin.training.image_formats import quantised
from eskin.training.made_up import random_images
from tests.support.image_scenes import SHAPES
from tests.support.table import each_row

LAYERS = ("conv 5 4", "pool", "conv 3 6", "pool", "dense 5", "dense 3")


def config(size: tuple[int, int] = (9, 11), layers: tuple[str, ...] = LAYERS) -> AcceleratorConfig:
    return AcceleratorConfig.of_image(*size, layers, SHAPES, name="elsewhere")


def network(*, norm: bool = True, bias: bool = True, pool_up: bool = True, seed: int = 3) -> nn.Sequential:
    """As somebody would write it; its batch norms have seen some images."""
    torch.manual_seed(seed)
    norms = [nn.BatchNorm2d(4), nn.BatchNorm2d(6)] if norm else [nn.Identity(), nn.Identity()]
    flat = 6 * (3 * 3 if pool_up else 2 * 2)
    made = nn.Sequential(
        nn.Conv2d(1, 4, 5, padding=2, bias=bias), norms[0], nn.ReLU(), nn.MaxPool2d(2, ceil_mode=pool_up),
        nn.Conv2d(4, 6, 3, padding=1, bias=bias), norms[1], nn.ReLU(), nn.MaxPool2d(2, ceil_mode=pool_up),
        nn.Flatten(), nn.Linear(flat, 5), nn.ReLU(), nn.Dropout(0.5), nn.Linear(5, 3),
    )  # fmt: skip
    made.train()
    with torch.no_grad():
        for _ in range(3):
            made(torch.rand(8, 1, 9, 11))
        for layer in made.modules():
            if isinstance(layer, nn.BatchNorm2d):
                layer.weight.uniform_(0.3, 1.5)
                layer.bias.uniform_(-0.5, 0.5)
            elif isinstance(layer, nn.Linear):
                layer.weight *= 5  # first weights give nearly the same logits whatever the image
    return made.eval()


def saved(path: Path, state: dict) -> Path:
    torch.save(state, path)
    return path


@each_row(("norm", "bias"), [(True, True), (True, False), (False, True)])
def test_it_computes_what_torch_computes(tmp_path, norm, bias):
    theirs = network(norm=norm, bias=bias)
    record = import_network(
        saved(tmp_path / "n.pt", theirs.state_dict()), config(), out=tmp_path / "m", mean=0, std=255
    )
    model = FloatModel.load(tmp_path / "m", images=True)
    images = random_images(config(), 12, 1)
    with torch.no_grad():
        expected = theirs.double()(torch.from_numpy(images / 255.0)[:, None]).numpy()
    for wrong in (0, 0.01):
        np.savez(tmp_path / "check.npz", inputs=images[:, None] / 255, outputs=expected + wrong)
        again = import_network(
            tmp_path / "n.pt", config(), out=tmp_path / "c", mean=0, std=255, check=tmp_path / "check.npz"
        )
        assert again["passed"] == (not wrong)
    assert np.ptp(expected, axis=0).max() > 0.05
    assert np.abs(float_images(model, images).logits - expected).max() < 1e-6
    assert list(record["imported"]["arrays"]) == ["0 conv 5 4", "2 conv 3 6", "4 dense 5", "5 dense 3"]
    integer = quantised(model, images)
    rounded = integer.config.formats.logit_format.to_real(run_images(integer, images).logits)
    assert np.abs(rounded - expected).max() < 0.1 * np.abs(expected).max()


def _without(state, *names):
    return {name: value for name, value in state.items() if name not in names}


STATE = network().state_dict()
WRONG = [
    (_without(STATE, "12.weight", "12.bias"), {}, "ends before layer 'dense 3'"),
    (
        STATE | {"0.weight": torch.zeros(4, 1, 3, 3)},
        {},
        r"array 0.weight: has shape \(4, 1, 3, 3\), and 'conv 5 4' takes \(4, 1, 5, 5\)",
    ),
    (
        STATE | {"1.running_mean": torch.zeros(5)},
        {},
        "array 1.running_mean: is missing or has not the 4 channels",
    ),
    (
        STATE | {"12.bias": torch.full((3,), float("nan"))},
        {},
        "array 12.bias: holds values that are no finite numbers",
    ),
    ({"rnn.weight_ih_l0": torch.zeros(3, 3)}, {}, "belongs to no convolution or dense layer"),
    (STATE, {"std": 0.0}, "--std 0: is no spread above 0"),
]


@each_row(("state", "changes", "words"), WRONG)
def test_what_does_not_fit_is_refused_in_a_sentence(tmp_path, state, changes, words):
    options = {"mean": 0.0, "std": 255.0} | changes
    with pytest.raises(InputError, match=words) as refused:
        import_network(saved(tmp_path / "n.pt", state), config(), out=tmp_path / "m", **options)
    assert "\n" not in str(refused.value) and not (tmp_path / "m").exists()
