"""Pressure images as PNG files, and images of another size."""

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np

from eskin.golden.core import InputError
from eskin.golden.data.recordings import Recordings, recordings_of

LARGEST_SIDE = 256
MODES = ("1", "P", "L", "LA", "RGB", "RGBA")
"""Of Pillow: 8 bits a pixel at most, or grey in colours."""


def load_pictures(source: Path, files: Sequence[Path]) -> Recordings:
    """The images of a folder with a sub-folder a class.

    Raises
    ------
    InputError
        A file is no image, has colours or more than 8 bits, or another size than the first.
    """
    images: list[np.ndarray] = []
    for file in files:
        pixels = _pixels(file)
        if images and pixels.shape != images[0].shape:
            height, width = pixels.shape
            first = "{} x {}".format(*images[0].shape)
            _refuse(file, f"has {height} x {width} pixels and the first one {first}; bring all to one size")
        images.append(pixels)
    labels = np.array([file.relative_to(source).parts[0] for file in files])
    names = np.array([file.name for file in files])
    arrays = {"images": np.array(images), "labels": labels}
    return recordings_of(arrays, str(source), groups={"source_file": names})


def _pixels(file: Path) -> np.ndarray:
    """(height, width) uint8."""
    from PIL import Image

    try:
        with Image.open(file) as picture:
            mode, (width, height) = picture.mode, picture.size
            small = max(width, height) <= LARGEST_SIDE
            pixels = np.asarray(picture.convert("RGB") if small and mode in MODES else 0)
    except (OSError, Image.DecompressionBombError, SyntaxError, ValueError) as error:
        _refuse(file, f"cannot be read ({error}); save it as an 8-bit grey PNG")
    if not small:
        why = f"has {height} x {width} pixels, and a side at most {LARGEST_SIDE}"
        _refuse(file, f"{why}; save it smaller")
    if mode not in MODES:
        _refuse(file, f"has mode {mode}; save it as an 8-bit grey PNG")
    if (pixels != pixels[..., :1]).any():
        _refuse(file, "has colours; pressure is one number a pixel: save it as an 8-bit grey PNG")
    return pixels[..., 0]


def _refuse(file: Path, why: str) -> NoReturn:
    raise InputError(f"image '{file}': {why}")


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
