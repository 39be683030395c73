"""A memory of 16-bit words with one port: it reads or writes in a cycle, and begins with anything.

On an iCE40 UP5K it is an SB_SPRAM256KA (Lattice TN-02022: 16384 words, one port, four bits under each bit of
MASKWREN, DATAOUT a cycle after the address, contents unknown at power-on); elsewhere what the tools make of
its behaviour.
"""

from amaranth.hdl import Cat, ClockSignal, Const, Instance, Module, Signal

from eskin.rtl.common.collisions import UNFILLED, working_memory
from eskin.rtl.common.memory_style import LARGE_WORDS, SMALL_FAMILY
from eskin.rtl.common.ports import Block, drive, inputs, outputs


class OnePortMemory(Block):
    """``words`` words of 16 bits behind one port.

    Members
    -------
    address : In, enable : In(1)
        The word, where one is read or written.
    write : In(2)
        Bytes of ``data`` that are written, low byte first; 0: the word is read.
    data : In(16)
    word : Out(16)
        The word that was read, one cycle later, until the next read; undefined after a write.

    Nothing may rely on a word that was not written.
    """

    def ports(self, words: int):
        return inputs("enable", address=range(max(2, words)), write=2, data=16) | outputs(word=16)

    def elaborate(self, platform):
        m, words = Module(), self.spec
        if platform == SMALL_FAMILY and words <= LARGE_WORDS:
            self._block(m)
            return m
        read, write = working_memory(m, "memory", 16, words, attrs=UNFILLED, granularity=8)
        drive(m, read, addr=self.address, en=self.enable & ~self.write.any())
        m.d.comb += self.word.eq(read.data)
        drive(m, write, addr=self.address, data=self.data, en=self.write & self.enable.replicate(2))
        return m

    def _block(self, m: Module) -> None:
        address = Signal(14)
        mask = Signal(4)
        m.d.comb += [
            address.eq(self.address),
            mask.eq(Cat(self.write[0].replicate(2), self.write[1].replicate(2))),
        ]
        m.submodules.memory = Instance(
            "SB_SPRAM256KA",
            i_ADDRESS=address,
            i_DATAIN=self.data,
            i_MASKWREN=mask,
            i_WREN=self.write.any(),
            i_CHIPSELECT=self.enable,
            i_CLOCK=ClockSignal(),
            i_STANDBY=Const(0, 1),
            i_SLEEP=Const(0, 1),
            i_POWEROFF=Const(1, 1),  # low switches it off
            o_DATAOUT=self.word,
        )
