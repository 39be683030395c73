"""Frames of a matrix: a scan ends from any state, and no sample is taken before its cell has settled."""

import dataclasses

from amaranth.hdl import Cat, Module, Mux, Signal

from eskin.golden.core.converters.matrix import MatrixPlan
from eskin.rtl.interface.matrix_converter import MatrixConverter
from formal.interface.spi_master import PLAN
from formal.proof import Bug, before, free_inputs, less_is_to_go, opened_up, proof, prove

SETTLE = 6
MATRIX = MatrixPlan(rows=2, columns=2, settle=SETTLE, port=dataclasses.replace(PLAN, lines=1, selects=1))
REDUCED = "2 x 2 cells of 4 bits, 6 cycles to settle"


def _scanner(m: Module):
    dut = MatrixConverter(MATRIX)
    inside = opened_up(dut)
    free_inputs(dut)
    return dut, inside, inside.parts["SpiMaster"]


@proof(
    "from any state of its registers and of its port's a scan goes on towards its end in every cycle; it "
    "ends in one cycle, idle then",
    depth=2,
    reduced=REDUCED,
    bugs=(
        Bug(
            "the time to settle stops at one",
            "settle.eq(settle - ~settled)",
            "settle.eq(settle - (settle > 1))",
            depth=20,
        ),
        Bug("the next cell is the same", "Mux(last_column, 0, pins.column + 1)", "pins.column", depth=60),
    ),
)
def scan_ends(m: Module) -> None:
    dut, inside, port = _scanner(m)
    running = port.place << len(port.timer) | port.timer
    within = Signal(10)
    # before the transfer: what is to settle, then what the port is still busy with; in it: what is to go;
    # then the word is there
    waiting = Mux(inside.converting, 896, 512) + running + inside.settle  # the former only after an upset
    m.d.comb += within.eq(
        Mux(inside.taken, 0, Mux(inside.converting & (port.place != 0), 1 + running, waiting))
    )
    left = Signal(12)
    m.d.comb += left.eq(Cat(within, ~dut.pins.column, ~dut.pins.row))
    was_busy, ended = before(dut.busy, "was_busy"), before(dut.finished & dut.busy, "ended")
    less_is_to_go(left, ~was_busy | ~dut.busy)
    prove(~was_busy | (dut.busy == ~ended), "busy until the end, and idle after it")


@proof(
    "select falls, which takes the sample, only when the address has stood for the time to settle",
    depth=3,
    reduced=REDUCED,
    bugs=(
        Bug(
            "no time to settle",
            "settle.eq(plan.settle)]\n            m.d.sync += [wrong",
            "settle.eq(0)]\n            m.d.sync += [wrong",
            depth=60,
        ),
        Bug(
            "the transfer does not wait",
            "self.busy & settled & ~converting",
            "self.busy & ~converting",
            depth=60,
        ),
    ),
)
def settles(m: Module) -> None:
    dut, inside, port = _scanner(m)
    address = Cat(dut.pins.row, dut.pins.column)
    was, running = before(address, "address_before"), before(1, "running")
    stood = Signal(range(SETTLE + 1), init=SETTLE)
    now = Mux(running & (address != was), 0, stood)
    m.d.sync += stood.eq(Mux(now == SETTLE, SETTLE, now + 1))
    fell = running & ~dut.pins.cs_n & before(dut.pins.cs_n, "cs_before")
    prove(~fell | (now == SETTLE), "the address has stood")
    # ---- for the induction
    prove((stood <= SETTLE) & (inside.settle <= SETTLE), "ranges")
    prove((now + inside.settle >= SETTLE), "settled when the count is over")
    prove(dut.pins.cs_n == (port.place == 0), "selected in a transfer")
    prove(~inside.converting | dut.busy, "only a scan converts")
    prove(~inside.taken | inside.converting, "a word is one that was waited for")
