"""Sample clock: the declared frame rate from the clock (docs/specification_interfaces.md section 12)."""

from amaranth.hdl import Const, Module, Mux, Signal
from amaranth.lib import wiring

from eskin.rtl.common import inputs, outputs


class SampleClock(wiring.Component):
    """``tick`` p times in q cycles: the first in the first cycle of ``run``, number k in cycle ceil(k q / p)
    from there.

    Parameters
    ----------
    p, q:
        Rate over clock in lowest terms (`eskin.golden.core.converters.sample_clock`); p < q.

    Members
    -------
    run : In(1)
        Low: no tick, and the next begins a new count.
    tick : Out(1)
        One cycle; combinational from ``run`` only in the first.

    Jitter: none if p is 1, otherwise below one cycle; it does not accumulate.
    """

    def __init__(self, p: int, q: int):
        self._p, self._q = p, q
        super().__init__(inputs("run") | outputs("tick"))

    def elaborate(self, platform):
        m = Module()
        p, q = self._p, self._q
        since = Signal(range(q), init=q - p)  # p times the cycles since the tick that was due, less than q
        due = since >= q - p
        m.d.comb += self.tick.eq(self.run & due)
        following = Mux(due, since - Const(q - p), since + p)
        m.d.sync += since.eq(Mux(self.run, following, q - p))
        return m
