"""The element-wise operations around their multiplier: operands in, narrowed results out
(docs/specification.md, section 5)."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, signed
from amaranth.lib import wiring

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import drive, inputs, narrow, outputs, saturate
from eskin.rtl.program.scheduler import Schedule
from eskin.rtl.program.timing import ELEMENT_OPERAND_BITS


class ElementwiseUnit(wiring.Component):
    """Element-wise operations around their lane: chooses the operand from the memories' words, and narrows
    the sum.

    ``a = S[i]``, ``T[i]``, ``S[i] - T[i]`` or the centred window sum; a sum starts from the rounding half,
    plus ``T[i]`` at product scale where asked. Result: floor shift by gate_frac (the half is in), SAT to
    state_format, or to feature_format and aligned for features.

    Members
    -------
    s, not_t, x : In(signed)
        Words of the state memory, the T memory (complements) and the window buffer.
    use_t, minus : In(1)
        Operand: ``use_t`` takes T instead of the state, ``minus`` subtracts T. When ``x`` is not 0, the state
        is 0 and nothing is subtracted.
    a : Out(signed(16))
    add : In(1)
        Load T too.
    load : Out(signed(elementwise_bits))
        First value of a sum; on a shared lane without the half, which comes from the addend memory.
    acc : In(signed(elementwise_bits)), feature : In(1)
        A finished sum, and whether it is a feature.
    code : Out(signed)
        The feature's code without alignment (probe).
    result : Out(signed(operand_bits))
        For the state memory.
    tick : In(1), index : Out(signed(index_bits))
        Table index of the result, registered at ``tick``.
    """

    def __init__(self, config: AcceleratorConfig, plan: Schedule):
        self._config, self._plan = config, plan
        state = signed(config.formats.state_format.width)
        super().__init__(
            inputs(
                "use_t",
                "minus",
                "add",
                "feature",
                "tick",
                s=signed(config.operand_bits),
                not_t=state,
                x=signed(config.centred_format.width),
                acc=signed(config.elementwise_bits),
            )
            | outputs(
                a=signed(ELEMENT_OPERAND_BITS),
                load=signed(config.elementwise_bits),
                code=signed(config.formats.feature_format.width),
                result=signed(config.operand_bits),
                index=signed(config.index_bits),
            )
        )

    def elaborate(self, platform):
        m = Module()
        config = self._config
        half = 0 if self._plan.shared else 1 << config.formats.gate_frac - 1
        # |h - n| <= 2 in the state's scale (both are tanh values or blends of them), so a 16-bit operand
        # holds the difference. Features in the state memory have up to 16 bits and come with T = 0. A window
        # sum comes with a difference of 0, so an exclusive or selects between them in the adder's own cells.
        # T comes as a complement, and -T = not_t + 1. The + 1 is always there; where nothing is subtracted it
        # cancels the -1.
        difference = Signal(signed(ELEMENT_OPERAND_BITS))
        m.d.comb += difference.eq(Mux(self.use_t, ~self.not_t, self.s) + Mux(self.minus, self.not_t, -1) + 1)
        drive(
            m,
            self,
            a=self.x ^ difference,
            load=Cat(Const(half, config.formats.gate_frac), Mux(self.add, ~self.not_t, 0)).as_signed(),
        )
        shifted = self.acc >> config.formats.gate_frac
        m.d.comb += self.code.eq(saturate(shifted, config.formats.feature_format))
        state = saturate(shifted, config.formats.state_format)
        states = [op for op in self._plan.program.elements if op.state and op.state != "x"]
        fits = (
            config.feature_align == 0
            and config.formats.feature_format.width >= config.formats.state_format.width
        )
        if not states or (fits and all(op.between for op in states)):
            # only features saturate, and a state fits their format as it is
            m.d.comb += self.result.eq(self.code)
        else:
            m.d.comb += self.result.eq(Mux(self.feature, self.code << config.feature_align, state))
        if config.recurrent and config.state_index_shift > 0:
            with m.If(self.tick):
                m.d.sync += self.index.eq(narrow(state, config.state_index_shift, config.index_format))
        return m
