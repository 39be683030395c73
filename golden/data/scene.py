"""A synthetic tactile scene: brush, roll and slide on an n x m piezoelectric array, with no more physics than
separates the three.

With 3 classes they are the modalities, with 2 brush and slide, in either direction and sense. More classes
are modality, heading and speed together, in this order: class i (from 0) is modality i mod 3, heading i / 3
mod 4 (east, south, west, north: by columns up, rows up, columns down, rows down), speed i / 12 (medium, slow,
fast). ``brush-east-medium`` is the first; any count takes the modalities evenly.

Lengths are in half widths of the array (the taxel centres lie in a square of -1..1), time t in seconds.

**Motion.** A contact touches down at one edge, dwells for 0.05 to 0.2 s, and crosses the array at constant
speed along its heading: along the columns (``direction`` 0) or along the rows (1), in either sense, a few
degrees off. ``u`` is how far the contact's centre has passed a taxel along the heading, ``y`` how far the
taxel lies beside the path. The normal force ``N(t)`` rises over the first tenth of the contact, falls over
the last, and carries the person's tremor.

**Force on a taxel**, with ``g(q) = exp(-q^2 / 2)``:

- roll, a rigid cylinder: a narrow line that loads and unloads, no shear: ``N g(u / w)``.
- slide, a soft finger pad: pressure, and shear that pushes the skin together ahead of the pad and pulls it
  apart behind: ``N g(q) g(y / 2) (p + m(s) sqrt(e) q)``, ``q = u / w``. Shear builds up with the distance
  slid, ``m(s) = friction tanh(s / 0.25)``, and the pad moves by stick and slip, a sawtooth of 8 to 14 Hz on
  ``u``.
- brush, rows of bristle tufts at pitch ``l`` under a broad patch: ``N g(u / b) ((1 + cos(2 pi u / l + phase))
  / 2 + 0.15 (f - 1))``, where f, drawn anew from an exponential distribution every 20 ms, stands for the many
  short contacts of single bristles.

All times the coupling of each taxel in this trial (an uneven surface, a tilted hand).

**Sensor.** A piezoelectric taxel does not see static force: ``dV/dt = dF/dt - V / tau``, ``tau = 1 / (2 pi
CORNER_HZ)``. Gain (5 % apart) and rest level (1.65 V, 4 mV apart) belong to the taxel. White noise and slow
drift are added, and the converter rounds to codes.

So that per-taxel mean and deviation tell little, forces are alike over the classes and vary by person and
trial. What tells the classes apart is the order in which a taxel is loaded: + then - (roll), - then +
(slide), several times (brush).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from eskin.golden.core.config import PRESETS, AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.data.recordings import Recordings

MODALITIES = ("brush", "roll", "slide")
HEADINGS = ("east", "south", "west", "north")
"""Names of the heading after 0, 1, 2 and 3 quarter turns; row 0 is the northern one."""
SPEEDS = {"medium": 1.0, "slow": 1.3, "fast": 0.62}
"""Length of a contact, relative to a medium one; with the limits of that one the bands hardly meet."""
RECORDING_S = 3.0
"""Length of a recording, seconds: an onset within the first 0.9 s leaves room for 6144 frames at 3 kHz."""
REST_VOLT = 1.65
CORNER_HZ = 0.5
"""High-pass corner of a piezoelectric taxel with its amplifier, hertz."""
TYPICAL_VOLT = {"brush": 0.20, "roll": 0.20, "slide": 0.16}
"""Signal of a typical force on a taxel before the high-pass, volt: with these the deviation of a taxel is
alike over the classes."""
NOISE_VOLT, DRIFT_VOLT = 0.0012, 0.002
SIDES = (2, 8)
"""Smallest and largest number of rows and of columns."""
PERSONS, TRIALS = 20, 4
CODES = 1 << 27
"""Samples (codes of one taxel) that a scene made from a configuration has at most: half a gigabyte."""


class Kind(NamedTuple):
    """What a class is: modality, quarter turns of the heading (None: either way along the trial's direction),
    length of a contact."""

    name: str
    modality: str
    quarter: int | None = None
    length: float = 1.0


def kinds(classes: int) -> tuple[Kind, ...]:
    """The scene's classes, 2 to 32, as the module describes them."""
    if classes <= 3:
        return tuple(Kind(name, name) for name in (MODALITIES if classes == 3 else ("brush", "slide")))
    speeds = list(SPEEDS)
    chosen = [(MODALITIES[index % 3], index // 3 % 4, speeds[index // 12]) for index in range(classes)]
    return tuple(
        Kind(f"{modality}-{HEADINGS[quarter]}-{speed}", modality, quarter, SPEEDS[speed])
        for modality, quarter, speed in chosen
    )


def scene_of(config: AcceleratorConfig, *, progress: Callable[[int, int], None] | None = None) -> Recordings:
    """The scene that belongs to a configuration: what ``--data synthetic`` means beside ``--config`` or a
    model.

    Its array is the most square one of ``taxels``, no more rows than columns; its classes are as many as
    class_names, which must be the scene's own (``kinds``); its rate is sample_rate_hz. 20 persons and 4
    trials as long as that makes no more than CODES samples, else 2 trials or 1, then fewer persons, 2 at
    least. The presets thesis and synthetic give the default scene.

    Raises
    ------
    InputError
        No array of 2..8 rows and columns has that many taxels; other class names; a rate outside 100..20000
        Hz.
    """
    rows = max(
        (
            n
            for n in range(SIDES[0], SIDES[1] + 1)
            if not config.sensor.taxels % n and n <= config.sensor.taxels // n <= SIDES[1]
        ),
        default=0,
    )
    if not rows:
        raise InputError(
            f"configuration '{config.name}', field taxels: is {config.sensor.taxels}; the synthetic scene "
            "has "
            f"{SIDES[0]} to {SIDES[1]} rows and "
            "as many columns, so use 4, 9, 16, 25, 36, 49, 64 or another product of two of them"
        )
    names = tuple(kind.name for kind in kinds(config.classes))
    if config.network.class_names != names:
        raise InputError(
            f"configuration '{config.name}', field class_names: is {', '.join(config.network.class_names)}; "
            "the synthetic scene of "
            f"{config.classes} classes has {', '.join(names)}"
        )
    # recordings of each class
    room = int(CODES / (RECORDING_S * config.sensor.sample_rate_hz * config.sensor.taxels * config.classes))
    trials = next(trials for trials in (TRIALS, 2, 1) if trials == 1 or room >= trials * PERSONS)
    return synthetic_recordings(
        persons=max(2, min(PERSONS, room // trials)),
        trials=trials,
        rows=rows,
        columns=config.sensor.taxels // rows,
        classes=config.classes,
        sample_rate_hz=config.sensor.sample_rate_hz,
        progress=progress,
    )


def _check_sizes(
    scene: str, persons: int, trials: int, rows: int, columns: int, classes: int, sample_rate_hz: float
) -> None:
    for name, value, low, high in (
        ("persons", persons, 1, 1000),
        ("trials", trials, 1, 100),
        ("rows", rows, *SIDES),
        ("columns", columns, *SIDES),
        ("classes", classes, 2, 32),
        ("sample_rate_hz", sample_rate_hz, 100, 20000),
    ):
        if not low <= value <= high:
            raise InputError(f"{scene}, {name}: is {value}; it must lie in {low}..{high}")


def _grid(rows: int, columns: int) -> np.ndarray:
    """(rows x columns, 2): across and down of each taxel, -1..1."""
    across, down = np.meshgrid(
        (2 * np.arange(columns) + 1) / columns - 1, (2 * np.arange(rows) + 1) / rows - 1
    )
    return np.stack([across.ravel(), down.ravel()], axis=1)


def synthetic_recordings(
    *,
    persons: int = PERSONS,
    trials: int = TRIALS,
    seed: int = 1,
    rows: int = 4,
    columns: int = 4,
    classes: int = 3,
    sample_rate_hz: float = 3000.0,
    progress: Callable[[int, int], None] | None = None,
) -> Recordings:
    """Recordings of every person doing every class ``trials`` times: classes x persons x trials, 3 s each.

    Parameters
    ----------
    persons, trials:
        People, and recordings for each person and class. Trials take the two directions in turn where a class
        has no heading of its own.
    seed:
        Everything follows from it; a person's recordings do not depend on how many persons there are.
    rows, columns:
        Taxels of the array, 2..8 each; taxel = row * columns + column.
    classes:
        2..32: brush and slide; brush, roll and slide; or modality, heading and speed together (``kinds``).
    sample_rate_hz:
        Frames a second.
    progress:
        Called with (persons done, persons in all).

    Returns
    -------
    Recordings
        Unsigned 16-bit codes of 62.5 uV; groups ``person``, ``trial``, ``direction``.

    Raises
    ------
    InputError
        A count, a size or the rate is out of range.
    """
    _check_sizes("synthetic scene", persons, trials, rows, columns, classes, sample_rate_hz)
    grid = _grid(rows, columns)
    array_rng = np.random.default_rng([seed, 0])
    gain = (1 + 0.05 * array_rng.standard_normal(len(grid))).astype(np.float32)
    rest = (REST_VOLT + 0.004 * array_rng.standard_normal(len(grid))).astype(np.float32)
    time = np.arange(round(RECORDING_S * sample_rate_hz)) / sample_rate_hz
    volt_per_code = PRESETS["thesis"].sensor.volt_per_code

    of_class = kinds(classes)
    each = trials * classes  # recordings of a person
    samples = np.empty((persons, each, len(time), len(grid)), dtype=np.int32)
    for person in range(persons):
        rng = np.random.default_rng([seed, 1 + person])
        habit = _habit(rng)
        force = np.empty((len(time), each, len(grid)), dtype=np.float32)
        for index in range(each):
            trial, label = divmod(index, classes)
            force[:, index] = _contact(of_class[label], rng, habit, trial % 2, grid, time)
        volt = _high_pass(force, sample_rate_hz) * gain + rest
        volt += NOISE_VOLT * rng.standard_normal(volt.shape, dtype=np.float32)
        volt += _drift(rng, time, volt.shape[1:])
        samples[person] = np.clip(np.rint(volt / volt_per_code), 0, 65535).astype(np.int32).transpose(1, 0, 2)
        if progress:
            progress(person + 1, persons)
    order = np.arange(persons * each)
    trials_of, labels = order // classes % trials, order % classes
    direction = np.array([-1 if kind.quarter is None else kind.quarter % 2 for kind in of_class])[labels]
    return Recordings(
        samples=samples.reshape(-1, len(grid)),
        offsets=np.arange(len(order) + 1) * len(time),
        labels=labels,
        class_names=tuple(kind.name for kind in of_class),
        sample_rate_hz=float(sample_rate_hz),
        groups={
            "person": order // each,
            "trial": trials_of,
            "direction": np.where(direction < 0, trials_of % 2, direction),
        },
        source="synthetic scene",
        volt_per_code=volt_per_code,
    )


def _habit(rng: np.random.Generator) -> dict[str, float]:
    """What a person keeps from trial to trial: factors, radians, hertz, half widths."""
    return {
        "speed": np.exp(rng.normal(0, 0.08)),
        "force": np.exp(rng.normal(0, 0.30)),
        "width": np.exp(rng.normal(0, 0.12)),
        "skew": rng.normal(0, np.radians(6)),
        "tremor_hz": rng.uniform(5, 9),
        "tremor": rng.uniform(0.02, 0.06),
        "friction": rng.uniform(0.8, 1.1),
        "pitch": rng.uniform(0.75, 0.95),
    }


def _contact(
    kind: Kind,
    rng: np.random.Generator,
    habit: dict[str, float],
    direction: int,
    grid: np.ndarray,
    time: np.ndarray,
) -> np.ndarray:
    """Signal of the force on every taxel, volt before the high-pass, shape (frames, taxels): one contact as
    the module describes it.

    ``direction`` counts where the class has no heading of its own; the sense is drawn then.
    """
    modality = kind.modality
    start = rng.uniform(0.15, 0.55)
    duration = np.clip(1.6 / (habit["speed"] * np.exp(rng.normal(0, 0.05))), 1.35, 1.85) * kind.length
    dwell = rng.uniform(0.05, 0.2)
    quarter = direction + 2 * rng.integers(2) if kind.quarter is None else kind.quarter
    heading = np.pi / 2 * quarter + habit["skew"] + rng.normal(0, np.radians(3))
    reach = 1.2 + rng.normal(0, 0.05)
    width = habit["width"] * np.exp(rng.normal(0, 0.06))
    level = TYPICAL_VOLT[modality] * habit["force"] * np.exp(rng.normal(0, 0.25))
    along = grid @ [np.cos(heading), np.sin(heading)]
    beside = grid @ [-np.sin(heading), np.cos(heading)] - rng.normal(0, 0.25)
    coupling = level * np.exp(rng.normal(0, 0.18, len(grid)) + rng.normal(0, 0.2) * beside)

    touching = (time > start) & (time < start + duration)
    since = time[touching, None] - start
    ramp = np.clip(np.minimum(since, duration - since) / (0.1 * duration), 0, 1)
    normal = (
        ramp**2
        * (3 - 2 * ramp)
        * (1 + habit["tremor"] * np.sin(2 * np.pi * (habit["tremor_hz"] * since + rng.uniform())))
    )
    slid = 2 * reach * np.clip((since - dwell) / (duration - dwell), 0, 1)
    if modality == "slide":
        stuck = (since * rng.uniform(8, 14) + rng.uniform()) % 1
        q = _single(slid - 0.05 * (stuck - 0.5) - reach - along) / _single(0.3 * width)
        shear = habit["friction"] * np.tanh(slid / 0.25)
        shape = _bump(q) * _bump(beside / 2) * (_single(0.4) + _single(np.sqrt(np.e) * shear) * q)
    elif modality == "roll":
        shape = _bump((slid - reach - along) / (0.28 * width))
    else:
        u = _single(slid - reach - along)
        tufts = (1 + np.cos(_single(2 * np.pi / habit["pitch"]) * u + _single(rng.uniform(0, 2 * np.pi)))) / 2
        hold = max(1, round(0.02 / (time[1] - time[0])))
        bristles = rng.exponential(1.0, (len(u) // hold + 1, len(grid))).repeat(hold, axis=0)[: len(u)]
        shape = _bump(u / _single(0.6 * width)) * (tufts + _single(0.15 * (bristles - 1)))
    force = np.zeros((len(time), len(grid)), dtype=np.float32)
    force[touching] = _single(normal) * shape * _single(coupling)
    return force


def _single(value) -> np.ndarray:
    return np.asarray(value, dtype=np.float32)


def _bump(q) -> np.ndarray:
    return np.exp(-0.5 * _single(q) ** 2)


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
    return _single(DRIFT_VOLT) * np.sin(
        _single(2 * np.pi * frequency) * _single(time)[:, None, None] + _single(phase)
    )
