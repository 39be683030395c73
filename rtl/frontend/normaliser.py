"""Window sums to the operands of the feature products (docs/specification.md, section 3)."""

from collections.abc import Sequence
from typing import Any

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value, signed, unsigned
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.utils import ceil_log2

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import (
    centred_layout,
    drive,
    inputs,
    load_lines,
    load_signature,
    means_memory,
    outputs,
    reaches,
    sum_layout,
)
from eskin.rtl.frontend.registered_adder import RegisteredAdder
from eskin.rtl.program.memory_map import Memory as Loaded
from eskin.rtl.program.memory_map import mean_count


def mean_address(config: AcceleratorConfig, length: Value, kind: Value | None, taxel: Value) -> Value:
    """Address of the mean of a length, of a kind or of an input where each has a mean; each
    field has separate bits."""
    bits = ceil_log2(len(config.window_lengths))
    return Cat(
        length[:bits],
        *(() if kind is None else (kind,)),
        *((taxel,) if config.features.feature_scale == "taxel" else ()),
    )


class Normaliser(wiring.Component):
    """``centred = SAT_SQ(16,0)((d - mean[q]) >> feature_shift[q])``, 0 for a masked taxel; with means of
    ``mean_frac`` fraction bits d is theirs before the difference. The product with scale is the engine's.

    With several kinds of feature, or a scale a taxel, mean and shift belong to the beat's kind, or the
    mean belongs to its input.

    Parameters
    ----------
    config:
        The accelerator's configuration, ``feature_shift`` filled in.
    means:
        One integer (``mean_format``, codes) for each of ``window_lengths``, or for each of
        `eskin.rtl.program.memory_map.mean_places`. The ROM's content; with ``config.hardware.loadable`` the
        content before the first load (default 0).

    Ports
    -----
    i : In(stream of ``sum_layout``)
    mask : In(taxels)
        Bit k = 1: taxel k is out of use. With a fault detector each sum carries that mark itself, and nothing reads
        the port.
    load : In(load_signature)
        The host's writes, address = q * ``config.mean_words`` + word, low word first; q: ``mean_address``. Only while
        no window passes.
    o : Out(stream of ``centred_layout``)
    wrong : Out(1)
        With ``checksum``: the mean that was just used does not have its parity, the highest of its bits.
    blank : Out(1)
        ``o`` is 0 in this cycle, the second after a reset: the engine stores it as its word for no window.

    Timing
    ------
    One beat every 2 cycles, a window's first one cycle later: the mean is read in its first cycle. Where
    means differ from beat to beat, every 3 cycles. A beat stays at ``i`` until its result is taken, so that
    its flags need no register here.
    """

    def __init__(self, config: AcceleratorConfig, means: Sequence[int] | None = None):
        lengths = len(config.window_lengths)
        if len(config.features.feature_shift) != lengths * config.kinds:
            raise ValueError(
                f"feature_shift has {len(config.features.feature_shift)} values for {lengths} window "
                "lengths: quantise first"
            )
        self.config = config
        self.means = [0] * mean_count(config) if means is None else list(map(int, means))
        super().__init__(
            inputs(i=stream.Signature(sum_layout(config)), mask=config.sensor.taxels)
            | outputs(o=stream.Signature(centred_layout(config)), wrong=1, blank=1)
            | inputs(load=load_signature(config))
        )

    def elaborate(self, platform):
        config, m = self.config, Module()
        words, sum_bits, frac = config.mean_words, config.mean_format.width, config.mean_frac
        low_word = (1 << 16 * words) - 1
        init = [mean & low_word for mean in self.means]
        style = means_memory(config, platform, len(self.means))
        m.submodules.means = means = Memory(
            shape=unsigned(16 * words), depth=len(self.means), init=init, attrs=style
        )
        read = means.read_port()
        if config.hardware.loadable:
            write = means.write_port(granularity=16)
            # one or two words a mean
            entry, word = (self.load.address >> words - 1, self.load.address[: words - 1])
            loads = self.load.enable & self.load.select[load_lines(config)[Loaded.MEANS]]
            drive(
                m,
                write,
                addr=entry,
                data=self.load.data.replicate(words),
                en=Cat(loads & (word == half) for half in range(words)),
            )

        width = config.centred_format.width
        # bits that no borrow comes from: 0 in every mean
        low = config.features.feature_shift[0] + frac if config.features.aligned_means else 0
        # d with the fraction bits of the means, complemented: ones below
        complement = Cat(Const(-1, frac), self.i.p.complement).as_signed() if frac else self.i.p.complement
        # d - mean = ~(~d + mean): an adder without inverters. Its sum is registered; what follows is
        # combinational. A masked taxel is forced, too, to 0.
        several = config.constants > 1
        kind: Any = self.i.p.kind if config.kinds > 1 else None
        mean_of = mean_address(config, self.i.p.length, kind, self.i.p.taxel) if several else self.i.p.length
        drive(m, read, addr=mean_of, en=self.i.valid)
        mean_read = Signal()
        added = Signal()
        if config.hardware.checksum:
            m.d.comb += self.wrong.eq(added & read.data.xor())
        accepted = self.i.valid & self.i.ready
        at_last = reaches(self.i.p.taxel, config.sensor.taxels - 1)
        at_first = self.i.p.taxel == 0
        if config.kinds > 1:
            at_last &= reaches(self.i.p.kind, config.kinds - 1)
            at_first &= self.i.p.kind == 0
        # complement of d - mean
        m.submodules.adder = adder = RegisteredAdder(config, max(sum_bits - low, width) + 1, before=1)
        difference = adder.total
        # of the two cycles after a reset, in which no sum can come, the second gives 0
        begun = Signal()
        blanked = Signal()
        masked = Signal()
        m.d.sync += [begun.eq(1), blanked.eq(begun)]
        m.d.comb += self.blank.eq(begun & ~blanked)
        looks = ~added & (self.i.valid | ~begun)
        drive(m, adder, step=looks, word=read.data[low:sum_bits].as_signed(), addend=complement >> low)
        out_of_use = (
            self.i.p.masked if config.faults.fault_frames else self.mask.bit_select(self.i.p.taxel, 1)
        )
        with m.If(looks):
            m.d.sync += masked.eq(out_of_use | ~begun)
        used = accepted if several else accepted & at_last  # the mean is read again
        m.d.sync += [
            mean_read.eq((mean_read | self.i.valid) & ~used),
            added.eq(self.i.valid & mean_read & ~accepted),
        ]

        # Narrowing takes one LUT a bit: its select inputs give one of two shifts or, when forced, the level
        # itself.
        above = Signal(signed(len(difference) + 1 - width))
        shifted = Signal(width - 1)
        choice = Cat(kind, self.i.p.length) if config.kinds > 1 else self.i.p.length
        forced = Signal()
        level = Signal()
        negative = Signal()
        picked = Signal.like(choice)
        for pick, target, start in ((choice, above, width - 1), (picked, shifted, 0)):
            with m.Switch(pick):
                for number, shift in enumerate(config.features.feature_shift):
                    q, k = divmod(number, config.kinds)
                    with m.Case(q << ceil_log2(config.kinds) | k):
                        m.d.comb += target.eq(~difference >> shift + frac - low + start)
        m.d.comb += [
            negative.eq(~difference[-1] & ~masked),
            forced.eq(masked | (above != negative.replicate(len(above)).as_signed())),
            level.eq(~negative & ~masked),
            picked.eq(Mux(forced, level.replicate(len(picked)), choice)),
            self.o.valid.eq(added),
            self.i.ready.eq(added & self.o.ready),
        ]
        drive(
            m,
            self.o.p,
            value=Cat(Mux(forced, picked[0].replicate(width - 1), shifted), negative),
            length=self.i.p.length,
            first=at_first,
            last=at_last,
            final=self.i.p.final,
            **({"partial": self.i.p.partial} if config.follows_touch else {}),
        )
        return m
