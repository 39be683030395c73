"""Small made-up recordings with known touches, and the configuration that finds them: for the tests of model,
pipeline and training."""

from pathlib import Path

import numpy as np

from eskin.golden.data import Recordings
from tests.support.small_designs import TRACKED

SMALL = TRACKED.replace(
    name="small",
    sample_rate_hz=1000.0,
    rest_frames=16,
    clip=200,
    onset_mean_frames=16,
    onset_threshold=10,
    rearm_frames=24,
    hop=10,
    window=20,
    steps=6,
    hidden=6,
    class_names=("rise", "fall", "pulse"),
)


def touch(kind: int, rng: np.random.Generator, frames: int = 110) -> np.ndarray:
    """Deviation (frames, 4) of one touch: a level that rises, that falls, or that comes and goes; strength
    and speed vary."""
    x = np.clip(np.arange(frames) / frames * rng.uniform(0.9, 1.2), 0, 1)
    course = (30 + 90 * x, 120 - 90 * x, 60 + 60 * np.sin(6 * np.pi * x))[kind]
    return course[:, None] * rng.uniform(0.7, 1.3, 4) * np.array([1, 1, -1, 0.5])


def scene(recordings: int = 60, seed: int = 0) -> Recordings:
    """Recordings of 0 to 2 touches. Group ``person``: 5 values. Recording 0 is never touched; recording 1
    ends inside its touch."""
    rng = np.random.default_rng(seed)
    labels = np.arange(recordings) % 3
    parts = []
    for index, label in enumerate(labels):
        quiet = rng.integers(30, 70)
        pieces = [np.zeros((quiet, 4))]
        if index == 1:
            pieces.append(touch(label, rng)[:50])
        elif index > 1:
            pieces += [touch(label, rng), np.zeros((60, 4))]
            if index % 4 == 0:
                pieces += [touch(rng.integers(3), rng), np.zeros((40, 4))]
        part = np.concatenate(pieces)
        parts.append(
            np.rint(1000 + rng.integers(-50, 50, 4) + part + rng.normal(0, 2, part.shape)).astype(np.int32)
        )
    return Recordings.of(
        parts,
        labels,
        class_names=SMALL.network.class_names,
        sample_rate_hz=SMALL.sensor.sample_rate_hz,
        groups={"person": (np.arange(recordings) // 3) % 5},
        source="scene",
    )


def archived(recordings: Recordings, folder: Path) -> None:
    """``data.npz`` and ``c.json`` of a scene in ``folder``."""
    names = ("samples", "offsets", "labels", "class_names", "sample_rate_hz")
    np.savez(folder / "data.npz", **{name: getattr(recordings, name) for name in names}, **recordings.groups)
    (folder / "c.json").write_text(SMALL.to_json())
