"""The clock of a chip's whole chain, stopped while no register could change: one gate, no register outside
it."""

from amaranth.hdl import (
    ClockDomain,
    ClockSignal,
    DomainRenamer,
    Elaboratable,
    EnableInserter,
    Instance,
    Module,
    ResetSignal,
    Value,
)

from eskin.rtl.common import CHIP

CELL = "top_clock_gate"
"""The clock-gate cell, which each process names differently. Ports: CLK, CE, GCLK; CE is held while CLK is
high."""


def gated(chain: Elaboratable, needed: Value, platform: str | None) -> Module:
    """``chain`` with clock edges only where ``needed``.

    The edge at the end of a cycle passes when ``needed`` is high in that cycle. So the waking input is
    sampled at the same edge as without the gate, and no cycle is lost. ``needed`` must settle before the
    edge, like any register's input.

    Parameters
    ----------
    needed:
        A value of ``chain``'s, made of its registers and inputs.
    platform:
        ``CHIP``: a clock gate. Otherwise the same in enables: for simulation and proofs, which cannot model a
        gated clock.
    """
    m = Module()
    if platform == CHIP:
        m.domains.awake = ClockDomain("awake", local=True)
        m.submodules.gate = Instance(CELL, i_CLK=ClockSignal(), i_CE=needed, o_GCLK=ClockSignal("awake"))
        m.d.comb += ResetSignal("awake").eq(ResetSignal())
        m.submodules.chain = DomainRenamer("awake")(chain)
    else:
        m.submodules.chain = EnableInserter(needed)(chain)
    return m
