"""The cocotb bench of a generated folder, started as its reader starts it."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from eskin.cosim.runner import verilator_command


def make(folder: Path, simulator: str = "icarus") -> subprocess.CompletedProcess[str]:
    """``make SIM=...`` in the folder."""
    program, around = verilator_command()
    around["PATH"] = f"{program.parent}:{Path(sys.executable).parent}:{os.environ['PATH']}"
    return subprocess.run(
        ["make", f"SIM={simulator}", "VLT_VERSION=5.048"],  # the package's --version is not a number
        cwd=folder,
        env=around,
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
