"""A synthetic tactile scene: brush, roll and slide on an n x m piezoelectric array, with no more physics than separates the three.

Lengths are in half array widths (the taxel centres lie in a square of -1..1), time t in seconds from the start of the recording.

**Motion.** The contact runs across the array along a heading (along the columns, ``direction`` 0, or along the rows, 1; either sense, a few
degrees off by habit) at constant speed, lateral offset ``y0``, with a tremor of some percent. For a taxel, ``u`` is how far the contact's
centre has passed it along the heading and ``y`` how far it lies beside the path. ``N(t)`` is the normal force: it rises smoothly over the
first and falls over the last tenth of the contact, times the person's and the trial's force.

**Force on a taxel**, in units of N:

- roll, a rigid cylinder: a narrow line, loading then unloading, no shear: ``g(u / w)``, ``g(q) = exp(-q^2 / 2)``.
- slide, a soft finger pad: pressure plus shear, which compresses the skin ahead of the pad and stretches it behind:
  ``[p g(q) + mu sqrt(e) q g(q)] g(y / v)``, ``q = u / w``; ``u`` moves by stick and slip, a sawtooth of some hertz.
- brush, rows of bristle tufts at a pitch ``l`` under a broad patch, each bristle short: ``g(u / b) (1 + cos(2 pi u / l + phase)) / 2 +`` flicker,
  the flicker a sum of short contacts at random times under the same patch.

**Sensor.** A piezoelectric taxel shows no static force: ``dV/dt = k dF/dt - V / tau`` with ``tau = 1 / (2 pi corner)``; each taxel has its own
gain (some percent, a property of the array) and rest level near 1.65 V. White noise and a slow drift are added and the A/D converter rounds to codes.

Gains are such that per-taxel mean and deviation are alike over the classes: what tells them apart is the order in which a taxel is loaded,
+ then - (roll), - then + (slide), several times (brush).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from golden.config import PRESETS
from golden.errors import InputError
from golden.recordings import Recordings

CLASS_NAMES = ("brush", "roll", "slide")
SECONDS = 3.0
"""Length of a recording, seconds: an onset within the first 0.7 s leaves room for 6144 frames at 3 kHz."""
REST_VOLT = 1.65
CORNER_HZ = 0.5
"""High-pass corner of a piezoelectric taxel with its amplifier, hertz."""
SENSITIVITY = {"brush": 0.20, "roll": 0.20, "slide": 0.16}
"""Volt a unit of force, by class: it makes the per-taxel deviation of the classes alike."""


def synthetic_recordings(
    *,
    persons: int = 20,
    trials: int = 4,
    seed: int = 1,
    rows: int = 4,
    columns: int = 4,
    sample_rate_hz: float = 3000.0,
    progress: Callable[[int, int], None] | None = None,
) -> Recordings:
    """Recordings of every person doing every modality ``trials`` times: 3 x persons x trials of 3 s each.

    Parameters
    ----------
    persons, trials:
        People, and recordings a person and modality. Trials take the two directions in turn.
    seed:
        Everything follows from it; a person's recordings do not depend on how many persons there are.
    rows, columns:
        Taxels of the array, 2..8 each; taxel = row * columns + column.
    sample_rate_hz:
        Frames a second.
    progress:
        Called with (persons done, persons in all).

    Returns
    -------
    Recordings
        Classes brush, roll, slide; unsigned 16-bit codes of 62.5 uV; groups ``person``, ``trial``, ``direction``.

    Raises
    ------
    InputError
        A count, size or rate is out of range.
    """
    for name, value, low, high in (
        ("persons", persons, 1, 1000), ("trials", trials, 1, 100), ("rows", rows, 2, 8), ("columns", columns, 2, 8),
        ("sample_rate_hz", sample_rate_hz, 100, 20000),
    ):  # fmt: skip
        if not low <= value <= high:
            raise InputError(f"synthetic scene, {name}: is {value}; it must lie in {low}..{high}")
    array = np.random.default_rng([seed, 0])
    grid = np.stack(np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows), axis=-1).reshape(-1, 2) * 2 - 1
    gain = 1 + 0.05 * array.standard_normal(len(grid))
    rest = REST_VOLT + 0.004 * array.standard_normal(len(grid))
    time = np.arange(round(SECONDS * sample_rate_hz)) / sample_rate_hz
    volt_per_code = PRESETS["thesis"].volt_per_code

    samples = np.empty((persons, trials * 3, len(time), len(grid)), dtype=np.int32)
    for person in range(persons):
        rng = np.random.default_rng([seed, 1 + person])
        habit = _habit(rng)
        force = np.empty((len(time), trials * 3, len(grid)), dtype=np.float32)
        for trial in range(trials):
            for label, modality in enumerate(CLASS_NAMES):
                force[:, trial * 3 + label] = SENSITIVITY[modality] * _contact(modality, rng, habit, trial % 2, grid, time)
        volt = _high_pass(force, sample_rate_hz) * gain + rest
        volt += 0.0012 * rng.standard_normal(volt.shape, dtype=np.float32)
        volt += _drift(rng, time, volt.shape[1:])
        samples[person] = np.clip(np.rint(volt / volt_per_code), 0, 65535).astype(np.int32).transpose(1, 0, 2)
        if progress:
            progress(person + 1, persons)
    count = persons * trials * 3
    index = np.arange(count)
    return Recordings(
        samples=samples.reshape(-1, len(grid)),
        offsets=np.arange(count + 1) * len(time),
        labels=index % 3,
        class_names=CLASS_NAMES,
        sample_rate_hz=float(sample_rate_hz),
        groups={"person": index // (3 * trials), "trial": index // 3 % trials, "direction": index // 3 % trials % 2},
        source="synthetic scene",
        volt_per_code=volt_per_code,
    )


def _habit(rng: np.random.Generator) -> dict[str, float]:
    """What one person keeps from trial to trial."""
    return {
        "speed": np.exp(rng.normal(0, 0.08)),
        "force": np.exp(rng.normal(0, 0.30)),
        "width": np.exp(rng.normal(0, 0.12)),
        "skew": rng.normal(0, np.radians(6)),
        "tremor_hz": rng.uniform(5, 9),
        "tremor": rng.uniform(0.02, 0.06),
        "friction": rng.uniform(0.8, 1.1),
        "pitch": rng.uniform(0.9, 1.1),
    }


def _contact(modality, rng, habit, direction, grid, time) -> np.ndarray:
    """Force on every taxel (frames, taxels) of one contact."""
    start = rng.uniform(0.15, 0.55)
    duration = np.clip(1.6 / (habit["speed"] * np.exp(rng.normal(0, 0.05))), 1.35, 1.85)
    heading = np.pi / 2 * direction + np.pi * rng.integers(2) + habit["skew"] + rng.normal(0, np.radians(3))
    along = grid @ np.array([np.cos(heading), np.sin(heading)])
    beside = grid @ np.array([-np.sin(heading), np.cos(heading)]) - rng.normal(0, 0.15)
    width = habit["width"] * np.exp(rng.normal(0, 0.06))
    level = habit["force"] * np.exp(rng.normal(0, 0.25))

    progress = (time - start) / duration  # 0 at first contact, 1 at the last
    ramp = np.clip(np.minimum(progress, 1 - progress) / 0.1, 0, 1)
    normal = level * ramp * ramp * (3 - 2 * ramp) * (1 + habit["tremor"] * np.sin(2 * np.pi * habit["tremor_hz"] * time + rng.uniform(0, 7)))
    reach = 1.2 + rng.normal(0, 0.05)
    dwell = rng.uniform(0.05, 0.2) / duration
    travel = np.clip((progress - dwell) / (1 - dwell), 0, 1)
    centre = reach * (2 * travel - 1)
    moving = (progress > 0) & (progress < 1)
    normal, centre = normal[moving, None].astype(np.float32), centre[moving]
    if modality == "slide":
        slip_hz = rng.uniform(8, 14)
        centre = centre - 0.05 * ((time[moving] * slip_hz + rng.uniform()) % 1 - 0.5)
    u = (centre[:, None] - along).astype(np.float32)
    if modality == "roll":
        shape = _bump(u / (0.28 * width))
    elif modality == "slide":
        q = u / np.float32(0.3 * width)
        shear = habit["friction"] * np.sqrt(np.e) * np.tanh(2 * reach * travel[moving, None] / 0.25)
        shape = _bump(q) * (0.4 + shear * q) * _bump(beside / 1.5)
    else:
        patch = _bump(u / (0.55 * width))
        flicker = np.repeat(rng.exponential(1.0, (len(u) // 60 + 1, grid.shape[0])), 60, axis=0)[: len(u)]
        shape = patch * (0.5 + 0.5 * np.cos(2 * np.pi * u / habit["pitch"] + rng.uniform(0, 2 * np.pi)) + 0.15 * (flicker - 1))
    force = np.zeros((len(time), len(grid)), dtype=np.float32)
    force[moving] = normal * shape
    return force


def _bump(q):
    return np.exp(-0.5 * np.asarray(q, dtype=np.float32) ** 2)


def _high_pass(force: np.ndarray, sample_rate_hz: float) -> np.ndarray:
    """First-order high-pass along frames, from rest: ``V(t) = a (V(t-1) + F(t) - F(t-1))``, ``a = exp(-2 pi corner / rate)``."""
    decay = np.float32(np.exp(-2 * np.pi * CORNER_HZ / sample_rate_hz))
    volt = np.zeros_like(force)
    change = np.diff(force, axis=0)
    for frame in range(1, len(force)):
        np.multiply(volt[frame - 1] + change[frame - 1], decay, out=volt[frame])
    return volt


def _drift(rng: np.random.Generator, time: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """A slow sine of a few millivolt a taxel."""
    frequency, phase = rng.uniform(0.05, 0.2, shape), rng.uniform(0, 2 * np.pi, shape)
    return (0.002 * np.sin(2 * np.pi * frequency * time[:, None, None] + phase)).astype(np.float32)
