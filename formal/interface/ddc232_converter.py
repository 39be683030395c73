"""Frames of a DDC232: set-up and frames end from any state, and no data clock comes near an edge of CONV."""

import dataclasses
from unittest import mock

from amaranth.hdl import Module, Mux, Signal

from eskin.golden.core.converters.ddc232 import DdcPlan
from eskin.rtl.interface import ddc232_converter
from eskin.rtl.interface.ddc232_converter import Ddc232Converter
from formal.proof import Bug, assume, before, free_inputs, less_is_to_go, opened_up, proof, prove

PERIOD, QUIET, BITS = 64, 5, 3
PLAN = DdcPlan(
    configuration=5,
    bits=BITS,
    places=(1, None, 0),
    clk_half=1,
    half=2,
    wait=6,
    quiet=QUIET,
    deadline=0,
    dvalid=0,
)
PLAN = dataclasses.replace(PLAN, deadline=PERIOD - QUIET - PLAN.read_cycles)
SHORT = dict(
    CONFIGURATION_BITS=3,
    REVISION_BITS=1,
    PATTERN=1,
    PATTERN_BITS=2,
    EXPECTED_BITS=6,
    READBACK_BITS=6,
    WARM_UP=1,
)
REDUCED = "3 words of 3 bits, a configuration of 3 bits, 6 bits of readback, 64 cycles a frame, quiet for 5, one integration thrown away"


def _chip(m: Module):
    with mock.patch.multiple(ddc232_converter, **SHORT):
        dut = Ddc232Converter(PLAN, 2)
        inside = opened_up(dut)
    free_inputs(dut)
    return dut, inside


def _states(inside) -> dict:
    """Whether each state is the present one, by name."""
    states = inside.states
    return {name: states._data["signal"] == number for name, number in states.encoding.items()}


@proof(
    "from any state of its registers the controller goes on, in every cycle, towards a state in which it is "
    "ready for a frame or begins "
    "the set-up anew; it waits in no other",
    depth=2,
    reduced=REDUCED,
    bugs=(
        Bug("it waits for DVALID for ever", "with m.Elif(over):", "with m.Elif(over & falls):", depth=170),
        Bug("the timer stops at one", "timer.eq(timer - ~over)", "timer.eq(timer - (timer > 1))", depth=20),
        Bug(
            "a clock that does not count down",
            "place.eq(place - 1), wait",
            "place.eq(place - (place != 4)), wait",
            depth=100,
        ),
    ),
)
def goes_on(m: Module) -> None:
    dut, inside = _chip(m)
    now = _states(inside)
    # what is to go: the states in the order in which they follow one another, then half periods, then cycles
    rank = Signal(4)
    order = {"reset": 7, "wake": 6, "write": 5, "latch": 4, "check": 3, "idle": 0, "wait": 2, "read": 1}
    m.d.comb += rank.eq(sum((Mux(state, order[name], 0) for name, state in now.items()), start=0))
    moving = now["write"] | now["check"] | now["read"]
    left = Signal(24)
    m.d.comb += left.eq(rank << 20 | Mux(moving, inside.place << len(inside.timer), 0) | inside.timer)
    failed = before(dut.fault.any(), "failed")
    less_is_to_go(left, before(now["idle"], "was_idle") | failed)
    prove(~failed | now["reset"], "the set-up begins anew after a fault")
    prove(~dut.finished | ~now["idle"], "only what was begun ends")


@proof(
    "with a start every 64 cycles, whatever the chip does, no data clock rises or falls within 5 cycles of "
    "an edge "
    "of CONV, before or after",
    depth=3,
    reduced=REDUCED,
    bugs=(
        Bug(
            "DVALID may come too late",
            "timer.eq(plan.deadline - 4)",
            "timer.eq(plan.deadline + 4)",
            depth=250,
        ),
        Bug(
            "DVALID of the edge before counts",
            "falls & (timer < plan.deadline - 4 - plan.quiet)",
            "falls",
            depth=250,
        ),
    ),
)
def quiet(m: Module) -> None:
    dut, inside = _chip(m)
    pins, timer, place = dut.pins, inside.timer, inside.place
    to_start = Signal(range(PERIOD))
    m.d.sync += to_start.eq(Mux(to_start == 0, PERIOD - 1, to_start - 1))
    prove(to_start < PERIOD, "period")
    assume(dut.start == (to_start == 0))
    conv_was, dclk_was, running = (
        before(pins.conv, "conv_was"),
        before(pins.dclk, "dclk_was"),
        before(1, "running"),
    )
    edge, moved = running & (pins.conv != conv_was), running & (pins.dclk != dclk_was)
    since_conv = Signal(range(QUIET + 1), init=QUIET)
    since_dclk = Signal(range(QUIET + 1), init=QUIET)
    conv_now, dclk_now = Mux(edge, 0, since_conv), Mux(moved, 0, since_dclk)
    for counter, value in ((since_conv, conv_now), (since_dclk, dclk_now)):
        m.d.sync += counter.eq(Mux(value == QUIET, QUIET, value + 1))
    prove(~moved | (conv_now == QUIET), "after CONV")
    prove(~edge | (dclk_now == QUIET), "before CONV")
    # ---- for the induction
    now = _states(inside)
    prove((since_conv <= QUIET) & (since_dclk <= QUIET), "ranges")
    clocked = now["check"] | now["read"]
    prove(pins.dclk == (clocked & (place != 0) & ~place[0]), "the clock is the place")
    resting = ~(now["idle"] | now["wait"])
    prove(~resting | (conv_now == QUIET), "CONV rests in the set-up, and while words are read")
    gone = PERIOD - 1 - to_start  # cycles since the start
    prove(
        ~now["wait"] | ((gone + timer == PLAN.deadline - 4) & (conv_now == Mux(gone > QUIET, QUIET, gone))),
        "deadline",
    )
    prove(~now["wait"] | (dclk_now == QUIET), "the last words were read long ago")
    prove(
        ~now["read"] | (gone + place * PLAN.half + timer <= PERIOD - QUIET - 3), "the words are over in time"
    )
    prove(~now["idle"] | (dclk_now + to_start + 1 >= QUIET) | (dclk_now + timer + 1 >= QUIET), "idle")
