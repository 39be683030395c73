"""Frames of SPI converters: a scan ends from any state, once, and every code that counts is handed on."""

import dataclasses

from amaranth.hdl import Cat, Module, Mux, Signal

from eskin.rtl.interface.spi_converter import SpiConverter
from formal.interface.spi_master import CHIP, PLAN
from formal.proof import Bug, before, free_inputs, less_is_to_go, opened_up, proof, prove

SMALL = dataclasses.replace(CHIP, channels=2, delay=1, code_bits=3)
FRAME = dataclasses.replace(
    PLAN, chip=SMALL, transfers=tuple((group, step) for group in range(2) for step in range(3))
)
TAXELS = 2 * 2 * 2


@proof(
    "from any state of its registers and of its port's a scan goes on towards its end in every cycle; it "
    "ends in one cycle, idle then",
    depth=2,
    reduced="2 lines, 2 selects, 2 channels of 4 bits, a transfer late",
    bugs=(
        Bug(
            "the port is not asked again",
            "begin.eq(self.busy & master.idle & ~handing)",
            "begin.eq(self.busy & master.idle & (transfer == 0))",
            depth=60,
        ),
        Bug("a transfer is not counted", "transfer.eq(transfer + 1)", "transfer.eq(transfer)", depth=60),
        Bug(
            "the lines are handed on for ever",
            "end_of_lines = line == plan.lines - 1",
            "end_of_lines = line == plan.lines",
            depth=60,
        ),
    ),
)
def scan_ends(m: Module) -> None:
    dut = SpiConverter(FRAME, TAXELS)
    inside = opened_up(dut)
    port = inside.parts["SpiMaster"]
    free_inputs(dut)
    count, lines = len(FRAME.transfers), FRAME.lines
    ahead = Signal.like(inside.transfer, name="transfers_ahead")
    lines_ahead = Signal(1)
    m.d.comb += [ahead.eq(count - 1 - inside.transfer), lines_ahead.eq(lines - 1 - inside.line)]
    running = port.place << len(port.timer) | port.timer
    within = Signal(12)
    waiting = Mux(port.place == 0, (1 << 11) + port.timer, 16 + running)
    m.d.comb += within.eq(Mux(inside.handing, lines_ahead, waiting))
    left = Signal(16)
    m.d.comb += left.eq(Cat(within, ahead))
    was_busy, ended = before(dut.busy, "was_busy"), before(dut.finished, "ended")
    less_is_to_go(left, ~was_busy | ~dut.busy)
    prove(~was_busy | (dut.busy == ~ended), "busy until the end, and idle after it")
    prove(~(dut.finished & ~dut.busy), "only a scan ends")
