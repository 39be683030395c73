"""Checksum over the constants in the image engine's memories: docs/specification_interfaces.md section 11."""

from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib.wiring import In

from eskin.rtl.common import HOST_BITS, Block, inputs, outputs
from eskin.rtl.engine.memory_check import folded
from eskin.rtl.image.bias_memory import ADDEND_BITS
from eskin.rtl.program.image_passes import ImagePlan
from eskin.rtl.program.signature import START, TAPS, WIDTH


class ImageCheck(Block):
    """Adds every word of the passes and the weights of every tap to a signature.

    The signature is 0 after each pass's words and after the last tap unless a word is wrong. Biases are
    checked by parity as the chain takes them. The check itself reads nothing and takes no cycle
    (`eskin.rtl.program.image_signature`).

    Members
    -------
    begins : In(1)
        An image starts: the signature restarts.
    arrives : In(1), word : In(16), checks : In(1)
        A word of the passes is there; it is a pass's check word.
    multiplies : In(1), weights : In(lanes x weight_bits), dense : In(1)
        A tap's weights are there; of a dense layer the first `ImagePlan.dense_lanes` count.
    ends : In(1)
        Pulse: the last tap's weights have been there.
    shifts : In(1), addend : In(26)
        The chain takes a bias; it and its parity bit.
    fault : Out(1)
        One cycle: a word is wrong. Of passes before anything is computed with them; of weights and biases
        before the last logit is given.
    """

    def ports(self, plan: ImagePlan):
        words = {
            "word": In(HOST_BITS),
            "weights": In(plan.lanes * plan.weight_bits),
            "addend": In(ADDEND_BITS + 1),
        }
        return (
            inputs("begins", "arrives", "checks", "multiplies", "dense", "ends", "shifts")
            | outputs("fault")
            | words
        )

    def elaborate(self, platform):
        m = Module()
        plan = self.spec
        common = plan.dense_lanes * plan.weight_bits
        total = folded(self.weights[:common])
        if common < len(self.weights):  # (only beyond 32 bits)
            total ^= Mux(self.dense, 0, folded(self.weights[common:]))
        signature = Signal(WIDTH, init=START)
        judged = Signal()
        advanced = Cat(0, signature[:-1]) ^ Mux(signature[-1], TAPS, 0)
        with m.If(self.begins):
            m.d.sync += signature.eq(START)
        with m.Elif(self.arrives | self.multiplies):
            m.d.sync += signature.eq(advanced ^ Mux(self.arrives, self.word, total))
        m.d.sync += judged.eq(self.checks | self.ends)
        m.d.comb += self.fault.eq((judged & signature.any()) | (self.shifts & self.addend.xor()))
        return m
