"""The receiver of serial bytes: after a break it takes the first byte that is sent, and nothing before it."""

from amaranth.hdl import Array, Cat, Const, Module, Signal

from eskin.rtl.host.uart import UartReceiver
from formal.proof import Bug, any_number, assume, free, placed, proof, prove

DIVISOR, BITS = 4, 10
BYTE = DIVISOR * BITS
"""Cycles of a byte, start and stop bit included."""
HISTORY, LATENCY = 15, 3
"""Cycles of anything before the break; from the line's pin to where it is looked at."""


@proof(
    "whatever came before: once the line has been low for a byte's length and then high, the next byte is "
    "received as it was sent, and "
    "nothing else is from where the line fell",
    method="bounded",
    depth=HISTORY + 2 * BYTE + 14,
    reduced="4 clocks a bit",
    bugs=(
        Bug("a break is a start bit", "active.eq(before & ~line)", "active.eq(~line)"),
        Bug("what ends with a low stop bit is a byte", "~shift[0] & line)", "~shift[0])"),
    ),
)
def byte_after_a_break(m: Module) -> None:
    dut = placed(UartReceiver(DIVISOR))
    cycle = Signal(8)
    m.d.sync += cycle.eq(cycle + 1)
    # break, high line, byte
    falls, rises, begins = (any_number(8, name) for name in ("falls", "rises", "begins"))
    assume((falls <= HISTORY) & (rises >= falls + BYTE) & (rises <= falls + BYTE + 6))
    assume((begins > rises) & (begins <= rises + DIVISOR))
    byte = any_number(8, "byte")
    history = Signal()
    at = Signal(8)
    free(history)
    m.d.comb += [at.eq(cycle - begins), dut.rx.eq(history)]
    with m.If((cycle >= begins) & (cycle < begins + BYTE)):
        m.d.comb += dut.rx.eq(Array(Cat(Const(0, 1), byte, Const(1, 1)))[at >> 2])
    with m.Elif((cycle >= falls) & (cycle < begins)):
        m.d.comb += dut.rx.eq(cycle >= rises)
    stop = begins + BYTE - DIVISOR + LATENCY  # its stop bit is looked at somewhere in it
    heard = Signal()
    m.d.sync += heard.eq(heard | (dut.valid & (cycle >= begins)))
    prove(~dut.valid | (cycle < falls + LATENCY) | (cycle >= stop - 1), "nothing out of the break")
    prove(
        ~dut.valid | (cycle < stop - 1) | (cycle >= begins + BYTE) | (dut.data == byte),
        "the byte that was sent",
    )
    prove((cycle < begins + BYTE) | heard, "it is received before the stop bit is over")
