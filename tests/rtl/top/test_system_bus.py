"""rtl/top/system.py: the generated Verilog under the masters of cocotbext."""

import json
from pathlib import Path

import numpy as np
import pytest
from cocotb_tools.runner import get_results, get_runner

from eskin.cosim import runner
from eskin.cosim.flow import converter_model
from eskin.golden.core import PRESETS
from eskin.golden.data import Recordings
from eskin.golden.model import run, through_converter
from eskin.golden.model.decision_word import decision_word
from eskin.rtl.fpga.export import verilog
from eskin.rtl.program.memory_map import memory_images
from eskin.rtl.top.system import System
from eskin.training.made_up import random_recordings
from eskin.verbs.cosim import BUILD
from scripts.coverage import CONVERTERS
from tests.cosim.test_converters import ARRAYS, RANDOM, array_case
from tests.cosim.test_converters import CONFIG as SENSED
from tests.support.covered import note
from tests.support.random_models import random_integer_model

BOARD = Path(__file__).parents[2] / "support" / "bus_board.sv"
CONFIG = random_integer_model(
    PRESETS["thesis"].replace(taxels=5, feature_shift=(), hidden=4, lanes=1), 1
).config


@pytest.mark.parametrize("bus", ["axi4lite", pytest.param("wishbone", marks=pytest.mark.slow)])
def test_masters_of_others_read_and_write(bus, tmp_path):
    (tmp_path / "design.sv").write_text(verilog(System(CONFIG, host=bus), "design"))
    icarus = get_runner("icarus")
    icarus.build(
        sources=[tmp_path / "design.sv"],
        hdl_toplevel="design",
        build_dir=tmp_path,
        build_args=["-g2012"],
        timescale=("1ns", "1ps"),
    )
    results = icarus.test(
        test_module="tests.support.bus_cocotb",
        hdl_toplevel="design",
        build_dir=tmp_path,
        extra_env=runner.BENCH_ENVIRONMENT
        | {"ESKIN_BUS": bus, "ESKIN_TAXELS": "5", "PYTHONPATH": str(Path(__file__).resolve().parents[3])},
    )
    assert get_results(results) == (1, 0)
    note("converter and bus", "none", bus)


@pytest.mark.slow
@pytest.mark.parametrize("bus", ["axi4lite", "wishbone"])
@pytest.mark.parametrize("chip", ["ads7953", *CONVERTERS])
def test_a_cpu_reads_the_decisions_of_a_converters_frames(chip, bus, tmp_path):
    """The words of all decisions, in order, from the converter's pins on."""
    if chip in ARRAYS:
        config, made = array_case(chip)
        samples = made.recording(0)
        rest = samples[:1]
    else:
        config = SENSED.replace(**RANDOM[chip])
        samples = random_recordings(config, (300,), seed=4).samples
        rule, taxels = config.onset_rule, config.sensor.taxels
        rest = np.full((1, taxels), (rule.band_low + rule.band_high) // 2, samples.dtype)
    model = random_integer_model(config.replace(loadable=False), 5)
    config = model.config
    # nobody touches at the beginning and at the end
    samples = np.concatenate([*[rest] * 30, samples, *[rest] * 20])
    made = Recordings(samples, np.array([0, len(samples)]), np.array([0]), ("any",), 1.0)
    recordings, codes = through_converter(made, config)
    rows = run(model, recordings).streams["decision"][0]
    expected = [decision_word(config, row) for row in rows if not row[4]]  # nobody ends the recording
    design = verilog(System(config, memory_images(config, model.arrays), host=bus), "accelerator")
    (tmp_path / "accelerator.v").write_text(design)
    models, options = converter_model(config)
    built = runner.build(
        "verilator",
        [tmp_path / "accelerator.v", *models],
        {"BEATS": codes.shape[1], "CLASSES": config.classes},
        BUILD / "simulators",
        options=options,
        wrapper=BOARD,
        top=BOARD.stem,
    )
    np.save(tmp_path / "codes.npy", codes)
    period = round(config.hardware.clock_hz / config.sensor.scan_rate_hz)
    (tmp_path / "board.json").write_text(json.dumps({"bus": bus, "period": period}))
    runner.run(built, tmp_path, limit_s=900, bench="tests.support.bus_bench")
    result = json.loads((tmp_path / "result.json").read_text())
    assert len(expected) > 3 and result == {"words": expected, "faults": 0, "violations": 0}
    note("converter and bus", config.interface.converter.name, bus)
