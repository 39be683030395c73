"""Sample narrower: a sample from a converter's code by offset, shift, saturation (docs/specification_interfaces.md
section 12)."""

from amaranth.hdl import Module

from eskin.golden.core import AcceleratorConfig
from eskin.golden.core.converters import code_bits, code_offset, code_shift
from eskin.rtl.common import Block, inputs, narrow, outputs, saturate, shape_of


class SampleNarrower(Block):
    """SAT(RND((code - offset) / 2**shift)), combinational; a shift below 0 appends zeros.

    Members
    -------
    code : In(code bits), unsigned
    sample : Out(sample_format)
    """

    def ports(self, config: AcceleratorConfig):
        return inputs(code=code_bits(config)) | outputs(sample=shape_of(config.sample_format))

    def elaborate(self, platform):
        m = Module()
        config, shift, offset = self.spec, code_shift(self.spec), code_offset(self.spec)
        centred = self.code - offset
        result = (
            narrow(centred, shift, config.sample_format)
            if shift >= 0
            else saturate(centred << -shift, config.sample_format)
        )
        m.d.comb += self.sample.eq(result)
        return m
