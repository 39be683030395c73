"""What a configuration's defences cost in hardware: the design placed for a board, and played in co-simulation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from golden.config import AcceleratorConfig
from golden.model import random_integer_model
from golden.recordings import Recordings
from rtl.targets import target as find_target
from scripts import build_job, flow

BOARD = "icebreaker"
PLAYED = 3
"""Recordings of the co-simulation."""


def hardware_cost(
    config: AcceleratorConfig, recordings: Recordings, *, board: str = BOARD, cache: Path = build_job.CACHE
) -> dict[str, Any]:
    """Cells and cycles of ``config``, onset to decision without the serial link, with the lanes that the board's part calls for.

    The network's numbers are random: neither depends on them, where memories are loadable.

    Returns
    -------
    dict
        board, lanes, lane_type; logic_cells, lut, ff, bram, fmax_hz (one placement; logic_cells and bram None where it does not fit) and
        misfit, why not; frame_cycles, step_cycles, decision_cycles: the most that were counted in co-simulation at full pace; bit_exact,
        compared_values: of that run.
    """
    part = find_target(board)
    config = config.with_lanes(None, build_job.suited_lane_type(config, part))
    model = random_integer_model(config, 1)
    cost: dict[str, Any] = {"board": board, "lanes": config.lanes, "lane_type": config.lane_type, "misfit": None}
    try:
        built = build_job.build(model.config, model.arrays, part, link=False, cache=cache)[0]
        cost |= {key: built[key] for key in ("logic_cells", "lut", "ff", "bram", "fmax_hz")}
    except build_job.BuildError as error:
        cost |= {"misfit": str(error), "logic_cells": None, "bram": None}
    some = recordings.subset(recordings.evenly(min(PLAYED, len(recordings))))
    played = flow.cosimulate(model, some, work=flow.BUILD / "defence_cost")
    cycles = played["cycles"]
    return cost | {
        "frame_cycles": cycles["frame_max"], "step_cycles": cycles["step_max"], "decision_cycles": cycles["decision_latency_max"],
        "bit_exact": played["bit_exact"], "compared_values": played["compared_values"],
    }  # fmt: skip
