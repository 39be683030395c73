"""Failure modes of networks for images: disturbances do what they say, sound networks hold their bounds,
broken variants do not."""

import dataclasses

import numpy as np
import pytest

from eskin.golden.core import AcceleratorConfig
from eskin.golden.model import IntegerModel, images_of, run_images
from eskin.requests import StabilityRequest
from eskin.study.stability.images import (
    IMAGE_MODES,
    ImageBench,
    continued,
    empty_images,
    fainter,
    kept_maps,
    lost_taxels,
    plain_run,
    shifted,
    stuck_taxels,
    turned,
)
from eskin.study.stability.suite import judge
from eskin.training.image_formats import quantised
from eskin.training.train_images import ImageRecipe, train_network
from eskin.verbs.stability_job import run
from tests.support.image_scenes import SHAPES, shapes

RECIPE = ImageRecipe(
    epochs=40, batch=16, turn=20.0, mirror=False, shift=0.1, zoom=0.0, dropout=0.0, noise=0.01
)


@pytest.fixture(scope="module")
def bench() -> ImageBench:
    scene = shapes(40, 0, (14, 16))
    config = AcceleratorConfig.of_image(
        14, 16, ("conv 3 4", "pool", "conv 3 8", "pool", "dense 3"), SHAPES, name="shapes"
    )
    model = train_network(config, images_of(scene), scene.labels, recipe=RECIPE, seed=0)
    bench = ImageBench(quantised(model, images_of(scene)), scene, few=60, flips=150)
    assert bench.clean_accuracy > 0.95
    return bench


def rows(bench):
    return [
        (f"W_{stage.number}", fmt)
        for stage, fmt in zip(bench.config.weighted_stages, bench.config.image.weight_formats, strict=True)
    ]


def changed(bench, *, arrays=None, run=plain_run):
    """A bench with other arrays of the integer network, or another part under test."""
    model = IntegerModel(bench.config, bench.model.arrays | (arrays or {}), bench.model.source)
    return dataclasses.replace(bench, model=model, run=run, origin=bench)


def seeing(change):
    """A bench whose network sees ``change`` of each image."""
    return lambda bench: changed(bench, run=lambda model, images: plain_run(model, change(images)))


def coarse(bench):
    arrays = {name: bench.model.arrays[name] >> fmt.width - 2 << fmt.width - 2 for name, fmt in rows(bench)}
    return changed(bench, arrays=arrays)


def overconfident(bench):
    return changed(
        bench, arrays={"b_0": np.clip(bench.model.arrays["b_0"] * 10 + (1 << 16), -(1 << 23), (1 << 23) - 1)}
    )


def fragile(bench):
    def run(model, images):
        upset = any(
            not np.array_equal(array, bench.model.arrays[name]) for name, array in model.arrays.items()
        )
        return plain_run(
            IntegerModel(model.config, model.arrays | ({"W_0": -model.arrays["W_0"]} if upset else {})),
            images,
        )

    return changed(bench, run=run)


def late(bench):
    def run(model, images):
        trace = plain_run(model, images)
        return dataclasses.replace(trace, decision=np.roll(trace.decision, 1))

    return changed(bench, run=run)


half_read = seeing(lambda images: images * (np.arange(images.shape[1]) < images.shape[1] // 2)[:, None])
BROKEN = {
    "object moved": half_read,
    "object turned": coarse,
    "pressed less, pressed more": seeing(lambda images: images & 127),
    "empty array": overconfident,
    "noise on every taxel": coarse,
    "taxels lost": half_read,
    "a taxel stuck": coarse,
    "a row lost": half_read,
    "a column lost": half_read,
    "a bit of a weight": fragile,
    "a bit of a map": late,
}


@pytest.mark.parametrize("name", IMAGE_MODES)
def test_every_mode_is_judged_and_its_broken_variant_fails(bench, name):
    mode = IMAGE_MODES[name]
    record, _ = judge(mode, bench)
    broken, _ = judge(mode, BROKEN[name](bench))
    assert record["worst_case"] and record["curve"]["x"]
    assert record["bound"] == pytest.approx(broken["bound"], abs=1e-6)
    assert not broken["passed"], (broken["value"], broken["bound"])
    assert (record["value"] > broken["value"]) == (mode.at_least is not None)


def test_disturbances_do_what_they_say(bench):
    images = bench.images[:3]
    wide = np.pad(images, ((0, 0), (3, 3), (3, 3)))
    corners = ((0, 3), (6, 3), (3, 0), (3, 6))
    moved = [wide[:, y : y + 14, x : x + 16] for y, x in corners]
    assert all(map(np.array_equal, shifted(bench, images, 0.2), moved))
    assert all((same == images).all() for same in shifted(bench, images, 0.0))
    weak, strong = fainter(bench, images, 0.5)
    assert (weak == np.rint(images * 0.5)).all() and strong.max() == 255 and (strong >= images).all()
    (lost,) = lost_taxels(bench, np.full((50, 14, 16), 9, np.uint8), 0.1)
    assert set(np.unique(lost)) == {0, 9} and 0.08 < np.mean(lost == 0) < 0.12
    (stuck,) = stuck_taxels(bench, images, 3)
    assert ((stuck != images).sum(axis=(1, 2)) == 3).all() and (stuck[stuck != images] == 255).all()
    bar = np.zeros((1, 15, 15), np.uint8)
    bar[0, 7, 3:12] = 200
    (upright, _) = turned(bench, bar, 90)
    assert (upright[0, 3:12, 7] == 200).all() and upright[0, 7, 3] == 0
    assert empty_images(bench, 0.0).tolist() == np.zeros((1, 14, 16)).tolist()
    assert empty_images(bench, 2.0).max() > 2


def test_a_map_goes_on_to_the_decision_of_the_whole_network(bench):
    images = bench.images[:20]
    whole = run_images(bench.model, images).decision
    maps = kept_maps(bench, images)
    assert list(maps) == [0, 2, 4] and all(
        (continued(bench.model, number, values) == whole).all() for number, values in maps.items()
    )


@pytest.mark.slow
def test_the_weakest_cases_are_confirmed_by_the_hardware(bench, tmp_path):
    bench.model.save(tmp_path / "model")
    asked = StabilityRequest(model=tmp_path / "model", data="made", out=tmp_path / "out", few=20)
    result = run(asked, bench.recordings, flips=20, workers=1, cache=tmp_path / "kept")
    played = [mode["rtl"] for mode in result["modes"] if mode["rtl"]]
    assert len(played) == 3 and all(rtl["bit_exact"] and rtl["compared_values"] > 100 for rtl in played)
