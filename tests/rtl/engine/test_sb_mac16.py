"""The DSP lane's behaviour against the SB_MAC16 that it becomes, on the vendor's cell model."""

from __future__ import annotations

import random
import re
import tempfile
from functools import cache
from pathlib import Path

from amaranth.back import rtlil

from eskin.rtl.engine.lanes import lane_signature
from eskin.rtl.engine.sb_mac16 import ICE40, DspLane
from eskin.rtl.fpga.tools import run_tool
from tests.support.table import each_row
from tests.support.vendor_cells import run_bench

BUILD = Path(__file__).resolve().parents[3] / "build"
BUILD.mkdir(exist_ok=True)
OPERATIONS = 4000
SETTLED = 3  # operations until every register has been written
BENCH = """`timescale 1ns / 1ps
module bench;
    reg clk = 0, tick, swap, valid;
    reg [15:0] a, b;
    reg [@ACC@-1:0] load;
    wire [@ACC@-1:0] behaviour, block;
    reg [@ACC@+34:0] words [0:@LAST@];
    integer n, differences, moved;
    reg [@ACC@-1:0] kept;
    behaviour one (.clk(clk), .rst(1'b0), .tick(tick), .a(a), .b(b), .swap(swap), .load(load), .valid(valid), .acc(behaviour));
    block two (.clk(clk), .rst(1'b0), .tick(tick), .a(a), .b(b), .swap(swap), .load(load), .valid(valid), .acc(block));
    initial begin
        $readmemh("words.hex", words);
        differences = 0;
        moved = 0;
        for (n = 0; n <= @LAST@; n = n + 1) begin
            {tick, a, b, swap, load, valid} = words[n];
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


def operations(accumulates: bool, acc_bits: int) -> list[tuple[int, ...]]:
    """Random (tick, a, b, swap, load, valid), often at the ends of the formats; the one thing the schedule
    promises is kept."""
    rng = random.Random(acc_bits)

    def number(bits: int) -> int:
        low, high = -(1 << bits - 1), (1 << bits - 1) - 1
        return (
            rng.choice([low, high, 0, -1, 1, rng.randint(low, high), rng.randint(low, high)])
            & (1 << bits) - 1
        )

    found = []
    for k in range(OPERATIONS):
        early = k < SETTLED
        swap = int(rng.random() < 0.2 or (early and accumulates))
        valid = int(early or rng.random() < 0.7) & ~(swap & accumulates)
        found.append(
            (int(early or rng.random() < 0.7), number(16), number(16), swap, number(acc_bits), valid)
        )
    return found


@cache
def verilog(accumulates: bool, acc_bits: int, name: str, platform: str | None) -> str:
    """A lane as a module called ``name``."""
    signature = lane_signature(16, 16, acc_bits, load_with_operands=not accumulates, accumulates=accumulates)
    # not under the system's temporary folder, which the tool does not see
    with tempfile.TemporaryDirectory(dir=BUILD) as folder:
        (Path(folder) / "lane.il").write_text(
            rtlil.convert(DspLane(signature), name=name, platform=platform, emit_src=False)
        )
        (Path(folder) / "lane.ys").write_text(
            "read_rtlil lane.il\nproc\nopt_clean\nwrite_verilog -noattr lane.v\n"
        )
        run_tool("yosys", ["-q", "lane.ys"], Path(folder))
        return (Path(folder) / "lane.v").read_text()


def differences(
    tmp_path: Path, accumulates: bool, acc_bits: int, change=lambda text: text
) -> tuple[int, int]:
    """(operations after which the two differ, operations that moved the sum); ``change`` alters the block's
    Verilog."""
    behaviour, block = (
        verilog(accumulates, acc_bits, "behaviour", None),
        verilog(accumulates, acc_bits, "block", ICE40),
    )
    assert "SB_MAC16" in block and "SB_MAC16" not in behaviour
    (tmp_path / "behaviour.v").write_text(behaviour)
    (tmp_path / "block.v").write_text(change(block))
    words = []
    for operation in operations(accumulates, acc_bits):
        word = 0
        for value, bits in zip(operation, (1, 16, 16, 1, acc_bits, 1), strict=True):
            word = word << bits | value
        words.append(f"{word:x}\n")
    (tmp_path / "words.hex").write_text("".join(words))
    bench = BENCH
    for mark, value in (("ACC", acc_bits), ("LAST", OPERATIONS - 1), ("SETTLED", SETTLED)):
        bench = bench.replace(f"@{mark}@", str(value))
    (tmp_path / "bench.v").write_text(bench)
    differ, moved = re.search(
        r"(\d+) differences, moved (\d+) times", run_bench(tmp_path, "behaviour.v", "block.v")
    ).groups()
    return int(differ), int(moved)


@each_row("acc_bits", [32, 27])
@each_row("accumulates", [True, False])
def test_the_block_does_what_the_behaviour_says(tmp_path, accumulates, acc_bits):
    differ, moved = differences(tmp_path, accumulates, acc_bits)
    assert differ == 0 and moved > OPERATIONS // 3


@each_row(
    ("accumulates", "parameter", "wrong"),
    [
        (True, "A_SIGNED", 0),
        (True, "B_REG", 0),
        (True, "BOTADDSUB_UPPERINPUT", 1),
        (True, "TOPADDSUB_CARRYSELECT", 0),
        (False, "C_REG", 0),
        (False, "BOTADDSUB_LOWERINPUT", 1),
    ],
)
def test_a_wrong_parameter_is_seen(tmp_path, accumulates, parameter, wrong):
    def change(text: str) -> str:
        changed = re.sub(rf"\.{parameter}\(32'[sd]*\d+\)", f".{parameter}(32'd{wrong})", text)
        assert changed != text
        return changed

    assert differences(tmp_path, accumulates, 32, change)[0] > OPERATIONS // 100
