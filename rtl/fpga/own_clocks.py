"""A design on the own oscillators of an iCE40UP5K, as the top of a bitstream."""

from amaranth.hdl import ClockDomain, ClockSignal, Const, DomainRenamer, Instance, Module
from amaranth.lib import wiring

from eskin.golden.core.converters import sample_clock
from eskin.rtl.common import forward, members_but
from eskin.rtl.interface.sample_clock import SampleClock
from eskin.rtl.top.standby import FAST_HZ, SLOW_HZ, StandbyControl, start_cycles

DIVIDERS = dict(zip(FAST_HZ, ("0b11", "0b10", "0b01", "0b00"), strict=True))
"""CLKHF_DIV of SB_HFOSC by frequency."""


class OnOwnClocks(wiring.Component):
    """``inner``, which has ``scan`` and ``resting`` (`eskin.rtl.top.system.System` with a plan), clocked by SB_HFOSC,
    whose scans SB_LFOSC counts. Its other ports are pins.

    There is no reset: the part gives every register its reset value when it is configured, and the first fast edge
    comes `start_cycles` later, when block memories can be read (`eskin.rtl.fpga.synthesis.BLOCK_MEMORY_S`).

    Parameters
    ----------
    rate_hz:
        Scans a second; where they are no whole number of slow cycles, a scan is up to a slow cycle late
        (`SampleClock`).
    clock_hz:
        One of FAST_HZ.
    """

    def __init__(self, inner: wiring.Component, rate_hz: float, clock_hz: float):
        self._inner, self._rate_hz, self._clock_hz = inner, rate_hz, clock_hz
        super().__init__(members_but(inner, "scan", "resting"))

    def elaborate(self, platform):
        m = Module()
        m.domains += ClockDomain("slow", reset_less=True), ClockDomain("sync", reset_less=True)
        m.submodules.standby = control = StandbyControl(start_cycles())
        m.submodules.slow = Instance(
            "SB_LFOSC", i_CLKLFPU=Const(1), i_CLKLFEN=Const(1), o_CLKLF=ClockSignal("slow")
        )
        m.submodules.fast = Instance(
            "SB_HFOSC",
            p_CLKHF_DIV=DIVIDERS[self._clock_hz],
            i_CLKHFPU=control.power,
            i_CLKHFEN=control.output,
            o_CLKHF=ClockSignal("sync"),
        )
        m.submodules.scans = clock = DomainRenamer("slow")(SampleClock(*sample_clock(SLOW_HZ, self._rate_hz)))
        m.submodules.inner = inner = self._inner
        m.d.comb += [
            clock.run.eq(1),
            control.due.eq(clock.tick),
            control.resting.eq(inner.resting),
            inner.scan.eq(control.scan),
        ]
        forward(m, self, inner)
        return m
