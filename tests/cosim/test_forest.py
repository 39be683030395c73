"""Trees: hardware against golden at every stage, in both simulators."""

import pytest

from eskin.cosim.simulation import Simulation
from eskin.training.made_up import random_recordings
from eskin.verbs.cosim import cosimulate
from tests.support.random_models import random_integer_model
from tests.support.small_designs import TRACKED
from tests.support.strategies import Design, differences

BASE = TRACKED.replace(cell="trees", decision="last", trees=3, nodes=20, depth=4, lanes=1)
FOLLOWING = {"window_mode": "whole", "touch_frames": 48, "store_per_window": 2, "steps": 3}
DEFENCES = dict(checksum=True, watchdog=True, fault_frames=16, feature_kinds=("mean", "activity"))


def test_every_stage_is_golden_with_defences_and_two_kinds(tmp_path):
    assert not differences(Design(BASE.replace(**DEFENCES), 4, True), tmp_path)


@pytest.mark.slow
def test_the_other_simulator_too(tmp_path):
    model = random_integer_model(BASE.replace(**FOLLOWING, feature_scale="taxel"), 9)
    recordings = random_recordings(model.config, (200, 90), 9)
    result = cosimulate(model, recordings, Simulation(), work=tmp_path)
    assert result.bit_exact and result.steps >= 6 and result.simulator == "verilator"
