"""A piezoelectric array for made-up scenes: force on taxels to the converter's codes.

A piezoelectric taxel does not see static force: ``dV/dt = dF/dt - V / tau``, ``tau = 1 / (2 pi CORNER_HZ)``.
Gain (5 % apart) and rest level (1.65 V, 4 mV apart) belong to the taxel. White noise and slow drift are
added, and the converter rounds to codes of 62.5 uV.
"""

from collections.abc import Callable

import numpy as np

from eskin.golden.core import PRESETS, InputError
from eskin.golden.data.recordings import Recordings

REST_VOLT = 1.65
CORNER_HZ = 0.5
"""High-pass corner of a piezoelectric taxel with its amplifier, hertz."""
NOISE_VOLT, DRIFT_VOLT = 0.0012, 0.002
VOLT_PER_CODE = PRESETS["thesis"].sensor.volt_per_code
RECORDING_S = 3.0
"""Length of a recording, seconds: an onset within the first 0.9 s leaves room for 6144 frames at 3 kHz."""
SIDES = (2, 8)
"""Smallest and largest number of rows and of columns."""
Person = Callable[[int, int], np.ndarray]
"""Called with (label, trial): force (frames, taxels) of a recording, volt before the high-pass."""


class PiezoArray:
    """rows x columns taxels, taxel = row * columns + column, row 0 the northern one; their gains and rest
    levels follow from ``seed``.

    grid: (taxels, 2), across and down of each taxel's centre, -1..1. time: (frames), seconds.

    Raises
    ------
    InputError
        A rate outside 100..20000 Hz.
    """

    def __init__(self, seed: int, rows: int, columns: int, sample_rate_hz: float) -> None:
        if not 100 <= sample_rate_hz <= 20000:
            raise InputError(
                f"synthetic scene, sample_rate_hz: is {sample_rate_hz}; it must lie in 100..20000"
            )
        across, down = np.meshgrid(
            (2 * np.arange(columns) + 1) / columns - 1, (2 * np.arange(rows) + 1) / rows - 1
        )
        self.grid = np.stack([across.ravel(), down.ravel()], axis=1)
        self.time = np.arange(round(RECORDING_S * sample_rate_hz)) / sample_rate_hz
        self.sample_rate_hz = float(sample_rate_hz)
        self._seed = seed
        rng = np.random.default_rng([seed, 0])
        self._gain = single(1 + 0.05 * rng.standard_normal(len(self.grid)))
        self._rest = single(REST_VOLT + 0.004 * rng.standard_normal(len(self.grid)))

    def recorded(
        self,
        person_of: Callable[[np.random.Generator], Person],
        persons: int,
        trials: int,
        class_names: tuple[str, ...],
        source: str,
    ) -> Recordings:
        """Every person doing every class ``trials`` times, by person, trial and class; groups ``person`` and
        ``trial``. A person draws from a generator of its own.
        """
        classes = len(class_names)
        each = trials * classes  # recordings of a person
        samples = np.empty((persons, each, len(self.time), len(self.grid)), dtype=np.int32)
        for number in range(persons):
            rng = np.random.default_rng([self._seed, 1 + number])
            person = person_of(rng)
            force = np.empty((len(self.time), each, len(self.grid)), dtype=np.float32)
            for index in range(each):
                trial, label = divmod(index, classes)
                force[:, index] = person(label, trial)
            samples[number] = self._codes(force, rng)
        order = np.arange(persons * each)
        return Recordings(
            samples=samples.reshape(-1, len(self.grid)),
            offsets=np.arange(len(order) + 1) * len(self.time),
            labels=order % classes,
            class_names=class_names,
            sample_rate_hz=self.sample_rate_hz,
            groups={"person": order // each, "trial": order // classes % trials},
            source=source,
            volt_per_code=VOLT_PER_CODE,
        )

    def _codes(self, force: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Codes (recordings, frames, taxels), int32, of force (frames, recordings, taxels)."""
        volt = _high_pass(force, self.sample_rate_hz) * self._gain + self._rest
        volt += NOISE_VOLT * rng.standard_normal(volt.shape, dtype=np.float32)
        volt += _drift(rng, self.time, volt.shape[1:])
        return np.clip(np.rint(volt / VOLT_PER_CODE), 0, 65535).astype(np.int32).transpose(1, 0, 2)


def single(value) -> np.ndarray:
    """In single precision."""
    return np.asarray(value, dtype=np.float32)


def bump(q) -> np.ndarray:
    """``exp(-q^2 / 2)``."""
    return np.exp(-0.5 * single(q) ** 2)


def _high_pass(force: np.ndarray, sample_rate_hz: float) -> np.ndarray:
    """First-order high-pass along the first axis, from rest: ``V(t) = a (V(t-1) + F(t) - F(t-1))``, ``a =
    exp(-2 pi CORNER_HZ / rate)``."""
    decay = np.float32(np.exp(-2 * np.pi * CORNER_HZ / sample_rate_hz))
    volt = np.diff(force, axis=0, prepend=force[:1])
    for frame in range(1, len(volt)):
        volt[frame] += volt[frame - 1]
        volt[frame] *= decay
    return volt


def _drift(rng: np.random.Generator, time: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """A slow sine of 0.05 to 0.2 Hz on every taxel of every recording, volt."""
    frequency, phase = rng.uniform(0.05, 0.2, shape), rng.uniform(0, 2 * np.pi, shape)
    return single(DRIFT_VOLT) * np.sin(
        single(2 * np.pi * frequency) * single(time)[:, None, None] + single(phase)
    )
