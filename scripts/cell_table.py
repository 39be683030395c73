"""What each cell costs and gives: linear, GRU 4, 8, 12 on the front ends of several scenes, one table.

``python -m scripts.cell_table SCENE ...`` prints it. A SCENE is a model folder of ``eskin train --cell auto``
(or without --cell and --config), whose training.json has the accuracy of every candidate on recordings left
out, by itself or as NAME=FOLDER; or a preset's name, then without accuracies.

Cycles are those of the program on 4 DSP lanes; latency is from the last sample of a window to its decision at
the icebreaker's 12 MHz. Cells are Yosys' counts on an iCE40 UP5K, onset to decision without the serial link,
before placement. Energy is the estimate of ``eskin build`` for cell and classifier, good to a factor
(docs/energy.md). The network's numbers are random where cells are counted: nothing depends on them.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from eskin.golden.core.config import PRESETS, AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.model.model import random_integer_model
from eskin.golden.studies.energy import estimate, scheduled_activity
from eskin.golden.training.choose_network import network
from eskin.rtl.fpga.targets import target
from eskin.rtl.program.schedule import lowest_clock_hz, mean_frame_cycles, schedule
from eskin.verbs.feature_cost import synthesised

CELLS: tuple[tuple[str, int | None], ...] = (("linear", None), ("gru", 4), ("gru", 8), ("gru", 12))
BOARD, LANES = "icebreaker", 4
COLUMNS = (
    "scene",
    "cell",
    "accuracy",
    "multiplies a touch",
    "cycles a step",
    "latency",
    "LUT",
    "flip-flops",
    "multipliers",
    "block memories",
    "large ones",
    "a touch",
)


def scene(text: str) -> tuple[str, AcceleratorConfig, list[dict[str, Any]]]:
    """Name, front end and judged candidates of a SCENE."""
    if text in PRESETS:
        return text, PRESETS[text], []
    name, _, folder = text.rpartition("=")
    try:
        candidates = json.loads((Path(folder) / "training.json").read_text())["candidates"]
    except (OSError, ValueError, KeyError):
        raise InputError(
            f"{folder}: is no preset and no model folder of 'eskin train --cell auto'; give one of them"
        ) from None
    return name or Path(folder).name, AcceleratorConfig.load(Path(folder) / "config.json"), candidates


def accuracy_of(candidates: Sequence[dict[str, Any]], config: AcceleratorConfig) -> str:
    """The best recipe's accuracy of that network, in words; - where it was judged on another front end, or
    not at all."""
    hidden = config.network.hidden if config.recurrent else 0
    sizes = {"cell": config.network.cell, "hidden": hidden, "multiplies_step": config.multiplies}
    rows = [row for row in candidates if all(row[key] == value for key, value in sizes.items())]
    best = max(rows, key=lambda row: row["accuracy"], default=None)
    return f"{100 * best['accuracy']:.1f} +- {100 * best['standard_error']:.1f} %" if best else "-"


def row_of(name: str, config: AcceleratorConfig, candidates: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    """A row of `COLUMNS`."""
    config = random_integer_model(config.replace(lanes=LANES, lane_type="dsp", feature_shift=()), 1).config
    cells, plan, board = synthesised(config), schedule(config), target(BOARD)
    activity = scheduled_activity(config, plan.step_cycles, *mean_frame_cycles(config), cells["dsp"])
    energy = estimate(config, board.device, activity, lowest_clock_hz(config))
    called = f"GRU {config.network.hidden}" if config.recurrent else "linear"
    counts = (str(cells[kind]) for kind in ("lut", "ff", "dsp", "bram", "spram"))
    return (
        name,
        called,
        accuracy_of(candidates, config),
        str(config.windows.steps * config.multiplies),
        str(plan.step_cycles),
        f"{1e6 * plan.decision_cycles / board.clock_hz:.1f} us",
        *counts,
        f"{1e9 * energy['per_touch_j']:.0f} nJ",
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, a row as soon as it is known."""
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0], epilog="example: synthetic=m_synthetic biotac=m_biotac pvdf"
    )
    parser.add_argument(
        "scenes", nargs="+", metavar="SCENE", help="a model folder of 'eskin train --cell auto', or a preset"
    )
    try:
        scenes = [scene(text) for text in parser.parse_args(arguments).scenes]
    except InputError as error:
        parser.error(str(error))
    print("| " + " | ".join(COLUMNS) + " |\n|---|---|" + "--:|" * (len(COLUMNS) - 2))
    for name, config, candidates in scenes:
        for cell, hidden in CELLS:
            print(
                "| " + " | ".join(row_of(name, network(config, cell, hidden), candidates)) + " |", flush=True
            )


if __name__ == "__main__":
    main()
