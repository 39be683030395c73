"""Fault detector: stuck, silent or saturated taxels (docs/specification_interfaces.md, section 10). It is a branch
beside the front of the chain."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal
from amaranth.utils import ceil_log2

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import Block, drive, inputs, outputs, struct, working_memory


class FaultDetector(Block):
    """Adds up how much each taxel's samples change in a block of ``fault_frames`` frames.

    A taxel that changes too little gets its flag raised. The memory holds how much of ``fault_activity`` is
    left and whether it is used up, so no sum grows beyond the limit. The lowest ``fault_bits`` bits of the
    last sample and the flag are in the same word, which has 16 bits for a limit below 64.

    Parameters
    ----------
    config:
        The accelerator's configuration, ``fault_frames`` > 0.

    Ports
    -----
    i : In(struct: valid, taxel)
        A beat is taken in this cycle, of this taxel; never held up. Frames are whole: ``taxels`` beats each,
        taxel 0 first.
    complement : In(fault_bits), settling : In(1)
        Values of the last beat, from the cycle after it until the next one: the lowest bits of ~sample; the
        rest level is not known yet.
    flag : Out(1)
        In the same cycles: the taxel's flag, this frame's verdict included.
    flags : Out(taxels)
        All flags, while no frame is under way: bit k = taxel k, as of the last frame.
    raised : Out(1)
        One cycle for each beat of a taxel with its flag raised, this frame included.

    Timing
    ------
    One beat a cycle. ``flag`` comes 1 cycle after its beat was taken, through the logic behind the memory: a
    taxel's verdict is known with the taxel's sample, so that nothing waits for the end of the frame.
    """

    def ports(self, config: AcceleratorConfig):
        return inputs(
            "settling", i=struct("valid", taxel=range(config.sensor.taxels)), complement=config.fault_bits
        ) | outputs("flag", "raised", flags=config.sensor.taxels)

    def elaborate(self, platform):
        config, m = self.spec, Module()
        bits, limit = config.fault_bits, config.faults.fault_activity
        width = max(1, limit.bit_length())
        layout = struct(sample=bits, left=width, active=1, flag=1)
        read, write = working_memory(m, "state", layout, config.sensor.taxels)
        fresh = Signal()
        taxel = Signal.like(self.i.taxel)
        m.d.sync += fresh.eq(self.i.valid)
        with m.If(self.i.valid):
            m.d.sync += taxel.eq(self.i.taxel)
        drive(m, read, addr=self.i.taxel, en=self.i.valid)
        before = read.data

        # --- frame_in_block in the block; memory contents of an earlier recording are never looked at
        frame_in_block = Signal(ceil_log2(config.faults.fault_frames), init=-1)
        judged = Signal()  # this block is
        known = Signal()  # it was before this frame: the flags in memory are this recording's
        block_first, block_last = frame_in_block == 0, frame_in_block.all()
        with m.If(self.i.valid & (self.i.taxel == 0)):
            m.d.sync += [frame_in_block.eq(frame_in_block + 1), known.eq(judged)]
        with m.If(fresh & block_first):
            m.d.sync += judged.eq(~self.settling)

        # --- left - |change|: the complement of a rise and 1, or a fall, is added
        sample = ~self.complement
        complement = Signal(bits)  # of the change, modulo 2**bits
        m.d.comb += complement.eq(self.complement + before.sample)
        at_end = (sample == 0) | sample.all()  # of the range: such a change counts as a rise of 0
        rises = complement[-1] | at_end
        negative = complement ^ (~complement[-1]).replicate(bits)  # its highest bit is set
        magnitude = negative | at_end.replicate(bits)
        extended = Cat(magnitude, Const(1, 1).replicate(width))
        low, high = extended[:width], extended[width:]
        left = Signal(width + 1)  # its carry shows that it is not below 0
        m.d.comb += left.eq(before.left + low + rises)
        active = ~block_first & (before.active | ~left[-1] | ~high.all())
        m.d.comb += self.flag.eq((before.flag & known) | (block_last & judged & ~active))
        drive(m, write, addr=taxel, en=fresh)
        drive(m, write.data, sample=sample, left=Mux(block_first, limit, left), active=active, flag=self.flag)
        m.d.comb += self.raised.eq(fresh & self.flag)
        with m.If(fresh):
            m.d.sync += self.flags.eq(Cat(self.flags[1:], self.flag))
        return m
