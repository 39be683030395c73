"""The cocotb bench of a generated folder, started as its reader starts it."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from eskin.cosim.runner import verilator_command


def make(folder: Path, simulator: str = "icarus") -> subprocess.CompletedProcess[str]:
    """``make SIM=...`` in the folder."""
    around = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    if (
        simulator == "verilator"
    ):  # the package has a build's name for a version, which cocotb's Makefile cannot read
        program, environment = verilator_command()
        around |= environment
        script = folder / "bin" / "verilator"
        script.parent.mkdir(exist_ok=True)
        script.write_text(
            f'#!/bin/sh\n[ "$1" = --version ] && exec echo Verilator 5.048\nexec {program} "$@"\n'
        )
        script.chmod(0o755)
        around["PATH"] = f"{script.parent}:{Path(sys.executable).parent}:{os.environ['PATH']}"
    return subprocess.run(
        ["make", f"SIM={simulator}"],
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
