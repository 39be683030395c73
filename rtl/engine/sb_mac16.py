"""A lane in the iCE40's DSP block, accumulator and all (docs/specification.md, section 4)."""

from amaranth.hdl import Const, Module, Signal
from amaranth.lib import wiring

from eskin.rtl.common import sb_mac16

ICE40 = "ice40"
"""Platform name for which the lane becomes an SB_MAC16; for any other it is described by its behaviour."""


class DspLane(wiring.Component):
    """`eskin.rtl.engine.lanes.lane_signature` on one SB_MAC16 with registered operands and the block's 32-bit
    accumulator.

    A lane that accumulates loads its accumulator in a separate slot: the schedule's gap keeps ``swap`` and
    ``valid`` apart. Otherwise the load comes in through the registers of inputs C and D and is added to the
    product.

    On other targets the same behaviour is described plainly. tests/rtl/engine/test_sb_mac16.py compares the
    two, with the vendor's cell model.
    """

    def elaborate(self, platform):
        m = Module()
        (self._block if platform == ICE40 else self._behaviour)(m)
        return m

    @property
    def _adds_load(self) -> bool:
        return not self.signature.accumulates

    def _behaviour(self, m: Module) -> None:
        a = Signal.like(self.a, reset_less=True)
        b = Signal.like(self.b, reset_less=True)
        load = Signal.like(self.load, reset_less=True)
        total = Signal.like(self.acc, reset_less=True)
        m.d.comb += self.acc.eq(total)
        with m.If(self.tick):
            m.d.sync += [a.eq(self.a), b.eq(self.b), load.eq(self.load)]
            if self._adds_load:
                with m.If(self.valid):
                    m.d.sync += total.eq(load + a * b)
            else:
                with m.If(self.swap):
                    m.d.sync += total.eq(self.load)
                with m.Elif(self.valid):
                    m.d.sync += total.eq(total + a * b)

    def _block(self, m: Module) -> None:
        def wide(value, bits: int) -> Signal:
            signal = Signal(bits)
            m.d.comb += signal.eq(value)
            return signal

        load = wide(self.load, 32)
        out = Signal(32)
        own_load = not self._adds_load
        hold = wide(~(self.valid | self.swap) if own_load else ~self.valid, 1)
        load_now = self.swap if own_load else Const(0)
        m.d.comb += self.acc.eq(out)
        adds = int(self._adds_load)
        m.submodules.mac = sb_mac16(
            out,
            self.tick,
            wide(self.a, 16),
            wide(self.b, 16),
            load,
            p_A_SIGNED=1,
            p_B_SIGNED=1,
            p_A_REG=1,
            p_B_REG=1,
            p_C_REG=adds,
            p_D_REG=adds,
            p_TOPADDSUB_LOWERINPUT=2,
            p_BOTADDSUB_LOWERINPUT=2,  # the 32-bit product
            p_TOPADDSUB_UPPERINPUT=adds,
            p_BOTADDSUB_UPPERINPUT=adds,  # plus the sum, or C:D
            p_BOTADDSUB_CARRYSELECT=0,
            i_OLOADTOP=load_now,
            i_OLOADBOT=load_now,
            i_OHOLDTOP=hold,
            i_OHOLDBOT=hold,
        )
