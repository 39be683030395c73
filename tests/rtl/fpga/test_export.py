"""The exported Verilog: the same text every time, free of what the simulators stumble over."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from eskin.golden.core import PRESETS
from eskin.rtl.fpga.export import TOP, export, rom, verilog
from eskin.rtl.fpga.tools import ToolError
from eskin.rtl.top.bus_top import BusTop
from eskin.rtl.top.image_accelerator import make_accelerator
from eskin.rtl.top.sensing import Sensing
from tests.rtl.fpga.test_other_tools import DESIGNS, model_of
from tests.support.text_proof import prove

ROOT = Path(__file__).resolve().parents[3]


def test_text_is_deterministic_portable_and_complete():
    config = PRESETS["pvdf"].replace(feature_shift=(3,), hidden=4)
    text = export(config)
    script = (
        "from eskin.golden.core.config import PRESETS; from eskin.rtl.fpga.export import export; import "
        "hashlib;"
        "print(hashlib.sha256(export(PRESETS['pvdf'].replace(feature_shift=(3,), "
        "hidden=4)).encode()).hexdigest())"
    )
    other = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT,
        env={**os.environ, "PYTHONHASHSEED": "77"},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert other.stdout.strip() == hashlib.sha256(text.encode()).hexdigest(), other.stderr
    assert "always @*" not in text and "always @(*)" not in text, (
        "always @* misses its time-zero event in Icarus"
    )
    assert str(ROOT) not in text and "/src" not in text, "no path of the machine that generated it"
    for port in (
        "i__payload",
        "i__valid",
        "i__ready",
        "o__payload",
        "bus__addr",
        "busy",
        "probe__state__value",
        "clk",
        "rst",
    ):
        assert port in text


def exported(design) -> tuple[Any, str, str]:
    """Component, module and text of one of `DESIGNS`."""
    kind, system = DESIGNS[design]
    model = model_of(kind)
    config, arrays = model.config, model.arrays
    images = rom(config, arrays)
    if system:
        component: Any = BusTop(config, images, **{"bus": None, **system})
    elif config.interface.converter.name != "none":
        component = Sensing(config, images)
    else:
        component = make_accelerator(config, images)
    return component, TOP, verilog(component, TOP)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("design", [name for name in DESIGNS if name != "thesis"])
def test_the_text_is_the_design_proved_block_by_block(design, tmp_path):
    """All blocks of each kind of design; those of thesis differ in the sizes of their memories."""
    assert prove(*exported(design), tmp_path) > 15


@pytest.mark.slow
@pytest.mark.parametrize(
    ("block", "old", "new", "said"),
    [
        ("classifier.search", "margin + above", "margin - above", "unproven"),
        ("engine.lane_0", " * ", " + ", "unproven"),
        ("accelerator", ".frames__offered(i__valid)", ".frames__offered(frames__taken)", "unproven"),
        ("control.state", "= 1'h0;", "= 1'h1;", "begins otherwise"),
    ],
    ids=["operator", "product", "instance", "initial value"],
)
def test_a_text_that_is_not_the_design_is_found(block, old, new, said, tmp_path):
    component, top, text = exported("linear")
    begin = text.index(f"module \\{top}.{block} " if block != top else f"module {top}(")
    faulty = text[:begin] + text[begin:].replace(old, new, 1)
    assert faulty != text
    with pytest.raises((ToolError, AssertionError), match=said):
        prove(component, top, faulty, tmp_path, only=block)
