"""Every cell on every number of lanes, three sizes, on recorded streams: bit-exact, and the cycles of its
program."""

from __future__ import annotations

from pathlib import Path

import pytest

from eskin.golden.core.config import PRESETS
from eskin.golden.data.load import load_recordings
from eskin.golden.model.model import random_integer_model, with_network
from eskin.rtl.program.schedule import schedule
from eskin.verbs.flow import cosimulate

BUILDS = Path(__file__).resolve().parents[3] / "build" / "simulators"
CELLS = [("gru", "before"), ("gru", "after"), ("lstm", "before")]
SIZES = [("pvdf", 8, 5), ("fabric", 12, 3), ("fabric", 20, 7)]
"""(preset and its recordings: 8 or 16 taxels, hidden, classes)"""


def simulate(shared_data, tmp_path, preset, hidden, classes, cell, reset, count, **hardware):
    """Co-simulate ``count`` recordings on a random model; returns (result, its configuration)."""
    folder = {"pvdf": "pvdf_indent", "fabric": "fabric_slide"}[preset]
    recordings = load_recordings(shared_data / folder / "recordings.npz")
    recordings = recordings.subset(
        [k for k in recordings.evenly(count * 3) if recordings.labels[k] < classes][:count]
    )
    names = PRESETS[preset].network.class_names[:classes]
    config = with_network(
        PRESETS[preset].replace(class_names=names, **hardware), cell=cell, reset=reset, hidden=hidden
    )
    model = random_integer_model(config, seed=hidden + classes)
    return cosimulate(model, recordings, work=tmp_path, builds=BUILDS), model.config


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("lanes", [1, 2, 4, 6, 12])
@pytest.mark.parametrize(("preset", "hidden", "classes"), SIZES)
@pytest.mark.parametrize(("cell", "reset"), CELLS)
def test_bit_exact_with_the_programs_cycles(
    shared_data, tmp_path, cell, reset, preset, hidden, classes, lanes
):
    result, config = simulate(shared_data, tmp_path, preset, hidden, classes, cell, reset, 4, lanes=lanes)
    assert result["recordings"] == 4 and result["bit_exact"] and result["mismatches"] == 0, result[
        "mismatch_list"
    ]
    plan = schedule(config)
    assert result["cycles"]["step_min"] == result["cycles"]["step_max"] == plan.step_cycles


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize(("preset", "hidden", "classes"), SIZES)
@pytest.mark.parametrize(("cell", "reset"), CELLS)
def test_one_serial_lane_is_bit_exact_with_its_programs_cycles(
    shared_data, tmp_path, cell, reset, preset, hidden, classes
):
    result, config = simulate(
        shared_data, tmp_path, preset, hidden, classes, cell, reset, 2, lanes=1, lane_type="serial"
    )
    assert result["recordings"] == 2 and result["bit_exact"] and result["mismatches"] == 0, result[
        "mismatch_list"
    ]
    plan = schedule(config)
    assert result["cycles"]["step_min"] == result["cycles"]["step_max"] == plan.step_cycles


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize(("lanes", "lane_types"), [(1, ("plain", "dsp", "serial")), (4, ("plain", "dsp"))])
def test_every_lane_type_gives_the_same_outputs(shared_data, tmp_path, lanes, lane_types):
    """All lane types equal the golden trace of the same model on 5 recordings, so they equal each other."""
    for lane_type in lane_types:
        result, config = simulate(
            shared_data,
            tmp_path / lane_type,
            "fabric",
            12,
            3,
            "gru",
            "before",
            5,
            lanes=lanes,
            lane_type=lane_type,
        )
        assert result["recordings"] == 5 and result["bit_exact"], result["mismatch_list"]
        assert result["cycles"]["step_min"] == result["cycles"]["step_max"] == schedule(config).step_cycles
