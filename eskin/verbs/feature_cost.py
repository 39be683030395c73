"""What each kind of feature costs in hardware: cells of the synthesised chain on an iCE40, cycles of the
program and of a frame.

``python -m eskin.verbs.feature_cost`` prints a row for every set of kinds, on the PVDF preset. Cells are
Yosys' counts before placement (onset to decision, without the serial link). The network's numbers are random:
nothing depends on them.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from eskin.golden.core.config import PRESETS, AcceleratorConfig
from eskin.golden.core.jobs import Record
from eskin.golden.model.model import random_integer_model
from eskin.rtl.fpga.synthesis import ICE40_DSP, Chain, synthesise
from eskin.rtl.program.schedule import frame_cycles, schedule

SETS: dict[str, Record] = {
    "mean": {},
    "mean, a scale a taxel": {"feature_scale": "taxel"},
    "mean, activity (sum)": {"feature_kinds": ("mean", "activity")},
    "mean, activity (change)": {"feature_kinds": ("mean", "activity"), "activity_rule": "change"},
    "mean, integral": {"feature_kinds": ("mean", "integral")},
    "all": {"feature_kinds": ("mean", "activity", "integral")},
    "all, a scale a taxel": {"feature_kinds": ("mean", "activity", "integral"), "feature_scale": "taxel"},
    "activity (sum)": {"feature_kinds": ("activity",)},
    "integral": {"feature_kinds": ("integral",)},
}
"""Sets of features by what a row calls them: changes to the preset."""


def synthesised(config: AcceleratorConfig) -> dict[str, int]:
    """Cells of the chain without the link: lut, carry, ff, bram (block memories), spram (large ones), dsp."""
    with tempfile.TemporaryDirectory() as folder:
        cells = synthesise(Chain(config), ICE40_DSP, Path(folder)).cells
    return {
        "lut": cells["SB_LUT4"],
        "carry": cells["SB_CARRY"],
        "ff": sum(count for name, count in cells.items() if name.startswith("SB_DFF")),
        "bram": sum(count for name, count in cells.items() if name.startswith("SB_RAM40_4K")),
        "spram": cells.get("SB_SPRAM256KA", 0),
        "dsp": cells.get("SB_MAC16", 0),
    }


def feature_cost(config: AcceleratorConfig) -> dict[str, int]:
    """Cells of `synthesised`; inputs, multiplies; step and decision: cycles of the program; frame,
    frame_plain: most cycles of a frame that ends a window, and of another."""
    config = random_integer_model(config, 1).config
    plan = schedule(config)
    return synthesised(config) | {
        "inputs": config.inputs,
        "multiplies": config.multiplies,
        "step": plan.step_cycles,
        "decision": plan.decision_cycles,
        "frame": frame_cycles(config),
        "frame_plain": frame_cycles(config, ends_window=False),
    }


def main() -> None:
    """Print the table, a row as soon as it is known."""
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0], epilog="example: --lane-type plain --block 1"
    )
    parser.add_argument("--lane-type", default="dsp", help="plain, dsp or serial (default: %(default)s)")
    parser.add_argument("--lanes", type=int, default=4, help="default: %(default)s")
    parser.add_argument("--sets", nargs="*", default=list(SETS), help="rows by name (default: all)")
    parser.add_argument(
        "--block", type=int, default=24, help="frames of a block of activity (default: %(default)s)"
    )
    asked = parser.parse_args()
    base = PRESETS["pvdf"].replace(lanes=asked.lanes, lane_type=asked.lane_type, activity_block=asked.block)
    begun = False
    for name in asked.sets:
        row = feature_cost(base.replace(**SETS[name]))
        if not begun:
            print("| features | " + " | ".join(row) + " |\n|---|" + "--:|" * len(row))
            begun = True
        print(f"| {name} | " + " | ".join(map(str, row.values())) + " |", flush=True)


if __name__ == "__main__":
    main()
