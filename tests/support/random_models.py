"""Models with random weights."""

from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.model import FloatModel, IntegerModel, constants_shape, network_formats, network_shapes
from eskin.golden.model.model import readout_shapes
from eskin.golden.model.preprocess import companded
from eskin.training.formats import normaliser_constants


def random_integer_model(config: AcceleratorConfig, seed: int) -> IntegerModel:
    """A model with random weights, for tests: as a trained one, or (one array in four) spread over the whole
    format; biases are not 0.

    Mean and scale suit the signals that the configuration's front end lets through; feature_shift is filled
    when empty.
    """
    rng, rule, features = np.random.default_rng(seed), config.onset_rule, config.features
    banded = rule.onset == "band"
    spread = (rule.band_high - rule.band_low) / 2 if banded else float(rule.onset_threshold)
    level = (rule.band_low + rule.band_high) / 2 if config.rest_level.rest == "none" else 0.0
    mu: Any = level + spread * rng.uniform(-0.2, 0.2)
    few_levels = config.sensor.sample_bits <= 2
    sigma: Any = max(spread, 0.5 if few_levels else 8.0) * float(np.exp(rng.uniform(-0.7, 0.7)))
    if config.constants > 1 or features.feature_kinds != ("mean",) or few_levels:
        mu, sigma = _random_scaling(config, rng, mu, sigma)
    filled, mean, scale = normaliser_constants(config, mu, sigma)
    if config.features.feature_shift:
        filled = config
    arrays: dict[str, np.ndarray] = {"mean": mean, "scale": scale}
    if config.is_forest:
        # a third are 0, which the features of masked taxels are
        threshold = rng.normal(0, 1.0, config.forest.nodes) * (rng.random(config.forest.nodes) > 0.33)
        arrays |= random_forest(config, rng) | {"threshold": config.threshold_format.quantise(threshold)}
    for name, shape in ({} if config.is_forest else network_shapes(config, real=False)).items():
        fmt = network_formats(config)[name]
        if rng.random() < 0.25:
            arrays[name] = rng.integers(fmt.min_code, fmt.max_code, shape, endpoint=True)
        else:
            deviation = 0.5 if name.startswith("b") else 1.5 * shape[-1] ** -0.5
            arrays[name] = fmt.quantise(rng.normal(0.0, deviation, shape))
        if name.startswith("b"):
            # a bias of 0 would hide a bias that the hardware forgets
            arrays[name] = np.where(arrays[name] == 0, 1, arrays[name])
    for name, shape in readout_shapes(config).items():
        ends = (
            (0, 2 * config.readout_rule.taught - 1)
            if name == "taught_count"
            else (config.state_code_format.min_code, config.state_code_format.max_code)
        )
        arrays[name] = rng.integers(*ends, shape, endpoint=True)
    return IntegerModel(filled, arrays, f"random model {seed}")


def random_forest(config: AcceleratorConfig, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Every array of trees but the thresholds: each node after the roots in a random free place, votes of 8 bits."""
    forest = config.forest
    child, level = np.full((forest.nodes, 2), -1), [1] * forest.trees
    free = [(root, side) for root in range(forest.trees) for side in (0, 1)] if forest.depth > 1 else []
    for node in range(forest.trees, forest.nodes):
        parent, side = free.pop(rng.integers(len(free)))
        child[parent, side] = node
        level.append(level[parent] + 1)
        free += [(node, 0), (node, 1)] if level[node] < forest.depth else []
    leaf = child < 0
    minuend, inputs = rng.integers(0, config.windows.steps * config.inputs, forest.nodes), config.inputs
    less = minuend // inputs * inputs + rng.integers(0, inputs, forest.nodes)
    return {
        "tree_input": minuend,
        "subtrahend": np.where(rng.random(forest.nodes) < 0.5, minuend, less),
        "child": np.where(leaf, -1 - rng.integers(0, config.classes, child.shape), child),
        "vote": np.where(leaf, rng.integers(-128, 128, child.shape), 0),
    }


def random_float_model(
    config: AcceleratorConfig, seed: int, deviation: float = 0.6, mu: float = 0.0, sigma: float = 60.0
) -> FloatModel:
    """A float model with random weights; every input has the mean ``mu`` and the deviation ``sigma``."""
    rng, constants = np.random.default_rng(seed), constants_shape(config)
    arrays = {
        name: rng.normal(0, deviation, shape) for name, shape in network_shapes(config, real=True).items()
    }
    scale = {"mu": np.full(constants, mu), "sigma": np.full(constants, sigma)}
    return FloatModel(config, arrays if config.is_image else arrays | scale)


def _logarithm(value: float, knee: int, frac: int) -> float:
    return companded(np.array([round(value)]), knee, frac)[0] / 2.0**frac


def _random_scaling(
    config: AcceleratorConfig, rng: np.random.Generator, mu: float, sigma: float
) -> tuple[np.ndarray, np.ndarray]:
    """Constants a kind or an input about the constants of the mean, each a little different."""
    features, count, frac = config.features, config.constants, config.formats.feature_format.frac_bits
    moved = sigma * features.activity_block**0.5
    of_kind = {
        "mean": (mu, sigma),
        "activity": (moved, moved),
        "integral": tuple(
            _logarithm(abs(value) * config.last_frame / 2, features.integral_knee, features.integral_frac)
            for value in (mu, sigma)
        ),
        "highest": (mu + sigma, sigma),
        "lowest": (mu - sigma, sigma),
    }
    kinds = np.resize(features.feature_kinds, count)
    middle, spread = np.array([of_kind[kind] for kind in kinds]).T
    means = middle + spread * rng.uniform(-0.2, 0.2, count)
    sigmas = np.maximum(spread, np.where(kinds == "integral", 0.25, 1.0)) * rng.uniform(0.5, 1.0, count)
    # no finer features than a 16-bit scale can make of the window's value
    units = np.array(config.feature_units).reshape(-1, config.kinds).min(axis=0)
    fractions = config.most_mean_frac if config.sensor.sample_bits <= 2 else 0
    finest = 2.0 ** (frac + config.formats.gate_frac - fractions) / config.scale_format.max_code
    sigmas = np.maximum(sigmas, 1.01 * finest / np.resize(units, count))
    return (means, sigmas) if count > 1 else (means[0], sigmas[0])
