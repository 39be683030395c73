"""The host's writes into the memories: it selects a memory, then writes its words in order."""

from amaranth.hdl import Module, Signal

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import HOST_BITS, Block, at_end, drive, inputs, load_lines, load_signature, outputs
from eskin.rtl.program.memory_map import Memory, load_words


class MemoryLoader(Block):
    """Advances the address of the selected memory with every word, and refuses words while ``locked``.

    Members
    -------
    data : In(16)
        Writes of the host.
    chosen : In(1)
        ``data`` names the memory (register MEMORY_SELECT), whose first word comes next.
    written : In(1)
        ``data`` is the next word (MEMORY_DATA).
    locked : In(1)
        No word is taken.
    load : Out
        A line a memory, address and word; combinational from ``data``. Never enabled in a ROM design.
    seek : In(1), onward : In(1), only with taught places
        ``data`` is the word of the memory PROTOTYPES that comes next; the word after it comes next.
    refused : Out(1)
        The word is not taken: ``locked``, or behind the memory's end (``checksum``).
    """

    def ports(self, config: AcceleratorConfig):
        controls = inputs("chosen", "written", "locked")
        if config.readout_rule.taught:
            controls |= inputs("seek", "onward")
        return inputs(data=HOST_BITS) | outputs("refused", load=load_signature(config)) | controls

    def elaborate(self, platform):
        m = Module()
        hardware, lines = self.spec.hardware, load_lines(self.spec)
        lane_bits = max(2, (hardware.lanes - 1).bit_length())  # the other memories are told apart by two
        # one line a memory: decoded as it is chosen, not as it is written
        select = Signal(len(lines), init=1)
        address = self.address = Signal(range(load_words(self.spec) + hardware.checksum))
        refuses = self.locked
        if hardware.checksum:
            refuses = self.locked | at_end(self.spec, select, address)
        m.d.comb += self.refused.eq(self.written & refuses)
        drive(
            m,
            self.load,
            enable=self.written & ~refuses & int(hardware.loadable),
            select=select,
            address=address,
            data=self.data,
        )
        m.d.sync += address.eq(address + self.load.enable)
        with m.If(self.chosen):
            m.d.sync += address.eq(0)
            mask = 1 << 6 | (1 << lane_bits) - 1
            for number, line in lines.items():
                m.d.sync += select[line].eq(self.data & mask == number & mask)
        if self.spec.readout_rule.taught:
            with m.If(self.onward):
                m.d.sync += address.eq(address + 1)
            with m.If(self.seek):
                m.d.sync += [address.eq(self.data), select.eq(1 << lines[Memory.PROTOTYPES])]
        return m
