"""Netlists under the bench of the generated Verilog: exact on every family; counters of what changes in them."""

import subprocess
from itertools import pairwise
from pathlib import Path

import pytest

from eskin.cosim import flow, runner
from eskin.cosim.activity import instrument, read_count
from eskin.cosim.netlist import Hardware, netlist_hardware
from eskin.cosim.simulation import Simulation
from eskin.golden.core import FEATURE_KINDS
from eskin.golden.model import IntegerModel, run, write_vectors
from eskin.rtl.fpga.generate import generate
from eskin.training.formats import with_network
from eskin.training.made_up import random_recordings
from eskin.verbs.cosim import netlist_of
from tests.support.random_models import random_integer_model
from tests.support.small_designs import SMALL

BUILDS = Path("build/simulators")
CONFIG = SMALL.replace(
    hop=8,
    window=17,
    touch_frames=40,
    steps=3,
    pretrigger_frames=4,
    rearm_frames=16,
    lanes=1,
    table_entries=64,
)
FRAMES = 70


@pytest.fixture
def model(request) -> IntegerModel:
    return random_integer_model(getattr(request, "param", CONFIG), 5)


@pytest.fixture
def recordings(model):
    return random_recordings(model.config, [FRAMES], seed=4)


@pytest.fixture
def play(model, recordings, tmp_path):
    """``play(hardware, **options)``: the shared design and vectors on ``hardware``."""
    trace = run(model, recordings)
    assert trace.touches.completed.sum() >= 3
    vectors = write_vectors(tmp_path / "vectors.npz", trace, recordings, [9])
    design = generate(model.config, model.arrays, tmp_path / "design")

    def call(hardware: Hardware, simulator: str = "icarus", **options):
        how = Simulation(simulator=simulator, hardware=hardware, **options)
        return flow.cosim(design, vectors, how, work=tmp_path / "work")

    return call


LINEAR = with_network(CONFIG, cell="linear")
TREES = with_network(CONFIG, cell="trees").replace(trees=3, nodes=20, depth=4, lane_type="dsp")
"""Its nodes are in large memories."""


@pytest.mark.parametrize(
    "model, target, cell",
    [
        (LINEAR, "icebreaker", "SB_MAC16"),
        pytest.param(TREES, "icebreaker", "SB_SPRAM256KA", marks=pytest.mark.slow),
        pytest.param(CONFIG, "ulx3s", "MULT18X18D", marks=pytest.mark.slow),
        pytest.param(CONFIG, "tangnano9k", "MULT", marks=pytest.mark.slow),
    ],
    ids=["linear", "trees", "ecp5", "gowin"],
    indirect=["model"],
)
def test_the_netlist_is_exact(model, play, target, cell):
    hardware, cells = netlist_of(model.config, model.arrays, target)
    assert any(name.startswith(cell) and count for name, count in cells.items())
    result = play(hardware)
    assert result.mismatch_list == [] and result.bit_exact
    assert (result.level, result.target) == ("netlist", target)
    assert all(stage.compared_values for name, stage in result.stages.items() if name != "state")


SPARED = {
    "20 classes, weights a window": dict(
        cell="linear", decision="last", class_names=tuple(f"c{k}" for k in range(20))
    ),
    "asked for": dict(spare_blocks=True, checksum=True),
    "all kinds": dict(feature_kinds=FEATURE_KINDS, activity_rule="change", integral_knee=4),
}
"""Designs that an iCE40 UP5K is spared block memories for."""


@pytest.mark.slow
@pytest.mark.parametrize("name", SPARED)
def test_weights_in_large_memories_are_exact(recordings, tmp_path, name):
    """Two models one after the other: the host's writes and the engine's reads share the large memories' only
    port."""
    config = CONFIG.replace(**SPARED[name], lanes=4, lane_type="dsp")
    for seed in (5, 6):
        model = random_integer_model(config, seed)
        hardware, cells = netlist_of(model.config, model.arrays, "icebreaker")
        assert cells["SB_SPRAM256KA"] == 4
        trace = run(model, recordings)
        vectors = write_vectors(tmp_path / f"{seed}.npz", trace, recordings, [9])
        design = generate(model.config, model.arrays, tmp_path / f"design{seed}")
        how = Simulation(simulator="icarus", hardware=hardware)
        result = flow.cosim(design, vectors, how, work=tmp_path / "work")
        assert result.bit_exact and result.steps >= 3, result.mismatch_list


# ---------------------------------------------------------------- activity counters
NETLIST = r"""
module accelerator(clk, d, q);
  input clk;
  input [1:0] d;
  output [1:0] q;
  wire busy = 1;
  SB_DFFE \engine.a  (
    .C(clk),
    .D(d[0]),
    .E(1'h1),
    .Q(q[0])
  );
  SB_DFF \front_end.b  (
    .C(clk),
    .D(d[1]),
    .Q(q[1])
  );
  SB_MAC16 #(
    .A_REG(1'h0)
  ) \engine.product  (
    .A({ d, 14'h0000 }),
    .B(16'h0003),
    .CLK(clk)
  );
  SB_RAM40_4K #(
    .READ_MODE(32'd0)
  ) \engine.weights  (
    .RCLKE(1'h1),
    .RE(d[0])
  );
  SB_SPRAM256KA \engine.maps  (
    .ADDRESS({ d, 12'h000 }),
    .CHIPSELECT(d[1]),
    .CLOCK(clk)
  );
endmodule
"""


CLOCKS = 40
DRIVER = f"""
`timescale 1ns / 1ps
module wrapper;
  reg measured = 1;
  integer step;
  reg clk = 0;
  reg [1:0] d = 0;
  wire [1:0] q;
  accelerator dut (.clk(clk), .d(d), .q(q));
  initial begin
    for (step = 0; step < {CLOCKS}; step = step + 1) begin #5 clk = 1; #5 clk = 0; d = 2'((step * step) >> 1); end
    $finish;
  end
endmodule
"""


@pytest.mark.slow
def test_counters_count_what_changes(tmp_path):
    """Two registers and a multiplier beside memories, driven with a known sequence; counted by hand here."""
    (tmp_path / "counted.v").write_text(instrument(NETLIST, lambda name: name.split(".")[0]))
    (tmp_path / "driver.sv").write_text(DRIVER)
    verilator, environment = runner.verilator_command()
    models = netlist_hardware(tmp_path / "counted.v", "ice40", "made")
    command = [
        verilator,
        "--binary",
        "--timing",
        "-Wno-fatal",
        "-Wno-lint",
        "--top-module",
        "wrapper",
        *models.options,
        "driver.sv",
    ]
    built = subprocess.run(
        [*command, *models.sources],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert built.returncode == 0, built.stderr[-2000:]
    subprocess.run([tmp_path / "obj_dir" / "Vwrapper"], cwd=tmp_path, check=True, timeout=600)
    driven = [0] + [(step * step >> 1) & 3 for step in range(CLOCKS)]  # d at each rising edge
    at_edges = [0, 0, *driven][: CLOCKS + 1]  # q at each rising edge, and before the first
    toggles = [sum((before ^ after) >> bit & 1 for before, after in pairwise(at_edges)) for bit in (0, 1)]
    # operand b is not 0 at the first edge
    changes = 1 + sum(before != after for before, after in pairwise(driven[:CLOCKS]))
    count = read_count(tmp_path)
    assert count == {
        "cycles": CLOCKS,
        "busy": CLOCKS,
        "toggles": {"engine": toggles[0], "front_end": toggles[1]},
        "multiplies": changes,
    }
