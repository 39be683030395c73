"""CNN-LSTM and ConvLSTM on images of the array over time ("Dataset B" of the thesis), small enough for two
cores.

The thesis cuts 6144 frames into 24 images; each holds 256 frames of 4 x 4 taxels side by side, 64 x 64
pixels. Here it is IMAGES images of TILES x TILES frames, means over time, so a fold trains in a minute.

- CNN-LSTM: two convolutions and pools on each image, their values into an LSTM, which decides at the last
  image. The thesis takes the values from networks trained on photographs; these convolutions are trained with
  the rest.
- ConvLSTM: an LSTM whose products are 3 x 3 convolutions, its last state pooled, two dense layers.

Both by Adam on cross-entropy.
"""

import math
from collections.abc import Callable

import numpy as np
import torch

from eskin.study.baselines.method import Fitted, Method
from eskin.study.baselines.scene import Scene
from eskin.training.losses import descend

IMAGES, TILES = 12, 4
"""Images of a touch; tiles along each side of an image, a frame each."""

UPDATES, BATCH, RATE = 400, 32, 0.01
"""Of the training: as many updates as our recipe has, its one-cycle schedule."""

CHANNELS, UNITS = (8, 16), 16
"""Of the CNN-LSTM: its two convolutions, its LSTM."""

FILTERS, DENSE, POOLED = 8, 32, 4
"""Of the ConvLSTM: filters of each gate, units of its first dense layer, values along each side of the pooled
state."""

KERNEL = 3


def images(scene: Scene) -> np.ndarray:
    """(n, IMAGES, height, width): tile (i, j) of image k is frame (k TILES + i) TILES + j."""
    rows, columns = scene.shape
    frames = scene.frames(IMAGES * TILES * TILES).reshape(-1, IMAGES, TILES, TILES, rows, columns)
    return frames.transpose(0, 1, 2, 4, 3, 5).reshape(len(frames), IMAGES, TILES * rows, TILES * columns)


class CnnLstm(torch.nn.Module):
    """Images (n, images, height, width) to logits (n, classes)."""

    def __init__(self, height: int, width: int, classes: int) -> None:
        super().__init__()
        first, second = CHANNELS
        self.cnn = torch.nn.Sequential(
            torch.nn.Conv2d(1, first, KERNEL, padding=1),
            torch.nn.ReLU(),
            torch.nn.AdaptiveAvgPool2d((-(-height // 2), -(-width // 2))),
            torch.nn.Conv2d(first, second, KERNEL, padding=1),
            torch.nn.ReLU(),
            torch.nn.AdaptiveAvgPool2d(2),
            torch.nn.Flatten(),
        )
        self.lstm = torch.nn.LSTM(4 * second, UNITS, batch_first=True)
        self.dense = torch.nn.Linear(UNITS, classes)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Logits after the last image."""
        embedded = self.cnn(x.flatten(0, 1)[:, None]).unflatten(0, x.shape[:2])
        return self.dense(self.lstm(embedded)[0][:, -1])


class ConvLstm(torch.nn.Module):
    """Images (n, images, height, width) to logits (n, classes)."""

    def __init__(self, height: int, width: int, classes: int) -> None:
        super().__init__()
        self.gates = torch.nn.Conv2d(1 + FILTERS, 4 * FILTERS, KERNEL, padding=1)
        self.pool = torch.nn.AdaptiveAvgPool2d(POOLED)
        self.hidden = torch.nn.Linear(FILTERS * POOLED * POOLED, DENSE)
        self.dense = torch.nn.Linear(DENSE, classes)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Logits after the last image: i, f, o sigmoids, g a tanh, c' = f c + i g, h' = o tanh(c')."""
        state = memory = x.new_zeros(len(x), FILTERS, *x.shape[2:])
        for k in range(x.shape[1]):
            i, f, g, o = self.gates(torch.cat([x[:, k, None], state], dim=1)).chunk(4, dim=1)
            memory = torch.sigmoid(f) * memory + torch.sigmoid(i) * torch.tanh(g)
            state = torch.sigmoid(o) * torch.tanh(memory)
        return self.dense(torch.relu(self.hidden(self.pool(state).flatten(1))))


def multiplies(network: torch.nn.Module, *shape: int) -> int:
    """Of one input of this shape: each layer's products, those of the gates, and pooling's scale factors."""
    count = 0

    def note(layer: torch.nn.Module, inputs: tuple[torch.Tensor, ...], output) -> None:
        nonlocal count
        if isinstance(layer, torch.nn.Conv2d):
            count += output.numel() * layer.in_channels // layer.groups * math.prod(layer.kernel_size)
        elif isinstance(layer, torch.nn.Linear):
            count += output.numel() * layer.in_features
        elif isinstance(layer, torch.nn.LSTM):
            per_step = layer.hidden_size * (4 * (layer.input_size + layer.hidden_size) + 3)
            count += inputs[0].shape[1] * per_step
        elif isinstance(layer, torch.nn.AdaptiveAvgPool2d):
            count += output.numel()

    layers = [layer for layer in network.modules() if not list(layer.children())]
    hooks = [layer.register_forward_hook(note) for layer in layers]
    try:
        with torch.no_grad():
            network(torch.zeros(1, *shape))
    finally:
        for hook in hooks:
            hook.remove()
    if isinstance(network, ConvLstm):
        count += shape[0] * 3 * FILTERS * shape[1] * shape[2]
    return count


def _fit(
    make: Callable[[int, int, int], torch.nn.Module], scene: Scene, part: np.ndarray, seed: int
) -> Fitted:
    pictures = images(scene)
    mean, scale = float(pictures[part].mean()), float(pictures[part].std()) + 1e-9
    x, y = torch.tensor((pictures - mean) / scale), torch.tensor(scene.labels)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = make(x.shape[2], x.shape[3], scene.classes)
        train = torch.tensor(part)

        def loss_of() -> torch.Tensor:
            rows = train[torch.randint(len(train), (BATCH,))]
            return torch.nn.functional.cross_entropy(network(x[rows]), y[rows])

        descend(network.parameters(), loss_of, RATE, UPDATES)

    def decide(rows: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return network(x[rows]).argmax(dim=1).numpy()

    return Fitted(decide, sum(p.numel() for p in network.parameters()), multiplies(network, *x.shape[1:]))


def fit_cnn_lstm(scene: Scene, part: np.ndarray, seed: int) -> Fitted:
    """CNN-LSTM."""
    return _fit(CnnLstm, scene, part, seed)


def fit_convlstm(scene: Scene, part: np.ndarray, seed: int) -> Fitted:
    """ConvLSTM."""
    return _fit(ConvLstm, scene, part, seed)


TILED = (
    Method("cnn-lstm", "CNN-LSTM, images over time", "tiles", fit_cnn_lstm, one_seed=True),
    Method("convlstm", "ConvLSTM, images over time", "tiles", fit_convlstm, one_seed=True),
)
