"""The serial line: every byte that is taken is on it, whole, bit by bit, each for its time; idle is high."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal

from eskin.rtl.interface.uart_transmitter import UartTransmitter
from formal.proof import Bug, free_source, opened_up, proof, prove

DIVISOR = 3


@proof(
    "a byte that is taken is on the line as a start bit, eight data bits from the lowest and a stop bit, "
    "each for the divisor's cycles; no "
    "byte is taken meanwhile, and the line is high where there is none",
    depth=3,
    reduced="3 cycles a bit",
    bugs=(
        Bug("no stop bit", "left.eq(9)", "left.eq(8)", depth=60),
        Bug("highest bit first", "self.tx.eq(bits[0])", "self.tx.eq(bits[7])", depth=20),
        Bug(
            "a byte is taken in the stop bit",
            "self.i.ready.eq((left == 0) & over)",
            "self.i.ready.eq(left == 0)",
            depth=60,
        ),
    ),
)
def bytes_are_whole(m: Module) -> None:
    dut = UartTransmitter(DIVISOR)
    inside = opened_up(dut)
    free_source(dut.i)
    # ---- a reference: the ten bits of the byte, which of them is on the line (10: none), cycles of it so far
    frame = Signal(10)
    at = Signal(range(11), init=10)
    cycles = Signal(range(DIVISOR))
    taken = dut.i.valid & dut.i.ready
    over = cycles == DIVISOR - 1
    with m.If(taken):
        m.d.sync += [frame.eq(Cat(Const(0, 1), dut.i.payload, Const(1, 1))), at.eq(0), cycles.eq(0)]
    with m.Elif(at != 10):
        m.d.sync += [at.eq(Mux(over, at + 1, at)), cycles.eq(Mux(over, 0, cycles + 1))]
    prove(dut.tx == Mux(at == 10, 1, frame.bit_select(at, 1)), "the line")
    prove(~taken | (at == 10) | ((at == 9) & over), "no byte is taken while another is sent")
    prove((at != 10) | dut.i.ready, "an idle line takes a byte")
    # ---- for the induction
    prove((at <= 10) & (cycles < DIVISOR) & (inside.left <= 9) & (inside.timer < DIVISOR), "ranges")
    prove(
        Mux(
            at == 10,
            (inside.left == 0) & (inside.timer == 0),
            (inside.left == 9 - at) & (inside.timer == DIVISOR - 1 - cycles),
        ),
        "place",
    )
    for bit in range(10):
        prove(
            (at != bit) | (inside.bits[: 9 - bit] == frame[bit + 1 :]) if bit < 9 else Const(1),
            f"what follows bit {bit}",
        )
    prove((at == 10) | (frame[9] & ~frame[0]), "start and stop")
