"""rtl/top/system.py: the generated Verilog under the masters of cocotbext."""

from pathlib import Path

import pytest
from cocotb_tools.runner import get_results, get_runner

from eskin.golden.core import PRESETS
from eskin.rtl.fpga.export import verilog
from eskin.rtl.top.system import System
from tests.support.covered import note
from tests.support.random_models import random_integer_model

CONFIG = random_integer_model(
    PRESETS["thesis"].replace(taxels=5, feature_shift=(), hidden=4, lanes=1), 1
).config


@pytest.mark.parametrize("bus", ["axi4lite", pytest.param("wishbone", marks=pytest.mark.slow)])
def test_masters_of_others_read_and_write(bus, tmp_path):
    (tmp_path / "design.sv").write_text(verilog(System(CONFIG, host=bus), "design"))
    runner = get_runner("icarus")
    runner.build(
        sources=[tmp_path / "design.sv"],
        hdl_toplevel="design",
        build_dir=tmp_path,
        build_args=["-g2012"],
        timescale=("1ns", "1ps"),
    )
    results = runner.test(
        test_module="tests.support.bus_cocotb",
        hdl_toplevel="design",
        build_dir=tmp_path,
        extra_env={
            "ESKIN_BUS": bus,
            "ESKIN_TAXELS": "5",
            "PYTHONPATH": str(Path(__file__).resolve().parents[3]),
        },
    )
    assert get_results(results) == (1, 0)
    note("converter and bus", "none", bus)
