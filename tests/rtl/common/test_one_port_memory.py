"""A memory with one port: its answers against a list, and its iCE40 block on the vendor's cell model against
its behaviour."""

import random
import re

from eskin.rtl.common import OnePortMemory
from eskin.rtl.common.memory_style import LARGE_WORDS
from eskin.rtl.engine.sb_mac16 import ICE40
from tests.support.stream_bench import simulate
from tests.support.table import each_row
from tests.support.vendor_cells import run_bench, verilog_of

WORDS, ACCESSES = LARGE_WORDS, 3000


def accesses() -> list[tuple[int, int, int, int]]:
    """Random (address, enable, write, data)."""
    rng = random.Random(5)
    return [
        (rng.randrange(32) << 9, int(rng.random() < 0.85), rng.choice((0, 0, 1, 2, 3)), rng.getrandbits(16))
        for _ in range(ACCESSES)
    ]


def expected() -> list[int | None]:
    """The word after each access: of the last read; None where nothing may be relied on."""
    words: list[list[int | None]] = [[None, None] for _ in range(WORDS)]
    word, found = None, []
    for address, enable, write, data in accesses():
        if enable and write:
            for byte in range(2):
                if write >> byte & 1:
                    words[address][byte] = data >> 8 * byte & 0xFF
            word = None
        elif enable:
            low, high = words[address]
            word = None if low is None or high is None else low | high << 8
        found.append(word)
    assert sum(each is not None for each in found) > ACCESSES // 3
    return found


def test_words_and_bytes_against_a_list():
    dut = OnePortMemory(WORDS)

    async def bench(ctx):
        for access, word in zip(accesses(), expected(), strict=True):
            for signal, value in zip((dut.address, dut.enable, dut.write, dut.data), access, strict=True):
                ctx.set(signal, value)
            await ctx.tick()
            assert word is None or ctx.get(dut.word) == word

    simulate(dut, bench)


BENCH = """`timescale 1ns / 1ps
module bench;
    reg clk = 0, enable;
    reg [13:0] address;
    reg [1:0] write;
    reg [15:0] data;
    wire [15:0] word;
    reg [39:0] accesses [0:@LAST@];
    reg [16:0] expected [0:@LAST@];
    integer n, wrong, compared;
    block dut (.clk(clk), .rst(1'b0), .address(address), .enable(enable), .write(write), .data(data), .word(word));
    initial begin
        $readmemh("accesses.hex", accesses);
        $readmemh("expected.hex", expected);
        wrong = 0;
        compared = 0;
        for (n = 0; n <= @LAST@; n = n + 1) begin
            {address, enable, write, data} = accesses[n];
            #5 clk = 1;
            #5 clk = 0;
            if (expected[n][16]) begin
                compared = compared + 1;
                if (word !== expected[n][15:0]) wrong = wrong + 1;
            end
        end
        $display("%0d wrong of %0d", wrong, compared);
    end
endmodule
"""


@each_row("platform", [ICE40, None])
@each_row("broken", [False, True])
def test_on_the_vendor_s_cell_and_as_verilog_with_unknown_contents(tmp_path, platform, broken):
    """``broken``: the bytes change places; the bench must see it."""
    dut = OnePortMemory(WORDS - broken)
    block = verilog_of(dut, "block", platform)
    assert ("SB_SPRAM256KA" in block) == (platform == ICE40)
    bench = BENCH.replace("@LAST@", str(ACCESSES - 1))
    if broken:
        bench = bench.replace(".write(write)", ".write({write[0], write[1]})")
    (tmp_path / "bench.v").write_text(bench)
    (tmp_path / "block.v").write_text(block)
    words = [
        f"{address << 19 | enable << 18 | write << 16 | data:010x}\n"
        for address, enable, write, data in accesses()
    ]
    (tmp_path / "accesses.hex").write_text("".join(words))
    (tmp_path / "expected.hex").write_text(
        "".join(f"{0 if word is None else 1 << 16 | word:05x}\n" for word in expected())
    )
    wrong, compared = map(int, re.search(r"(\d+) wrong of (\d+)", run_bench(tmp_path, "block.v")).groups())
    assert compared > ACCESSES // 3
    assert (wrong > 0) == broken
