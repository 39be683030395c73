"""Cost of a configuration's defences in hardware: the design placed for a board, and played in
co-simulation.
"""

from pathlib import Path

from eskin.golden.core import AcceleratorConfig, Arrays, Record, content_key
from eskin.golden.data import Recordings
from eskin.rtl.fpga.targets import target as find_target
from eskin.training.made_up import random_integer_model
from eskin.verbs import build_job, flow

BOARD = "icebreaker"
PLAYED = 3
"""Recordings of the co-simulation."""


def placed(config: AcceleratorConfig, arrays: Arrays, board: str, cache: Path, *, link: bool) -> Record:
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
