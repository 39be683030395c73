"""A scene unlike the synthetic one: a grip that lasts from the first frame to the last."""

from dataclasses import replace

import numpy as np

from eskin.golden.data import Recordings
from eskin.training.datasets import Datasets
from eskin.training.judge import CrossValidationSettings

GRIP_COUNTS, GRIP_NOISE, GRIP_OFFSET = 24.0, 0.6, 3.0
"""Counts that a firm grip gives the taxel under its middle; standard deviation of a sample's noise; counts of
a taxel that nothing touches."""
PERSONS, TRIALS, SEED, RATE_HZ = 4, 2, 1, 200.0
"""People, recordings for each person and class, what everything follows from, frames a second."""


def gripped_recordings(rows: int = 3, columns: int = 4, classes: int = 3) -> Recordings:
    """Objects held in a grip on a capacitive array: a sensor unlike the presets' (PERSONS x classes x TRIALS,
    2.2 to 3 s each).

    The hand holds the object from the first frame to the last, so there is no lead-in and no touch to wait
    for, and a taxel gives few counts. An object is where it presses: two bumps whose places and widths belong
    to the class (drawn from SEED), a little apart in every trial. The level that the first frame has
    already is therefore all there is to tell classes by. The rest is the hand's: force that differs by person
    and trial, sways by a tenth and trembles at 5 to 9 Hz, drift of each taxel, noise.

    Parameters
    ----------
    rows, columns:
        Taxels of the array, 2..8 each; taxel = row * columns + column.
    classes:
        Objects, 2..32.
    Returns
    -------
    Recordings
        Unsigned 8-bit counts; groups ``person``, ``trial``.

    """
    across, down = np.meshgrid(
        (2 * np.arange(columns) + 1) / columns - 1, (2 * np.arange(rows) + 1) / rows - 1
    )
    grid = np.stack([across.ravel(), down.ravel()], axis=1)
    objects = np.random.default_rng([SEED, 0])
    places, widths = objects.uniform(-0.8, 0.8, (classes, 2, 2)), objects.uniform(0.3, 0.6, (classes, 2))
    weights = objects.uniform(0.5, 1.0, (classes, 2))
    parts, rows = [], []
    for person in range(PERSONS):
        rng = np.random.default_rng([SEED, 1 + person])
        firm, hold = np.exp(rng.normal(0, 0.2)), rng.normal(0, 0.06, 2)  # how this hand grips, and where
        for trial in range(TRIALS):
            for label in range(classes):
                time = np.arange(round(rng.uniform(2.2, 3.0) * RATE_HZ))[:, None] / RATE_HZ
                centres = places[label] + hold + rng.normal(0, 0.06, (2, 2))
                distance = ((grid[:, None] - centres) ** 2).sum(axis=-1) / widths[label] ** 2
                shape = (weights[label] * np.exp(-0.5 * distance)).sum(axis=1)
                sway = 1 + 0.1 * np.sin(2 * np.pi * (rng.uniform(0.2, 0.6) * time + rng.uniform()))
                tremor = 1 + 0.04 * np.sin(2 * np.pi * (rng.uniform(5, 9) * time + rng.uniform()))
                force = firm * np.exp(rng.normal(0, 0.15)) * sway * tremor
                drift = 0.5 * rng.normal(0, 1, len(grid)) * time / 3
                counts = (
                    GRIP_OFFSET
                    + GRIP_COUNTS * force * shape
                    + drift
                    + GRIP_NOISE * rng.standard_normal((len(time), len(grid)))
                )
                parts.append(np.clip(np.rint(counts), 0, 255).astype(np.int32))
                rows.append((label, person, trial))
    labels, of_person, of_trial = zip(*rows, strict=True)
    made = Recordings.of(
        parts,
        labels,
        class_names=[f"object{label}" for label in range(classes)],
        sample_rate_hz=RATE_HZ,
        groups={"person": of_person, "trial": of_trial},
        source="gripped objects",
    )
    return replace(made, sample_bits=8)


def by_person(recordings: Recordings, seeds: list[int]) -> CrossValidationSettings:
    """Persons are left out, with networks of these seeds."""
    return CrossValidationSettings(
        recordings=recordings, groups=["person"], datasets=Datasets(recordings), seeds=seeds
    )
