"""DCNN by transfer: the touch as one colour image, a network trained on photographs, a new last layer
(chapter 2 of the thesis).

The thesis writes 4 x 4 x 30000 samples into 400 x 400 pixels of three colours, which hold just as many
values. Here the image is as small as it holds the touch, 64 pixels a side at least, in steps of 32. Frames
follow each other row by row, stretched in time to fill it. A value is sign * log2(1 + |deviation|) over the
bits of a sample, between 0 and 1: no scale is taken from the recordings.

The network is MobileNetV2 (M. Sandler et al. 2018), one of the thesis's, under torchvision's names, so that
torchvision's weights fit; the project downloads none. Without a file of weights the layers are random, and
only the last one learns.
"""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch

from eskin.golden.core import Arrays, InputError
from eskin.study.baselines.method import Fitted, Method
from eskin.study.baselines.scene import Scene
from eskin.study.baselines.tiles import multiplies

BLOCKS = (
    (1, 16, 1, 1),
    (6, 24, 2, 2),
    (6, 32, 3, 2),
    (6, 64, 4, 2),
    (6, 96, 3, 1),
    (6, 160, 3, 2),
    (6, 320, 1, 1),
)
"""MobileNetV2: expansion, channels, how many, stride of the first."""

VALUES = 1280
"""What the last layer reads."""

LEAST_SIDE, SIDE_STEP = 64, 32

MEAN, SCALE = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Of the photographs that published weights were trained on, by colour."""

LEARNT_NOT = (
    "dcnn: no --weights FILE, so its layers are random and only the last one learns: this is no transfer"
)


def _step(a: int, b: int, kernel: int, stride: int = 1, groups: int = 1) -> torch.nn.Sequential:
    convolution = torch.nn.Conv2d(a, b, kernel, stride, kernel // 2, groups=groups, bias=False)
    return torch.nn.Sequential(convolution, torch.nn.BatchNorm2d(b), torch.nn.ReLU6())


class _Block(torch.nn.Module):
    """Expand, one convolution a channel, project; added to its input where the sizes agree."""

    def __init__(self, a: int, b: int, stride: int, expand: int) -> None:
        super().__init__()
        inner = a * expand
        steps: list[torch.nn.Module] = [_step(a, inner, 1)] if expand > 1 else []
        steps += [
            _step(inner, inner, 3, stride, inner),
            torch.nn.Conv2d(inner, b, 1, bias=False),
            torch.nn.BatchNorm2d(b),
        ]
        self.conv = torch.nn.Sequential(*steps)
        self.added = stride == 1 and a == b

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x + self.conv(x) if self.added else self.conv(x)


class MobileNetV2(torch.nn.Module):
    """Images (n, 3, side, side) to VALUES values each; ``classifier`` is there for the names and the count of
    a file of weights."""

    def __init__(self, classes: int = 1000) -> None:
        super().__init__()
        layers: list[torch.nn.Module] = [_step(3, 32, 3, 2)]
        width = 32
        for expand, channels, count, stride in BLOCKS:
            for number in range(count):
                layers.append(_Block(width, channels, stride if number == 0 else 1, expand))
                width = channels
        layers.append(_step(width, VALUES, 1))
        self.features = torch.nn.Sequential(*layers)
        self.classifier = torch.nn.Sequential(torch.nn.Dropout(0.2), torch.nn.Linear(VALUES, classes))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Means over the last maps."""
        return self.features(x).mean(dim=(2, 3))


def read_weights(path: str | Path) -> dict[str, np.ndarray]:
    """The layers of a torchvision ``mobilenet_v2`` state dictionary (``torch.save``), without the last.

    Raises
    ------
    InputError
        No such file, no state dictionary, or that of another network.
    """
    fix = "give a state dictionary of torchvision's mobilenet_v2"
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise InputError(f"--weights {path}: there is no such file; {fix}") from None
    except Exception:  # what a foreign file does to the reader of archives and pickles is not documented
        raise InputError(f"--weights {path}: is no file of torch weights; {fix}") from None
    if not isinstance(state, Mapping) or not all(isinstance(value, torch.Tensor) for value in state.values()):
        raise InputError(f"--weights {path}: holds no dictionary of arrays; {fix}")
    with torch.device("meta"):
        shapes = {
            name: tuple(array.shape) for name, array in MobileNetV2().state_dict().items() if _kept(name)
        }
    for name, shape in shapes.items():
        if name not in state:
            raise InputError(f"--weights {path}: is of another network, it has no '{name}'; {fix}")
        if tuple(state[name].shape) != shape:
            raise InputError(
                f"--weights {path}: is of another network, '{name}' is {tuple(state[name].shape)} and not "
                f"{shape}; {fix}"
            )
    extra = next((name for name in state if name not in shapes and _kept(name)), None)
    if extra is not None:
        raise InputError(f"--weights {path}: is of another network, it has '{extra}'; {fix}")
    arrays = {name: state[name].float().numpy() for name in shapes}
    if not all(np.isfinite(array).all() for array in arrays.values()):
        raise InputError(f"--weights {path}: holds values that are no finite numbers; {fix}")
    return arrays


def _kept(name: str) -> bool:
    return (name.startswith("features.") and not name.endswith("num_batches_tracked")) or not name.startswith(
        ("features.", "classifier.")
    )


def network_of(weights: Arrays | None, seed: int = 0) -> MobileNetV2:
    """MobileNetV2 with these layers; None: random ones (K. He et al. 2015)."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = MobileNetV2(1)
        for layer in network.modules():
            if isinstance(layer, torch.nn.Conv2d):
                torch.nn.init.kaiming_normal_(layer.weight, mode="fan_out")
    if weights is not None:
        network.load_state_dict({name: torch.tensor(array) for name, array in weights.items()}, strict=False)
    return network.eval()


def side_of(scene: Scene) -> int:
    """Pixels of an image's side."""
    values = scene.config.last_frame * scene.config.sensor.taxels
    return max(LEAST_SIDE, SIDE_STEP * math.ceil(math.sqrt(values / 3) / SIDE_STEP))


def pictures(scene: Scene, side: int) -> np.ndarray:
    """(n, 3, side, side), 0 to 1: value v of the frames in a row is colour v mod 3 of pixel v // 3, row by
    row."""
    values, taxels = 3 * side * side, scene.config.sensor.taxels
    frames = scene.frames(-(-values // taxels)).reshape(len(scene.labels), -1)[:, :values]
    level = np.sign(frames) * np.log2(1 + np.abs(frames)) / scene.config.sensor.sample_bits
    return (
        (0.5 + 0.5 * np.clip(level, -1, 1))
        .reshape(-1, side, side, 3)
        .transpose(0, 3, 1, 2)
        .astype(np.float32)
    )


_known: dict[int, tuple[Scene, MobileNetV2, torch.Tensor, np.ndarray]] = {}


def _seen(scene: Scene) -> tuple[MobileNetV2, torch.Tensor, np.ndarray]:
    """The network, every picture, and what the network sees in it; found once, since no label is in it."""
    if id(scene) not in _known:
        _known.clear()
        network = network_of(scene.weights)
        mean, scale = (torch.tensor(values).view(1, 3, 1, 1) for values in (MEAN, SCALE))
        x = (torch.tensor(pictures(scene, side_of(scene))) - mean) / scale
        with torch.no_grad():
            features = torch.cat([network(part) for part in x.split(32)]).numpy()
        _known[id(scene)] = (scene, network, x, features.astype(np.float64))
    return _known[id(scene)][1:]


def fit_dcnn(scene: Scene, part: np.ndarray, seed: int) -> Fitted:
    """The last layer: a logistic regression on what the network sees."""
    from sklearn.linear_model import LogisticRegression

    network, x, features = _seen(scene)
    middle, spread = features[part].mean(axis=0), features[part].std(axis=0) + 1e-9
    model = LogisticRegression(max_iter=500).fit((features[part] - middle) / spread, scene.labels[part])

    def alone(row: int) -> np.ndarray:
        with torch.no_grad():
            values = network(x[row : row + 1]).numpy()
        return model.predict((values - middle) / spread)

    last = scene.classes * VALUES
    layers = sum(p.numel() for p in network.features.parameters())
    return Fitted(
        lambda rows: model.predict((features[rows] - middle) / spread),
        layers + last + scene.classes,
        multiplies(network, *x.shape[1:]) + last,
        alone=alone,
    )


TRANSFER = (Method("dcnn", "DCNN by transfer, one image", "transfer", fit_dcnn, one_seed=True),)
