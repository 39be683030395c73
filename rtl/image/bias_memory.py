"""The image engine's biases, each with its layer's rounding half. The chain takes one a cycle."""

from amaranth.hdl import Cat, Module, Signal, signed
from amaranth.lib.wiring import In, Out

from eskin.golden.core.images import BIAS_BITS
from eskin.rtl.common import HOST_BITS, Block, drive, inputs, working_memory
from eskin.rtl.program.image_passes import ImagePlan

ADDEND_BITS = BIAS_BITS + 1
"""A bias and a rounding half of at most as many bits: `eskin.rtl.program.image_signature.BIAS_WORD_BITS`."""


class BiasMemory(Block):
    """Each word is two words of the host's, low half first.

    Members
    -------
    restart : In(1), first : In
        The next word is ``first``.
    addend : Out(signed(25))
        Word ``first`` two cycles after ``restart``, then one a cycle.
    parity : Out(1)
        With ``checksum``: the bit on top of the word.
    load : In(1), load_address : In(16), load_word : In(16)
    """

    def ports(self, plan: ImagePlan):
        reading = {
            "restart": In(1),
            "first": In(plan.address_bits),
            "addend": Out(signed(ADDEND_BITS)),
            "parity": Out(1),
        }
        return inputs("load", load_address=HOST_BITS, load_word=HOST_BITS) | reading

    def elaborate(self, platform):
        m = Module()
        # A group of a dense layer may be narrower than the chain, which then takes the words after it too.
        depth = self.spec.addend_words + self.spec.lanes
        address = Signal(range(depth))
        parts = []
        m.d.sync += address.eq(address + 1)
        with m.If(self.restart):
            m.d.sync += address.eq(self.first)
        for half, bits in enumerate((16, ADDEND_BITS - 16 + self.spec.checksum)):
            read, write = working_memory(m, f"half_{half}", bits, depth)
            m.d.comb += read.addr.eq(address)
            drive(
                m,
                write,
                addr=self.load_address >> 1,
                data=self.load_word,
                en=self.load & (self.load_address[0] == half),
            )
            parts.append(read.data)
        word = Cat(*parts)
        drive(m, self, addend=word, parity=word[ADDEND_BITS:])
        return m
