"""CNN-LSTM and ConvLSTM on images of the array over time ("Dataset B" of the thesis), and a network trained on
photographs with a new last layer (its chapter 2), small enough for two cores.

The thesis cuts 6144 frames into 24 images; each holds 256 frames of 4 x 4 taxels side by side, 64 x 64
pixels. Here it is IMAGES images of TILES x TILES frames, means over time, so a fold trains in a minute.

- CNN-LSTM: two convolutions and pools on each image, their values into an LSTM, which decides at the last
  image. The thesis takes the values from networks trained on photographs; these convolutions are trained with
  the rest.
- ConvLSTM: an LSTM whose products are 3 x 3 convolutions, its last state pooled, two dense layers.
- DCNN: the touch as one colour image, 64 pixels a side at least, values in a row, through a network that was
  trained on photographs (``--dcnn``), whose last layer is new.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from baselines import Fitted, Method, Scene
from frames import frames_of, shape_of
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from torch.utils.flop_counter import FlopCounterMode

from eskin.training.losses import descend

IMAGES, TILES = 12, 4
"""Images of a touch; tiles along each side of an image, a frame each."""
UPDATES, BATCH, RATE = 400, 32, 0.01
"""Training: Adam on cross-entropy, one cycle."""
FILTERS = 8
"""Filters of each gate of the ConvLSTM."""
LEAST_SIDE, SIDE_STEP = 64, 32
"""Pixels of a side of the DCNN's image."""
MEAN, SCALE = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Mean and scale of the photographs on which published weights were trained, by colour."""


class CnnLstm(torch.nn.Module):
    """Images (n, images, height, width) to logits (n, classes)."""

    def __init__(self, height: int, width: int, classes: int) -> None:
        super().__init__()
        self.cnn = torch.nn.Sequential(
            torch.nn.Conv2d(1, 8, 3, padding=1),
            torch.nn.ReLU(),
            torch.nn.AdaptiveAvgPool2d((-(-height // 2), -(-width // 2))),
            torch.nn.Conv2d(8, 16, 3, padding=1),
            torch.nn.ReLU(),
            torch.nn.AdaptiveAvgPool2d(2),
            torch.nn.Flatten(),
        )
        self.lstm = torch.nn.LSTMCell(64, 16)
        self.dense = torch.nn.Linear(16, classes)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        embedded = self.cnn(x.flatten(0, 1)[:, None]).unflatten(0, x.shape[:2])
        state = None
        for k in range(x.shape[1]):
            state = self.lstm(embedded[:, k], state)
        return self.dense(state[0])


class ConvLstm(torch.nn.Module):
    """Images (n, images, height, width) to logits (n, classes)."""

    def __init__(self, height: int, width: int, classes: int) -> None:
        super().__init__()
        self.gates = torch.nn.Conv2d(1 + FILTERS, 4 * FILTERS, 3, padding=1)
        self.pool = torch.nn.AdaptiveAvgPool2d(4)
        self.hidden = torch.nn.Linear(16 * FILTERS, 32)
        self.dense = torch.nn.Linear(32, classes)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Gates i, f, o are sigmoids, g a tanh; c' = f c + i g, h' = o tanh(c')."""
        state = memory = x.new_zeros(len(x), FILTERS, *x.shape[2:])
        for k in range(x.shape[1]):
            i, f, g, o = self.gates(torch.cat([x[:, k, None], state], dim=1)).chunk(4, dim=1)
            memory = torch.sigmoid(f) * memory + torch.sigmoid(i) * torch.tanh(g)
            state = torch.sigmoid(o) * torch.tanh(memory)
        return self.dense(torch.relu(self.hidden(self.pool(state).flatten(1))))


def multiplies(network: torch.nn.Module, *shape: int) -> int:
    """Multiplies of one input of this shape, as torch counts them: products of convolutions and matrices."""
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        network(torch.zeros(1, *shape))
    return counter.get_total_flops() // 2


@dataclass(frozen=True)
class ImageMethod(Method):
    """A network on images over time."""

    make: Callable[[int, int, int], torch.nn.Module]
    one_seed = True

    def fit(self, scene: Scene, parts: Sequence[np.ndarray], seed: int) -> list[Fitted]:
        rows, columns = shape_of(scene.config)
        frames = frames_of(scene, IMAGES * TILES * TILES).reshape(-1, IMAGES, TILES, TILES, rows, columns)
        side_by_side = frames.transpose(0, 1, 2, 4, 3, 5)
        images = side_by_side.reshape(len(frames), IMAGES, TILES * rows, TILES * columns)
        return [self._fit(scene, images, part, seed) for part in parts]

    def _fit(self, scene: Scene, images: np.ndarray, part: np.ndarray, seed: int) -> Fitted:
        mean, scale = float(images[part].mean()), float(images[part].std()) + 1e-9
        x, y = torch.tensor((images - mean) / scale), torch.tensor(scene.labels)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            network, train = self.make(x.shape[2], x.shape[3], scene.classes), torch.tensor(part)

            def loss_of() -> torch.Tensor:
                rows = train[torch.randint(len(train), (BATCH,))]
                return torch.nn.functional.cross_entropy(network(x[rows]), y[rows])

            descend(network.parameters(), loss_of, RATE, UPDATES)
        parameters = sum(p.numel() for p in network.parameters())

        def decide(rows: np.ndarray) -> np.ndarray:
            with torch.no_grad():
                return network(x[rows]).argmax(dim=1).numpy()

        return Fitted(decide, parameters, multiplies(network, *x.shape[1:]))


# ---------------------------------------------------------------------- transfer
@dataclass(frozen=True)
class Transfer(Method):
    """The DCNN: a logistic regression on what a network sees. Value v of the frames in a row, sign * log2(1 +
    |deviation|) over the bits of a sample, is colour v mod 3 of pixel v // 3, row by row."""

    network: Path
    one_seed = True

    def fit(self, scene: Scene, parts: Sequence[np.ndarray], seed: int) -> list[Fitted]:
        sensor, network = scene.config.sensor, torch.export.load(self.network).module()
        sums = scene.config.last_frame * sensor.taxels / 3
        side = max(LEAST_SIDE, SIDE_STEP * math.ceil(math.sqrt(sums) / SIDE_STEP))
        frames = frames_of(scene, -(-3 * side * side // sensor.taxels)).reshape(len(scene.labels), -1)
        level = np.sign(frames) * np.log2(1 + np.abs(frames)) / sensor.sample_bits
        colours = 0.5 + 0.5 * np.clip(level[:, : 3 * side * side], -1, 1)
        mean, scale = (torch.tensor(values).view(1, 3, 1, 1) for values in (MEAN, SCALE))
        x = torch.tensor(colours.reshape(-1, side, side, 3).transpose(0, 3, 1, 2), dtype=torch.float32)
        x = (x - mean) / scale

        def seen(images: torch.Tensor) -> np.ndarray:
            with torch.no_grad():
                return torch.cat([network(image[None]) for image in images]).numpy()

        values = seen(x)
        last = scene.classes * values.shape[1]
        parameters = sum(p.numel() for p in network.parameters()) + last + scene.classes
        count = multiplies(network, *x.shape[1:]) + last
        fits = []
        for part in parts:
            model = make_pipeline(StandardScaler(), LogisticRegression(max_iter=500))
            model.fit(values[part], scene.labels[part])
            fits.append(
                Fitted(
                    lambda rows, model=model: model.predict(values[rows]),
                    parameters,
                    count,
                    alone=lambda row, model=model: model.predict(seen(x[row : row + 1])),
                )
            )
        return fits


OVER_TIME = (
    ImageMethod("cnn-lstm", "CNN-LSTM, images over time", CnnLstm),
    ImageMethod("convlstm", "ConvLSTM, images over time", ConvLstm),
)
