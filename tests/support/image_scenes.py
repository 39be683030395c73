"""Small pressure images of three shapes that a small network tells apart after few epochs; networks with
random weights."""

import math

import numpy as np

from eskin.golden.core import AcceleratorConfig, Pool, QFormat, narrow
from eskin.golden.core.images import PIXEL_FORMAT
from eskin.golden.data import Recordings
from eskin.golden.data.recordings import image_recordings
from eskin.golden.model import IntegerModel
from eskin.golden.model.image_network import accumulators, pooled
from eskin.training.made_up import random_images

SHAPES = ("bar", "dot", "frame")


def shapes(count: int, seed: int, size: tuple[int, int] = (8, 8)) -> Recordings:
    """``count`` images of each of SHAPES, moved about and of different strength."""
    rng = np.random.default_rng(seed)
    height, width = size
    images, labels = [], []
    for label, _ in enumerate(SHAPES):
        for _ in range(count):
            image = np.zeros(size)
            top, left, strength = (
                rng.integers(0, height - 5),
                rng.integers(0, width - 5),
                rng.integers(120, 250),
            )
            if label == 0:
                image[top + 2, left : left + 6] = strength
            elif label == 1:
                image[top + 1 : top + 4, left + 1 : left + 4] = strength
            else:
                image[top : top + 5, left : left + 5] = strength
                image[top + 1 : top + 4, left + 1 : left + 4] = 0
            images.append(np.clip(image + rng.integers(0, 6, size), 0, 255))
            labels.append(label)
    return image_recordings(np.array(images).astype(np.int64), np.array(labels), SHAPES, source="shapes")


def random_image_model(config: AcceleratorConfig, seed: int) -> IntegerModel:
    """A model with random weights, for tests: as trained ones are, or (one array in four) spread over the
    whole format. Its formats are chosen so that random images reach the ends of every map, and logits
    differ."""
    rng = np.random.default_rng(seed)
    bits = int(rng.choice([4, 8], p=[0.2, 0.8]))
    top = 2 ** (bits - 1) - 1
    arrays: dict[str, np.ndarray] = {}
    weights, given, before = [], [], PIXEL_FORMAT
    values = random_images(config, 8, seed)[..., None].astype(np.int64)
    for stage in config.stages:
        if isinstance(stage.layer, Pool):
            values = pooled(values)
            continue
        whole = rng.random() < 0.25
        drawn = (
            rng.integers(-top - 1, top + 1, stage.weight_shape)
            if whole
            else np.rint(rng.normal(0.0, 0.3 * top, stage.weight_shape))
        )
        codes = np.clip(drawn, -top - 1, top).astype(np.int64)
        sums = accumulators(stage, values, codes, np.zeros(stage.outputs))
        centre = sums.mean(axis=(0, 1, 2))  # as batch norm does, so that no channel is always 0
        bias = np.rint(rng.normal(-centre, 0.3 * float(np.std(sums)))).astype(np.int64)
        spread = float(np.quantile(np.abs(sums + bias), 0.99))
        arrays |= {f"W_{stage.number}": codes, f"b_{stage.number}": bias}
        shift = max(round(math.log2(max(spread, 1.0) / (8000 if stage.last else 200))), 0)
        fraction = bits - 1 + int(rng.integers(0, 3))
        weights.append(QFormat(bits - fraction, fraction))
        after = fraction + before.frac_bits - shift
        before = QFormat((16 if stage.last else 8) - after, after, signed=stage.last)
        given.append(before)
        values = narrow(accumulators(stage, values, codes, bias).astype(np.int64), shift, before)
    formats = {"weight_formats": tuple(weights), "map_formats": tuple(given[:-1]), "logit_format": given[-1]}
    return IntegerModel(config.replace(**formats), arrays, f"random image model {seed}")
