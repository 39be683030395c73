"""Map memory of the image engine: two memories of one port, read and written in turn."""

from amaranth.hdl import Cat, Module, Mux, Signal

from eskin.rtl.common import Block, OnePortMemory, drive, inputs, outputs
from eskin.rtl.program.image_passes import ImagePlan


class MapMemory(Block):
    """A pass reads one memory and writes the other, so one port each is enough. The image goes into memory 0.

    Members
    -------
    source : In(1)
        The memory that is read; the other one is written.
    read : In(1), read_address : In, value : Out(8)
        Latency 1.
    write : In(1), write_address : In, write_value : In(8)
    """

    def ports(self, plan: ImagePlan):
        return inputs(
            "source",
            "read",
            "write",
            read_address=plan.address_bits,
            write_address=plan.address_bits,
            write_value=8,
        ) | outputs(value=8)

    def elaborate(self, platform):
        m = Module()
        high = Signal()  # byte that was read
        source = Signal()  # memory that was read
        m.d.sync += [high.eq(self.read_address[0]), source.eq(self.source)]
        words = []
        for number, values in enumerate(self.spec.map_values):
            memory = OnePortMemory(-(-values // 2))
            m.submodules[f"maps_{number}"] = memory
            reads = self.source == number
            address = Mux(reads, self.read_address, self.write_address)
            drive(
                m,
                memory,
                address=address >> 1,
                enable=Mux(reads, self.read, self.write),
                write=Mux(reads, 0, Cat(~self.write_address[0], self.write_address[0])),
                data=self.write_value.replicate(2),
            )
            words.append(memory.word)
        word = Mux(source, words[1], words[0])
        m.d.comb += self.value.eq(Mux(high, word[8:], word))
        return m
