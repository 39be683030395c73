"""Made-up models, recordings and images: they exercise a configuration and resemble no sensor. For tests, benches and
counts of hardware. No torch."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.data.recordings import image_recordings as of_images
from eskin.golden.model import IntegerModel, network_formats, network_shapes
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
    if features.compand == "log":  # of a whole window
        knee, frac = features.compand_knee, features.compand_frac
        mu, sigma = (_logarithm(value * config.windows.window, knee, frac) for value in (mu, sigma))
    if config.constants > 1 or features.feature_kinds != ("mean",) or few_levels:
        mu, sigma = _random_scaling(config, rng, mu, sigma)
    filled, mean, scale = normaliser_constants(config, mu, sigma)
    if config.features.feature_shift:
        filled = config
    arrays: dict[str, np.ndarray] = {"mean": mean, "scale": scale}
    for name, shape in network_shapes(config, real=False).items():
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


def _logarithm(value: float, knee: int, frac: int) -> float:
    return companded(np.array([round(value)]), knee, frac)[0] / 2.0**frac


def _random_scaling(
    config: AcceleratorConfig, rng: np.random.Generator, mu: float, sigma: float
) -> tuple[np.ndarray, np.ndarray]:
    """Constants a kind or an input about those of the mean, each a little different."""
    features, count, frac = config.features, config.constants, config.formats.feature_format.frac_bits
    moved = sigma * features.activity_block**0.5
    of_kind = {
        "mean": (mu, sigma),
        "activity": (mu, sigma) if features.compand == "log" else (moved, moved),
        "integral": tuple(
            _logarithm(abs(value) * config.last_frame / 2, features.integral_knee, features.integral_frac)
            for value in (mu, sigma)
        ),
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


def random_recordings(config: AcceleratorConfig, lengths: Sequence[int], seed: int) -> Recordings:
    """Recordings that exercise a configuration rather than resemble an array: rest, touches now and then,
    some at full scale; with a fault detector a taxel of most recordings fails at some time, where it is or at
    an end of the range.

    Parameters
    ----------
    lengths:
        Frames of each recording that the chain takes; those between are random codes.
    seed:
        Seed of every random draw.
    """
    rng, fmt, taxels = np.random.default_rng(seed), config.sample_format, config.sensor.taxels
    rule, hop, whole = config.onset_rule, config.windows.hop, config.last_frame
    if rule.onset == "band":
        swing = rule.band_high - rule.band_low
        rest, noise = (rule.band_low + rule.band_high) / 2, swing / 16
    else:
        rest, noise = (fmt.min_code + fmt.max_code) / 2, rule.onset_threshold / 8
        swing = 6 * rule.onset_threshold
    samples = []
    for length in lengths:
        signal = np.clip(rng.normal(0, noise, (length, taxels)), -3 * noise, 3 * noise)
        time = np.arange(length)[:, None]
        at = int(rng.integers(0, 2 * hop + 1)) + config.rest_level.rest_frames
        while at < length:
            duration = int(rng.integers(1, whole + hop))
            inside = (time >= at) & (time < at + duration)
            speed, phase = rng.uniform(0.01, 0.6, taxels), rng.uniform(0, 6.3, taxels)
            gain = rng.normal(0, 1, taxels)
            strength = fmt.max_code if rng.random() < 0.15 else swing * rng.uniform(0.3, 1)
            signal += inside * (0.7 + np.sin(time * speed + phase)) * gain * strength
            at += duration + int(rng.integers(1, 2 * rule.rearm_frames + whole))
        codes = np.clip(np.rint(rest + signal), fmt.min_code, fmt.max_code).astype(np.int32)
        if config.faults.fault_frames and length and rng.random() < 0.8:
            frame, taxel = rng.integers(length), rng.integers(taxels)
            codes[frame:, taxel] = rng.choice([fmt.min_code, fmt.max_code, codes[frame, taxel]])
        samples.append(_between(codes, config, rng))
    return Recordings(
        samples=np.concatenate(samples),
        offsets=np.cumsum([0, *map(len, samples)]),
        labels=np.arange(len(lengths), dtype=np.int64) % config.classes,
        class_names=config.network.class_names,
        sample_rate_hz=config.sensor.sample_rate_hz,
        source=f"random recordings, seed {seed}",
        sample_bits=config.sensor.sample_bits,
        sample_signed=config.sensor.sample_signed,
    )


def _between(codes: np.ndarray, config: AcceleratorConfig, rng: np.random.Generator) -> np.ndarray:
    """The source's frames around those that the chain takes."""
    every, fmt = config.sensor.scan_every, config.sample_format
    if every == 1 or not len(codes):
        return codes
    size = every * (len(codes) - 1) + 1, codes.shape[1]
    source = rng.integers(fmt.min_code, fmt.max_code + 1, size, dtype=np.int32)
    source[::every] = codes
    return source


def random_images(config: AcceleratorConfig, count: int, seed: int) -> np.ndarray:
    """Images (count, height, width), uint8, for tests: blobs on zeros, noise over the whole range, all black
    and all white."""
    rng = np.random.default_rng(seed)
    height, width = config.image.height, config.image.width
    row, column = np.arange(height)[:, None], np.arange(width)
    traces = []
    for number in range(count):
        if number % 4 == 3:
            traces.append(rng.integers(0, 256, (height, width)))
        elif number in (5, 6):
            traces.append(np.full((height, width), 255 * (number - 5)))
        else:
            blobs = sum(
                rng.integers(60, 400)
                * np.exp(
                    -((row - rng.uniform(0, height)) ** 2 + (column - rng.uniform(0, width)) ** 2)
                    / rng.uniform(2, 30)
                )
                for _ in range(3)
            )
            traces.append(np.clip(blobs - 20, 0, 255))
    return np.array(traces).astype(np.uint8)


def image_recordings(
    config: AcceleratorConfig, images: np.ndarray, labels: np.ndarray | None = None
) -> Recordings:
    """Images (n, height, width) as recordings of this configuration's sensor."""
    labels = np.zeros(len(images), dtype=np.int64) if labels is None else labels
    return of_images(images, labels, config.network.class_names, rate_hz=config.sensor.sample_rate_hz)
