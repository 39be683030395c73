"""The stopped clock: streams and decisions as without it, at the sensor's pace. That no edge is missing is proved in
formal/top/clock_gate.py."""

from eskin.cosim import flow
from eskin.cosim.simulation import Simulation
from eskin.golden.model import write_vectors
from eskin.rtl.fpga.generate import generate
from tests.support.traffic_case import CONFIG, Case

GATED = {"clock_gate": True, "one_port": True}
CYCLES = 60
"""Clock cycles of a frame: the clock stops between frames, and a step takes several of them."""


def test_bit_exact_with_the_clock_stopped(tmp_path):
    case = Case(CONFIG.replace(**GATED))
    generate(case.config, case.model.arrays, tmp_path / "design")
    write_vectors(tmp_path / "vectors.npz", case.trace, case.recordings)
    result = flow.cosim(
        tmp_path / "design",
        tmp_path / "vectors.npz",
        Simulation(
            simulator="icarus",
            pace="declared",
            clock_hz=CYCLES * case.config.sensor.sample_rate_hz,
            waves=False,
        ),
        work=tmp_path / "gated",
    )
    assert result.bit_exact and result.compared_values > 100, result.mismatch_list
    assert result.registers["FAULTS"] == 0
