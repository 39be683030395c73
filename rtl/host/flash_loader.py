"""The model out of the board's SPI flash, at start: docs/specification.md section 16."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import In, Out

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

flash_pins = wiring.Signature({"cs_n": Out(1, init=1), "sclk": Out(1), "mosi": Out(1), "miso": In(1, init=1)})
"""Mode 0: both sides change their data when the clock falls."""


@dataclass(frozen=True, kw_only=True)
class Serial:
    """What a loader gives to states beside its own.

    out: bits that go, the highest first. left: how many more; ``last`` is the cycle that ends the last of them, and
    with it ``unit_now`` the bits that came. waits: none goes. checked: the one that ends with ``tick``, ``line`` or
    where ``writing`` the one that goes, counts for ``check``.
    """

    out: Signal
    left: Signal
    tick: Signal
    last: Signal
    line: Signal
    unit: Signal
    unit_now: Signal
    check: Signal
    check_now: Signal
    checked: Signal
    writing: Signal
    waits: Signal


class FlashLoader(wiring.Component):
    """Reads the image once, performs its writes as they come, and verifies the checksum before ``done``.

    An image with an unexpected head writes nothing. Damage behind the head shows only in the checksum, when
    the words are already written: ``done`` then stays low for ever, so nothing uses them. A new attempt needs
    a reset.

    Parameters
    ----------
    number, writes:
        Of the design (`eskin.rtl.program.flash_image`): the image must have this number and so many writes.
    wake_cycles:
        Cycles between the commands to wake and to read, at least 1.
    offset:
        Byte of the flash at which the image begins.
    members, then:
        Of a loader that goes on (`eskin.rtl.host.taught_log`): further ports, and the state behind ARM.

    Members
    -------
    pins : Out(flash_pins)
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

    def __init__(
        self,
        number: int,
        writes: int,
        *,
        wake_cycles: int,
        offset: int = FLASH_OFFSET,
        members: dict[str, Any] | None = None,
        then: str = "DONE",
    ) -> None:
        self._number, self._writes, self._wake_cycles, self._offset = number, writes, wake_cycles, offset
        self._then = then
        super().__init__(
            {"pins": Out(flash_pins), "bus": Out(bus_signature()), "done": Out(1), "failed": Out(1)}
            | (members or {})
        )

    def _beside(self, m: Module, serial: Serial) -> Iterator[Signal]:
        """Logic of a loader that goes on: up to its yield, of what ``done`` is, outside of the state machine, its
        states from there on."""
        return iter(())

    def elaborate(self, platform):
        m = Module()
        pins = self.pins
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
        last = self.last = Signal()
        checked = Signal()
        writing = Signal()
        waits = Signal()
        unit_now = self.unit_now = Signal(UNIT)
        check_now = self.check_now = Signal(CHECK)
        strobe = Signal()
        arm = Signal()
        m.d.comb += [
            pins.sclk.eq(phase[1]),
            pins.mosi.eq(out[-1]),
            tick.eq(phase == 3),
            last.eq(tick & (left == 0)),
            unit_now.eq(Cat(line, unit)),
            check_now.eq((check << 1) ^ Mux(check[-1] ^ Mux(writing, out[-1], line), TAPS, 0)),
            self.bus.addr.eq(Mux(arm, int(Register.CONTROL), unit[16:])),
            self.bus.w_data.eq(Mux(arm, int(Control.ARM), unit[:16])),
            self.bus.w_stb.eq(strobe | arm),
        ]
        m.d.sync += [phase.eq(Mux(pins.cs_n | waits, 0, phase + 1)), strobe.eq(0)]
        with m.If(tick):
            m.d.sync += [out.eq(out << 1), unit.eq(unit_now), left.eq(left - (left != 0))]
            with m.If(checked):
                m.d.sync += check.eq(check_now)
        beside = self._beside(
            m,
            Serial(
                **dict(out=out, left=left, tick=tick, last=last, line=line, unit=unit, unit_now=unit_now),
                **dict(check=check, check_now=check_now, checked=checked, writing=writing, waits=waits),
            ),
        )
        ready = next(beside, None)
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
                m.next = self._then
            next(beside, None)
            with m.State("DONE"):
                pass
            with m.State("FAILED"):
                m.d.sync += pins.cs_n.eq(1)
        m.d.comb += [
            self.done.eq(states.ongoing("DONE") if ready is None else ready),
            self.failed.eq(states.ongoing("FAILED")),
        ]
        return m
