"""The early decision: several in a row agree, each by a large enough margin (specification, section 7)."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import wiring

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import inputs, outputs


class EarlyRule(wiring.Component):
    """High when the offered local decision is the ``early_steps``-th in a row for one class.

    Each of them must have a margin of at least ``early_margin``.

    Members
    -------
    best, margin : In
        Class and margin (not negative) of the local decision that is offered.
    taken : In(1)
        It is taken.
    ended : In(1)
        The touch ends, which forgets what was seen.
    met : Out(1)
        Combinational from ``best`` and ``margin``, 0 cycles.
    """

    def __init__(self, config: AcceleratorConfig, margin_bits: int):
        self._config = config
        super().__init__(
            inputs("taken", "ended", best=range(config.classes), margin=margin_bits) | outputs("met")
        )

    def elaborate(self, platform):
        m = Module()
        steps = self._config.network.early_steps
        # decisions just before this one that count, early_steps - 1 at most; no bits if a decision counts at once
        agreed = self.agreed = Signal(range(steps))
        before = self.before = Signal.like(self.best)
        counts = Signal()
        m.d.comb += counts.eq((agreed == steps - 1) & ((self.best == before) | (steps == 1)))
        enough = self.margin >= self._config.network.early_margin
        m.d.comb += self.met.eq(enough & counts)
        with m.If(self.taken):
            m.d.sync += before.eq(self.best)
            follows = (agreed != 0) & (self.best == before)
            m.d.sync += agreed.eq(Mux(enough, Mux(follows, Mux(counts, agreed, agreed + 1), 1), 0))
        with m.If(self.ended):
            m.d.sync += agreed.eq(0)
        return m
