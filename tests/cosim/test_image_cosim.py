"""Images through the generated Verilog: every map, logit and decision against the golden model, cycles
against the formula."""

import dataclasses
import math
from pathlib import Path

import pytest
from amaranth.back import rtlil

from eskin.golden.core import PRESETS, AcceleratorConfig, InputError
from eskin.golden.core.images import SIZES, network
from eskin.golden.model import IntegerModel, run_images, write_image_vectors
from eskin.rtl.fpga.export import verilog as text_of
from eskin.rtl.fpga.generate import boot_writes, register_map
from eskin.rtl.program.image_passes import plan_of
from eskin.rtl.program.memory_map import Fault
from eskin.rtl.program.schedule import decision_cycles, step_cycles
from eskin.rtl.top.accelerator import Accelerator
from eskin.rtl.top.board import Board
from eskin.rtl.top.image_accelerator import make_accelerator
from eskin.training.made_up import image_recordings, random_images
from eskin.verbs.flow import cosimulate
from eskin.verbs.generate_job import generate_design
from tests.support.generated_bench import make
from tests.support.image_scenes import random_image_model
from tests.support.link_flow import play_link

ROOT = Path(__file__).resolve().parents[2]
CLASSES = ("cone", "cube", "ball", "ring")


def kept_values(plan) -> int:
    """Values of all maps of an image that the engine writes."""
    return sum(math.prod(one.result) for one in plan.passes[:-1])


def model_of(
    height: int, width: int, layers, lanes: int, lane_type: str = "plain", classes=CLASSES
) -> IntegerModel:
    config = AcceleratorConfig.of_image(height, width, layers, classes).with_lanes(lanes, lane_type)
    return random_image_model(config, seed=3)


@pytest.fixture(scope="module")
def small() -> IntegerModel:
    return model_of(5, 7, ["conv 5 6", "pool", "conv 3 5", "pool", "dense 4"], lanes=4)


def played(model: IntegerModel, count: int, tmp_path, **options) -> dict:
    images = image_recordings(model.config, random_images(model.config, count, seed=2))
    return cosimulate(model, images, work=tmp_path / "work", **options)


def test_every_map_with_stalls_on_four_state_icarus_while_weights_are_refused(small, tmp_path):
    """Icarus: what was never written is X, so a map that is read before it is written would show."""
    result = played(small, 4, tmp_path, simulator="icarus", stalls=True, probe=True)
    plan = plan_of(small.config)
    assert result["passed"], result["mismatch_list"]
    assert (
        result["stages"]["map"] == {"compared_values": 4 * kept_values(plan), "mismatches": 0}
        and kept_values(plan) > 50
    )
    assert result["stages"]["logit"]["compared_values"] == 4 * len(CLASSES)
    assert result["decisions"] == 2 * 4, "a local one and a global one each"
    assert result["cycles"]["step_min"] == result["cycles"]["step_max"] == step_cycles(small.config)
    assert result["probe"]["after"] & 1, "a weight write while an image comes is refused"


def test_the_generated_bench_passes_by_itself_and_sees_a_wrong_weight(small, tmp_path):
    folder = generate_design(small, tmp_path / "design")
    assert make(folder).returncode == 0
    boot = (folder / "load.hex").read_text().split("\n")
    (folder / "load.hex").write_text("\n".join([boot[0], f"{int(boot[1], 16) ^ 0x40:06x}", *boot[2:]]))
    done = make(folder)
    assert done.returncode and "AssertionError: stage " in done.stdout


DEFENDED = dict(checksum=True, watchdog=True, clock_gate=True)


@pytest.mark.parametrize("pace", ["full", "declared"])
def test_defences_and_a_stopping_clock_change_no_value_and_no_cycle(small, tmp_path, pace):
    model = dataclasses.replace(small, config=small.config.replace(**DEFENDED))
    clock = 60 * small.config.sensor.sample_rate_hz if pace == "declared" else None
    result = played(model, 3, tmp_path, simulator="icarus", pace=pace, clock_hz=clock)
    assert result["bit_exact"], result["mismatch_list"]
    assert result["registers"]["FAULTS"] & ~Fault.INPUT_STALLED == 0
    assert result["cycles"]["step_max"] == step_cycles(small.config)
    if pace == "full":
        assert result["cycles"]["decision_latency_max"] == decision_cycles(small.config)
        assert result["registers"]["LONGEST"] == plan_of(small.config).logit_cycles


REFUSED = {
    "lanes": dict(lanes=6),
    "loadable": dict(loadable=False),
    "one_port": dict(one_port=True),
    "one_phase": dict(one_phase=True),
}


@pytest.mark.parametrize("field", REFUSED)
def test_hardware_that_images_do_not_have_is_refused_in_a_sentence(small, field):
    with pytest.raises(InputError, match=f"field {field}: .*"):
        make_accelerator(small.config.replace(**REFUSED[field]))


def test_without_an_image_network_the_design_is_the_recurrent_chain_alone():
    config = PRESETS["pvdf"].replace(hidden=4, feature_shift=(3,))
    images = model_of(4, 4, ["dense 4"], lanes=1).config
    designs = (make_accelerator(config), Accelerator(config), make_accelerator(images))
    chosen, alone, other = (rtlil.convert(design, name="top", emit_src=False) for design in designs)
    assert chosen == alone and "receiver" not in alone and "receiver" in other


@pytest.mark.slow
def test_images_over_the_serial_pins_of_the_board_with_damaged_packets(small, tmp_path):
    config, images = small.config, random_images(small.config, 4, seed=2)
    vectors = write_image_vectors(tmp_path / "vectors.npz", run_images(small, images).streams, images)
    verilog = tmp_path / "board_top.sv"
    verilog.write_text(text_of(Board(config, clock_hz=12e6, baud=3e6), "board_top"))
    options = dict(
        work=tmp_path / "work",
        builds=ROOT / "build" / "simulators",
        order=[*range(4), *(k % 4 for k in range(14))],
    )
    result = play_link(
        verilog,
        config,
        register_map(config),
        boot_writes(config, small.arrays),
        vectors,
        corruptions=True,
        seed=3,
        **options,
    )
    assert not result["wrong"] and result["decisions"] >= 2 * 18
    assert any(any(played["noticed"]) for played in result["played"]), "the line was damaged"


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("target, lane_type", [("icebreaker", "dsp"), ("ulx3s", "plain")])
def test_the_netlist_is_bit_exact_in_the_part_s_own_memories(target, lane_type, tmp_path):
    model = model_of(6, 7, ["conv 3 9", "pool", "conv 3 5", "dense 4"], 8, lane_type)
    result = played(model, 2, tmp_path, level="netlist", target=target, simulator="icarus")
    cells = result["without_probes"]["cells"]
    assert result["passed"], result["mismatch_list"] + result["without_probes"]["mismatch_list"]
    if target == "icebreaker":
        assert (cells["SB_SPRAM256KA"], cells["SB_MAC16"]) == (4, 8)


NETWORKS = [("tactnet", *size, 8) for size in SIZES] + [("tactnet", 28, 50, lanes) for lanes in (1, 4, 16)]
NETWORKS += [(name, 28, 50, 8) for name in ("four", "four-lean", "tactnet-half")]


@pytest.mark.slow
@pytest.mark.parametrize("name, height, width, lanes", NETWORKS)
def test_whole_networks_on_verilator(name, height, width, lanes, tmp_path):
    classes = tuple(f"class{k}" for k in range(22))
    model = model_of(height, width, network(name, 22), lanes, "dsp", classes)
    result = played(model, 10, tmp_path)
    plan = plan_of(model.config)
    assert result["bit_exact"], result["mismatch_list"]
    assert result["stages"]["map"] == {"compared_values": 10 * kept_values(plan), "mismatches": 0}
    assert result["passed"] == (lanes > 1), (
        "28 rows at 1000 Hz are over before a single lane at 12 MHz has an image"
    )
    assert (
        result["cycles"]["step_max"]
        == step_cycles(model.config)
        <= (1.15 if lanes == 16 else 1.05) * plan.multiplies / lanes
    )
