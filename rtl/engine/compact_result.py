"""What a STORE of the compact engine writes: the accumulator saturated, or a table's answer
(docs/specification.md, section 4)."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from eskin.golden.core import AcceleratorConfig, QFormat
from eskin.rtl.engine.activation_unit import ActivationUnit
from eskin.rtl.program.compact_program import DATA_BITS, CompactProgram, Kind


class CompactResult(wiring.Component):
    """Saturates the accumulator, or gives a table's answer.

    The addends already contain the rounding half. ``result`` is combinational; a table answers the index of
    the STORE before.

    Members
    -------
    acc, left : In
        Of `eskin.rtl.engine.compact_accumulator.CompactAccumulator`.
    store : In(1)
        The instruction is a STORE: the table is looked up.
    kind : In(2)
        The format (`eskin.rtl.program.compact_program.Kind`).
    table : In(1)
        The table's answer, or the bits that were shifted out where a sum is carried, in the place of the
        accumulator.
    tanh : In(1)
        Which table.
    result : Out(signed(16))
        What is written.
    """

    def __init__(self, config: AcceleratorConfig, code: CompactProgram) -> None:
        self._config, self._code = config, code
        super().__init__(
            {
                "acc": In(signed(code.accumulator_bits)),
                "left": In(config.kept_low_bits),
                "store": In(1),
                "kind": In(2),
                "table": In(1),
                "tanh": In(1),
                "result": Out(signed(DATA_BITS)),
            }
        )

    def elaborate(self, platform):
        m = Module()
        config, code, acc, kind = self._config, self._code, self.acc, self.kind
        formats = {Kind.LOGIT: config.formats.logit_format, Kind.FEATURE: config.formats.feature_format} | (
            {Kind.STATE: QFormat(DATA_BITS, 0)}
            if code.carries
            else {Kind.INDEX: config.index_format, Kind.STATE: config.formats.state_format}
        )  # a carried sum's words fit: `AcceleratorConfig.kept_low_bits`
        answers = Signal()
        sign = acc[-1]
        exceeds = Signal()
        m.d.comb += answers.eq(self.store & self.table)
        with m.Switch(kind):
            for result_kind, fmt in formats.items():
                above = acc[min(fmt.width, len(acc)) - 1 : -1]
                with m.Case(result_kind):
                    m.d.comb += exceeds.eq((above != sign.replicate(len(above))) & ~answers)
        if code.carries:  # and has no tables
            answer = Cat(self.left, Const(0, 1))
        else:
            m.submodules.activation = table = ActivationUnit(config)
            answer = Mux(self.tanh, ~table.not_state, table.gate)
            index = Cat(self.result[: config.index_bits - 1], sign)
            m.d.comb += [table.enable.eq(self.store), table.tanh.eq(self.tanh), table.index.eq(index)]
        # One LUT a bit chooses between the accumulator, the table and, where the value exceeds its format, 0
        # and 1.
        for bit in range(DATA_BITS):
            within = {result_kind for result_kind, fmt in formats.items() if bit < fmt.width - 1}
            if len(within) == len(formats):
                level = ~sign
            else:
                level = sign
                for result_kind in within:
                    level = Mux(kind == result_kind, ~sign, level)
            chosen = Signal(2, name=f"choice_{bit}")
            m.d.comb += chosen.eq(Cat(Mux(exceeds, level, answers), exceeds))
            sum_bit, table_bit = acc[min(bit, len(acc) - 1)], answer[min(bit, len(answer) - 1)]
            m.d.comb += self.result[bit].eq(Mux(chosen[1], chosen[0], Mux(chosen[0], table_bit, sum_bit)))
        return m
