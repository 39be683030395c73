"""Check that recordings fit a configuration, and convert them to its codes and classes."""

import dataclasses
from collections.abc import Callable

import numpy as np

from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.data import Recordings
from eskin.golden.data.codes import clipped_to, in_words


def _other_worth(recordings: Recordings, config: AcceleratorConfig) -> np.ndarray | None:
    """Number of a configuration's codes per code of the recordings; None if it is one, or if one of them
    has no value per code."""
    step, of_model = np.array(recordings.volt_per_code), np.array(config.sensor.volt_per_code)
    if recordings.taxels != config.sensor.taxels or not (step.all() and of_model.all()):
        return None
    ratio = step / of_model
    return None if (abs(ratio - 1.0) <= 0.01).all() else ratio


def rescaled(recordings: Recordings, config: AcceleratorConfig) -> Recordings:
    """``recordings`` in the codes of a configuration's sensor, if both have a value per code and these
    differ; the share that clips is in their notes."""
    of_model = config.sensor.volt_per_code
    ratio = _other_worth(recordings, config)
    if ratio is None:
        return recordings
    fmt, unit = config.sample_format, recordings.unit or "V"
    codes = np.rint(recordings.samples * ratio)
    step = in_words(recordings.volt_per_code)
    note = f"one code is {step} {unit}, of configuration '{config.name}' {in_words(of_model)}: brought to its codes"
    return dataclasses.replace(
        recordings,
        samples=np.clip(codes, fmt.min_code, fmt.max_code).astype(np.int32),
        volt_per_code=of_model,
        sample_bits=config.sensor.sample_bits,
        sample_signed=config.sensor.sample_signed,
        notes=(*recordings.notes, note, *clipped_to(codes, fmt)[1]),
    )


def at_source_rate(recordings: Recordings, config: AcceleratorConfig) -> Recordings:
    """Recordings of the frames that a model scans, as its board sends them, at the rate of its sensor: each frame is held
    until the next, and the chain takes the first. Others are returned as they are."""
    sensor, rate = config.sensor, recordings.sample_rate_hz
    every = sensor.scan_every
    scans = recordings.scan_every == 1 and abs(rate / sensor.scan_rate_hz - 1.0) <= 0.02
    if every == 1 or not scans:
        return recordings
    return dataclasses.replace(
        recordings,
        samples=np.repeat(recordings.samples, every, axis=0),
        offsets=every * recordings.offsets,
        sample_rate_hz=every * rate,
        notes=(
            *recordings.notes,
            f"{rate:g} Hz is the rate of the model's scans: each frame is held {every} times",
        ),
    )


def for_model(
    recordings: Recordings, config: AcceleratorConfig, say: Callable[[str], None] = lambda note: None
) -> Recordings:
    """``recordings`` as a model takes them: in its codes (``rescaled``), at its rate (``at_source_rate``) and with its
    classes. ``say`` is called with each sentence about a change.

    Raises
    ------
    InputError
        As ``check_fit``; a recording is of no class of the model.
    """
    known = len(recordings.notes)
    recordings = at_source_rate(rescaled(recordings, config), config)
    for note in recordings.notes[known:]:
        say(f"recordings '{recordings.source}': {note}")
    if config.is_image == bool(recordings.image_shape):  # else check_fit says what they are
        recordings = recordings.with_classes(config.network.class_names, f"configuration '{config.name}'")
    check_fit(recordings, config)
    return recordings


def check_fit(recordings: Recordings, config: AcceleratorConfig) -> None:
    """Refuse recordings that this configuration's sensor did not give, before any long work.

    Raises
    ------
    InputError
        Other taxels, codes outside the sample format or of another worth, a rate more than 2 % off, or other
        class names.
    """

    def refuse(subject: str, why: str) -> None:
        raise InputError(
            f"recordings '{recordings.source}', {subject}: {why}; use recordings and a model of one sensor "
            "and task"
        )

    if config.is_image and recordings.image_shape != (config.image.height, config.image.width):
        shape = recordings.image_shape
        has = "no images" if shape is None else f"images of {shape[0]} x {shape[1]} pixels"
        refuse(
            "array images",
            f"holds {has} and configuration '{config.name}' takes {config.image.height} x "
            f"{config.image.width}",
        )
    if recordings.image_shape and not config.is_image:
        refuse(
            "array images",
            f"holds images and configuration '{config.name}' has cell {config.network.cell}, which takes "
            "recordings",
        )
    if recordings.taxels != config.sensor.taxels:
        refuse(
            "array samples",
            f"has {recordings.taxels} taxels and configuration '{config.name}', field taxels, has "
            f"{config.sensor.taxels}",
        )
    low, high = int(recordings.samples.min()), int(recordings.samples.max())
    if low < config.sample_format.min_code or high > config.sample_format.max_code:
        span = f"{config.sample_format.min_code}..{config.sample_format.max_code}"
        refuse(
            "array samples",
            f"runs from {low} to {high} and configuration '{config.name}', field sample_bits, takes {span}",
        )
    if _other_worth(recordings, config) is not None:
        worth, of_model = map(in_words, (recordings.volt_per_code, config.sensor.volt_per_code))
        refuse(
            "array lsb_volt",
            f"has a code worth {worth} and configuration '{config.name}', field volt_per_code, {of_model}",
        )
    rate = recordings.sample_rate_hz * recordings.scan_every
    if abs(rate / config.sensor.sample_rate_hz - 1.0) > 0.02:
        refuse(
            "array sample_rate_hz",
            f"is {rate:g} and configuration '{config.name}', field sample_rate_hz, has "
            f"{config.sensor.sample_rate_hz:g}",
        )
    if recordings.class_names != config.network.class_names:
        refuse(
            "array class_names",
            f"is {', '.join(recordings.class_names)} and configuration '{config.name}' has "
            f"{', '.join(config.network.class_names)}",
        )
