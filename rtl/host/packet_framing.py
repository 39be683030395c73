"""Framing of RFC 1662 (HDLC-like, octet-stuffed): flag 0x7E around a packet, 0x7D before an escaped byte,
16-bit frame check sequence."""

from amaranth.hdl import Module, Signal, Value
from amaranth.lib import wiring

from eskin.rtl.common import drive, inputs, outputs

FLAG, ESCAPE = 0x7E, 0x7D
FLIPPED_BIT = 5
"""Bit of an escaped byte that is inverted."""
FCS_START = 0xFFFF
FCS_TAPS = 0x8408
"""CRC-16/IBM-SDLC (X-25): x^16 + x^12 + x^5 + 1, lowest bit first; starts with ones, is sent inverted, low
byte first."""
FCS_GOOD = 0xF0B8
"""The register's value after an intact packet and its check sequence."""


def is_special(byte: Value) -> Value:
    """A flag or an escape, which differ in their two lowest bits."""
    return (byte[2:] == FLAG >> 2) & (byte[0] ^ byte[1])


class Unstuffer(wiring.Component):
    """Takes flags and escapes out.

    Members
    -------
    data : In(8)
    valid : In(1)
        One byte off the line in this cycle.
    byte : Out(8)
    byte_valid : Out(1)
        A byte of the packet, in the same cycle.
    end : Out(1)
        A flag, in the same cycle.
    aborted : Out(1)
        With ``end``: an escape came right before it, which ends no packet.
    """

    def __init__(self) -> None:
        super().__init__(inputs("valid", data=8) | outputs("byte_valid", "end", "aborted", byte=8))

    def elaborate(self, platform):
        m = Module()
        escaped = Signal()
        special = is_special(self.data)
        is_flag, is_escape = special & self.data[1], special & self.data[0] & ~escaped
        drive(
            m,
            self,
            byte=self.data ^ (escaped << FLIPPED_BIT),
            end=self.valid & is_flag,
            byte_valid=self.valid & ~is_flag & ~is_escape,
            aborted=escaped,
        )
        with m.If(self.valid):
            m.d.sync += escaped.eq(is_escape)
        return m


class FrameCheck(wiring.Component):
    """The check sequence, a byte a cycle.

    Members
    -------
    start : In(1)
        A packet begins.
    byte : In(8), valid : In(1)
        Its next byte, check sequence included. Not together with ``start``.
    good : Out(1)
        From the cycle after its last byte on: the check sequence is right.
    """

    def __init__(self) -> None:
        super().__init__(inputs("start", "valid", byte=8) | outputs("good"))

    def elaborate(self, platform):
        m = Module()
        fcs = Signal(16, init=FCS_START)
        # Eight steps of the shift register in closed form. The taps are placed so that a byte feeds back into
        # itself only once.
        mixed = Signal(8)
        fed = Signal(8)
        m.d.comb += [mixed.eq(fcs ^ self.byte), fed.eq(mixed ^ (mixed << 4)), self.good.eq(fcs == FCS_GOOD)]
        with m.If(self.start):
            m.d.sync += fcs.eq(FCS_START)
        with m.Elif(self.valid):
            m.d.sync += fcs.eq(fcs[8:] ^ (fed << 8) ^ (fed << 3) ^ (fed >> 4))
        return m
