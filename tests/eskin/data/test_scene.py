"""The scene of the presets: as it was published, and as its name and configuration say."""

import numpy as np
import pytest

from eskin.data import load_recordings, synthetic_recordings, turns
from eskin.data.fit import check_fit
from eskin.data.scene import SCENES, synthetic_scene
from eskin.golden.core import PRESETS, AcceleratorConfig, InputError
from eskin.training.formats import with_network
from tests.support.table import each_row

SYNTHETIC = PRESETS["synthetic"]


# ---------------------------------------------------------------------- other classes and arrays
def sized(taxels: int, classes: int, hidden: int = 12, steps: int = 20, **changes) -> AcceleratorConfig:
    """The synthetic configuration of another array and task."""
    names = (SCENES | {4: turns.CLASSES})[classes]
    return with_network(
        SYNTHETIC.replace(taxels=taxels, class_names=names, **changes), hidden=hidden, steps=steps
    )


def test_the_default_scene_is_what_it_was():
    """Samples, labels, classes and groups, by their check sum: results that were published on it must not move."""
    assert synthetic_recordings().content.startswith("64448ee5d3bf1853")


def test_the_scene_follows_from_the_configuration():
    for taxels, rows in ((4, 2), (8, 2), (12, 3), (36, 6)):
        config = sized(taxels, 2, sample_rate_hz=200.0)
        scene = load_recordings("synthetic", config=config)
        same = synthetic_recordings(rows=rows, columns=taxels // rows, classes=2, sample_rate_hz=200.0)
        assert np.array_equal(scene.samples, same.samples)
        check_fit(scene, config)
    small = load_recordings("synthetic", config=sized(16, 3, sample_rate_hz=200.0))
    assert len(small) == 240 and np.array_equal(
        small.samples, synthetic_recordings(sample_rate_hz=200.0).samples
    )


@each_row("taxels, classes, persons, trials", [(16, 3, 20, 4), (4, 2, 20, 4), (64, 3, 20, 2)])
def test_many_taxels_and_classes_make_fewer_recordings(monkeypatch, taxels, classes, persons, trials):
    asked: dict[str, int] = {}
    monkeypatch.setattr("eskin.data.scene.synthetic_recordings", asked.update)
    synthetic_scene(sized(taxels, classes))
    assert (asked["persons"], asked["trials"], asked["rows"] * asked["columns"]) == (persons, trials, taxels)
    assert persons * trials * classes * taxels * 9000 <= 1 << 27


@each_row(
    "config, match",
    [
        (SYNTHETIC.replace(taxels=7), "field taxels: is 7; the synthetic scene has 2 to 8 rows and columns"),
        (SYNTHETIC.replace(taxels=160), "field taxels: is 160; the synthetic scene has 2 to 8 rows"),
        (
            PRESETS["pvdf"],
            "field class_names: is Cube3, .*; the synthetic scenes have brush, slide, or brush, roll, slide, or on, left, back",
        ),
        (
            SYNTHETIC.replace(class_names=("slide", "brush")),
            "field class_names: is slide, brush; .* have brush, slide, or",
        ),
        (
            SYNTHETIC.replace(sample_rate_hz=35.6),
            "synthetic scene, sample_rate_hz: is 35.6; it must lie in 100..20000",
        ),
    ],
)
def test_configurations_without_a_scene_are_refused(config, match):
    with pytest.raises(InputError, match=match):
        load_recordings("synthetic", config=config)


def test_four_classes_from_python_are_refused():
    with pytest.raises(InputError, match="synthetic scene, classes: is 4; use 2 or 3"):
        synthetic_recordings(classes=4)
