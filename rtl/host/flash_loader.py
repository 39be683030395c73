"""Words out of a board's SPI flash, at start: the program of examples/soc."""

from collections.abc import Sequence

import numpy as np
from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import In, Out

OFFSET = 1 << 20
"""Byte of the flash at which they begin: behind the bitstream of every board."""
WAKE, READ = 0xAB, 0x03
"""Commands: out of deep power-down, where an iCE40 may leave its flash, and read from a 24-bit address on."""
WAKE_S = 100e-6
"""Seconds that a flash has to wake; data sheets say 3 to 30 us."""
TAPS = 0x04C11DB7
"""Of the checksum, CRC-32/MPEG-2."""

flash_pins = wiring.Signature({"cs_n": Out(1, init=1), "sclk": Out(1), "mosi": Out(1), "miso": In(1, init=1)})
"""Mode 0: both sides change their data when the clock falls."""


def image(words: Sequence[int]) -> bytes:
    """Contents of the flash from OFFSET on: words of 16 bits, highest bit first, and their checksum."""
    data, check = np.array(words, ">u2").tobytes(), 0xFFFFFFFF
    for bit in np.unpackbits(np.frombuffer(data, np.uint8)).tolist():
        check = (check << 1 & 0xFFFFFFFF) ^ TAPS * (check >> 31 ^ bit)
    return data + check.to_bytes(4, "big")


class FlashLoader(wiring.Component):
    """Reads ``words`` words of 16 bits and their checksum once.

    Members
    -------
    flash : Out(flash_pins)
        A bit takes 4 cycles; the flash may take all but two of them to answer.
    word : Out(16), valid : Out(1)
        Each word, in turn.
    done : Out(1)
        All are read and the checksum proved right. It stays low for ever where it did not.
    """

    def __init__(self, words: int, clock_hz: float) -> None:
        self._bits, self._wake_cycles = 16 * words, max(1, round(WAKE_S * clock_hz))
        super().__init__({"flash": Out(flash_pins), "word": Out(16), "valid": Out(1), "done": Out(1)})

    def elaborate(self, platform):
        m = Module()
        pins, line = self.flash, Signal(init=1)
        m.submodules.synchroniser = FFSynchronizer(pins.miso, line, init=1)
        phase, out = Signal(2), Signal(32)  # of a bit: the clock is low, low, high, high
        left, timer = Signal(range(self._bits + 32)), Signal(range(self._wake_cycles + 1))
        check, check_now = Signal(32, init=0xFFFFFFFF), Signal(32)
        tick = phase == 3
        last = tick & (left == 0)
        m.d.comb += [
            pins.sclk.eq(phase[1]),
            pins.mosi.eq(out[-1]),
            check_now.eq((check << 1) ^ Mux(check[-1] ^ line, TAPS, 0)),
        ]
        m.d.sync += [phase.eq(Mux(pins.cs_n, 0, phase + 1)), self.valid.eq(0)]
        with m.If(tick):
            m.d.sync += [out.eq(out << 1), left.eq(left - 1), self.word.eq(Cat(line, self.word))]
        with m.FSM():
            with m.State("START"):
                m.d.sync += [pins.cs_n.eq(0), out.eq(WAKE << 24), left.eq(7)]
                m.next = "WAKE"
            with m.State("WAKE"), m.If(last):
                m.d.sync += pins.cs_n.eq(1)
                m.next = "WAIT"
            with m.State("WAIT"):
                m.d.sync += timer.eq(timer + 1)
                with m.If(timer == self._wake_cycles):
                    m.d.sync += [pins.cs_n.eq(0), out.eq(READ << 24 | OFFSET), left.eq(31)]
                    m.next = "ASK"
            with m.State("ASK"), m.If(last):
                m.d.sync += left.eq(self._bits + 31)
                m.next = "READ"
            with m.State("READ"), m.If(tick):
                m.d.sync += [check.eq(check_now), self.valid.eq((left >= 32) & (left[:4] == 0))]
                with m.If(left == 0):
                    # remainder of a message with the check sequence behind it
                    m.d.sync += [pins.cs_n.eq(1), self.done.eq(check_now == 0)]
                    m.next = "END"
            with m.State("END"):
                pass
        return m
