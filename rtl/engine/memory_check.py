"""Checksum over the constants in the engine's memories: docs/specification_interfaces.md section 11."""

from functools import reduce
from operator import xor

from amaranth.hdl import Cat, Module, Mux, Signal, Value

from eskin.rtl.common import Block, inputs, outputs, reaches
from eskin.rtl.engine.sequencer import control_layout
from eskin.rtl.program.microcode import Microcode
from eskin.rtl.program.signature import START, TAPS, WIDTH


def folded(value: Value) -> Value:
    """`eskin.rtl.program.signature.fold` as gates."""
    value = Value.cast(value)
    pieces = [value[start : start + WIDTH].as_unsigned() for start in range(0, len(value), WIDTH)]
    return reduce(xor, pieces)


class MemoryCheck(Block):
    """Adds every constant that a step reads to a signature.

    The signature is 0 in the slot of the step's last logit unless a word is wrong. The check itself reads
    nothing and takes no slot: the microcode points idle reads at constants
    (`eskin.rtl.program.microcode.Microcode`).

    Members
    -------
    word : In(control_layout), enable : In(1)
        The slot and its end, of the sequencer.
    weights, addend, gate : In
        Words that the memories read: all lanes' words side by side; the addend; the gate memory's word.
    operand : In(16)
        The element-wise operand: in the last logit's slot made of the words that stand for 0 alone.
    blank : In(16)
        On a shared lane: what the constants' memory adds to a gate; 0, unless the gate memory's word of this
        slot is a constant.
    fault : Out(1)
        One cycle, at the end of the last logit's slot: a word is wrong.

    A fault shows in the slot of the last logit, `eskin.rtl.program.timing.logit_to_decision` cycles before
    the decision it may have changed is offered.
    """

    def ports(self, code: Microcode):
        config = code.plan.config
        return inputs(
            "enable",
            word=control_layout(code),
            weights=config.hardware.lanes * config.weight_bits,
            addend=config.accumulator_bits,
            gate=WIDTH,
            operand=WIDTH,
            blank=WIDTH,
        ) | outputs("fault")

    def elaborate(self, platform):
        m = Module()
        code, word = self.spec, self.word
        plan, layout = code.plan, code.layout
        # The words of this slot were addressed in the previous one.
        counts = Signal()
        weight_read = Signal()
        constant_read = Signal()
        gates = len(plan.program.gate_regions)
        apart = layout.shared and gates  # gates in a memory of their own
        constant = (
            word.gate[layout.constants.bit_length() - 1]
            if apart
            else reaches(word.gate[layout.gate_bits :], gates)
            if gates
            else 1
        )
        addend = folded(self.addend)
        with m.If(self.enable):
            m.d.sync += [
                counts.eq(word.in_step & ~word.ends_step),
                weight_read.eq(word.mac),
                constant_read.eq(constant),
            ]
        if plan.partial_rows:
            biases = len(plan.bias_rows)
            addend_read = Signal()
            with m.If(self.enable):
                m.d.sync += addend_read.eq(
                    (word.addend < biases) | ((word.addend == plan.half_address) & plan.shared)
                )
            addend = Mux(addend_read, addend, 0)
        signature = Signal(WIDTH)
        advanced = Cat(0, signature[:-1]) ^ Mux(signature[-1], TAPS, 0)
        read = Mux(weight_read, folded(self.weights), 0) ^ addend ^ Mux(constant_read, self.gate, 0)
        with m.If(self.enable):
            m.d.sync += signature.eq(Mux(counts, advanced ^ read, START))
        m.d.comb += self.fault.eq(self.enable & word.ends_step & (signature.any() | self.operand.any()))
        if apart:
            with m.If(self.enable & counts & ~constant_read & self.blank.any()):
                m.d.comb += self.fault.eq(1)
        return m
