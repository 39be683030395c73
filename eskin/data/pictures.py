"""Pressure images as PNG files, a sub-folder a class."""

from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np

from eskin.golden.core import InputError
from eskin.golden.data.recordings import Recordings, recordings_of

MODES = ("1", "P", "L", "LA", "RGB", "RGBA")
"""Pillow's modes that are read: 8 bits a pixel at most, or grey in colours."""


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
            mode = picture.mode
            pixels = np.asarray(picture.convert("RGB") if mode in MODES else 0)
    except (OSError, Image.DecompressionBombError, SyntaxError, ValueError) as error:
        _refuse(file, f"cannot be read ({error}); save it as an 8-bit grey PNG")
    if mode not in MODES:
        _refuse(file, f"has mode {mode}; save it as an 8-bit grey PNG")
    if (pixels != pixels[..., :1]).any():
        _refuse(file, "has colours; pressure is one number a pixel: save it as an 8-bit grey PNG")
    return pixels[..., 0]


def _refuse(file: Path, why: str) -> NoReturn:
    raise InputError(f"image '{file}': {why}")
