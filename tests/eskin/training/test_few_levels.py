"""A sensor of events, whose codes are 0 and 1: integers decide as floats do."""

from dataclasses import replace

import numpy as np

from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, load_training
from eskin.training.derive import derive_config
from eskin.training.formats import with_network
from eskin.training.integers import quantise
from eskin.training.train import TrainingRequest, train

TAXELS, CLASSES, FRAMES = 24, 6, 160


def events(count: int = 120, seed: int = 0) -> Recordings:
    """Classes differ in the rate of events of each taxel, which rises and falls; persons in all rates."""
    rng, size = np.random.default_rng(seed), (CLASSES, TAXELS)
    rates, depth, phase = (rng.uniform(0, most, size) for most in (0.03, 0.5, 2 * np.pi))
    time = 2 * np.pi * np.arange(FRAMES)[:, None] / FRAMES
    labels, persons = np.arange(count) % CLASSES, np.arange(count) // CLASSES % 4
    rising = [(0.01 + rates[k]) * (1 + depth[k] * np.sin(time + phase[k])) for k in labels]
    codes = [rng.random(rate.shape) < rate * (0.8 + 0.1 * p) for rate, p in zip(rising, persons, strict=True)]
    made = Recordings.of(
        np.array(codes).astype(np.uint8), labels, sample_rate_hz=200, groups={"person": persons}
    )
    return replace(made, sample_bits=8)


def test_two_code_levels_lose_nothing_in_integers(tmp_path):
    recordings = events()
    config = with_network(derive_config(recordings)[0], cell="linear")
    train(recordings, config, TrainingRequest(folds=4, seeds=1, splits=[["person"]]), out=tmp_path / "model")
    split = load_training(tmp_path / "model")["cross_validation"][0]
    assert split["float_accuracy"] > 0.75, "a scene that can be learned"
    assert split["float_accuracy"] - split["integer_accuracy"] <= 0.005 and split["agreement"] >= 0.95
    integer = quantise(tmp_path / "model")
    assert integer.config.mean_frac >= 4 and integer.config.formats.feature_format.width == 12
    assert (IntegerModel.load(tmp_path / "model").arrays["mean"] == integer.arrays["mean"]).all()
