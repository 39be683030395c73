"""Sigmoid and tanh by table (docs/specification.md, section 6)."""

from amaranth.hdl import Cat, Module, Mux, Signal, signed, unsigned
from amaranth.lib.memory import Memory

from eskin.golden.core import AcceleratorConfig, sigmoid_table, tanh_table
from eskin.rtl.common import Block, drive, inputs, outputs, short_of_blocks
from eskin.rtl.program.signature import with_parity


class ActivationUnit(Block):
    """ROM with the tables of golden/core/activation.py: the sigmoid's in the lower half, tanh's in the upper.

    ``tanh(x) = 2 s(2x) - 1``. If a gate has one fraction bit more than a state, the codes of the two tables
    differ by a constant. One table then serves both, and the ROM is half as large; the tables are compared to
    find out. Designs with two to four DSP lanes have both tables, unless block memories are short
    (`eskin.rtl.common.memory_style.short_of_blocks`).

    Members
    -------
    index : In(signed(index_bits))
        Rounded and saturated pre-activation; SQ(index_bits, 0).
    tanh : In(1)
        Which table.
    enable : In(1)
        Look up in this cycle; otherwise the answers stay.
    gate : Out(signed), not_state : Out(signed)
        Gate code (sigmoid) and complement of the state code (tanh) of the index one look-up before; the
        function that was asked for counts.
    walk : In(1)
        With ``checksum``: the table is idle. Look up the entry after the entry that was last looked up this
        way.
    wrong : Out(1)
        With ``checksum``: the entry looked up last does not have its parity; unknown before the first.

    Latency 1 cycle, one look-up a cycle.
    """

    def ports(self, config: AcceleratorConfig):
        return inputs("tanh", "enable", "walk", index=signed(config.index_bits)) | outputs(
            "wrong",
            gate=signed(config.gate_format.width),
            not_state=signed(config.formats.state_format.width),
        )

    def elaborate(self, platform):
        m = Module()
        config = self.spec
        sigmoid, tanh = sigmoid_table(config), tanh_table(config)
        half = config.gate_one >> 1
        # With few DSP lanes logic cells are scarcer than memory: complements are stored instead of being
        # made. With one lane the block memories of an iCE40 UP5K do not reach for both, which costs more
        # cells than it spares.
        may_share = config.hardware.lane_type != "dsp" or not 1 < config.hardware.lanes <= 4
        may_share = may_share or short_of_blocks(config, platform)
        alike = may_share and bool((sigmoid - half == tanh).all())
        table = [int(code) for code in (sigmoid if alike else (*sigmoid, *~tanh))]
        bits = max(config.gate_format.width, config.formats.state_format.width)
        checked = int(config.hardware.checksum)
        init = [with_parity(code, bits) if checked else code & (1 << bits) - 1 for code in table]
        m.submodules.table = memory = Memory(shape=unsigned(bits + checked), depth=len(table), init=init)
        read = memory.read_port()
        code = read.data[:bits].as_signed()
        # entry i of a table stands at i + T/2: the index with its sign bit turned over
        address = Cat(self.index[:-1], ~self.index[-1])
        address = address if alike else Cat(address, self.tanh)
        if config.hardware.checksum:
            next_entry = Signal(range(len(table)))
            m.d.sync += next_entry.eq(next_entry + self.walk)
            address = Mux(self.walk, next_entry, address)
        drive(m, read, en=self.enable | self.walk, addr=address)
        drive(m, self, gate=code, not_state=~(code - half) if alike else code)
        if config.hardware.checksum:
            m.d.comb += self.wrong.eq(read.data.xor())
        return m
