"""M of K: the onset rule holds in M of the last K frames that it was applied to (docs/specification.md,
section 2)."""

from amaranth.hdl import Cat, Module, Signal

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import Block, inputs, outputs, struct


class OnsetFilter(Block):
    """High where at least ``onset_hits`` of the last ``onset_span`` judged frames, this one included, fulfil
    the rule.

    Parameters
    ----------
    config:
        The accelerator's configuration, ``onset_span`` > 1.

    Ports
    -----
    i : In(struct: valid, hit)
        ``hit``: this frame fulfils the rule. ``valid``: the rule is applied to the frame, which ends with
        this cycle; there is no back-pressure.
    met : Out(1)
        Combinational from ``hit``, 0 cycles.
    """

    def ports(self, config: AcceleratorConfig):
        return inputs(i=struct("valid", "hit")) | outputs("met")

    def elaborate(self, platform):
        config, m = self.spec, Module()
        past = Signal(config.onset_rule.onset_span - 1)
        with m.If(self.i.valid):
            m.d.sync += past.eq(Cat(self.i.hit, past))
        m.d.comb += self.met.eq(sum(Cat(self.i.hit, past)) >= config.onset_rule.onset_hits)
        return m
