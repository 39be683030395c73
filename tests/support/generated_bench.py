"""The cocotb bench of a generated folder, started as its reader starts it."""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np


def make(
    folder: Path, simulator: str = "icarus", *options: str, path: Sequence[str] = ()
) -> subprocess.CompletedProcess[str]:
    """``make SIM=...`` in the folder, with more folders before PATH."""
    path = ":".join([*path, str(Path(sys.executable).parent), os.environ["PATH"]])
    return subprocess.run(
        ["make", f"SIM={simulator}", *options],
        cwd=folder,
        env=os.environ | {"PATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=900,
        check=False,
    )


def flip(folder: Path, stage: str, index: int) -> str:
    """Make one golden value of the folder's vectors wrong; how the bench tells of it."""
    with np.load(folder / "vectors.npz") as archive:
        arrays = dict(archive)
    right = int(arrays[stage][index])
    arrays[stage][index] ^= 1
    np.savez(folder / "vectors.npz", allow_pickle=False, **arrays)
    return f"stage {stage}, index {index}: expected {right ^ 1}, got {right}\n"
