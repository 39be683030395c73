"""What a configuration's defences cost in hardware: the design placed for a board, and played in
co-simulation.

``python -m eskin.verbs.defence_cost`` prints the rows of docs/robustness.md for checksum and
watchdog (with the link, which tells the faults).
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from eskin.golden.core.config import PRESETS, AcceleratorConfig
from eskin.golden.core.jobs import Record
from eskin.golden.core.memo import content_key
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.model import random_integer_model
from eskin.rtl.fpga.targets import target as find_target
from eskin.rtl.program.schedule import schedule
from eskin.verbs import build_job, flow

BOARD = "icebreaker"
PLAYED = 3
"""Recordings of the co-simulation."""
CHECKS = {
    "neither": (False, False),
    "checksum": (True, False),
    "watchdog": (False, True),
    "both": (True, True),
}
"""Name of a row: checksum, watchdog."""


def placed(
    config: AcceleratorConfig, arrays: Mapping[str, np.ndarray], board: str, cache: Path, *, link: bool
) -> Record:
    """One placement: {logic_cells, lut, ff, bram, fmax_hz}, or {misfit, logic_cells and bram None} where it
    does not fit."""
    try:
        request = build_job.BuildRequest(
            lanes_asked=True, config=config, arrays=arrays, target=find_target(board), link=link, cache=cache
        )
        built = build_job.build(request)[0]
    except build_job.BuildError as error:
        return {"misfit": str(error), "logic_cells": None, "bram": None}
    return {"misfit": None} | {key: built[key] for key in ("logic_cells", "lut", "ff", "bram", "fmax_hz")}


def hardware_cost(
    config: AcceleratorConfig, recordings: Recordings, *, board: str = BOARD, cache: Path = build_job.CACHE
) -> Record:
    """Cells and cycles of ``config``, onset to decision without the serial link, with the lanes that the
    board's part calls for.

    The network's numbers are random: neither depends on them, where memories are loadable.

    Returns
    -------
    dict
        board, lanes, lane_type; logic_cells, lut, ff, bram, fmax_hz (one placement; logic_cells and bram None
        where it does not fit) and misfit, why not; frame_cycles, step_cycles, decision_cycles: the most that
        were counted in co-simulation at full pace; bit_exact, compared_values: of that run.
    """
    config = config.with_lanes(None, build_job.suited_lane_type(config, find_target(board)))
    model = random_integer_model(config, 1)
    cost = {"board": board, "lanes": config.hardware.lanes, "lane_type": config.hardware.lane_type} | placed(
        model.config, model.arrays, board, cache, link=False
    )
    some = recordings.subset(recordings.evenly(min(PLAYED, len(recordings))))
    played = flow.cosimulate(model, some, work=flow.BUILD / "defence_cost" / content_key(config.to_dict()))
    cycles = played["cycles"]
    return cost | {
        "frame_cycles": cycles["frame_max"],
        "step_cycles": cycles["step_max"],
        "decision_cycles": cycles["decision_latency_max"],
        "bit_exact": played["bit_exact"],
        "compared_values": played["compared_values"],
    }


def main() -> None:
    """Print what checksum and watchdog cost as a Markdown table."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--preset", default="thesis")
    parser.add_argument("--lanes", type=int, default=4)
    parser.add_argument("--type", default="dsp")
    options = parser.parse_args()
    head = f"{options.preset}, {options.lanes} {options.type} lanes, with the link"
    print(f"| {head} | cells | flip-flops | block memories | cycles a step |")
    print("| --- | --: | --: | --: | --: |")
    for name, (checksum, watchdog) in CHECKS.items():
        config = (
            PRESETS[options.preset]
            .with_lanes(options.lanes, options.type)
            .replace(checksum=checksum, watchdog=watchdog)
        )
        model = random_integer_model(config, 1)
        # With the link: without it nobody reads the faults, and what finds them is not there either.
        cells = placed(model.config, model.arrays, BOARD, build_job.CACHE, link=True)
        cycles = schedule(model.config).step_cycles
        print(
            f"| {name} | {cells['logic_cells']} | {cells.get('ff')} | {cells['bram']} | {cycles} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
