"""Asynchronous serial bytes: 1 start bit, 8 data bits (lowest first), 1 stop bit, no parity."""

import math

from amaranth.hdl import Cat, Const, Module, Mux, Signal
from amaranth.lib import stream
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import In, Out

from eskin.golden.core import InputError
from eskin.rtl.common import Block, drive, inputs, outputs

DIVISOR_MIN = 4
"""Clocks a bit: with fewer, one clock of doubt about the edge is more than a quarter of a bit."""
RATE_ERROR_MAX = 0.02
"""Highest error of the bit rate: a sample in the middle of the stop bit, 9.5 bits after the edge, then errs
by less than a fifth of a bit."""


def uart_divisor(clock_hz: float, baud: float) -> int:
    """Clocks a bit: round(clock_hz / baud).

    Raises
    ------
    InputError
        Fewer than DIVISOR_MIN clocks a bit, or a rate that this clock misses by more than RATE_ERROR_MAX;
        names one that fits.
    """
    divisor = round(clock_hz / baud)
    if divisor < DIVISOR_MIN:
        raise InputError(
            f"baud {baud:g}: a clock of {clock_hz:g} Hz gives it {clock_hz / baud:.3g} clocks a bit and "
            f"{DIVISOR_MIN} are needed; "
            f"use at most {clock_hz / DIVISOR_MIN:g}"
        )
    if abs(clock_hz / divisor / baud - 1) > RATE_ERROR_MAX:
        raise InputError(
            f"baud {baud:g}: a clock of {clock_hz:g} Hz cannot make it within 2 %; "
            f"use {clock_hz / math.ceil(clock_hz / baud):g}"
        )
    return divisor


class UartReceiver(Block):
    """Bytes out of a serial line.

    Parameters
    ----------
    divisor:
        Clocks a bit, at least DIVISOR_MIN.

    Members
    -------
    rx : In(1)
        The line, asynchronous, idle high.
    data : Out(8)
    valid : Out(1)
        One cycle in the middle of the stop bit, where that is high: ``data`` is a byte.

    A byte with a low stop bit is dropped; the length of its packet is then wrong. A byte begins at a
    falling edge. So after a break the line must first go high: otherwise the receiver would start within
    the break, and then within each of a series of bytes. The start bit is not sampled again in its middle.
    A spike therefore makes a byte, which the packet's checks must refuse anyway.
    """

    def ports(self, divisor: int):
        return inputs("rx") | outputs("valid", data=8)

    def elaborate(self, platform):
        m, divisor = Module(), self.spec
        line = Signal()
        before = Signal()
        m.submodules.synchroniser = FFSynchronizer(self.rx, line, init=1)
        # The start bit goes ahead of the data bits through the register; where it comes out, the next sample
        # is the stop bit.
        shift = Signal(9)
        active = Signal()
        # to the middle of data bit 0, half a clock of doubt about the edge taken off
        to_first = (3 * divisor - 3) // 2
        timer = Signal(range(to_first + 1))
        sample = active & (timer == 0)
        drive(m, self, data=shift[1:], valid=sample & ~shift[0] & line)
        m.d.sync += before.eq(line)
        with m.If(~active):
            m.d.sync += [timer.eq(to_first), shift.eq(0xFF), active.eq(before & ~line)]
        with m.Elif(sample):
            m.d.sync += [timer.eq(divisor - 1), shift.eq(Cat(shift[1:], line)), active.eq(shift[0])]
        with m.Else():
            m.d.sync += timer.eq(timer - 1)
        return m


class UartTransmitter(Block):
    """One byte after the other.

    Parameters
    ----------
    divisor:
        Clocks a bit (`uart_divisor`).

    Members
    -------
    i : In(stream of 8 bits)
        Taken when the line is free.
    tx : Out(1)
        The line, from a register, idle high.

    A byte takes 10 * ``divisor`` cycles.
    """

    def ports(self, divisor: int):
        return {"i": In(stream.Signature(8)), "tx": Out(1, init=1)}

    def elaborate(self, platform):
        m, divisor = Module(), self.spec
        bits = Signal(9)  # bits to follow the bit on the line, the stop bit a one behind the data
        left = Signal(range(11))
        timer = Signal(range(divisor))
        over = timer == 0
        m.d.comb += self.i.ready.eq((left == 0) & over)
        m.d.sync += timer.eq(Mux(over, 0, timer - 1))
        with m.If(self.i.ready & self.i.valid):
            m.d.sync += [
                self.tx.eq(0),
                bits.eq(Cat(self.i.payload, Const(1, 1))),
                left.eq(9),
                timer.eq(divisor - 1),
            ]
        with m.Elif((left != 0) & over):
            m.d.sync += [
                self.tx.eq(bits[0]),
                bits.eq(Cat(bits[1:], 1)),
                left.eq(left - 1),
                timer.eq(divisor - 1),
            ]
        return m
