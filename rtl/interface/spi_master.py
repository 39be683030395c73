"""A serial port to converters: one transfer, several data lines at once (docs/specification_interfaces.md section
12)."""

from amaranth.hdl import Cat, Module, Mux, Signal, unsigned
from amaranth.lib import data, wiring
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import In, Out

from eskin.golden.core import SpiPlan
from eskin.rtl.common import Block, drive, inputs, outputs


def spi_pins(lines: int, selects: int) -> wiring.Signature:
    """Pins of an SPI port: selects, active low; clock, idle low; data out; a line of data in for each of
    ``lines`` chips."""
    return wiring.Signature(
        {
            "cs_n": Out(selects, init=(1 << selects) - 1),
            **outputs("sclk", "mosi"),
            "miso": In(lines, init=(1 << lines) - 1),
        }
    )


class SpiMaster(Block):
    """One transfer of ``plan.chip.bits`` clocks, most significant bit first, mode 0: both sides change their
    data when the clock falls.

    The input is sampled at the end of the clock's high half, so that a chip may take all but two cycles of a whole
    period to answer. Where half a period is one cycle, it is sampled a cycle later, and a chip may take one cycle.

    Parameters
    ----------
    plan:
        Clocks of a transfer, data lines, selects, and the cycles of half a period (``half``), from select to the
        first clock (``lead``) and of select high (``high``).

    Members
    -------
    start : In(1)
        Begin a transfer; only while ``idle``.
    select : In, command : In(bits)
        Number of the select that falls, and the bits to send; taken with ``start``.
    short : In(1), only with ``plan.short``
        The transfer has so many clocks, and ``words`` then holds nothing; taken with ``start``.
    idle : Out(1)
        No transfer, and select has been high long enough.
    done : Out(1)
        One cycle, the last of a transfer: from the next one on ``words`` holds what came in, until the next transfer.
    words : Out(array of lines words)
    pins : Out
        `spi_pins`; all from registers.

    A transfer takes lead + 2 half bits + high cycles from ``start`` until ``idle``. From any state of its
    registers the port is idle again after at most twice that, for its two counters only count down.
    """

    def ports(self, plan: SpiPlan):
        bits, lines, selects = plan.chip.bits, plan.lines, plan.selects
        begun = inputs("start", select=range(max(2, selects)), command=bits)
        begun |= inputs("short") if plan.short else {}
        return begun | outputs(
            "idle", "done", words=data.ArrayLayout(unsigned(bits), lines), pins=spi_pins(lines, selects)
        )

    def elaborate(self, platform):
        m = Module()
        plan, pins = self.spec, self.pins
        halves = 2 * plan.chip.bits
        lines = Signal(plan.lines)
        m.submodules.synchroniser = FFSynchronizer(pins.miso, lines)
        # Half periods to go: halves + 1 while select leads, then high (even) and low (odd) in turn, 0 with
        # select high.
        place = Signal(range(halves + 2))
        timer = Signal(range(max(plan.half, plan.lead, plan.high)))
        out = Signal(plan.chip.bits)
        over = timer == 0
        last = place == 1
        drive(m, self, idle=(place == 0) & over, done=last & over)
        m.d.comb += pins.mosi.eq(out[-1])
        m.d.sync += timer.eq(timer - ~over)
        with m.If(self.start & self.idle):
            m.d.sync += [
                place.eq(Mux(self.short, 2 * plan.short, halves) + 1 if plan.short else halves + 1),
                timer.eq(plan.lead - 1),
                out.eq(self.command),
                pins.cs_n.eq(~(1 << self.select)),
            ]
        with m.Elif(over & (place != 0)):
            m.d.sync += [
                place.eq(place - 1),
                timer.eq(Mux(last, plan.high - 1, plan.half - 1)),
                pins.sclk.eq(place[0] & ~last),
            ]
            with m.If(last):
                m.d.sync += pins.cs_n.eq(~0)
            read = [word.eq(Cat(line, word)) for word, line in zip(self.words, lines, strict=True)]
            with m.If(~place[0]):  # the clock falls
                m.d.sync += [out.eq(out << 1), *(read if plan.half > 1 else [])]
            if plan.half == 1:
                with m.Else():  # at the end of the lead, too, but that bit is shifted out again
                    m.d.sync += read
        return m
