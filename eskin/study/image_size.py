"""Images of another size."""

import dataclasses
import re

import numpy as np

from eskin.golden.core import InputError
from eskin.golden.data import Recordings


def image_size(text: str) -> tuple[int, int]:
    """Height and width that ``26x47`` says."""
    sides = re.fullmatch(r"(\d{1,3})x(\d{1,3})", text.lower())
    if not sides or not (4 <= int(sides[1]) <= 256 and 4 <= int(sides[2]) <= 160):
        raise InputError(
            f"--size {text[:40]}: is no size of images; give height x width, 4x4 to 256x160, as in 26x47"
        )
    return int(sides[1]), int(sides[2])


def resized(recordings: Recordings, height: int, width: int) -> Recordings:
    """Images of another size: each new pixel is the mean of the area that it covers, rounded half up.

    Raises
    ------
    InputError
        The recordings are no images.
    """
    if recordings.image_shape is None:
        raise InputError(
            f"recordings '{recordings.source}': are no images, so have no height and width; leave --size out"
        )
    old = recordings.image_shape
    images = recordings.samples.reshape(-1, *old)
    scaled = np.floor(_areas(old[0], height) @ images @ _areas(old[1], width).T + 0.5).astype(np.int32)
    offsets = np.arange(len(recordings) + 1, dtype=np.int64) * height
    return dataclasses.replace(
        recordings, samples=scaled.reshape(-1, width), offsets=offsets, image_shape=(height, width)
    )


def _areas(old: int, new: int) -> np.ndarray:
    """(new, old): the share of each old pixel in each new one, along one axis."""
    ends = np.arange(new + 1) * old / new
    places = np.arange(old)
    overlap = np.minimum(ends[1:, None], places + 1) - np.maximum(ends[:-1, None], places)
    return np.maximum(overlap, 0) * new / old
