"""Folders of PNG files, and images of another size."""

import numpy as np
import pytest
from PIL import Image

from eskin.data import load_recordings
from eskin.golden.core import InputError
from eskin.study.image_size import resized
from tests.support.image_scenes import shapes
from tests.support.table import each_row


def folder_of(tmp_path, mode="L"):
    rng = np.random.default_rng(0)
    images = {}
    for name in ("cup", "ball"):
        (tmp_path / name).mkdir()
        for number in range(3):
            image = rng.integers(0, 256, (6, 9)).astype(np.uint8)
            Image.fromarray(image).convert(mode).save(tmp_path / name / f"{name}{number}.png")
            images[name, number] = image
    return images


@each_row("mode", ["L", "RGB", "LA"])
def test_a_folder_by_class_is_an_archive_of_images(tmp_path, mode):
    images = folder_of(tmp_path, mode)
    loaded = load_recordings(tmp_path)
    assert loaded.image_shape == (6, 9)
    assert loaded.class_names == ("ball", "cup")
    assert loaded.labels.tolist() == [0, 0, 0, 1, 1, 1]
    assert (loaded.recording(4) == images["cup", 1]).all() and loaded.groups["source_file"][4] == "cup1.png"


@each_row(
    ("damage", "words"),
    [
        (
            lambda folder: Image.new("L", (9, 7)).save(folder / "cup" / "z.png"),
            "z.png': has 7 x 9 pixels and the first one 6 x 9",
        ),
        (
            lambda folder: Image.new("RGB", (9, 6), (1, 2, 3)).save(folder / "cup" / "z.png"),
            "z.png': has colours",
        ),
        (
            lambda folder: Image.new("RGB", (9, 6), (9, 2, 3)).quantize().save(folder / "cup" / "z.png"),
            "z.png': has colours",
        ),
        (
            lambda folder: Image.new("L", (9, 257)).save(folder / "cup" / "z.png"),
            "z.png': has 257 x 9 pixels and the first one 6 x 9",
        ),
        (
            lambda folder: Image.new("I;16", (9, 6)).save(folder / "cup" / "z.png"),
            "z.png': has mode I;16; save it as an 8-bit grey PNG",
        ),
        (lambda folder: (folder / "cup" / "z.png").write_bytes(b"no picture"), "z.png': cannot be read"),
        (lambda folder: (folder / "none").mkdir(), "none': has no file of recordings"),
    ],
)
def test_what_is_no_pressure_image_is_refused_by_its_name(tmp_path, damage, words):
    folder_of(tmp_path)
    damage(tmp_path)
    with pytest.raises(InputError, match=words) as refused:
        load_recordings(tmp_path)
    assert "\n" not in str(refused.value)


def test_another_size_keeps_the_mean_and_the_place():
    scene = shapes(2, 0, (8, 12))
    same = resized(scene, 8, 12)
    assert (same.samples == scene.samples).all()
    half = resized(scene, 4, 6)
    image = scene.recording(0).reshape(4, 2, 6, 2).mean(axis=(1, 3))
    assert half.image_shape == (4, 6) and (half.recording(0) == np.floor(image + 0.5)).all()
    odd = resized(scene, 7, 11)
    assert abs(odd.recording(3).mean() - scene.recording(3).mean()) < 0.5 and odd.lengths.tolist() == [7] * 6
