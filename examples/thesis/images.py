"""CNN-LSTM and ConvLSTM on images of the array over time ("Dataset B" of the thesis), and a network trained on
photographs with a new last layer (its chapter 2), small enough for two cores.

The thesis cuts 6144 frames into 24 images; each holds 256 frames of 4 x 4 taxels side by side, 64 x 64
pixels. Here it is IMAGES images of TILES x TILES frames, means over time, so a fold trains in a minute.

- CNN-LSTM: two convolutions and pools on each image, their values into an LSTM, which decides at the last
  image. The thesis takes the values from networks trained on photographs; these convolutions are trained with
  the rest.
- ConvLSTM: an LSTM whose products are 3 x 3 convolutions, its last state pooled, two dense layers.
- DCNN: the touch as one colour image, 64 pixels a side at least, values in a row; MobileNetV2 (M. Sandler et
  al. 2018) under torchvision's names, so that its weights fit (``--weights``; none are downloaded). Without
  them the layers are random, and only the last one learns: that is no transfer.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from frames import frames_of, shape_of
from sklearn.linear_model import LogisticRegression
from torch.utils.flop_counter import FlopCounterMode

from eskin.study.baselines import Fitted, Scene
from eskin.training.losses import descend

IMAGES, TILES = 12, 4
"""Images of a touch; tiles along each side of an image, a frame each."""
UPDATES, BATCH, RATE = 400, 32, 0.01
"""Training: Adam on cross-entropy, one cycle."""
FILTERS = 8
"""Filters of each gate of the ConvLSTM."""
VALUES, LEAST_SIDE, SIDE_STEP = 1280, 64, 32
"""Inputs of the last layer of the DCNN; pixels of its image's side."""
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
class ImageMethod:
    """A network on images over time."""

    name: str
    label: str
    make: Callable[[int, int, int], torch.nn.Module]
    hardware: bool = False
    one_seed: bool = True

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
def _step(a: int, b: int, kernel: int, stride: int = 1, groups: int = 1) -> torch.nn.Sequential:
    convolution = torch.nn.Conv2d(a, b, kernel, stride, kernel // 2, groups=groups, bias=False)
    return torch.nn.Sequential(convolution, torch.nn.BatchNorm2d(b), torch.nn.ReLU6())


class _Block(torch.nn.Module):
    """Expand, one convolution a channel, project; added to its input where the sizes agree."""

    def __init__(self, a: int, b: int, stride: int, expand: int) -> None:
        super().__init__()
        inner, self.added = a * expand, stride == 1 and a == b
        steps = [_step(a, inner, 1)] if expand > 1 else []
        projected = torch.nn.Conv2d(inner, b, 1, bias=False), torch.nn.BatchNorm2d(b)
        self.conv = torch.nn.Sequential(*steps, _step(inner, inner, 3, stride, inner), *projected)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x + self.conv(x) if self.added else self.conv(x)


class MobileNetV2(torch.nn.Module):
    """Images (n, 3, side, side) to VALUES values each; ``classifier`` is there for the names in a file."""

    def __init__(self) -> None:
        super().__init__()
        layers: list[torch.nn.Module] = [_step(3, 32, 3, 2)]
        width = 32
        for expand, channels, count, stride in (
            (1, 16, 1, 1), (6, 24, 2, 2), (6, 32, 3, 2), (6, 64, 4, 2), (6, 96, 3, 1), (6, 160, 3, 2), (6, 320, 1, 1)
        ):  # fmt: skip
            for number in range(count):
                layers.append(_Block(width, channels, stride if number == 0 else 1, expand))
                width = channels
        self.features = torch.nn.Sequential(*layers, _step(width, VALUES, 1))
        self.classifier = torch.nn.Sequential(torch.nn.Dropout(0.2), torch.nn.Linear(VALUES, 1000))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.features(x).mean(dim=(2, 3))


def mobilenet(weights: Path | None) -> MobileNetV2:
    """With the weights of a file; None: random layers (K. He et al. 2015)."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        network = MobileNetV2()
        for layer in network.modules():
            if isinstance(layer, torch.nn.Conv2d):
                torch.nn.init.kaiming_normal_(layer.weight, mode="fan_out")
    if weights is not None:
        network.load_state_dict(torch.load(weights, map_location="cpu", weights_only=True))
    return network.eval()


@dataclass(frozen=True)
class Transfer:
    """The DCNN: a logistic regression on what the network sees. Value v of the frames in a row, sign * log2(1 +
    |deviation|) over the bits of a sample, is colour v mod 3 of pixel v // 3, row by row."""

    name: str = "dcnn"
    label: str = "DCNN by transfer, one image"
    weights: Path | None = None
    hardware: bool = False
    one_seed: bool = True

    def fit(self, scene: Scene, parts: Sequence[np.ndarray], seed: int) -> list[Fitted]:
        sensor, network = scene.config.sensor, mobilenet(self.weights)
        held = scene.config.last_frame * sensor.taxels / 3
        side = max(LEAST_SIDE, SIDE_STEP * math.ceil(math.sqrt(held) / SIDE_STEP))
        frames = frames_of(scene, -(-3 * side * side // sensor.taxels)).reshape(len(scene.labels), -1)
        level = np.sign(frames) * np.log2(1 + np.abs(frames)) / sensor.sample_bits
        colours = 0.5 + 0.5 * np.clip(level[:, : 3 * side * side], -1, 1)
        mean, scale = (torch.tensor(values).view(1, 3, 1, 1) for values in (MEAN, SCALE))
        x = torch.tensor(colours.reshape(-1, side, side, 3).transpose(0, 3, 1, 2), dtype=torch.float32)
        x = (x - mean) / scale

        def seen(rows: torch.Tensor) -> np.ndarray:
            with torch.no_grad():
                return torch.cat([network(some) for some in rows.split(32)]).numpy()

        values, last = seen(x), scene.classes * VALUES
        parameters = sum(p.numel() for p in network.features.parameters()) + last + scene.classes
        count = multiplies(network, *x.shape[1:]) + last
        fits = []
        for part in parts:
            middle, spread = values[part].mean(axis=0), values[part].std(axis=0) + 1e-9
            model = LogisticRegression(max_iter=500).fit((values[part] - middle) / spread, scene.labels[part])

            def known(rows: np.ndarray, model=model, middle=middle, spread=spread) -> np.ndarray:
                return model.predict((values[rows] - middle) / spread)

            def alone(row: int, model=model, middle=middle, spread=spread) -> np.ndarray:
                return model.predict((seen(x[row : row + 1]) - middle) / spread)

            fits.append(Fitted(known, parameters, count, alone=alone))
        return fits


OVER_TIME = (
    ImageMethod("cnn-lstm", "CNN-LSTM, images over time", CnnLstm),
    ImageMethod("convlstm", "ConvLSTM, images over time", ConvLstm),
)
