"""Small pressure images of three shapes that a small network tells apart after few epochs."""

from __future__ import annotations

import numpy as np

from eskin.golden.data.recordings import Recordings, image_recordings

SHAPES = ("bar", "dot", "frame")


def shapes(count: int, seed: int, size: tuple[int, int] = (8, 8)) -> Recordings:
    """``count`` images of each of SHAPES, moved about and of different strength."""
    rng = np.random.default_rng(seed)
    height, width = size
    images, labels = [], []
    for label, _ in enumerate(SHAPES):
        for _ in range(count):
            image = np.zeros(size)
            top, left, strength = rng.integers(0, height - 5), rng.integers(0, width - 5), rng.integers(120, 250)
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
