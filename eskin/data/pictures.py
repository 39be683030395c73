"""Folders of pressure images as PNG files, a sub-folder for each class."""

import dataclasses
import re
from pathlib import Path
from typing import NoReturn

import numpy as np

from eskin.golden.core import InputError
from eskin.golden.data.recordings import Recordings, recordings_of

SUFFIX = ".png"
LARGEST_SIDE = 256
MODES = ("1", "P", "L", "LA", "RGB", "RGBA")
"""Of Pillow: 8 bits a pixel at most, or grey in colours."""
RECORDED = (".csv", ".tsv", ".txt", ".lvm", ".parquet", ".mcap", ".db3", ".bag")
"""Files that are recordings themselves."""


def is_picture_folder(path: Path) -> bool:
    """True when a sub-folder of ``path`` holds PNG files, and none a file of recordings beside which they are
    plots."""
    folders = [folder for folder in path.iterdir() if folder.is_dir()]
    beside = any(file.suffix.lower() in RECORDED for folder in folders for file in folder.iterdir())
    return not beside and any(map(_pictures, folders))


def load_picture_folder(path: Path) -> Recordings:
    """The images of a folder: class names are the sub-folders' names, in order of the alphabet, and so are
    the files of each.

    Raises
    ------
    InputError
        A file is no image, has colours or more than 8 bits, or another size than the first; a sub-folder has
        none.
    """
    from PIL import Image

    def refuse(file: Path, why: str) -> NoReturn:
        raise InputError(f"image '{file}': {why}")

    classes = sorted(
        folder for folder in path.iterdir() if folder.is_dir() and not folder.name.startswith(".")
    )
    images: list[np.ndarray] = []
    labels, names = [], []
    for label, folder in enumerate(classes):
        files = _pictures(folder)
        if not files:
            refuse(folder, f"holds no {SUFFIX} file; give every class some, or take the folder away")
        for file in files:
            try:
                with Image.open(file) as picture:
                    mode, width, height = picture.mode, *picture.size
                    small = max(width, height) <= LARGEST_SIDE
                    pixels = np.asarray(picture.convert("RGB") if small and mode in MODES else 0)
            except (OSError, Image.DecompressionBombError, SyntaxError, ValueError) as error:
                refuse(file, f"cannot be read ({error}); save it as an 8-bit grey PNG")
            if not small:
                why = f"has {height} x {width} pixels, and a side at most {LARGEST_SIDE}"
                refuse(file, f"{why}; save it smaller")
            if mode not in MODES:
                refuse(file, f"has mode {mode}; save it as an 8-bit grey PNG")
            if (pixels != pixels[..., :1]).any():
                refuse(file, "has colours; pressure is one number a pixel: save it as an 8-bit grey PNG")
            if images and pixels.shape[:2] != images[0].shape:
                first = f"{images[0].shape[0]} x {images[0].shape[1]}"
                refuse(
                    file, f"has {height} x {width} pixels and the first one {first}; bring all to one size"
                )
            images.append(pixels[..., 0])
            labels.append(label)
            names.append(file.name)
    arrays = {
        "images": np.array(images),
        "labels": np.array(labels),
        "class_names": np.array([folder.name for folder in classes]),
    }
    return recordings_of(arrays, str(path), groups={"source_file": np.array(names)})


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


def _pictures(folder: Path) -> list[Path]:
    return sorted(file for file in folder.iterdir() if file.suffix.lower() == SUFFIX and file.is_file())
