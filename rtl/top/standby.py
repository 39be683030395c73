"""A board's part without a pin clock: its slow oscillator counts the scans, and its fast one runs only while a scan
is read and the chain works (docs/specification_interfaces.md section 19)."""

import math
from typing import Any

from amaranth.hdl import Module, Signal
from amaranth.lib import wiring
from amaranth.lib.cdc import FFSynchronizer

from eskin.golden.core import AcceleratorConfig
from eskin.golden.core.converters.base import USUAL_HZ
from eskin.golden.core.converters.spi import Spi
from eskin.rtl.common import inputs, outputs
from eskin.rtl.program.schedule import decision_cycles, frame_cycles, mean_frame_cycles, step_cycles

SLOW_HZ, FAST_HZ = 10e3, (6e6, 12e6, 24e6, 48e6)
"""Of an iCE40UP5K: SB_LFOSC, and SB_HFOSC by its divider."""
TOLERANCE = 0.1
"""Both are off by so much at most (the part's data sheet)."""
START_S = 100e-6
"""From power to a stable fast clock, whose output must stay off meanwhile. The oscillator's usage guide says so, from
memory; nobody has measured it here."""
QUIET_CYCLES = 64
"""Fast cycles without any work before the oscillator goes off: more than a converter's port takes behind its last
code, and a command before `busy` shows it."""
CROSSING_CYCLES = 3
"""Slow cycles until the slow domain knows that the fast one is through."""


def start_cycles() -> int:
    """Slow cycles that last START_S, however fast the slow oscillator is."""
    return math.ceil(START_S * SLOW_HZ * (1 + TOLERANCE))


def standby_plan(config: AcceleratorConfig, clock_hz: float) -> Any:
    """The plan by which the converter is read: no limit of its data sheet is broken at the fastest clock that the
    oscillator may have, and it sleeps between scans. With `hz`, and on an unknown chip, its wires are as much faster as the
    clock is."""
    converter = config.interface.converter
    hertz = converter.hz or (USUAL_HZ if isinstance(converter, Spi) else 0.0)
    return converter.replace(hz=(1 + TOLERANCE) * hertz).plan(config, (1 + TOLERANCE) * clock_hz).sleeping


def turn(config: AcceleratorConfig, clock_hz: float) -> tuple[float, float, float, float]:
    """Seconds of a turn of the fast oscillator, at nominal frequencies: from power to output, of the scan, and of all
    that follows without a touch; and the share of time in which a chip of the converter is awake."""
    after = 2 * config.sensor.taxels + mean_frame_cycles(config)[1] + QUIET_CYCLES
    plan = standby_plan(config, clock_hz)
    awake = plan.awake(config.sensor.scan_rate_hz / clock_hz)
    return start_cycles() / SLOW_HZ, plan.scan_cycles / clock_hz, after / clock_hz, awake


def work_cycles(config: AcceleratorConfig, clock_hz: float) -> int:
    """Most fast cycles from a scan's start until the oscillator goes off, by the schedule."""
    chain = (
        2 * config.sensor.taxels + frame_cycles(config) + max(step_cycles(config), decision_cycles(config))
    )
    return standby_plan(config, clock_hz).scan_cycles + chain + QUIET_CYCLES


def cannot_sleep(config: AcceleratorConfig, clock_hz: float) -> str:
    """Why the fast oscillator cannot stop between the scans of this design; empty where it can."""
    rate, interface = config.sensor.scan_rate_hz, config.interface
    if interface.stimulator != "none":
        return "the stimulator's line and times need a clock that always runs"
    if interface.converter.name == "ddc232":
        return "the ddc232 takes its clock from the part and integrates all the time"
    if clock_hz not in FAST_HZ:
        return f"the part's own oscillator makes {', '.join(f'{hertz / 1e6:g}' for hertz in FAST_HZ)} MHz, not this clock"
    work_s = work_cycles(config, clock_hz) / clock_hz / (1 - TOLERANCE)
    needed = start_cycles() + math.ceil(work_s * SLOW_HZ * (1 + TOLERANCE)) + CROSSING_CYCLES
    if needed > SLOW_HZ / rate:
        return (
            f"a start of the own oscillator, a scan and the work take {1e3 * needed / SLOW_HZ:.1f} ms, and {rate:g} scans a "
            f"second leave {1e3 / rate:.2g}"
        )
    return ""


class StandbyControl(wiring.Component):
    """Power and output of a fast oscillator, and the start of each scan; domains ``slow`` (always clocked) and ``sync``
    (clocked by that oscillator).

    The two domains pass turns on by toggles, and each of these is one register: ``request`` and ``settled`` of the
    slow domain, ``done`` of the fast one. Power is on while ``request`` and ``done`` differ, the output while
    ``settled`` and ``done`` do. So both go off at the very edge at which the fast domain is through, without a slow one.
    By then no register has had a new value at its input for ``quiet`` cycles, and the first edges of the
    next turn change the synchroniser alone: a short pulse at either end does no harm.

    Parameters
    ----------
    start:
        Slow cycles from power to output.
    quiet:
        Fast cycles of ``resting`` before the oscillator goes off.

    Members
    -------
    due : In(1), slow
        One cycle: a scan is due. Where the scan before is not through, it is begun behind that.
    resting : In(1), sync
        Nothing moves. It falls in the cycle after ``scan``.
    scan : Out(1), sync
        One cycle: a scan begins.
    power, output : Out(1)
        To the oscillator.

    A scan begins ``start`` slow cycles and 2 to 3 fast ones after the slow edge that ends ``due``.
    """

    def __init__(self, start: int, quiet: int = QUIET_CYCLES):
        self._start, self._quiet = start, quiet
        super().__init__(inputs("due", "resting") | outputs("scan", "power", "output"))

    def elaborate(self, platform):
        m = Module()
        request, settled, done, waiting = (
            Signal(name=name) for name in "request settled done waiting".split()
        )
        self.request, self.settled, self.done, self.waiting = request, settled, done, waiting
        is_done, go, begun = self.is_done, self.go, self.begun = Signal(), Signal(), Signal()
        timer = self.timer = Signal(range(self._start))
        m.submodules.to_slow = FFSynchronizer(done, is_done, o_domain="slow")
        m.submodules.to_fast = FFSynchronizer(settled, go, o_domain="sync")
        m.d.comb += [self.power.eq(request ^ done), self.output.eq(settled ^ done)]

        with m.If((request == is_done) & (self.due | waiting)):
            m.d.slow += [request.eq(~request), waiting.eq(waiting & self.due), timer.eq(self._start - 1)]
        with m.Else():
            m.d.slow += [waiting.eq(waiting | self.due), timer.eq(timer - (timer != 0))]
            with m.If(timer == 0):
                m.d.slow += settled.eq(request)

        still = self.still = Signal(range(self._quiet + 1))
        m.d.comb += self.scan.eq(go != begun)
        m.d.sync += begun.eq(go)
        with m.If(self.scan | ~self.resting):
            m.d.sync += still.eq(0)
        with m.Elif(still != self._quiet):
            m.d.sync += still.eq(still + 1)
        with m.Else():
            m.d.sync += done.eq(begun)
        return m
