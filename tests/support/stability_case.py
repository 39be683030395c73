"""A tiny array with three touches that six taxels tell apart with room to spare, and a network trained on it,
for the failure modes."""

import dataclasses
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel
from eskin.study.stability.core import Bench
from eskin.training import datasets
from eskin.training import fit as fitting
from eskin.training import recipe as recipes
from eskin.training.formats import with_network
from eskin.training.quantise import profile, quantise_model
from tests.support.touch_scenes import SMALL

CONFIG = SMALL.replace(
    name="tiny",
    taxels=6,
    rest_frames=32,
    clip=112,
    onset_check_frames=8,
    onset_threshold=8,
    rearm_frames=40,
    hop=24,
    window=48,
    steps=10,
    hidden=12,
    class_names=("left", "right", "both"),
    fault_frames=16,
    fault_activity=3,
    clock_hz=1e6,
)
KINDS = dict(
    feature_kinds=("mean", "activity", "integral"), activity_rule="change", activity_block=8, integral_knee=5
)
NOISE = 1.5
PATTERNS = np.array([[1, -1, 1, -1, 1, -1], [-1, 1, -1, 1, -1, 1], [1, 1, -1, -1, 1, 1]], dtype=float)


def recordings(count: int = 24, seed: int = 1) -> Recordings:
    """Touches of 50 to 105 codes on every taxel, a slow swing with the sign of its class's pattern; groups
    ``trial``."""
    rng = np.random.default_rng(seed)
    labels = np.arange(count) % 3
    streams = []
    for label in labels:
        lead, touch = int(rng.integers(120, 170)), CONFIG.last_frame
        time = np.arange(lead + 2 * touch)
        shape = np.where(
            time >= lead, np.sin(np.clip((time - lead) / (1.5 * touch), 0, 1) * np.pi) ** 0.3, 0.0
        )
        height = rng.uniform(60, 90) * rng.uniform(0.85, 1.15, CONFIG.sensor.taxels)
        streams.append(
            29000
            + 40 * rng.standard_normal(CONFIG.sensor.taxels)
            + shape[:, None] * PATTERNS[label] * height
            + NOISE * rng.standard_normal((len(time), CONFIG.sensor.taxels))
        )
    return Recordings.of(
        [np.rint(stream).astype(int) for stream in streams],
        labels,
        class_names=CONFIG.network.class_names,
        sample_rate_hz=CONFIG.sensor.sample_rate_hz,
        groups={"trial": np.arange(count) // 3 % 4},
        source="tiny",
    )


def _trained(config: AcceleratorConfig, recipe: str, updates: int) -> Bench:
    """A network, trained once a session, with 200 steps as its longest run and few flips."""
    data, recipe = recordings(), dataclasses.replace(recipes.RECIPES[recipe], updates=updates)
    found = datasets.find_dataset(data, config, recipe)
    rows = [datasets.touch_rows(found, np.arange(len(data)))]
    (model,) = fitting.fit_networks(found, config, recipe, rows, 1, lambda done, total: None)
    integer = quantise_model(model, profile(model, found.touches))
    options = {"config": integer.config, "few": 9, "points": 1, "long": 200, "flips": 96}
    return Bench(recordings=data, model=integer, real=model, **options)


@cache
def bench() -> Bench:
    """A GRU."""
    return _trained(CONFIG, "robust", 200)


@cache
def linear_bench() -> Bench:
    """The same touches, a linear cell on all kinds of feature."""
    return _trained(with_network(CONFIG, cell="linear").replace(**KINDS), "linear", 4)


def model_folder(folder: Path) -> Path:
    """The same network as a model folder."""
    of = bench()
    of.real.save(folder, {})
    of.model.save(folder)
    return folder


def changed(of: Bench, config: Any = None, arrays: Any = None) -> Bench:
    """A bench with fields of the configuration or arrays of the integer model replaced; disturbances and bounds are
    the sound model's."""
    fields = of.config.replace(**(config or {}))
    model = IntegerModel(fields, of.model.arrays | (arrays or {}))
    whole, few = (dataclasses.replace(each, config=fields, model=model) for each in (of, of.sample))
    for other, sound in ((whole, of), (few, of.sample)):
        for name in ("clean", "onsets", "sigma", "rest_noise", "clean_accuracy"):
            vars(other)[name] = getattr(sound, name)
    vars(whole)["sample"] = few
    return whole
