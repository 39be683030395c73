"""The synthetic scene of ``make run``: two strokes over the skin, and how the second turns from the first.

A class is a relation: the second stroke goes ``on`` the way of the first, turns ``left``, comes ``back`` or
turns ``right``. Most touches begin eastward, MIRRORED of them westward. Lengths are in half widths of the
array; a stroke is a finger pad, ``N g((x - a) / w) g(b / 2)``, a and b where
a taxel lies along and beside its path, x from -1.2 to 1.2 at constant speed, N its pressure, which rises over
the first and falls over the last 15 % of it.

**Why networks differ on it.** The class depends on the first stroke: on the skin, ``left`` after an eastward
stroke ends like ``right`` after a westward one. A linear classifier adds up evidence of both strokes, so the
first cannot change how it reads the second, however wide it is: it serves the eastward touches and loses the
others. Nor does it know when the second stroke begins, which varies with persons and touches. A recurrent
network stores the first direction until the second stroke; with more units it separates more directions,
speeds and pressures.

**Independent of the class.** Length of a touch, shares of its strokes, the pause between them, pressure,
place, lead-in and direction of the first stroke do not depend on the class. Recordings are equally long, and
each taxel has a separate rest level. tests/eskin/data/test_turns.py checks this.

**The array** is piezoelectric. A taxel does not see static force: ``dV/dt = dF/dt - V / tau``, ``tau = 1 / (2 pi
CORNER_HZ)``. Gain (5 % apart) and rest level (1.65 V, 4 mV apart) belong to the taxel. White noise and slow drift
are added, and the converter rounds to codes of 62.5 uV.

The scene's figures were chosen so that networks of several sizes differ. Accuracies on it say how the product
works, nothing of a sensor.
"""

import numpy as np

from eskin.golden.core import PRESETS, AcceleratorConfig, InputError
from eskin.golden.data.recordings import Recordings

TURNS = {"on": 0, "left": 3, "back": 2, "right": 1}
"""Quarter turns, clockwise seen with row 0 on top, from the first stroke's heading to the second's."""
CLASSES = tuple(TURNS)
PERSONS, TRIALS, SEED = 16, 8, 1
MIRRORED = 0.12
"""Share of touches that begin westward."""
UNEVEN = 0.3
"""Spread of the logarithms of a stroke's share in a touch's time and of its pressure."""
VOLT = 0.1
"""Signal of a typical pressure before the high-pass, volt."""
REST_VOLT, NOISE_VOLT, DRIFT_VOLT = 1.65, 0.0012, 0.002
CORNER_HZ = 0.5
"""High-pass corner of a piezoelectric taxel with its amplifier, hertz."""
VOLT_PER_CODE = PRESETS["thesis"].sensor.volt_per_code
RECORDING_S = 3.0
"""Length of a recording, seconds: an onset within the first 0.9 s leaves room for 6144 frames at 3 kHz."""
SIDES = (2, 8)
"""Smallest and largest number of rows and of columns."""
CODES = 1 << 25
"""Samples (codes of one taxel) that a scene made from a configuration has at most."""


def scene_of(config: AcceleratorConfig) -> Recordings:
    """The scene on the array of a configuration: what ``--data synthetic`` means beside ``--config`` or a model. Its
    array is the most square one of ``taxels``, no more rows than columns; its rate is sample_rate_hz; fast and large
    arrays have fewer trials and persons.

    Raises
    ------
    InputError
        No array of 2..8 rows and columns has that many taxels; a rate outside 100..20000 Hz.
    """
    taxels, (least, most) = config.sensor.taxels, SIDES
    sides = [n for n in range(least, most + 1) if not taxels % n and n <= taxels // n <= most]
    if not sides:
        raise InputError(
            f"configuration '{config.name}', field taxels: is {taxels}; the synthetic scene has {least} to {most} rows and "
            "columns; use the product of two such numbers, such as 16"
        )
    # recordings of each class
    room = int(CODES / (RECORDING_S * config.sensor.sample_rate_hz * taxels * len(CLASSES)))
    trials = next(trials for trials in (TRIALS, 2, 1) if trials == 1 or room >= trials * PERSONS)
    return turn_recordings(
        persons=max(2, min(PERSONS, room // trials)),
        trials=trials,
        rows=sides[-1],
        columns=taxels // sides[-1],
        sample_rate_hz=config.sensor.sample_rate_hz,
    )


def turn_recordings(
    *,
    persons: int = PERSONS,
    trials: int = TRIALS,
    rows: int = 3,
    columns: int = 3,
    sample_rate_hz: float = 200.0,
) -> Recordings:
    """Recordings of every person doing every class ``trials`` times, 3 s each.

    Parameters
    ----------
    persons, trials:
        People, and recordings for each person and class.
    rows, columns:
        Taxels of the array, 2..8 each; taxel = row * columns + column.
    sample_rate_hz:
        Frames a second.

    Returns
    -------
    Recordings
        Unsigned 16-bit codes of 62.5 uV, by person, trial and class; groups ``person``, ``trial``.

    Raises
    ------
    InputError
        A rate outside 100..20000 Hz.
    """
    if not 100 <= sample_rate_hz <= 20000:
        raise InputError(f"synthetic scene, sample_rate_hz: is {sample_rate_hz}; it must lie in 100..20000")
    across, down = np.meshgrid(*((2 * np.arange(side) + 1) / side - 1 for side in (columns, rows)))
    grid = np.stack([across.ravel(), down.ravel()], axis=1)  # (taxels, 2), of each taxel's centre, -1..1
    time = np.arange(round(RECORDING_S * sample_rate_hz)) / sample_rate_hz
    of_array = np.random.default_rng([SEED, 0])
    gain = single(1 + 0.05 * of_array.standard_normal(len(grid)))
    rest = single(REST_VOLT + 0.004 * of_array.standard_normal(len(grid)))
    decay = np.float32(np.exp(-2 * np.pi * CORNER_HZ / sample_rate_hz))
    each = trials * len(CLASSES)  # recordings of a person
    order = np.arange(persons * each)
    labels = order % len(CLASSES)
    samples = np.empty((persons, each, len(time), len(grid)), dtype=np.int32)
    for person in range(persons):
        rng = np.random.default_rng([SEED, 1 + person])
        habit = {
            "pace": np.exp(rng.normal(0, 0.15)),
            "force": np.exp(rng.normal(0, UNEVEN)),
            "width": np.exp(rng.normal(0, 0.12)),
            "skew": rng.normal(0, np.radians(6)),
        }
        turns = [TURNS[CLASSES[label]] for label in labels[:each]]
        force = np.stack([_touch(turn, rng, habit, grid, time) for turn in turns], axis=1)
        volt = np.diff(force, axis=0, prepend=force[:1])
        for frame in range(1, len(volt)):  # the high-pass, from rest
            volt[frame] += volt[frame - 1]
            volt[frame] *= decay
        volt = volt * gain + rest
        volt += NOISE_VOLT * rng.standard_normal(volt.shape, dtype=np.float32)
        drift, phase = rng.uniform(0.05, 0.2, volt.shape[1:]), rng.uniform(0, 2 * np.pi, volt.shape[1:])
        turned = single(2 * np.pi * drift) * single(time)[:, None, None] + single(phase)  # 0.05 to 0.2 Hz
        volt += single(DRIFT_VOLT) * np.sin(turned)
        samples[person] = np.clip(np.rint(volt / VOLT_PER_CODE), 0, 65535).transpose(1, 0, 2)
    return Recordings(
        samples=samples.reshape(-1, len(grid)),
        offsets=np.arange(len(order) + 1) * len(time),
        labels=labels,
        class_names=CLASSES,
        sample_rate_hz=float(sample_rate_hz),
        groups={"person": order // each, "trial": order // len(CLASSES) % trials},
        source="synthetic scene",
        volt_per_code=VOLT_PER_CODE,
    )


def _touch(
    turn: int, rng: np.random.Generator, habit: dict[str, float], grid: np.ndarray, time: np.ndarray
) -> np.ndarray:
    """Force on every taxel, shape (frames, taxels), volt before the high-pass: two strokes as the module describes
    them."""
    first = 2 if rng.random() < MIRRORED else 0
    start = rng.uniform(0.15, 0.4)
    duration = np.clip(rng.uniform(1.2, 1.8) * habit["pace"], 1.0, 2.2)
    shares = np.exp(rng.normal(0, UNEVEN, 3)) * [1, 1, rng.uniform(0.1, 0.3)]  # two strokes, and a pause
    stroke, second, pause = duration * shares / shares.sum()
    width = 0.5 * habit["width"] * np.exp(rng.normal(0, 0.08))
    coupling = VOLT * habit["force"] * np.exp(rng.normal(0, UNEVEN) + rng.normal(0, 0.15, len(grid)))
    force = np.zeros((len(time), len(grid)), dtype=np.float32)
    for quarter, begin, length in ((first, start, stroke), (first + turn, start + stroke + pause, second)):
        heading = np.pi / 2 * quarter + habit["skew"] + rng.normal(0, np.radians(6))
        along = grid @ [np.cos(heading), np.sin(heading)]
        beside = grid @ [-np.sin(heading), np.cos(heading)] - rng.normal(0, 0.15)
        touching = (time > begin) & (time < begin + length)
        share = (time[touching, None] - begin) / length
        ramp = np.clip(np.minimum(share, 1 - share) / 0.15, 0, 1)
        pressure = np.exp(rng.normal(0, UNEVEN)) * ramp**2 * (3 - 2 * ramp)
        place = 1.2 * (2 * share - 1)
        force[touching] += single(pressure * coupling) * bump((place - along) / width) * bump(beside / 2)
    return force


def single(value) -> np.ndarray:
    """In single precision."""
    return np.asarray(value, dtype=np.float32)


def bump(q) -> np.ndarray:
    """``exp(-q^2 / 2)``."""
    return np.exp(-0.5 * single(q) ** 2)
