"""The only place that turns the design into Verilog."""

import re
import tempfile
from pathlib import Path

from amaranth.back import rtlil
from amaranth.lib import wiring

from eskin.golden.core import AcceleratorConfig, Arrays
from eskin.rtl.common import without_contents
from eskin.rtl.fpga.readable import ports_named, readable
from eskin.rtl.fpga.tools import run_tool
from eskin.rtl.program.memory_map import Images, memory_images
from eskin.rtl.top.accelerator import Accelerator

TOP = "accelerator"


def export(config: AcceleratorConfig, arrays: Arrays | None = None, name: str = TOP) -> str:
    """SystemVerilog text of the accelerator, module ``name``; the same text every time.

    ``arrays`` is the integer model that goes into a ROM design (``loadable`` false); a loadable one is the
    same for every model.
    """
    return verilog(Accelerator(config, rom(config, arrays)), name)


def rom(config: AcceleratorConfig, arrays: Arrays | None) -> Images | None:
    """Memory contents of a ROM design; None where the host loads them."""
    return None if config.hardware.loadable or arrays is None else memory_images(config, arrays)


PASSES = """read_rtlil top.il
proc -norom
opt_clean
pmuxtree
opt_expr
memory_collect
splitnets -driver
techmap -map wide_logic_not.v
opt_clean -purge
write_verilog -sv -noattr top.sv
"""
"""Verilog text from RTLIL: choices between many values are trees (as ``case`` they would overlap), parts of a
signal with a driver each are signals, and values that nothing reads have no name."""

WIDE_LOGIC_NOT = Path(__file__).with_name("wide_logic_not.v")
WAIVER = Path(__file__).with_name("waiver.vlt")
"""Verilator's expected warnings, with reasons; part of the output of `eskin.rtl.fpga.generate.generate`."""


def verilog(component: wiring.Component, name: str) -> str:
    """SystemVerilog text of any design as module ``name``.

    Amaranth's own Verilog writes ``always @*`` blocks that miss their time-zero event in Icarus under -g2012,
    so a ready that is high from reset on stays X for ever. As ``always_comb`` the same blocks wake each other
    without end at time zero in a design of this size. So processes become multiplexers (``proc`` with them),
    which both simulators take; names that Yosys made are replaced (no ``-norename``), because Icarus takes a
    function called ``$...`` for a system function.

    `PASSES` and a statement for each initial value leave of a linter's warnings those that WAIVER names.
    """
    text = ports_named(rtlil.convert(component, name=name, emit_src=False))
    if "begins_as_anything" in text:
        text = without_contents(text)
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "top.il", Path(folder) / "top.sv"
        source.write_text(text)
        (Path(folder) / WIDE_LOGIC_NOT.name).write_text(WIDE_LOGIC_NOT.read_text())
        (Path(folder) / "passes.ys").write_text(PASSES)
        run_tool("yosys", ["-q", "passes.ys"], Path(folder))
        shown = readable(target.read_text().partition("\n")[2])  # without the line that names Yosys' build
    # an initial value beside processes that assign is a warning where it stands in the declaration
    return re.sub(
        r"^( *)(reg .*?(\\\S+ |\w+)) = (.*;)$", r"\1\2;\n\1initial \3 = \4", shown, flags=re.MULTILINE
    )
