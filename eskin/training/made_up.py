"""Made-up recordings and images: they exercise a configuration and resemble no sensor. For benches and tests. No torch."""

from collections.abc import Sequence

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.data.recordings import image_recordings as of_images
from eskin.golden.model import IntegerModel, Trace, run


def random_recordings(config: AcceleratorConfig, lengths: Sequence[int], seed: int) -> Recordings:
    """Recordings that exercise a configuration rather than resemble an array: rest, touches now and then,
    some at full scale; with a fault detector, a taxel of most recordings fails at some time and sticks at its
    value or at an end of the range.

    Parameters
    ----------
    lengths:
        Frames of each recording that the chain takes; the source's frames between them are random codes.
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


def decided_recordings(model: IntegerModel, lengths: Sequence[int]) -> tuple[Recordings, Trace]:
    """`random_recordings` of the first seed that leads to a decision (without one they would check nothing),
    and their trace."""
    for seed in range(1, 51):
        recordings = random_recordings(model.config, lengths, seed)
        trace = run(model, recordings)
        if len(trace.streams["decision"][0]):
            break
    return recordings, trace


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
