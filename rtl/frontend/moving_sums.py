"""The moving sum of every taxel, and the result of the onset rule ``baseline`` (docs/specification.md,
section 2)."""

from amaranth.hdl import Cat, Module, Mux, Shape, Signal, signed
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.utils import ceil_log2

from eskin.golden.core import AcceleratorConfig, signed_bits
from eskin.rtl.common import NO_COLLISION, drive, exceeds, inputs, outputs


class MovingSums(wiring.Component):
    """The sum of the last ``onset_mean_frames`` deviations of each taxel, compared with the threshold at the
    end of each block.

    The sum is a running total less its value ``onset_mean_frames`` frames ago. The total may wrap, because
    the difference is exact modulo its width. The block runs beside the pipeline and watches its last stage: a
    beat's sum is compared 3 cycles after the beat has arrived there.

    Members
    -------
    advance : In(1)
        The pipeline advances.
    coming_valid, coming_index : In
        The stage before its last holds a beat; the taxel of it.
    index, last, block_end, masked, settling, complement : In
        Values of the beat in its last stage: taxel; the frame's last; its frame ends a block; it does not count; its
        rest level settles, so that it adds 0; the complement of its deviation.
    last_taken : In(1)
        The frame's last beat leaves if the verdict is there.
    over : Out(1)
        One cycle: a taxel that counts exceeds the threshold.
    decided : Out(1)
        The last taxel of a block has been compared.
    holds : Out(1)
        A beat that has left is still added or compared.
    """

    def __init__(self, config: AcceleratorConfig, complement: Shape):
        self._config = config
        index = range(config.sensor.taxels)
        super().__init__(
            inputs(
                "advance",
                "coming_valid",
                "last",
                "block_end",
                "masked",
                "settling",
                "last_taken",
                coming_index=index,
                index=index,
                complement=complement,
            )
            | outputs("over", "decided", "holds")
        )

    def elaborate(self, platform):
        m = Module()
        config, rule = self._config, self._config.onset_rule
        blocks = rule.onset_mean_frames // rule.onset_check_frames
        bits = signed_bits(rule.onset_mean_frames * config.deviation_bound)
        m.submodules.totals = totals = Memory(
            shape=signed(bits), depth=config.sensor.taxels, init=[], attrs=NO_COLLISION
        )
        m.submodules.history = history = Memory(
            shape=signed(bits), depth=blocks << ceil_log2(config.sensor.taxels), init=[], attrs=NO_COLLISION
        )
        total_read, total_write = totals.read_port(), totals.write_port()
        past_read, past_write = history.read_port(), history.write_port()
        slot = Signal(range(blocks))  # of one block: no bits
        wrapped = Signal()

        fresh = self.fresh = Signal()
        added = self.added = Signal()
        moved_valid = Signal()
        decided = self.decided
        total = Signal(signed(bits))
        moved = Signal(signed(bits))
        values = {
            key: Signal.like(getattr(self, key), name=f"held_{key}")
            for key in ("index", "last", "block_end", "masked")
        }
        m.d.sync += [fresh.eq(self.advance & self.coming_valid), added.eq(fresh)]
        drive(m, total_read, addr=self.coming_index, en=self.advance)
        drive(m, past_read, addr=Cat(self.index, slot), en=fresh)
        with m.If(fresh):
            m.d.sync += [
                total.eq(Mux(self.settling, 0, total_read.data - ~self.complement)),
                *(register.eq(getattr(self, key)) for key, register in values.items()),
            ]
        past = Mux(wrapped, past_read.data, 0)
        moved_last = self.moved_last = Signal()
        m.d.sync += [
            moved.eq(total - past),  # modulo 2**bits, and |moved| < 2**(bits-1)
            moved_valid.eq(added & values["block_end"] & ~values["masked"]),
            moved_last.eq(added & values["block_end"] & values["last"]),
        ]
        m.d.comb += self.holds.eq(added | moved_valid | moved_last | decided)
        drive(m, total_write, addr=values["index"], data=total, en=added)
        drive(m, past_write, addr=Cat(values["index"], slot), data=total, en=added & values["block_end"])
        limit = rule.onset_threshold * rule.onset_mean_frames
        m.d.comb += self.over.eq(moved_valid & (exceeds(moved, limit) | ~exceeds(moved, -limit - 1)))
        with m.If(moved_last):
            m.d.sync += [decided.eq(1), slot.eq(slot + 1), wrapped.eq(wrapped | (slot == blocks - 1))]
        with m.Elif(self.last_taken):
            m.d.sync += decided.eq(0)
        return m
