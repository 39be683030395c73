"""The rest level of every taxel and the deviation from it (docs/specification.md, section 2)."""

from itertools import count

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value, signed, unsigned
from amaranth.lib import wiring
from amaranth.utils import ceil_log2

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import drive, inputs, outputs, working_memory


class RestLevel(wiring.Component):
    """Reads the level of a beat's taxel, gives the deviation, and the next level one stage later.

    The level has ``level_frac`` fraction bits, at least the 4 of the specification. If ``rest_frames`` is a
    power of two, the settling sum is the level: its finer bits have no effect, and the rounding half is its
    initial value. Otherwise the sum is multiplied by a reciprocal that the constructor proves exact.

    Members
    -------
    advance : In(1)
        The pipeline advances.
    coming_index : In
        Taxel of the beat that comes into the first stage.
    sample, settle_first : In
        Values of the beat there: the complement of its sample; the first frame that settles.
    deviation : Out(signed)
        The complement of its deviation, 0 cycles.
    settling, settle_last, negative : In(1)
        Values of the beat in the second stage: its frame settles, for the last time; the complement of its deviation
        is negative.
    next : Out
        Its taxel's level after this frame, 0 cycles.
    w_index, w_level, w_enable : In
        The level is written; at most 3 beats after it was read, which 4 taxels allow. With fewer the detector
        holds the next frame up until then.
    """

    def __init__(self, config: AcceleratorConfig):
        self._config, self.reciprocal = config, None
        frames, span = config.rest_level.rest_frames, config.sample_format
        self.level_frac = max(4, ceil_log2(frames))
        self.level_bits = config.sensor.sample_bits + self.level_frac
        if frames & (frames - 1):
            self.level_frac = 4
            # sums of offset-binary samples: 0..top; the quotient of (16 S + B/2) / B must be exact on all of
            # them
            self.reciprocal = exact_reciprocal(
                frames, 16 * frames * (span.max_code - span.min_code) + frames // 2
            )
        index = range(config.sensor.taxels)
        super().__init__(
            inputs(
                "advance",
                "settle_first",
                "settling",
                "settle_last",
                "negative",
                "w_enable",
                coming_index=index,
                sample=signed(config.sensor.sample_bits),
                w_index=index,
                w_level=self.level_bits,
            )
            | outputs(deviation=signed(config.sensor.sample_bits + 1), next=self.level_bits)
        )

    def elaborate(self, platform):
        m = Module()
        bits = self._config.sensor.sample_bits
        read, write = working_memory(m, "level", unsigned(self.level_bits), self._config.sensor.taxels)
        # levels are kept of offset-binary samples: never negative
        inverted = Cat(self.sample[: bits - 1], self.sample[bits - 1] ^ self._config.sensor.sample_signed)
        baseline = read.data[self.level_frac - 4 :][: bits + 4]
        # ~(sample - ((baseline + 8) >> 4)) = ~sample + (baseline >> 4) + bit 3 of baseline, as one adder
        deviation = (
            Cat(Const(1, 1), inverted, Const(1, 1)).as_signed() + Cat(baseline[3:], Const(0)).as_signed()
        )
        drive(m, read, addr=self.coming_index, en=self.advance)
        m.d.comb += self.deviation.eq(deviation[1:])
        drive(m, write, addr=self.w_index, data=self.w_level, en=self.w_enable)
        held = Signal(self.level_bits, reset_less=True)
        sample = Signal(bits, reset_less=True)
        at_level = Signal(reset_less=True)
        # what the settling sum starts from: the half that makes its final shift round half up
        half = 0 if self.reciprocal or self.level_frac == 4 else 1 << self.level_frac - 5
        with m.If(self.advance):
            m.d.sync += [
                held.eq(Mux(self.settle_first, Const(half, self.level_bits), read.data)),
                sample.eq(~inverted),
                at_level.eq(~inverted == baseline[4:]),
            ]
        m.d.comb += self.next.eq(self._after(held, sample, at_level))
        return m

    def _after(self, level: Signal, sample: Signal, at_level: Signal) -> Value:
        """The level after this frame: one adder for the settling sum and for the tracking step of 1/16
        code."""
        config = self._config
        frames, low = config.rest_level.rest_frames, self.level_frac - 4
        settled = sample if self.reciprocal else sample << self.level_frac - ceil_log2(frames)
        baseline = level[low:]
        if config.rest_level.rest == "tracked":
            # sign(16 sample - baseline): the sample equals the baseline's integer part, or the deviation's
            # sign shows it
            up = self.negative & ~at_level
            hold = at_level & (baseline[:4] == 0)
            step = Cat(Const(0, low), ~hold, (~hold & ~up).replicate(len(baseline) - 1))
            total = level + Mux(self.settling, settled, step)
        else:
            total = level + settled
        if self.reciprocal:
            factor, shift = self.reciprocal
            mean = ((total << 4) + frames // 2) * factor >> shift
            return Mux(self.settle_last, mean, total)
        return total


def exact_reciprocal(divisor: int, largest: int) -> tuple[int, int]:
    """``(factor, shift)`` with ``n * factor >> shift == n // divisor`` for every n in 0..largest: the
    smallest that is proven.

    With factor = ceil(2**shift / divisor) and excess = factor * divisor - 2**shift, ``largest * excess <
    2**shift`` suffices (Granlund and Montgomery 1994).
    """
    factors = ((-(-(1 << shift) // divisor), shift) for shift in count(1))
    return next((a, shift) for a, shift in factors if largest * (a * divisor - (1 << shift)) < 1 << shift)
