"""Converters: the codes that a converter makes of a recording, and the samples that the chain gets from them
(docs/specification_interfaces.md section 12)."""

import dataclasses

import numpy as np

from eskin.golden.core import AcceleratorConfig, converter_plan
from eskin.golden.core.converters import code_format, code_offset, code_shift
from eskin.golden.data import Recordings


def samples_of(codes: np.ndarray, config: AcceleratorConfig) -> np.ndarray:
    """Samples of converter codes: SAT(RND((code - offset) / 2**shift)); a shift below 0 appends zeros."""
    fmt, shift = config.sample_format, code_shift(config)
    centred = codes.astype(np.int64) - code_offset(config)
    moved = np.floor_divide(centred + 2 ** (shift - 1), 2**shift) if shift > 0 else centred * 2**-shift
    return np.clip(moved, fmt.min_code, fmt.max_code).astype(np.int32)


def codes_of(samples: np.ndarray, config: AcceleratorConfig) -> np.ndarray:
    """Codes that a converter would give for recorded samples: the nearest code, and outside its range the
    limit."""
    fmt, shift = code_format(config), code_shift(config)
    wide = samples.astype(np.int64)
    moved = wide * 2**shift if shift >= 0 else np.floor_divide(wide + 2 ** (-shift - 1), 2**-shift)
    return np.clip(moved + code_offset(config), fmt.min_code, fmt.max_code).astype(np.int64)


def through_converter(recordings: Recordings, config: AcceleratorConfig) -> tuple[Recordings, np.ndarray]:
    """Recordings as the chain gets them through the configuration's converter, and the codes at its pins:
    (frames, taxels), or (frames, electrodes)."""
    plan = converter_plan(config)
    codes = plan.to_pins(codes_of(recordings.samples, config), config)
    samples = samples_of(plan.from_pins(codes, config), config)
    return dataclasses.replace(recordings, samples=samples), codes
