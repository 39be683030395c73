"""The stopped clock: streams and decisions as without it, at the sensor's pace; a gate that stops too much is
seen."""

import pytest

from eskin.cosim import flow
from eskin.cosim.netlist import Hardware
from eskin.data import load_recordings
from eskin.golden.core import PRESETS, InputError
from eskin.golden.model import write_vectors
from eskin.rtl.fpga.generate import generate
from eskin.training.made_up import random_integer_model
from eskin.verbs.flow import cosimulate
from tests.rtl.fpga.test_netlist import BUILDS
from tests.support.traffic_case import CONFIG, Case

GATED = {"clock_gate": True, "one_port": True}
CYCLES = 60
"""Clock cycles of a frame: the clock stops between frames, and a step takes several of them."""


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A small gated design with its vectors: (case, folder)."""
    case, folder = Case(CONFIG.replace(**GATED)), tmp_path_factory.mktemp("gate")
    generate(case.config, case.model.arrays, folder / "design")
    write_vectors(folder / "vectors.npz", case.trace, case.recordings)
    return case, folder


def play(case, folder, name: str, old: str = "", new: str = ""):
    verilog = (folder / "design" / "accelerator.sv").read_text()
    assert old in verilog
    source = folder / f"{name}.sv"
    source.write_text(verilog.replace(old, new, 1) if old else verilog)
    return flow.cosim(
        folder / "design",
        folder / "vectors.npz",
        simulator="icarus",
        pace="declared",
        clock_hz=CYCLES * case.config.sensor.sample_rate_hz,
        hardware=Hardware((source,)),
        waves=False,
        work=folder / name,
        builds=BUILDS,
    )


@pytest.mark.timeout(1800)
def test_bit_exact_with_the_clock_stopped_between_frames(case):
    result = play(*case, "gated")
    assert result["bit_exact"] and result["compared_values"] > 100, result["mismatch_list"]
    assert result["registers"]["FAULTS"] == 0


@pytest.mark.timeout(1800)
def test_a_gate_that_stops_a_chain_at_work_is_seen(case):
    text = (case[1] / "design" / "accelerator.sv").read_text()
    line = next(line for line in text.splitlines() if line.startswith("  assign needed ="))
    result = play(*case, "asleep", line, "  assign needed = rst | i__valid | bus__w_stb | bus__r_stb;")
    assert not result["bit_exact"]


def test_not_with_lanes_of_an_fpga():
    with pytest.raises(InputError, match="clock_gate.*lane_type"):
        CONFIG.replace(clock_gate=True, lane_type="dsp")


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_twenty_recordings_and_how_often_the_clock_runs(shared_data, tmp_path):
    recordings = load_recordings(shared_data / "pvdf_indent" / "recordings.npz")
    recordings = recordings.subset(recordings.evenly(20))
    model = random_integer_model(PRESETS["pvdf"].replace(lanes=4, **GATED), 3)
    result = cosimulate(model, recordings, work=tmp_path, builds=BUILDS, pace="declared", clock_hz=786e3)
    share = 100 * result["clocked_share"]
    print(
        f"{result['compared_values']} values, {result['mismatches']} mismatches, {share:.1f} % of cycles "
        "have an edge"
    )
    assert result["bit_exact"] and result["recordings"] == 20 and result["passed"]
    assert 0.03 < result["clocked_share"] < 0.06
