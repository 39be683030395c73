"""What checksum and watchdog cost: ``python -m scripts.checksum_cost`` prints the README's rows (onset to decision, without the link)."""

from __future__ import annotations

import argparse
from pathlib import Path

from golden.config import PRESETS, AcceleratorConfig
from rtl.implementation import place
from rtl.schedule import schedule
from rtl.synthesis import Harness, PoweredOn, synthesise
from rtl.targets import target
from scripts.flow import BUILD

CHOICES = {"neither": (False, False), "checksum": (True, False), "watchdog": (False, True), "both": (True, True)}


def cost(config: AcceleratorConfig, board: str, folder: Path) -> dict[str, int]:
    """Cells, flip-flops and block memories of the chain placed on ``board``, and cycles of a step."""
    part = target(board)
    netlist = synthesise(PoweredOn(Harness(config)), part.family, folder, keep=("inner.chain",))
    sites = dict(zip(("clk", "shift_in", "capture", "shift_out"), ("35", "2", "46", "47"), strict=True))
    placed = place(netlist, part, sites, folder / "placed", seed=1, border="inner.chain")
    counts = {column: sum(row[column] for block, row in placed.blocks.items() if block != "top") for column in ("cells", "ff", "bram")}
    return counts | {"cycles": schedule(config).step_cycles}


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--preset", default="thesis")
    parser.add_argument("--lanes", type=int, default=4)
    parser.add_argument("--type", default="dsp")
    options = parser.parse_args()
    preset = PRESETS[options.preset]
    config = preset.replace(feature_shift=(8,) * len(preset.window_lengths)).with_lanes(options.lanes, options.type)
    print(f"| {options.preset}, {options.lanes} {options.type} lanes | cells | flip-flops | block memories | cycles a step |")
    print("| --- | --: | --: | --: | --: |")
    for name, (checksum, watchdog) in CHOICES.items():
        found = cost(config.replace(checksum=checksum, watchdog=watchdog), "icebreaker", BUILD / "defence_cost" / name)
        print(f"| {name} | {found['cells']} | {found['ff']} | {found['bram']} | {found['cycles']} |", flush=True)


if __name__ == "__main__":
    main()
