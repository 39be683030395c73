"""The serial port to converters: it comes back to idle from any state, one chip is selected at a time, times
are kept."""

from amaranth.hdl import Module, Mux, Signal

from eskin.golden.core import SpiPlan
from eskin.golden.core.converters.spi import SpiChip
from eskin.rtl.interface.spi_master import SpiMaster
from formal.proof import Bug, before, free_inputs, less_is_to_go, opened_up, proof, prove

BITS, HALF, LEAD, HIGH = 4, 2, 3, 5
CHIP = SpiChip(bits=BITS, channels=1, sclk_hz=1e6, conversions_hz=1e6, high_s=0, lead_s=0)
PLAN = SpiPlan(chip=CHIP, lines=2, selects=2, transfers=((0, 0),), half=HALF, lead=LEAD, high=HIGH)
REDUCED = "4 bits, 2 lines, 2 selects, 2, 3 and 5 cycles"


def _port(m: Module):
    dut = SpiMaster(PLAN)
    inside = opened_up(dut)
    free_inputs(dut)
    return dut, inside


@proof(
    "from any state of its counters a transfer that is not begun anew goes on towards idle in every cycle",
    depth=2,
    reduced=REDUCED,
    quick=True,
    bugs=(
        Bug("the timer stops at one", "timer.eq(timer - ~over)", "timer.eq(timer - (timer > 1))", depth=8),
        Bug(
            "the last half period begins the transfer anew",
            "place.eq(place - 1)",
            "place.eq(Mux(last, halves, place - 1))",
            depth=40,
        ),
    ),
)
def back_to_idle(m: Module) -> None:
    dut, inside = _port(m)
    left = Signal(16)  # what is to go: every cycle takes something of it away
    m.d.comb += left.eq((inside.place << len(inside.timer)) + inside.timer)
    less_is_to_go(left, before(dut.start & dut.idle, "begun") | (left == 0))
    prove(dut.idle == (left == 0), "idle where nothing is to go")


@proof(
    "at most one chip is selected, none while the port is idle; the clock moves only with a chip selected "
    "and rests low otherwise",
    depth=3,
    reduced=REDUCED,
    bugs=(
        Bug(
            "select stays low",
            "                m.d.sync += pins.cs_n.eq(~0)\n",
            "                m.d.sync += pins.cs_n.eq(pins.cs_n)\n",
            depth=40,
        ),
        Bug("all chips at once", "pins.cs_n.eq(~(1 << self.select))", "pins.cs_n.eq(0)", depth=8),
        Bug("a clock too many", "pins.sclk.eq(place[0] & ~last)", "pins.sclk.eq(place[0])", depth=40),
    ),
)
def one_chip(m: Module) -> None:
    dut, inside = _port(m)
    none = dut.pins.cs_n.all()
    prove(dut.pins.cs_n.any(), "one chip at most")
    prove((inside.place == 0) == none, "selected while a transfer goes on, and only then")
    prove(~none | ~dut.pins.sclk, "no clock without a chip")
    prove(dut.pins.sclk == ((inside.place != 0) & ~inside.place[0]), "the clock is the place")
    prove(inside.place <= 2 * BITS + 1, "place")


@proof(
    "select is high for its time between transfers, and low for its time before the first clock; each half "
    "period has its cycles",
    depth=3,
    reduced=REDUCED,
    bugs=(
        Bug("no quiet time", "Mux(last, plan.high - 1, plan.half - 1)", "plan.half - 1", depth=40),
        Bug("the first clock comes early", "timer.eq(plan.lead - 1)", "timer.eq(plan.half - 1)", depth=12),
        Bug(
            "a start is taken while select must be high",
            "m.If(self.start & self.idle)",
            "m.If(self.start & (place == 0))",
            depth=40,
        ),
    ),
)
def quiet_times(m: Module) -> None:
    dut, inside = _port(m)
    # cycles so far, at most 15
    high, half, lead = (Signal(4, name=name) for name in ("high", "half", "lead"))
    none, sclk = dut.pins.cs_n.all(), dut.pins.sclk
    was_none, was_clock = before(~none, "was_selected"), before(sclk, "was_clock")
    ever = Signal()  # a transfer has been
    m.d.sync += [
        ever.eq(ever | ~none),
        high.eq(Mux(none, Mux(high == 15, 15, high + 1), 0)),
        lead.eq(Mux(none | (inside.place < 2 * BITS + 1), 0, Mux(lead == 15, 15, lead + 1))),
        half.eq(Mux(sclk == was_clock, Mux(half == 15, 15, half + 1), 1)),
    ]
    fell = ~none & ~was_none
    prove(~fell | ~ever | (high >= HIGH), "quiet time")
    rises = sclk & ~was_clock
    prove(~rises | (inside.place != 2 * BITS) | (lead >= LEAD), "time to the first clock")
    prove((sclk == was_clock) | (inside.place >= 2 * BITS) | (half >= HALF), "half a period")
    # ---- for the induction
    place, timer = inside.place, inside.timer
    prove(place <= 2 * BITS + 1, "place")
    prove(none == (place == 0), "selected while a transfer goes on")
    prove(sclk == ((place != 0) & ~place[0]), "clock")
    prove(~none | ~ever | (high + 1 + timer >= HIGH) | (high == 15), "quiet time to go")
    prove((place != 2 * BITS + 1) | (lead + 1 + timer >= LEAD) | (lead == 15), "lead to go")
    changed = sclk != was_clock
    now = Mux(changed, 0, half)
    prove((place == 0) | (place > 2 * BITS) | (now + 1 + timer >= HALF) | (now == 15), "half to go")
    prove(timer <= max(HALF, LEAD, HIGH) - 1, "timer")
