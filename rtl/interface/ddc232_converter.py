"""Frames from a DDC232: configuration, its readback, integrations in turn on both sides
(docs/specification_interfaces.md section 12)."""

from amaranth.hdl import Array, Cat, Const, Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.cdc import FFSynchronizer

from eskin.golden.core import ConverterFault
from eskin.golden.core.converters.ddc232 import (
    CONFIGURATION_BITS,
    PATTERN,
    PATTERN_BITS,
    READBACK_BITS,
    REVISION_BITS,
    WARM_UP,
    DdcPlan,
)
from eskin.rtl.common import drive, inputs, outputs
from eskin.rtl.interface.converter_ports import converter_ports

REPEATED_BITS = READBACK_BITS - CONFIGURATION_BITS - REVISION_BITS - PATTERN_BITS
"""Last bits of the readback, which are not compared; nor is the revision."""

DDC_PINS = wiring.Signature(
    outputs("clk", "reset_n", "conv", "din_cfg", "clk_cfg", "dclk") | inputs("dvalid_n", "dout")
)
"""Names of the data sheet; its DIN (the next chip's data) is tied low, its CLK runs always."""


class Ddc232Converter(wiring.Component):
    """One integration per ``start``: CONV changes, the ended integration is converted meanwhile, DVALID
    falls, the words are shifted out.

    After reset, and after a fault, the chip is set up: reset, configuration, readback compared, `WARM_UP`
    integrations thrown away. A DVALID that does not fall while there is time to read is SILENT; words that
    are all 0 or all 1 are STUCK; a wrong readback is READBACK.

    Parameters
    ----------
    plan:
        Cycles and the order of the words.

    Members
    -------
    pins : Out
        `DDC_PINS`; all from registers.

    The others: `converter_ports`. CONV changes one cycle after ``start``; its quiet time is kept
    by the plan's deadline. From any state of its registers the controller is in "idle" or "reset" within a
    setup's time: every other state counts down to one of them.
    """

    def __init__(self, plan: DdcPlan, taxels: int):
        self._plan = plan
        super().__init__(outputs(pins=DDC_PINS) | converter_ports(taxels, plan.bits))

    def elaborate(self, platform):
        m = Module()
        plan, pins = self._plan, self.pins
        bits, words = plan.bits, len(plan.places)
        dout = Signal()
        dvalid_n = Signal()
        dvalid_was = Signal()
        m.submodules.data = FFSynchronizer(pins.dout, dout)
        m.submodules.valid = FFSynchronizer(pins.dvalid_n, dvalid_n)
        m.d.sync += dvalid_was.eq(dvalid_n)
        falls = dvalid_was & ~dvalid_n

        clock_timer = Signal(range(plan.clk_half))
        clock_over = clock_timer == 0
        m.d.sync += [
            clock_timer.eq(Mux(clock_over, plan.clk_half - 1, clock_timer - 1)),
            pins.clk.eq(pins.clk ^ clock_over),
        ]

        # ---------------------------------------------------------------- the states' counters
        timer = Signal(range(max(plan.wait, plan.deadline, plan.half) + 1), init=plan.wait)
        place = Signal(range(2 * READBACK_BITS + 1))  # half periods to go: odd ones have the clock high
        over = timer == 0
        warm = Signal(range(WARM_UP + 1))
        shift = Signal(bits)
        left = Signal(range(bits))
        word = Signal(range(words))
        low = Signal()  # all bits of the frame so far are low
        high = Signal()
        wrong = Signal()
        code_due = Signal()
        m.d.sync += timer.eq(timer - ~over)
        halves_over = (place == 0) & over
        falling = over & place[0]  # the data clock's high half ends
        expected, looked_at = (
            Cat(
                Const(pattern, PATTERN_BITS),
                Const(0, REVISION_BITS),
                Const(configuration, CONFIGURATION_BITS),
            )
            for pattern, configuration in ((PATTERN, plan.configuration), (-1, -1))
        )
        index = place[1:]  # of the readback's bits, from its end
        from_end = Signal(range(len(expected)))
        m.d.comb += from_end.eq(index - REPEATED_BITS)
        checked = (index >= REPEATED_BITS) & looked_at.bit_select(from_end, 1)

        wired = Array([Const(taxel is not None, 1) for taxel in plan.places])[word]
        taxel = Array([Const(taxel or 0, len(self.put.place)) for taxel in plan.places])[word]
        drive(m, self.put, valid=code_due & wired, place=taxel, code=shift)
        m.d.sync += code_due.eq(0)

        def wait(cycles: int):
            return timer.eq(cycles - 1)

        def halves(count: int):
            return [place.eq(count), wait(plan.half)]

        def clocked(bit_clock):
            with m.If(over & (place != 0)):
                m.d.sync += [place.eq(place - 1), wait(plan.half), bit_clock.eq(~place[0])]

        def failed(fault: ConverterFault):
            drive(m, self, finished=1, fault=int(fault))
            m.d.sync += wait(plan.wait)
            m.next = "reset"

        with m.FSM(init="reset") as states:
            with m.State("reset"):
                m.d.sync += [pins.reset_n.eq(0), warm.eq(WARM_UP)]  # both data clocks are low
                with m.If(over):
                    m.d.sync += wait(plan.wait)
                    m.next = "wake"
            with m.State("wake"):
                m.d.sync += pins.reset_n.eq(1)
                with m.If(over):
                    m.d.sync += [*halves(2 * CONFIGURATION_BITS), shift.eq(plan.configuration)]
                    m.next = "write"
            with m.State("write"):  # the bit stands from the clock's rise on and is taken at its fall
                clocked(pins.clk_cfg)
                with m.If(over & ~place[0] & (place != 0)):
                    m.d.sync += [pins.din_cfg.eq(shift[CONFIGURATION_BITS - 1]), shift.eq(shift << 1)]
                with m.If(halves_over):
                    m.d.sync += wait(plan.wait)
                    m.next = "latch"
            with m.State("latch"), m.If(over):
                m.d.sync += [*halves(2 * READBACK_BITS), wrong.eq(0)]
                m.next = "check"
            with m.State("check"):
                clocked(pins.dclk)
                with m.If(falling & checked):
                    m.d.sync += wrong.eq(wrong | (dout != expected.bit_select(from_end, 1)))
                with m.If(halves_over):
                    with m.If(wrong):
                        failed(ConverterFault.READBACK)
                    with m.Else():
                        m.d.sync += wait(plan.quiet)
                        m.next = "idle"
            with m.State("idle"), m.If(self.start & over):
                m.d.sync += pins.conv.eq(~pins.conv)
                with m.If(warm != 0):
                    m.d.sync += warm.eq(warm - 1)
                with m.Else():
                    m.d.sync += [
                        timer.eq(plan.deadline - 4),
                        low.eq(1),
                        high.eq(1),
                        left.eq(bits - 1),
                        word.eq(0),
                    ]
                    m.next = "wait"
            with m.State("wait"):
                # one that is earlier belongs to the edge before
                with m.If(falls & (timer < plan.deadline - 4 - plan.quiet)):
                    m.d.sync += halves(2 * bits * words)
                    m.next = "read"
                with m.Elif(over):
                    failed(ConverterFault.SILENT)
            with m.State("read"):
                clocked(pins.dclk)
                with m.If(falling):
                    m.d.sync += [
                        shift.eq(Cat(dout, shift)),
                        low.eq(low & ~dout),
                        high.eq(high & dout),
                        left.eq(Mux(left == 0, bits - 1, left - 1)),
                        code_due.eq(left == 0),
                    ]
                with m.If(code_due):
                    m.d.sync += word.eq(word + 1)
                with m.If(halves_over):
                    with m.If(low | high):
                        failed(ConverterFault.STUCK)
                    with m.Else():
                        m.d.comb += self.finished.eq(1)
                        m.next = "idle"
        reading = states.ongoing("wait") | states.ongoing("read")
        drive(m, self, busy=~states.ongoing("idle"), away=~reading & ((warm != 0) | ~over))
        return m
