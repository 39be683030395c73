"""The narrowing of a finished row: to a table index, a value or a logit (docs/specification.md, section
4)."""

from amaranth.hdl import Cat, Module, Mux, Signal, signed

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import Block, drive, inputs, not_all_equal, outputs, saturate


class RowNarrowing(Block):
    """``narrow(total)`` of docs/specification.md section 4, combinational.

    The addend already holds the rounding half, so this is a floor shift and SAT.

    Members
    -------
    total : In(signed(accumulator_bits))
        Sum of a row, addend included.
    tanh : In(1)
        Index for the tanh table instead of the sigmoid's.
    index : Out(signed(index_bits))
        0 in a linear cell, as ``value``.
    value : Out(signed), logit : Out(signed)
        In state_format and logit_format.
    """

    def ports(self, config: AcceleratorConfig):
        return inputs("tanh", total=signed(config.accumulator_bits)) | outputs(
            index=signed(config.index_bits),
            value=signed(config.formats.state_format.width),
            logit=signed(config.formats.logit_format.width),
        )

    def elaborate(self, platform):
        m = Module()
        config, total = self.spec, self.total
        logit = total >> config.logit_shift
        m.d.comb += self.logit.eq(
            logit if config.logit_proven else saturate(logit, config.formats.logit_format)
        )
        if not config.recurrent:  # no row of a linear cell is anything but a logit
            return m
        # tanh's index has one fraction bit more, so one bit less above it. Both overflows are computed before
        # the late choice between them.
        more, low = config.sigmoid_shift - config.tanh_shift, config.index_bits - 1
        fine = Signal(signed(max(config.accumulator_bits - config.tanh_shift, low + more)))
        m.d.comb += fine.eq(total >> config.tanh_shift)
        negative = fine[-1]
        over = Signal()
        over_fine = Signal()
        m.d.comb += [
            over.eq(not_all_equal(fine[low + more :])),
            over_fine.eq(not_all_equal(fine[low : low + more + 1])),
        ]
        index = Mux(self.tanh, fine[:low], fine[more : low + more])
        index = Mux(over | (self.tanh & over_fine), (~negative).replicate(low), index)
        drive(
            m,
            self,
            index=Cat(index, negative),
            value=saturate(total >> config.value_shift, config.formats.state_format),
        )
        return m
