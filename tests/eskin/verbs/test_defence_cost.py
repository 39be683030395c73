"""eskin/verbs/defence_cost.py: what a defence costs in hardware, and how that is told."""

import numpy as np
import pytest

from eskin.golden.core import PRESETS
from eskin.golden.data import Recordings
from eskin.golden.model import random_recordings
from eskin.rtl.fpga.targets import target
from eskin.rtl.fpga.wiring import Wiring
from eskin.verbs import build_job, defence_cost, flow

PVDF = PRESETS["pvdf"]
DEFENDED = PVDF.replace(fault_frames=64, fault_activity=30, onset_hits=3, onset_span=4, margin_threshold=18)
BUILT = {"logic_cells": 900, "lut": 800, "ff": 500, "bram": 29, "fmax_hz": 4e7}
COSTS = ("logic_cells", "bram", "frame_cycles", "step_cycles", "decision_cycles")
CYCLES = {"frame_max": 22, "step_min": 219, "step_max": 220, "decision_latency_max": 170}


@pytest.fixture
def recordings() -> Recordings:
    return random_recordings(PVDF, (3000, 200, 3000, 3000, 10), 1)


@pytest.fixture
def asked(monkeypatch) -> dict:
    """What was built and played, neither of which is done."""
    seen: dict = {}

    def build(request):
        seen.update(built=request.config, part=request.target, link=request.link)
        if "misfit" in seen:
            raise build_job.BuildError(seen["misfit"])
        return BUILT, None, None

    def play(model, chosen, **options):
        seen.update(played=model.config, recordings=len(chosen))
        return {"cycles": CYCLES, "bit_exact": True, "compared_values": 77}

    monkeypatch.setattr(build_job, "build", build)
    monkeypatch.setattr(flow, "cosimulate", play)
    return seen


def test_the_defended_design_itself_is_placed_and_played(asked, recordings):
    cost = defence_cost.hardware_cost(DEFENDED, recordings)
    assert asked["built"] == asked["played"] and asked["part"].name == "icebreaker" and not asked["link"]
    assert asked["built"].replace(feature_shift=(), lane_type="plain") == DEFENDED
    assert asked["built"].hardware.lane_type == "dsp"
    assert asked["recordings"] == defence_cost.PLAYED
    assert [cost[key] for key in COSTS] == [900, 29, 22, 220, 170] and cost["bit_exact"]


def test_what_does_not_fit_has_cycles_but_no_cells(asked, recordings):
    asked["misfit"] = "needs 9 block memories of 8"
    cost = defence_cost.hardware_cost(DEFENDED, recordings.subset([0]))
    assert cost["misfit"] == asked["misfit"] and asked["recordings"] == 1
    assert [cost[key] for key in COSTS] == [None, None, 22, 220, 170]


def test_a_board_has_a_pin_for_unsure_decisions_where_there_is_a_threshold():
    board, pins = target("icebreaker"), {}
    for config in (PVDF, DEFENDED):
        pins[bool(config.network.margin_threshold)] = Wiring(config=config, target=board, link=True).sites()
    assert set(pins[True]) - set(pins[False]) == {"unsure"} and len(set(pins[True].values())) == len(
        pins[True]
    )


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_defences_cost_cells_and_no_cycles(recordings, tmp_path):
    plain, defended = (
        defence_cost.hardware_cost(config, recordings, cache=tmp_path) for config in (PVDF, DEFENDED)
    )
    assert plain["bit_exact"] and defended["bit_exact"]
    assert plain["logic_cells"] < defended["logic_cells"] < plain["logic_cells"] + 150
    assert defended["bram"] == plain["bram"] + 1
    assert np.array_equal(
        [plain[key] for key in COSTS if "cycles" in key], [defended[key] for key in COSTS if "cycles" in key]
    )
