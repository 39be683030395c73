"""The element-wise operations around their multiplier: operands in, narrowed results out."""

from __future__ import annotations

from amaranth.hdl import Cat, Const, Module, Mux, Signal, signed
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from golden.config import AcceleratorConfig
from rtl.fixed import narrow, saturate
from rtl.schedule import CellProgram, ElementOp


def operation_word(program: CellProgram, op: ElementOp | None) -> dict:
    """The instruction fields of ``op`` (None: a gap), as `ElementwiseUnit.word_layout` has them."""
    if op is None:
        return {}
    word: dict = {"active": 1, "two": int(len(op.terms) == 2), "add": int(bool(op.add)), "feature": int(op.state == "x")}
    for term, (a, b) in enumerate(op.terms):
        parts = a.split("-")
        operand = {"x": int(a == "X"), "t": int(parts[0].startswith("T.")), "minus": int(len(parts) == 2)}
        for part in parts:
            memory, _, region = part.partition(".")
            if memory == "S":
                operand["s_region"] = program.state_regions.index(region)
            elif memory == "T":
                operand["t_region"] = program.t_regions.index(region)
        if op.add:
            operand["t_region"] = program.t_regions.index(op.add)
        if b in program.gate_regions:
            operand["b_region"] = program.gate_regions.index(b)
        else:
            operand["b_region"] = len(program.gate_regions)
            operand["constant"] = {"one": 1, "zero": 2, "scale": 3}[b]
        word[f"term{term}"] = operand
    word["write_state"] = int(bool(op.state))
    word["state_region"] = program.state_regions.index(op.state) if op.state else 0
    word["write_t"] = int(bool(op.activated))
    word["activated_region"] = program.t_regions.index(op.activated) if op.activated else 0
    word["hidden"] = int(op.state == program.hidden and not op.name.startswith("clear"))
    return word


def operation_fields(program: CellProgram) -> dict:
    """Layout of the instruction fields."""
    states, ts = range(len(program.state_regions)), range(len(program.t_regions))
    operand = data.StructLayout(
        {"x": 1, "t": 1, "minus": 1, "s_region": states, "t_region": ts, "b_region": range(len(program.gate_regions) + 1), "constant": 2}
    )
    terms = {"term0": operand, "term1": operand}
    results = {"write_state": 1, "state_region": states, "write_t": 1, "activated_region": ts, "hidden": 1}
    return {"active": 1, "two": 1, "add": 1, "feature": 1, **terms, **results}


class ElementwiseUnit(wiring.Component):
    """Around the element-wise lane: chooses its operands from what the memories read, and narrows its accumulator.

    ``a = S[i]``, ``T[i]``, ``S[i] - T[i]`` or the centred window sum; ``b`` from the gate memory; the first term starts from the rounding
    half, plus ``T[i]`` at product scale where asked. Result: floor shift by gate_frac (the half is in), SAT to state_format, or to
    feature_format and aligned for features.

    Members
    -------
    s, t, x, b : In(signed)
        Read data of state, T, centred and gate memory in the cycle after the operation's issue.
    term : In(struct)
        Operand choice of that operation, delayed by one cycle.
    add : In(1)
    a, load : Out
        To the lane, same cycle.
    acc : In(signed(elementwise_bits))
        The lane's accumulator; ``feature`` says which format it becomes. Combinational from here to ``result``.
    feature : In(1)
    result : Out(signed(operand_bits))
        For the state memory.
    code : Out(signed)
        The feature's code without alignment (probe).
    index : Out(signed(index_bits))
        Table index of the result, one cycle later.
    """

    def __init__(self, config: AcceleratorConfig, term_layout: data.StructLayout) -> None:
        self._config = config
        state = signed(config.state_format.width)
        super().__init__(
            {
                "s": In(signed(config.operand_bits)), "t": In(state), "x": In(signed(config.centred_format.width)),
                "term": In(term_layout), "add": In(1), "a": Out(signed(16)), "load": Out(signed(config.elementwise_bits)),
                "acc": In(signed(config.elementwise_bits)), "feature": In(1), "result": Out(signed(config.operand_bits)),
                "code": Out(signed(config.feature_format.width)), "index": Out(signed(config.index_bits)),
            }
        )  # fmt: skip

    def elaborate(self, platform):
        m = Module()
        config, term = self._config, self.term
        plus = Mux(term.x, self.x, Mux(term.t, self.t, self.s))
        minus = Mux(term.minus, self.t, 0)
        half = 1 << config.gate_frac - 1
        # |h - n| <= 2 in the state's scale (both are tanh values or blends of them), so a 16-bit operand holds the difference
        m.d.comb += [
            self.a.eq(saturate(plus - minus, config.centred_format)),
            self.load.eq(Mux(self.add, Cat(Const(half, config.gate_frac), self.t).as_signed(), half)),
        ]
        shifted = Signal(signed(config.elementwise_bits - config.gate_frac))
        state = saturate(shifted, config.state_format)
        m.d.comb += [
            shifted.eq(self.acc >> config.gate_frac),
            self.code.eq(saturate(shifted, config.feature_format)),
            self.result.eq(Mux(self.feature, self.code << config.feature_align, state)),
        ]
        if config.state_index_shift > 0:
            m.d.sync += self.index.eq(narrow(state, config.state_index_shift, config.index_format))
        return m
