"""The exported Verilog: the same text every time, free of what the simulators stumble over."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest
from amaranth.back import rtlil

from eskin.golden.core.config import PRESETS, AcceleratorConfig
from eskin.golden.model.model import random_integer_model
from eskin.rtl.fpga.export import export
from eskin.rtl.fpga.tools import ToolError, run_tool
from eskin.rtl.frontend import front_end
from eskin.rtl.top.image_accelerator import make_accelerator
from tests.test_matrix import KINDS, TOUCHES

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
        timeout=120,
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


def test_kinds_of_feature_that_are_off_leave_no_trace(monkeypatch):
    """The Verilog of the mean alone is that of a configuration written before there were other kinds,
    whatever their fields hold."""
    config = PRESETS["thesis"].replace(hidden=4, feature_shift=(5, 4))
    untold = config.to_dict()
    for field in (
        "feature_kinds",
        "activity_rule",
        "activity_block",
        "integral_knee",
        "integral_frac",
        "feature_scale",
    ):
        del untold["features"][field]
    told = config.replace(activity_rule="change", activity_block=64, integral_knee=3, integral_frac=5)
    shifts = config.features.feature_shift * 2
    both = config.replace(feature_kinds=("mean", "integral"), feature_shift=shifts)
    assert "feature_expander" in rtlil.convert(make_accelerator(both), name="both", emit_src=False)

    def never(config):
        raise AssertionError("an expander is made")

    monkeypatch.setattr(front_end, "FeatureExpander", never)
    configs = (AcceleratorConfig.from_dict(untold), config, told)
    designs = {rtlil.convert(make_accelerator(one), name="top", emit_src=False) for one in configs}
    assert len(designs) == 1


BLOCKS = (
    "classifier.search",
    "control.state",
    "engine.addends",
    "engine.narrowing",
    "front_end.onset_detector.sums",
)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("fault", ["", "search"])
def test_the_text_is_the_design_proved_block_by_block(fault, tmp_path):
    """Yosys' induction over signals of the same name: blocks as Amaranth gives them against those of the text."""
    config = random_integer_model(TOUCHES.replace(**KINDS["linear"]), 1).config
    (tmp_path / "gold.il").write_text(
        rtlil.convert(make_accelerator(config), name="accelerator", emit_src=False)
    )
    text = export(config)
    if fault:  # one operator of one block
        block = text.index("module \\accelerator.classifier.search")
        text = text[:block] + text[block:].replace(" > ", " >= ", 1)
    (tmp_path / "gate.sv").write_text(text)
    for block in [name for name in BLOCKS if not fault or name.endswith(fault)]:
        script = []
        for side, read in (("gold", "read_rtlil gold.il"), ("gate", "read_verilog -sv gate.sv")):
            script += ["design -reset", read, f"hierarchy -top accelerator.{block}", "proc", "opt_expr"]
            script += ["memory_collect", "memory_map", "rename -hide w:_*_", "opt_clean"]
            script += [f"rename accelerator.{block} {side}", f"design -stash {side}"]
        script += [
            *(f"design -copy-from {side} {side}" for side in ("gold", "gate")),
            "equiv_make gold gate both",
        ]
        script += ["hierarchy -top both", "opt_clean", "equiv_struct", "equiv_simple -undef"]
        script += ["equiv_induct -undef", "equiv_status -assert", "select -assert-min 10 t:$equiv"]
        (tmp_path / "prove.ys").write_text("\n".join(["design -reset", *script, ""]))
        if fault:
            with pytest.raises(ToolError, match="unproven"):
                run_tool("yosys", ["-q", "prove.ys"], tmp_path)
        else:
            run_tool("yosys", ["-q", "prove.ys"], tmp_path)
