"""The stopped clock: streams and decisions as without it, at the sensor's pace; a gate that stops too much is
seen."""

import pytest

from eskin.cosim import flow
from eskin.cosim.netlist import Hardware
from eskin.golden.model import write_vectors
from eskin.rtl.fpga.generate import generate
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
def test_bit_exact_with_the_clock_stopped(case):
    result = play(*case, "gated")
    assert result["bit_exact"] and result["compared_values"] > 100, result["mismatch_list"]
    assert result["registers"]["FAULTS"] == 0


@pytest.mark.timeout(1800)
def test_a_gate_that_stops_a_chain_at_work_is_seen(case):
    text = (case[1] / "design" / "accelerator.sv").read_text()
    line = next(line for line in text.splitlines() if line.startswith("  assign needed ="))
    result = play(*case, "asleep", line, "  assign needed = rst | frames__offered | bus__w_stb | bus__r_stb;")
    assert not result["bit_exact"]
