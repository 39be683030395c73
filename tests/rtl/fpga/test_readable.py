"""rtl/fpga/readable.py: what the text says stays the same (every co-simulation plays it), and few of its
names are anonymous."""

import re

import pytest
from amaranth.back import rtlil

from eskin.golden.core import PRESETS
from eskin.rtl.decision.classifier import Classifier
from eskin.rtl.fpga.export import export, verilog
from eskin.rtl.fpga.readable import ports_named, readable
from eskin.rtl.fpga.tools import run_tool
from eskin.rtl.frontend.pretrigger_ring import PreTriggerRing
from eskin.rtl.host.recording_state import RecordingState
from tests.support.random_models import random_integer_model
from tests.support.small_designs import SMALL

MODULE = """module top(a, b, s, o);
  wire [3:0] _0_;
  wire [4:0] _1_;
  wire _2_;
  wire _3_;
  wire [3:0] _4_;
  wire [3:0] _5_;
  input [3:0] a;
  input [3:0] b;
  input signed [3:0] s;
  output [8:0] o;
  assign _0_ = a & b;
  assign _1_ = a + b;
  assign _2_ = a == 4'h3;
  assign _3_ = ~ _2_;
  assign _4_ = s | a;
  assign _5_ = a ^ b;
  assign o = { _0_, _1_ } + (_3_ ? _4_ : _5_[2:1]);
endmodule
"""


def test_only_what_has_the_wires_own_width_stands_where_it_is_used():
    """A sum keeps its carry, a signed operand stands in braces, and of a part the whole stays."""
    text = readable(MODULE)
    assert "assign o = { (a & b), a_sum } + ({~ (a == 4'h3)} ? {s | a} : of_a[2:1]);" in text
    assert "assign a_sum = a + b;" in text and "assign of_a = a ^ b;" in text
    assert not re.search(r"\b_\d+_\b", text)


def test_a_port_is_called_as_what_is_wired_to_it():
    cell = "  cell \\inner \\inner\n    connect \\port$7$0 \\i__valid\n    connect \\port$7$1 \\word [4:2]\n  end\n"
    named = ports_named(f"{cell}  wire width 3 input 1 \\port$7$1\n  wire \\i__valid\n")
    assert "connect \\i__valid_2 \\i__valid\n" in named and "wire width 3 input 1 \\word_4_2\n" in named


def test_at_most_a_tenth_of_the_names_is_anonymous():
    text = export(random_integer_model(PRESETS["pvdf"], 1).config)
    names = re.findall(r"^ *(?:wire|reg)\b[^;=]*?(\\\S+|\b\w+) ?;$", text, re.MULTILINE)
    anonymous = [name for name in names if re.fullmatch(r"_\d+_|\\port\$.*", name)]
    assert len(names) > 500 and len(anonymous) <= 0.1 * len(names)


FLAT = "hierarchy -top top; proc; flatten; memory_map; setundef -undriven -zero; setundef -zero; opt_clean"
EQUAL = f"""read_rtlil top.il; {FLAT}; rename top given; design -stash given
read_verilog -sv top.sv; {FLAT}; rename top made; design -stash made
design -copy-from given given; design -copy-from made made; equiv_make given made both
hierarchy -top both; equiv_simple; equiv_induct -seq 4; equiv_status -assert"""


@pytest.mark.parametrize("block", [Classifier, PreTriggerRing, RecordingState])
def test_the_text_is_equivalent_to_the_design(block, tmp_path):
    config = random_integer_model(SMALL, 5).config
    (tmp_path / "top.il").write_text(rtlil.convert(block(config), name="top", emit_src=False))
    (tmp_path / "top.sv").write_text(verilog(block(config), "top"))
    (tmp_path / "equal.ys").write_text(EQUAL.replace("; ", "\n"))
    run_tool("yosys", ["-q", "equal.ys"], tmp_path)
