"""eskin/study/baselines/tiles.py: where a frame lies in an image, the ConvLSTM against numpy, counts, the thesis's
sizes, learning."""

import itertools

import numpy as np
import pytest
import torch

from eskin.study.baselines.scene import Scene
from eskin.study.baselines.tiles import FILTERS, IMAGES, TILES, UNITS, CnnLstm, ConvLstm, images, multiplies
from tests.support.touch_scenes import SMALL, scene


@pytest.fixture(scope="module")
def touches():
    return Scene.of(scene(60, seed=3), SMALL)


def test_a_tile_is_a_frame(touches):
    pictures, frames = images(touches), touches.frames(IMAGES * TILES * TILES)
    assert pictures.shape == (len(touches.labels), IMAGES, 2 * TILES, 2 * TILES)
    rng = np.random.default_rng(0)
    for row, k, i, j in zip(
        *(rng.integers(high, size=40) for high in (len(pictures), IMAGES, TILES, TILES)), strict=True
    ):
        tile = pictures[row, k, 2 * i : 2 * i + 2, 2 * j : 2 * j + 2]
        assert np.array_equal(tile, frames[row, (k * TILES + i) * TILES + j].reshape(2, 2))


def test_convlstm_is_what_it_says():
    torch.manual_seed(1)
    network, x = ConvLstm(5, 6, 3).double(), torch.randn(2, 3, 5, 6, dtype=torch.float64)
    kernel, bias = (array.detach().numpy() for array in (network.gates.weight, network.gates.bias))
    state = memory = np.zeros((2, FILTERS, 5, 6))
    for k in range(3):
        seen = np.pad(
            np.concatenate([x[:, k, None].numpy(), state], axis=1), ((0, 0), (0, 0), (1, 1), (1, 1))
        )
        gates = np.empty((2, 4 * FILTERS, 5, 6))
        for y in range(5):
            for z in range(6):
                gates[:, :, y, z] = (
                    np.einsum("ncyz,fcyz->nf", seen[:, :, y : y + 3, z : z + 3], kernel) + bias
                )
        i, f, g, o = np.split(gates, 4, axis=1)
        memory = memory / (1 + np.exp(-f)) + np.tanh(g) / (1 + np.exp(-i))
        state = np.tanh(memory) / (1 + np.exp(-o))
    with torch.no_grad():
        expected = network.dense(torch.relu(network.hidden(network.pool(torch.tensor(state)).flatten(1))))
        assert torch.allclose(network(x), expected, atol=1e-12)


def test_multiplies_are_those_of_the_layers():
    pixels, pooled = 8 * 16, 4 * 8
    cnn = IMAGES * (9 * 8 * pixels + 8 * pooled + 9 * 8 * 16 * pooled + 16 * 4)
    assert (
        multiplies(CnnLstm(8, 16, 5), IMAGES, 8, 16)
        == cnn + IMAGES * UNITS * (4 * (64 + UNITS) + 3) + UNITS * 5
    )
    gates = IMAGES * pixels * (9 * (1 + FILTERS) * 4 * FILTERS + 3 * FILTERS)
    assert multiplies(ConvLstm(8, 16, 5), IMAGES, 8, 16) == gates + FILTERS * 16 + FILTERS * 16 * 32 + 32 * 5


def test_sizes_of_the_thesis():
    """Table 3.1: ConvLSTM 314M parameters, every image's state in its first dense layer; a CNN without its
    last layers before an LSTM 15M (VGG16), 26M (ResNet50, which Keras counts with four numbers of batch norm
    a channel), which 58 to 87 units give."""
    images, side, filters, dense, classes = 24, 64, 32, 100, 3
    gates = 4 * filters * (9 * (1 + filters) + 1)
    assert gates + (images * side**2 * filters + 1) * dense + (dense + 1) * classes == 314_611_347
    widths = [3, 64, 64, 128, 128, 256, 256, 256, *[512] * 6]
    vgg16 = sum(9 * a * b + b for a, b in itertools.pairwise(widths))

    def layer(kernel: int, a: int, b: int) -> int:
        return kernel**2 * a * b + 5 * b

    resnet50, width = layer(7, 3, 64), 64
    for inner, blocks in ((64, 3), (128, 4), (256, 6), (512, 3)):
        resnet50 += layer(1, width, 4 * inner)
        for _ in range(blocks):
            resnet50 += layer(1, width, inner) + layer(3, inner, inner) + layer(1, inner, 4 * inner)
            width = 4 * inner
    assert (vgg16, resnet50) == (14_714_688, 23_587_712)
    millions = [
        [
            round((cnn + 4 * n * (values + n) + classes * (n + 1)) / 1e6)
            for cnn, values in ((vgg16, 2048), (resnet50, 8192))
        ]
        for n in range(200)
    ]
    assert [n for n, sizes in enumerate(millions) if sizes == [15, 26]] == [*range(58, 88)]
