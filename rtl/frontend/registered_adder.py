"""An adder with its register, in a DSP block that would be idle (docs/specification.md, sections 2 and 3)."""

from amaranth.hdl import Module, Mux, Signal, signed
from amaranth.lib import wiring

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import SMALL_FAMILY, inputs, outputs, sb_mac16

BLOCKS, BLOCK_BITS = 8, 32
"""SB_MAC16 of an iCE40 UP5K; bits that one adds."""


class RegisteredAdder(wiring.Component):
    """Adds: ``total = word + addend + carry``, or ``addend`` alone.

    On an iCE40 whose lanes leave an SB_MAC16 idle the sum sits in it, where it takes no logic cell; the same
    behaviour is described plainly for any other. tests/rtl/frontend/test_registered_adder.py compares the
    two, with the vendor's cell model.

    Parameters
    ----------
    config:
        The accelerator's configuration.
    bits:
        Width of the sum.
    carry:
        0 or 1.
    before:
        Number of these adders that get an idle block first.

    Members
    -------
    step : In(1)
        Add at the next clock edge.
    alone : In(1)
        ``word`` does not count.
    word, addend : In(signed(bits))
    total : Out(signed(bits))
        After the edge, until the next ``step``.
    """

    def __init__(self, config: AcceleratorConfig, bits: int, *, carry: int = 0, before: int = 0):
        lanes = config.hardware.lanes
        # several lanes have one more beside them, for element-wise operations
        idle = config.hardware.lane_type == "dsp" and lanes + (lanes > 1) + before < BLOCKS
        self._in_block, self._carry = idle and bits <= BLOCK_BITS, carry
        shape = signed(bits)
        super().__init__(inputs("step", "alone", word=shape, addend=shape) | outputs(total=shape))

    def elaborate(self, platform):
        m = Module()
        if platform == SMALL_FAMILY and self._in_block:
            self._block(m)
            return m
        total = Signal.like(self.total, reset_less=True)
        m.d.comb += self.total.eq(total)
        with m.If(self.step):
            # ``alone`` is a register, so that its choice shares the adder's cells
            m.d.sync += total.eq(Mux(self.alone, self.addend, self.word + self.addend + self._carry))
        return m

    def _block(self, m: Module) -> None:
        word = Signal(signed(BLOCK_BITS))
        addend, out = Signal.like(word), Signal.like(word)
        m.d.comb += [word.eq(self.word), addend.eq(self.addend), self.total.eq(out)]
        m.submodules.mac = sb_mac16(
            out,
            self.step,
            word[16:],
            word[:16],
            addend,
            p_TOPADDSUB_LOWERINPUT=0,
            p_BOTADDSUB_LOWERINPUT=0,  # A:B
            p_TOPADDSUB_UPPERINPUT=1,
            p_BOTADDSUB_UPPERINPUT=1,  # plus C:D
            p_BOTADDSUB_CARRYSELECT=self._carry,
            i_OLOADTOP=self.alone,
            i_OLOADBOT=self.alone,
        )
