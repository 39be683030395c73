"""eskin/verbs/defence_cost.py: what a defence costs in hardware, and how that is told."""

import numpy as np
import pytest

from eskin.golden.core import PRESETS
from eskin.rtl.fpga.targets import target
from eskin.rtl.fpga.wiring import Wiring
from eskin.training.made_up import random_recordings
from eskin.verbs import defence_cost

PVDF = PRESETS["pvdf"]
DEFENDED = PVDF.replace(fault_frames=64, fault_activity=30, onset_hits=3, onset_span=4, margin_threshold=18)
COSTS = ("logic_cells", "bram", "frame_cycles", "step_cycles", "decision_cycles")


def test_a_board_has_a_pin_for_unsure_decisions_where_there_is_a_threshold():
    board, pins = target("icebreaker"), {}
    for config in (PVDF, DEFENDED):
        pins[bool(config.network.margin_threshold)] = Wiring(config=config, target=board, link=True).sites()
    assert set(pins[True]) - set(pins[False]) == {"unsure"} and len(set(pins[True].values())) == len(
        pins[True]
    )


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_defences_cost_cells_and_no_cycles(tmp_path):
    recordings = random_recordings(PVDF, (3000, 200, 3000, 3000, 10), 1)
    plain, defended = (
        defence_cost.hardware_cost(config, recordings, cache=tmp_path) for config in (PVDF, DEFENDED)
    )
    assert plain["bit_exact"] and defended["bit_exact"]
    assert plain["logic_cells"] < defended["logic_cells"] < plain["logic_cells"] + 150
    assert defended["bram"] == plain["bram"] + 1
    assert np.array_equal(
        [plain[key] for key in COSTS if "cycles" in key], [defended[key] for key in COSTS if "cycles" in key]
    )
