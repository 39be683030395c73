"""Images through the generated Verilog: every map, logit and decision against the golden model, cycles
against the formula."""

import math

import pytest

from eskin.cosim.simulation import Simulation
from eskin.golden.core import AcceleratorConfig
from eskin.golden.core.images import SIZES, network
from eskin.golden.model import IntegerModel, run_images, write_image_vectors
from eskin.rtl.program.image_passes import plan_of
from eskin.rtl.program.memory_map import Fault
from eskin.rtl.program.schedule import decision_cycles, step_cycles
from eskin.training.made_up import image_recordings, random_images
from eskin.verbs.cosim import cosimulate
from eskin.verbs.generate import generate_design
from tests.support.generated_bench import make
from tests.support.image_scenes import random_image_model
from tests.support.link_flow import play_link

CLASSES = ("cone", "cube", "ball", "ring")
LAYERS = ["conv 5 6", "pool", "conv 3 5", "pool", "dense 4"]


def model_of(
    height, width, layers, lanes: int, lane_type: str = "plain", classes=CLASSES, **fields
) -> IntegerModel:
    config = AcceleratorConfig.of_image(height, width, layers, classes).with_lanes(lanes, lane_type)
    return random_image_model(config.replace(**fields), seed=6)  # some values of its maps saturate


@pytest.fixture(scope="module")
def small() -> IntegerModel:
    return model_of(5, 7, LAYERS, lanes=4)


DEFENDED = (5, 7, LAYERS, 4), dict(checksum=True, watchdog=True, clock_gate=True)
NETLIST = 6, 7, ["conv 3 9", "pool", "conv 3 5", "dense 4"], 8
PLAYS = {
    # what was never written is X on Icarus, so a map that is read before it is written would show
    "stalls, a refused write": ((5, 7, LAYERS, 4), {}, 4, dict(stalls=True, probe=True)),
    "defended": (*DEFENDED, 3, {}),
    "defended, declared": (*DEFENDED, 3, dict(pace="declared", clock_hz=60e3)),
    "dsp": ((5, 7, LAYERS, 4, "dsp"), {}, 2, {}),
    "dsp, stalls": ((5, 7, LAYERS, 4, "dsp"), {}, 2, dict(stalls=True)),
    "dsp, declared": ((5, 7, LAYERS, 4, "dsp"), {}, 2, dict(pace="declared", clock_hz=60e3)),
    "netlist icebreaker": ((*NETLIST, "dsp"), {}, 2, dict(level="netlist", target="icebreaker")),
    "netlist ulx3s": (NETLIST, {}, 2, dict(level="netlist", target="ulx3s")),
}
"""Sizes, layers, lanes; fields; images; options."""
NETWORKS = [("tactnet", *size, 8) for size in SIZES] + [("tactnet", 28, 50, lanes) for lanes in (1, 4, 16)]
NETWORKS += [(name, 28, 50, 8) for name in ("four", "four-lean", "tactnet-half")]
LARGE = tuple(f"class{k}" for k in range(22))
PLAYS |= {
    f"{name}, {height} x {width}, {lanes} lanes": (
        (height, width, network(name, 22), lanes, "dsp", LARGE),
        {},
        10,
        dict(simulator="verilator"),
    )
    for name, height, width, lanes in NETWORKS
}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (k > 2)) for k, n in enumerate(PLAYS)]
)
def test_every_map_is_exact(name, tmp_path):
    sizes, fields, count, options = PLAYS[name]
    model = model_of(*sizes, **fields)
    config, plan = model.config, plan_of(model.config)
    images = image_recordings(config, random_images(config, count, seed=2))
    result = cosimulate(
        model, images, Simulation(**{"simulator": "icarus"} | options), work=tmp_path / "work"
    )
    map_values = sum(math.prod(part.result) for part in plan.passes[:-1])
    # of an image a local decision and a global one, six fields each
    wanted = {"map": count * map_values, "logit": count * config.classes, "decision": 12 * count}
    assert result.bit_exact and map_values > 50, result.mismatch_list
    assert {stage: result.stages[stage].compared_values for stage in wanted} == wanted
    cycles, registers, lanes = result.cycles, result.registers, config.hardware.lanes
    assert cycles.step_min == cycles.step_max == step_cycles(config)
    if name.startswith("defended"):
        assert registers["FAULTS"] & ~Fault.INPUT_STALLED == 0
    if name == "defended":
        assert cycles.decision_latency_max == decision_cycles(config)
        assert registers["LONGEST"] == plan.logit_cycles
    large = config.classes == len(LARGE)
    if large:
        assert cycles.step_max <= (1.15 if lanes == 16 else 1.05) * plan.multiplies / lanes
    # 28 rows at 1000 Hz are over before one lane at 12 MHz has an image, as 5 before 4 lanes at 60 kHz have one
    late = name.endswith("declared") or (large and lanes == 1)
    assert result.passed != late and result.probe == ("write" in name)
    if "netlist" in name:
        cells = result.without_probes.cells
        memories = cells.get("SB_SPRAM256KA", 0), cells.get("SB_MAC16", 0)
        assert memories == ((4, 8) if "icebreaker" in name else (0, 0))


def test_the_generated_bench_passes_by_itself_and_sees_a_wrong_weight(small, tmp_path):
    folder = generate_design(small, tmp_path / "design")
    assert make(folder).returncode == 0
    boot = (folder / "load.hex").read_text().split("\n")
    (folder / "load.hex").write_text("\n".join([boot[0], f"{int(boot[1], 16) ^ 0x40:06x}", *boot[2:]]))
    done = make(folder)
    assert done.returncode and "AssertionError: stage " in done.stdout


@pytest.mark.slow
def test_images_over_the_serial_pins_of_the_board_with_damaged_packets(small, tmp_path):
    images = random_images(small.config, 4, seed=2)
    vectors = write_image_vectors(tmp_path / "vectors.npz", run_images(small, images).streams, images)
    order = [*range(4), *(k % 4 for k in range(14))]
    result = play_link(small, vectors, corruptions=True, seed=3, order=order)
    assert not result["wrong"] and result["decisions"] >= 2 * 18
    assert any(any(played["noticed"]) for played in result["played"]), "the line was damaged"
