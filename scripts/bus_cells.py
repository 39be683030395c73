"""What a bus shell costs: cells of the whole design less those of the bare one, one table.

``python -m scripts.bus_cells`` prints it: Yosys' counts on an iCE40 UP5K before placement, preset ``thesis`` on
one lane. The network's numbers are random: nothing depends on them.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from eskin.golden.core.config import PRESETS
from eskin.golden.model.model import random_integer_model
from eskin.rtl.fpga.synthesis import ICE40_DSP, Chain, synthesise
from eskin.rtl.top.bus_top import BusTop

ROWS: dict[str, dict[str, Any]] = {
    "Wishbone": {"bus": "wishbone"},
    "APB": {"bus": "apb"},
    "AXI4-Lite": {"bus": "axi4lite"},
    "Wishbone, no queue": {"bus": "wishbone", "depth": 0},
    "Wishbone, a queue of 4": {"bus": "wishbone", "depth": 4},
    "Wishbone, frames from a stream": {"bus": "wishbone", "axis": True},
}


def cells(design: Any) -> tuple[int, int]:
    """LUTs and flip-flops."""
    with tempfile.TemporaryDirectory() as folder:
        counts = synthesise(design, ICE40_DSP, Path(folder)).cells
    return counts["SB_LUT4"], sum(count for name, count in counts.items() if name.startswith("SB_DFF"))


def main() -> None:
    """Print the table, a row as soon as it is known."""
    config = random_integer_model(PRESETS["thesis"].replace(lanes=1), 1).config
    bare = cells(Chain(config))
    print("| shell | LUT | flip-flops |\n| --- | --: | --: |")
    print(f"| none (the whole design) | {bare[0]} | {bare[1]} |", flush=True)
    for name, options in ROWS.items():
        lut, ff = cells(BusTop(config, **options))
        print(f"| {name} | {lut - bare[0]} | {ff - bare[1]} |", flush=True)


if __name__ == "__main__":
    main()
