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
each taxel has its own rest level. tests/eskin/data/test_turns.py checks this.

The scene's figures were chosen so that networks of several sizes differ. Accuracies on it say how the product
works, nothing of a sensor.
"""

import numpy as np

from eskin.data.piezo_array import RECORDING_S, SIDES, Person, PiezoArray, bump, single
from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.data.recordings import Recordings

TURNS = {"on": 0, "left": 3, "back": 2, "right": 1}
"""Quarter turns, clockwise seen with row 0 on top, from the first stroke's heading to the second's."""
CLASSES = tuple(TURNS)
PERSONS, TRIALS = 16, 8
MIRRORED = 0.12
"""Share of touches that begin westward."""
UNEVEN = 0.3
"""Spread of the logarithms of a stroke's share in a touch's time and of its pressure."""
VOLT = 0.1
"""Signal of a typical pressure before the high-pass, volt."""
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
    seed: int = 1,
    rows: int = 3,
    columns: int = 3,
    sample_rate_hz: float = 200.0,
) -> Recordings:
    """Recordings of every person doing every class ``trials`` times, 3 s each.

    Parameters
    ----------
    persons, trials:
        People, and recordings for each person and class.
    seed:
        Everything follows from it; a person's recordings do not depend on how many persons there are.
    rows, columns:
        Taxels of the array, 2..8 each; taxel = row * columns + column.
    sample_rate_hz:
        Frames a second.

    Returns
    -------
    Recordings
        Unsigned 16-bit codes of 62.5 uV; groups ``person``, ``trial``.

    Raises
    ------
    InputError
        As `eskin.data.piezo_array.PiezoArray`.
    """
    array = PiezoArray(seed, rows, columns, sample_rate_hz)

    def person_of(rng: np.random.Generator) -> Person:
        habit = {
            "pace": np.exp(rng.normal(0, 0.15)),
            "force": np.exp(rng.normal(0, UNEVEN)),
            "width": np.exp(rng.normal(0, 0.12)),
            "skew": rng.normal(0, np.radians(6)),
        }
        return lambda label, trial: _touch(TURNS[CLASSES[label]], rng, habit, array)

    return array.recorded(person_of, persons, trials, CLASSES, "synthetic scene")


def _touch(turn: int, rng: np.random.Generator, habit: dict[str, float], array: PiezoArray) -> np.ndarray:
    """Force on every taxel, shape (frames, taxels): two strokes as the module describes them."""
    first = 2 if rng.random() < MIRRORED else 0
    start = rng.uniform(0.15, 0.4)
    duration = np.clip(rng.uniform(1.2, 1.8) * habit["pace"], 1.0, 2.2)
    shares = np.exp(rng.normal(0, UNEVEN, 3)) * [1, 1, rng.uniform(0.1, 0.3)]  # two strokes, and a pause
    stroke, second, pause = duration * shares / shares.sum()
    width = 0.5 * habit["width"] * np.exp(rng.normal(0, 0.08))
    coupling = VOLT * habit["force"] * np.exp(rng.normal(0, UNEVEN) + rng.normal(0, 0.15, len(array.grid)))
    force = np.zeros((len(array.time), len(array.grid)), dtype=np.float32)
    for quarter, begin, length in ((first, start, stroke), (first + turn, start + stroke + pause, second)):
        heading = np.pi / 2 * quarter + habit["skew"] + rng.normal(0, np.radians(6))
        along = array.grid @ [np.cos(heading), np.sin(heading)]
        beside = array.grid @ [-np.sin(heading), np.cos(heading)] - rng.normal(0, 0.15)
        touching = (array.time > begin) & (array.time < begin + length)
        share = (array.time[touching, None] - begin) / length
        ramp = np.clip(np.minimum(share, 1 - share) / 0.15, 0, 1)
        pressure = np.exp(rng.normal(0, UNEVEN)) * ramp**2 * (3 - 2 * ramp)
        place = 1.2 * (2 * share - 1)
        force[touching] += single(pressure * coupling) * bump((place - along) / width) * bump(beside / 2)
    return force
