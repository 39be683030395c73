"""The scene of the presets thesis and synthetic: brush, roll and slide on an n x m piezoelectric array, with
no more physics than separates the three.

With 3 classes they are the modalities, with 2 brush and slide, in either direction and sense.

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

Everything is multiplied by the coupling of each taxel in this trial (an uneven surface, a tilted hand).

**Sensor.** `eskin.data.piezo_array`.

Forces are alike in all classes and vary by person and trial, so that mean and deviation of a taxel reveal
little. The classes differ in the order in which a taxel is loaded: + then - (roll), - then +
(slide), several times (brush).
"""

import dataclasses
import math
from functools import partial

import numpy as np

from eskin.data import turns
from eskin.data.piezo_array import RECORDING_S, SIDES, Person, PiezoArray, bump, single
from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.data.recordings import Recordings

MODALITIES = ("brush", "roll", "slide")
SCENES = {2: ("brush", "slide"), 3: MODALITIES}
"""Classes by their number."""
TYPICAL_VOLT = {"brush": 0.20, "roll": 0.20, "slide": 0.16}
"""Signal of a typical force on a taxel before the high-pass, volt: with these the deviation of a taxel is
alike over the classes."""
PERSONS, TRIALS = 20, 4
CODES = 1 << 27
"""Samples (codes of one taxel) that a scene made from a configuration has at most: half a gigabyte."""


def synthetic_scene(config: AcceleratorConfig) -> Recordings:
    """The scene that belongs to a configuration: what ``--data synthetic`` means beside ``--config`` or a
    model.

    It is the one whose classes the configuration names: those of `eskin.data.turns`
    or this module's. Its array is the most square one of ``taxels``, no more rows
    than columns; its rate is sample_rate_hz. Persons and trials are those of the scene as long as that makes
    no more than CODES samples, else 2 trials or 1, then fewer persons, 2 at least. The presets thesis and
    synthetic give this module's default.

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
            f"has {SIDES[0]} to {SIDES[1]} rows and columns; use the product of two such numbers, such as 16"
        )
    named = config.network.class_names
    turning = named == turns.CLASSES
    if not turning and named not in SCENES.values():
        raise InputError(
            f"configuration '{config.name}', field class_names: is {', '.join(named)}; the synthetic scenes have "
            f"{', or '.join(map(', '.join, (*SCENES.values(), turns.CLASSES)))}"
        )
    persons, most = (turns.PERSONS, turns.TRIALS) if turning else (PERSONS, TRIALS)
    make = turns.turn_recordings if turning else partial(synthetic_recordings, classes=config.classes)
    # recordings of each class
    room = int(CODES / (RECORDING_S * config.sensor.sample_rate_hz * config.sensor.taxels * config.classes))
    trials = next(trials for trials in (most, 2, 1) if trials == 1 or room >= trials * persons)
    return make(
        persons=max(2, min(persons, room // trials)),
        trials=trials,
        rows=rows,
        columns=config.sensor.taxels // rows,
        sample_rate_hz=config.sensor.sample_rate_hz,
    )


def synthetic_recordings(
    *,
    persons: int = PERSONS,
    trials: int = TRIALS,
    seed: int = 1,
    rows: int = 4,
    columns: int = 4,
    classes: int = 3,
    sample_rate_hz: float = 3000.0,
) -> Recordings:
    """Recordings of every person doing every class ``trials`` times: classes x persons x trials, 3 s each.

    Parameters
    ----------
    persons, trials:
        People, and recordings for each person and class. Trials take the two directions in turn.
    seed:
        Everything follows from it; a person's recordings do not depend on how many persons there are.
    rows, columns:
        Taxels of the array, 2..8 each; taxel = row * columns + column.
    classes:
        2 or 3: brush and slide; brush, roll and slide.
    sample_rate_hz:
        Frames a second.

    Returns
    -------
    Recordings
        Unsigned 16-bit codes of 62.5 uV; groups ``person``, ``trial``, ``direction``.

    Raises
    ------
    InputError
        As `PiezoArray`; another number of classes.
    """
    if classes not in SCENES:
        raise InputError(f"synthetic scene, classes: is {classes}; use {' or '.join(map(str, SCENES))}")
    array = PiezoArray(seed, rows, columns, sample_rate_hz)
    names = SCENES[classes]

    def person_of(rng: np.random.Generator) -> Person:
        habit = _habit(rng)
        return lambda label, trial: _contact(names[label], rng, habit, trial % 2, array.grid, array.time)

    recordings = array.recorded(person_of, persons, trials, names, "synthetic scene")
    groups = {**recordings.groups, "direction": recordings.groups["trial"] % 2}
    return dataclasses.replace(recordings, groups=groups)


def _habit(rng: np.random.Generator) -> dict[str, float]:
    """Habits of a person that stay from trial to trial: factors, radians, hertz, half widths."""
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
    modality: str,
    rng: np.random.Generator,
    habit: dict[str, float],
    direction: int,
    grid: np.ndarray,
    time: np.ndarray,
) -> np.ndarray:
    """Signal of the force on every taxel, volt before the high-pass, shape (frames, taxels): one contact as
    the module describes it.

    direction: 0 along the columns, 1 along the rows; the sense is drawn.
    """
    start = rng.uniform(0.15, 0.55)
    duration = np.clip(1.6 / (habit["speed"] * np.exp(rng.normal(0, 0.05))), 1.35, 1.85)
    dwell = rng.uniform(0.05, 0.2)
    quarter = direction + 2 * rng.integers(2)
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
        q = single(slid - 0.05 * (stuck - 0.5) - reach - along) / single(0.3 * width)
        shear = habit["friction"] * np.tanh(slid / 0.25)
        shape = bump(q) * bump(beside / 2) * (single(0.4) + single(math.sqrt(math.e) * shear) * q)
    elif modality == "roll":
        shape = bump((slid - reach - along) / (0.28 * width))
    else:
        u = single(slid - reach - along)
        # tufts at a regular pitch, and bristles that catch at random, each for 20 ms
        tufts = (1 + np.cos(single(2 * np.pi / habit["pitch"]) * u + single(rng.uniform(0, 2 * np.pi)))) / 2
        hold = max(1, round(0.02 / (time[1] - time[0])))
        bristles = rng.exponential(1.0, (len(u) // hold + 1, len(grid))).repeat(hold, axis=0)[: len(u)]
        shape = bump(u / single(0.6 * width)) * (tufts + single(0.15 * (bristles - 1)))
    force = np.zeros((len(time), len(grid)), dtype=np.float32)
    force[touching] = single(normal) * shape * single(coupling)
    return force
