"""Two buttons by which a board without a host is taught: docs/specification.md, section 18."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import In, Out

SAMPLE_S = 20e-3
"""Seconds between looks at the buttons: contacts bounce for less, so at most one look falls into it."""
HELD = 50
"""Looks from which on a button is held: one second."""


class TeachButtons(wiring.Component):
    """A button counts as down, or up, when two looks in a row say so.

    Parameters
    ----------
    sample_cycles:
        Cycles from look to look.

    Members
    -------
    choose_n, teach_n : In(1)
        To ground while pressed; not synchronous.
    chosen, taught : Out(1)
        Pulse: ``choose_n``, ``teach_n`` was released within a second.
    forgotten, named : Out(1)
        Pulse: it has been held for a second; its release then says nothing more.
    look : Out(1)
        Pulse, every ``sample_cycles``; the others come with it.
    """

    def __init__(self, sample_cycles: int) -> None:
        self._sample_cycles = sample_cycles
        outputs = ("chosen", "forgotten", "taught", "named", "look")
        super().__init__(
            {name: In(1, init=1) for name in ("choose_n", "teach_n")} | {name: Out(1) for name in outputs}
        )

    def elaborate(self, platform):
        m = Module()
        left = Signal(range(self._sample_cycles))
        looks_now = Signal()
        m.d.comb += looks_now.eq(left == 0)
        m.d.sync += [left.eq(Mux(looks_now, self._sample_cycles - 1, left - 1)), self.look.eq(looks_now)]
        for line, short, held in (
            (self.choose_n, self.chosen, self.forgotten),
            (self.teach_n, self.taught, self.named),
        ):
            now = Signal(init=1)
            before = Signal(init=1, name="line_before")
            down, looks = Signal(name="down"), Signal(range(HELD + 1), name="looks")
            m.submodules += FFSynchronizer(line, now, init=1)
            m.d.sync += [short.eq(0), held.eq(0)]
            with m.If(looks_now):
                m.d.sync += before.eq(now)
                with m.If(now == before):
                    m.d.sync += [
                        down.eq(~now),
                        looks.eq(Mux(now, 0, looks + (looks != HELD))),
                        short.eq(now & down & (looks != HELD)),
                        held.eq(~now & (looks == HELD - 1)),
                    ]
        return m
