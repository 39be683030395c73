"""Windows that follow the touch: hardware against golden at every stage, touches of every end, all kinds of feature.
tests/test_covering.py has one taxel, one window, extremes alone and a fault detector."""

import pytest

from eskin.cosim.simulation import Simulation
from eskin.golden.core import FEATURE_KINDS
from eskin.rtl.program.schedule import decision_cycles
from eskin.training.made_up import random_recordings
from eskin.verbs.cosim import cosimulate
from tests.support.small_designs import TRACKED
from tests.support.strategies import Design, differences

BASE = TRACKED.replace(
    window_mode="whole",
    feature_kinds=("mean",),
    hop=3,
    window=6,
    steps=4,
    store_per_window=4,
    touch_frames=200,
    rearm_frames=9,
)
DESIGNS = {
    "linear, ended by its longest touch": {
        "cell": "linear",
        "checksum": True,
        "decision": "last",
        "steps": 5,
        "store_per_window": 6,
        "touch_frames": 65,
    },
    "all kinds, changes": {
        "feature_kinds": FEATURE_KINDS,
        "activity_rule": "change",
        "activity_block": 3,
        "steps": 5,
        "store_per_window": 2,
        "feature_scale": "taxel",
        "fault_frames": 4,
    },
    # its companded value is wider than any sum that is stored
    "an integral of few codes": {
        "feature_kinds": ("integral",),
        "clip": 7,
        "integral_knee": 0,
        "touch_frames": 18,
    },
}


@pytest.mark.parametrize("title", DESIGNS)
def test_every_stage_is_golden(tmp_path, title):
    assert not differences(Design(BASE.replace(**DESIGNS[title]), 7, True), tmp_path)


def test_latency_counts_from_finish_where_that_ends_the_touch(tmp_path):
    """Up to the last decision; from the schedule the most."""
    model = Design(
        BASE.replace(**DESIGNS["all kinds, changes"], onset="immediate", rest="initial"), 7, False
    ).model
    recordings, planned = random_recordings(model.config, [150, 90], 7), decision_cycles(model.config)
    played = cosimulate(model, recordings, Simulation(simulator="icarus"), work=tmp_path)
    assert planned / 2 < played.cycles.decision_latency_max <= planned, (played.cycles, planned)
