"""The model out of the board's SPI flash, at start: docs/specification.md section 16."""

from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import In, Out

from eskin.rtl.common import drive, outputs
from eskin.rtl.host.control import bus_signature
from eskin.rtl.program.flash_image import FLASH_OFFSET, MAGIC
from eskin.rtl.program.memory_map import Control, Register

WAKE, READ = 0xAB, 0x03
"""Commands: out of deep power-down (an iCE40 may leave its flash there), and read from a 24-bit address
on."""
WAKE_S = 100e-6
"""Seconds that a flash has for it; data sheets say 3 to 30 us."""
TAPS = 0x04C11DB7
UNIT, HEAD, CHECK = 24, 32, 32
"""Bits of a unit, of the command to read, of the checksum."""

flash_pins = wiring.Signature({"cs_n": Out(1, init=1), **outputs("sclk", "mosi"), "miso": In(1, init=1)})
"""Mode 0: both sides change their data when the clock falls."""


class FlashLoader(wiring.Component):
    """Reads the image once, performs its writes as they come, and verifies the checksum before ``done``.

    An image with an unexpected head writes nothing. Damage behind the head shows only in the checksum, when
    the words are already written: ``done`` then stays low for ever, so nothing uses them. A new attempt needs
    a reset.

    Parameters
    ----------
    number, writes:
        Number of the design (`eskin.rtl.program.flash_image`) and number of writes that the image must have.
    wake_cycles:
        Cycles between the commands to wake and to read, at least 1.
    offset:
        Byte of the flash at which the image begins.

    Members
    -------
    flash : Out(flash_pins)
        All from registers. A bit takes 4 cycles; the flash may take all but two of them to answer.
    bus : Out(bus_signature)
        The host bus: the image's writes, 96 cycles apart, and ARM once the checksum has proved right. Nothing
        is read.
    done : Out(1)
        The model is there and ARM is written.
    failed : Out(1)
        It is not, and will not be: no flash, another design's image, or a damaged one.

    From reset to ``done`` or ``failed``: at most 32 + wake_cycles + 4 (32 + 48 + 24 writes + 32) + 6 cycles.
    """

    def __init__(self, number: int, writes: int, *, wake_cycles: int, offset: int = FLASH_OFFSET):
        self._number, self._writes, self._wake_cycles, self._offset = number, writes, wake_cycles, offset
        super().__init__(outputs("done", "failed", flash=flash_pins, bus=bus_signature()))

    def elaborate(self, platform):
        m = Module()
        pins = self.flash
        line = Signal(init=1)
        m.submodules.synchroniser = FFSynchronizer(pins.miso, line, init=1)
        phase = self.phase = Signal(2)  # of a bit: the clock is low, low, high, high
        out = Signal(HEAD)
        unit = Signal(UNIT)
        left = self.left = Signal(range(HEAD))
        writes = self.writes = Signal(range(self._writes + 1))
        timer = self.timer = Signal(range(self._wake_cycles + 1))
        check = Signal(CHECK, init=(1 << CHECK) - 1)
        tick = Signal()
        last = Signal()
        checked = Signal()
        unit_now = self.unit_now = Signal(UNIT)
        check_now = self.check_now = Signal(CHECK)
        strobe = Signal()
        arm = Signal()
        drive(m, pins, sclk=phase[1], mosi=out[-1])
        m.d.comb += [
            tick.eq(phase == 3),
            last.eq(tick & (left == 0)),
            unit_now.eq(Cat(line, unit)),
            check_now.eq((check << 1) ^ Mux(check[-1] ^ line, TAPS, 0)),
        ]
        drive(
            m,
            self.bus,
            addr=Mux(arm, int(Register.CONTROL), unit[16:]),
            w_data=Mux(arm, int(Control.ARM), unit[:16]),
            w_stb=strobe | arm,
        )
        m.d.sync += [phase.eq(Mux(pins.cs_n, 0, phase + 1)), strobe.eq(0)]
        with m.If(tick):
            m.d.sync += [out.eq(out << 1), unit.eq(unit_now), left.eq(left - (left != 0))]
            with m.If(checked):
                m.d.sync += check.eq(check_now)
        with m.FSM() as states:
            self.states = states
            with m.State("START"):
                m.d.sync += [pins.cs_n.eq(0), out.eq(WAKE << HEAD - 8), left.eq(7)]
                m.next = "WAKE"
            with m.State("WAKE"), m.If(last):
                m.d.sync += [pins.cs_n.eq(1), timer.eq(self._wake_cycles)]
                m.next = "WAIT"
            with m.State("WAIT"):
                m.d.sync += timer.eq(timer - (timer != 0))
                with m.If(timer == 0):
                    m.d.sync += [pins.cs_n.eq(0), out.eq(READ << 24 | self._offset), left.eq(HEAD - 1)]
                    m.next = "ASK"
            with m.State("ASK"), m.If(last):
                m.d.sync += [left.eq(UNIT - 1), writes.eq(self._writes - 1)]
                m.next = "MAGIC"
            for state, expected, then in (("MAGIC", MAGIC, "NUMBER"), ("NUMBER", self._number, "WRITES")):
                with m.State(state):
                    m.d.comb += checked.eq(1)
                    with m.If(last):
                        m.d.sync += left.eq(UNIT - 1)
                        m.next = "FAILED"
                        with m.If(unit_now == expected):
                            m.next = then
            with m.State("WRITES"):
                m.d.comb += checked.eq(1)
                with m.If(last):
                    m.d.sync += [strobe.eq(1), left.eq(UNIT - 1), writes.eq(writes - 1)]
                    with m.If(writes == 0):
                        m.d.sync += left.eq(CHECK - 1)
                        m.next = "CHECK"
            with m.State("CHECK"):
                m.d.comb += checked.eq(1)
                with m.If(last):
                    m.d.sync += pins.cs_n.eq(1)
                    m.next = "FAILED"
                    # what is left of a message with its own check sequence behind it
                    with m.If(check_now == 0):
                        m.next = "ARM"
            with m.State("ARM"):
                m.d.comb += arm.eq(1)
                m.next = "DONE"
            with m.State("DONE"):
                pass
            with m.State("FAILED"):
                m.d.sync += pins.cs_n.eq(1)
        drive(m, self, done=states.ongoing("DONE"), failed=states.ongoing("FAILED"))
        return m
