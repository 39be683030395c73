"""The image engine's weights: of convolutions a word for all lanes, of dense layers in two memories of one
port."""

from amaranth.hdl import Cat, Module, Mux, Signal, signed
from amaranth.lib import data
from amaranth.lib.memory import Memory

from eskin.rtl.common import HOST_BITS, NO_COLLISION, Block, OnePortMemory, drive, inputs, outputs
from eskin.rtl.program.image_passes import ImagePlan

DENSE_MEMORIES = 2


class WeightMemory(Block):
    """The weights of a tap, a lane each; latency 1.

    Members
    -------
    read : In(1), dense : In(1), address : In
        A tap's weights, from the dense layers' memories or the convolutions'.
    weights : Out(array of signed(weight_bits))
        In a dense layer only the first `ImagePlan.dense_lanes` are used.
    load : In(1), column : In, load_dense : In(2), load_address : In(16), load_word : In(16)
        The host's writes. ``column`` selects 16 bits of the convolutions' word, ``load_dense`` the low or
        high half of the dense layers' word.
    """

    def ports(self, plan: ImagePlan):
        return inputs(
            "read",
            "dense",
            "load",
            address=plan.address_bits,
            column=plan.columns,
            load_dense=DENSE_MEMORIES,
            load_address=HOST_BITS,
            load_word=HOST_BITS,
        ) | outputs(weights=data.ArrayLayout(signed(plan.weight_bits), plan.lanes))

    def elaborate(self, platform):
        m = Module()
        plan = self.spec
        width = plan.lanes * plan.weight_bits
        word = []
        for column in range(plan.columns):
            bits = min(16, width - 16 * column)
            m.submodules[f"conv_{column}"] = memory = Memory(
                shape=bits, depth=max(1, plan.conv_words), init=[], attrs=NO_COLLISION
            )
            read, write = memory.read_port(), memory.write_port()
            drive(m, read, addr=self.address, en=self.read & ~self.dense)
            drive(m, write, addr=self.load_address, data=self.load_word, en=self.load & self.column[column])
            word.append(read.data)
        conv = Cat(*word)

        part = (plan.dense_taps - 1).bit_length()  # address bits that choose a tap in a word
        halves = []
        for half in range(DENSE_MEMORIES):
            m.submodules[f"dense_{half}"] = memory = OnePortMemory(plan.dense_words)
            writes = self.load & self.load_dense[half]
            drive(
                m,
                memory,
                address=Mux(writes, self.load_address, self.address >> part),
                enable=writes | (self.read & self.dense),
                write=writes.replicate(len(memory.write)),
                data=self.load_word,
            )
            halves.append(memory.word)
        was_dense = Signal()
        chosen = Signal(part)
        m.d.sync += [was_dense.eq(self.dense), chosen.eq(self.address)]
        count = plan.dense_lanes * plan.weight_bits
        dense = Cat(*halves).word_select(chosen, count)
        m.d.comb += self.weights.as_value().eq(Cat(Mux(was_dense, dense, conv[:count]), conv[count:]))
        return m
