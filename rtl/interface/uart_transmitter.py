"""Bytes onto a serial line: 1 start bit, 8 data bits (lowest first), 1 stop bit, no parity."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out


class UartTransmitter(wiring.Component):
    """One byte after the other.

    Parameters
    ----------
    divisor:
        Clocks a bit (`eskin.rtl.host.uart.uart_divisor`).

    Members
    -------
    i : In(stream of 8 bits)
        Taken when the line is free.
    tx : Out(1)
        The line, from a register, idle high.

    A byte takes 10 * ``divisor`` cycles.
    """

    def __init__(self, divisor: int) -> None:
        self._divisor = divisor
        super().__init__({"i": In(stream.Signature(8)), "tx": Out(1, init=1)})

    def elaborate(self, platform):
        m = Module()
        bits = Signal(9)  # what is to follow the bit on the line, the stop bit a one behind the data
        left = Signal(range(11))
        timer = Signal(range(self._divisor))
        over = timer == 0
        m.d.comb += self.i.ready.eq((left == 0) & over)
        m.d.sync += timer.eq(Mux(over, 0, timer - 1))
        with m.If(self.i.ready & self.i.valid):
            m.d.sync += [
                self.tx.eq(0),
                bits.eq(Cat(self.i.payload, Const(1, 1))),
                left.eq(9),
                timer.eq(self._divisor - 1),
            ]
        with m.Elif((left != 0) & over):
            m.d.sync += [
                self.tx.eq(bits[0]),
                bits.eq(Cat(bits[1:], 1)),
                left.eq(left - 1),
                timer.eq(self._divisor - 1),
            ]
        return m
