"""The narrowing of a finished row: to a table index, a value or a logit."""

from __future__ import annotations

from amaranth.hdl import Module, Mux, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from golden.config import AcceleratorConfig
from rtl.fixed import saturate


class RowNarrowing(wiring.Component):
    """``narrow(total)`` of SPECIFICATION.md section 4; the addend held the rounding half, so it is a floor shift and SAT. Combinational.

    Members
    -------
    total : In(signed(accumulator_bits))
        Sum of a row, addend included.
    tanh : In(1)
        Index for the tanh table instead of the sigmoid's.
    index : Out(signed(index_bits))
    value : Out(signed), logit : Out(signed)
        In state_format and logit_format.
    """

    def __init__(self, config: AcceleratorConfig) -> None:
        self._config = config
        super().__init__(
            {
                "total": In(signed(config.accumulator_bits)), "tanh": In(1), "index": Out(signed(config.index_bits)),
                "value": Out(signed(config.state_format.width)), "logit": Out(signed(config.logit_format.width)),
            }
        )  # fmt: skip

    def elaborate(self, platform):
        m = Module()
        config, total = self._config, self.total
        # tanh's index has one fraction bit more: shift by one bit less, then both are narrowed alike
        fine = total >> config.tanh_shift
        aligned = Mux(self.tanh, fine, fine >> config.sigmoid_shift - config.tanh_shift)
        logit = total >> config.logit_shift
        m.d.comb += [
            self.index.eq(saturate(aligned, config.index_format)),
            self.value.eq(saturate(total >> config.value_shift, config.state_format)),
            self.logit.eq(logit[: config.logit_format.width] if config.logit_proven else saturate(logit, config.logit_format)),
        ]
        return m
