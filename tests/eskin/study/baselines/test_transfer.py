"""eskin/study/baselines/transfer.py: the image, torchvision's names and count, what files of weights are refused,
the last layer."""

import dataclasses

import numpy as np
import pytest
import torch

from eskin.golden.core import InputError
from eskin.study.baselines.scene import Scene
from eskin.study.baselines.transfer import (
    VALUES,
    MobileNetV2,
    fit_dcnn,
    network_of,
    pictures,
    read_weights,
    side_of,
)
from tests.support.touch_scenes import SMALL, scene


@pytest.fixture(scope="module")
def touches():
    return Scene.of(scene(40, seed=3), SMALL)


@pytest.fixture(scope="module")
def state():
    torch.manual_seed(4)
    return MobileNetV2().state_dict()


def test_the_network_is_torchvisions(state):
    """3 504 872 parameters, and names that its published files hold."""
    assert sum(p.numel() for p in MobileNetV2().parameters()) == 3_504_872
    assert len(state) == 314
    for name, shape in (
        ("features.0.0.weight", (32, 3, 3, 3)),
        ("features.1.conv.1.weight", (16, 32, 1, 1)),
        ("features.2.conv.3.running_var", (24,)),
        ("features.17.conv.2.weight", (320, 960, 1, 1)),
        ("features.18.1.bias", (1280,)),
        ("classifier.1.weight", (1000, 1280)),
    ):
        assert tuple(state[name].shape) == shape
    with torch.no_grad():
        assert MobileNetV2(1).features(torch.zeros(1, 3, 96, 96)).shape == (1, VALUES, 3, 3)


def test_values_lie_in_the_picture_in_order(touches):
    side = side_of(touches)
    assert side == 64
    seen = pictures(touches, side)
    frames = touches.frames(3 * side * side // 4)
    assert seen.shape == (len(touches.labels), 3, 64, 64) and seen.min() >= 0 and seen.max() <= 1
    rng = np.random.default_rng(0)
    for row, v in zip(rng.integers(len(seen), size=50), rng.integers(3 * side * side, size=50), strict=True):
        deviation = frames[row, v // 4, v % 4]
        level = 0.5 + 0.5 * np.sign(deviation) * np.log2(1 + abs(deviation)) / SMALL.sensor.sample_bits
        assert seen[row, v % 3, v // 3 // side, v // 3 % side] == pytest.approx(level, abs=1e-5)


def test_weights_are_read_and_used(tmp_path, state, touches):
    torch.save(state, tmp_path / "w.pth")
    arrays = read_weights(tmp_path / "w.pth")
    assert not any(name.startswith("classifier") for name in arrays)
    loaded = network_of(arrays).state_dict()
    assert all(torch.equal(loaded[name], state[name]) for name in arrays)
    assert not torch.equal(network_of(None).state_dict()["features.0.0.weight"], state["features.0.0.weight"])
    part, row = np.arange(20), 25
    for scene_ in (touches, dataclasses.replace(touches, weights=arrays, _known={})):
        fitted = fit_dcnn(scene_, part, 0)
        assert fitted.alone is not None and fitted.alone(row)[0] == fitted.decide(np.array([row]))[0]
        assert fitted.parameters == 3_504_872 - 1000 * 1281 + 3 * 1281
        assert (fitted.decide(part) == scene_.labels[part]).mean() > 0.8  # the last layer learns


def without(state, name):
    return {key: value for key, value in state.items() if key != name}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda s: without(s, "features.3.conv.0.0.weight"), "it has no 'features.3.conv.0.0.weight'"),
        (
            lambda s: s | {"features.0.0.weight": torch.zeros(32, 1, 3, 3)},
            r"'features.0.0.weight' is \(32, 1, 3, 3\)",
        ),
        (lambda s: s | {"layer1.0.conv1.weight": torch.zeros(3)}, "it has 'layer1.0.conv1.weight'"),
        (lambda s: s | {"features.18.1.bias": torch.full((1280,), torch.nan)}, "no finite numbers"),
        (lambda s: [1, 2], "no dictionary of arrays"),
    ],
)
def test_weights_of_another_network_are_refused(tmp_path, state, change, words):
    torch.save(change(state), tmp_path / "w.pth")
    with pytest.raises(InputError, match=words) as refused:
        read_weights(tmp_path / "w.pth")
    assert "mobilenet_v2" in str(refused.value)


def test_no_file_and_no_weights_are_refused(tmp_path):
    with pytest.raises(InputError, match="there is no such file"):
        read_weights(tmp_path / "none.pth")
    (tmp_path / "w.pth").write_bytes(b"not weights")
    with pytest.raises(InputError, match="is no file of torch weights"):
        read_weights(tmp_path / "w.pth")
