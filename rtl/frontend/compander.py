"""Window sums to their logarithm, straight between powers of two (docs/specification.md, section 3)."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common.fixed import biased_magnitude, logarithm
from eskin.rtl.common.layouts import sum_layout


class Compander(wiring.Component):
    """``sign(d) * ((e - K) * 2**F + floor(2**F * b / 2**e) - 2**F)``, ``b = |d| + 2**K``, ``2**e`` the
    largest power of two in b.

    The bits of b below its leading one already are the fraction, so this needs neither a logarithm nor a
    product. The position of the leading one is the integer part and selects the F bits.

    Parameters
    ----------
    config:
        The accelerator's configuration, ``compand`` log: K = ``compand_knee``, F = ``compand_frac``.

    Ports
    -----
    i : In(stream of ``sum_layout``)
    o : Out(stream of ``sum_layout``)
        The same windows with companded sums, as complements like the sums; integrals as they are.

    Timing
    ------
    One beat a cycle, out one cycle after it was taken. The result leaves through the logic behind the
    register.
    """

    def __init__(self, config: AcceleratorConfig):
        self.config = config
        layout = sum_layout(config)
        super().__init__({"i": In(stream.Signature(layout)), "o": Out(stream.Signature(layout))})

    def elaborate(self, platform):
        config, m = self.config, Module()
        knee, fraction, width = config.features.compand_knee, config.features.compand_frac, config.sum_bits
        biased = Signal(width)  # at most 2**(width - 1) + 2**knee, which has width bits
        negative = Signal()
        passed = Signal.like(self.o.p)
        is_negative = ~self.i.p.complement[-1]
        m.d.comb += self.i.ready.eq(~self.o.valid | self.o.ready)
        with m.If(self.i.ready):
            m.d.sync += self.o.valid.eq(self.i.valid)
        with m.If(self.i.valid & self.i.ready):
            m.d.sync += [
                biased.eq(biased_magnitude(self.i.p.complement, knee)),
                negative.eq(is_negative),
                passed.eq(self.i.p),
            ]

        companded = Signal(width - 1)
        logarithm(m, companded, biased, knee, fraction)
        result = Mux(negative, companded - 1, ~Cat(companded, Const(0, 1)))
        if "integral" in config.features.feature_kinds:  # companded already
            result = Mux(
                passed.kind == config.features.feature_kinds.index("integral"), passed.complement, result
            )
        m.d.comb += [self.o.p.eq(passed), self.o.p.complement.eq(result)]
        return m
