"""Window sums to the operands of the feature products (SPECIFICATION.md, section 3)."""

from __future__ import annotations

from collections.abc import Sequence

from amaranth.hdl import Cat, Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out
from amaranth.utils import ceil_log2

from golden.config import AcceleratorConfig
from rtl.collisions import before_an_adder
from rtl.fixed import shape_of
from rtl.onset_detector import reaches
from rtl.window_averager import sum_layout


def centred_layout(config: AcceleratorConfig) -> data.StructLayout:
    """One centred sum, with the window's length index, first and last taxel, last window of the touch."""
    length = sum_layout(config)["length"].shape
    return data.StructLayout({"value": shape_of(config.centred_format), "length": length, "first": 1, "last": 1, "final": 1})


class Normaliser(wiring.Component):
    """``centred = SAT_SQ(16,0)((d - mean[q]) >> feature_shift[q])``, 0 for a masked taxel. The product with scale is the engine's.

    Parameters
    ----------
    config:
        The accelerator's configuration, ``feature_shift`` filled in.
    means:
        One integer (scale of d, ``sum_bits``) for each of ``window_lengths``. The ROM's content; with ``config.loadable`` the content
        before the first load (default 0).

    Ports
    -----
    i : In(stream of ``sum_layout``)
    mask : In(taxels)
        Bit k = 1: taxel k is out of use. With a fault detector each sum says that itself, and nothing reads the port.
    load : In, only with ``config.loadable``
        ``enable`` writes ``data`` (16 bit) to ``address`` = q * ``config.mean_words`` + word, low word first. Only while no window passes.
    o : Out(stream of ``centred_layout``)
    wrong : Out(1)
        With ``checksum``: the mean that was just used does not have its parity, the highest of its bits.

    Timing
    ------
    One beat every 2 cycles, a window's first one cycle later: the mean is read in its first cycle. A beat stays at ``i`` until its
    result is taken, so that its flags need no register here.
    """

    def __init__(self, config: AcceleratorConfig, means: Sequence[int] | None = None):
        lengths = len(config.window_lengths)
        if len(config.feature_shift) != lengths:
            raise ValueError(f"feature_shift has {len(config.feature_shift)} values for {lengths} window lengths: quantise first")
        if means is None and not config.loadable:
            raise ValueError("means are needed where constants are in ROM")
        self.config, self.means = config, [int(mean) for mean in (means if means is not None else [0] * lengths)]
        bound = 1 << config.sum_bits - 1
        top = 1 << 16 * config.mean_words if config.checksum else bound  # words then, with their parity bits
        if len(self.means) != lengths or any(not -bound <= mean < top for mean in self.means):
            raise ValueError(f"means {self.means}: {lengths} numbers of {config.sum_bits} bits are needed")
        ports = {
            "i": In(stream.Signature(sum_layout(config))),
            "mask": In(config.taxels),
            "o": Out(stream.Signature(centred_layout(config))),
            "wrong": Out(1),
        }
        if config.loadable:
            address = unsigned(max(1, ceil_log2(lengths * config.mean_words)))
            ports["load"] = In(wiring.Signature({"address": Out(address), "data": Out(16), "enable": Out(1)}))
        super().__init__(ports)

    def elaborate(self, platform):
        config, m = self.config, Module()
        words, sum_bits = config.mean_words, config.sum_bits
        low_word = (1 << 16 * words) - 1
        init = [mean & low_word for mean in self.means]
        m.submodules.means = means = Memory(shape=unsigned(16 * words), depth=len(self.means), init=init, attrs=before_an_adder(platform))
        read = means.read_port()
        if config.loadable:
            write = means.write_port(granularity=16)
            place, word = self.load.address >> words - 1, self.load.address[: words - 1]  # one or two words a mean
            m.d.comb += [
                write.addr.eq(place), write.data.eq(self.load.data.replicate(words)),
                write.en.eq(Cat(self.load.enable & (word == half) for half in range(words))),
            ]  # fmt: skip

        width = config.centred_format.width
        low = config.feature_shift[0] if config.aligned_means else 0  # bits that no borrow comes from: 0 in every mean
        # d - mean = ~(~d + mean): an adder without inverters. Its sum is registered, the rest of the way is without registers.
        m.d.comb += read.addr.eq(self.i.p.length)
        mean_read, added = Signal(), Signal()
        if config.checksum:
            m.d.comb += self.wrong.eq(added & read.data.xor())
        taken = self.i.valid & self.i.ready
        at_last = reaches(self.i.p.taxel, config.taxels - 1)
        difference = Signal(signed(max(sum_bits - low, width) + 1), reset_less=True)  # complement of d - mean
        with m.If(~added):
            m.d.sync += difference.eq((self.i.p.complement >> low) + read.data[low:sum_bits].as_signed())
            with m.If(self.i.p.masked if config.fault_frames else self.mask.bit_select(self.i.p.taxel, 1)):
                m.d.sync += difference.eq(-1)
        m.d.sync += [mean_read.eq((mean_read | self.i.valid) & ~(taken & at_last)), added.eq(self.i.valid & mean_read & ~taken)]

        # Narrowing in one LUT a bit: what it picks is either a shift (of two) or, where it is forced, the level it is forced to.
        above, shifted = Signal(signed(len(difference) + 1 - width)), Signal(width - 1)
        negative = ~difference[-1]
        forced, level, picked = Signal(), Signal(), Signal.like(self.i.p.length)
        for pick, target, start in ((self.i.p.length, above, width - 1), (picked, shifted, 0)):
            with m.Switch(pick):
                for q, shift in enumerate(config.feature_shift):
                    with m.Case(q):
                        m.d.comb += target.eq(~difference >> shift - low + start)
        m.d.comb += [
            forced.eq(above != negative.replicate(len(above)).as_signed()),
            level.eq(~negative),
            picked.eq(Mux(forced, level.replicate(len(picked)), self.i.p.length)),
        ]
        m.d.comb += [
            self.o.valid.eq(added),
            self.i.ready.eq(added & self.o.ready),
            self.o.p.value.eq(Cat(Mux(forced, picked[0].replicate(width - 1), shifted), negative)),
            self.o.p.length.eq(self.i.p.length),
            self.o.p.first.eq(self.i.p.taxel == 0),
            self.o.p.last.eq(at_last),
            self.o.p.final.eq(self.i.p.final),
        ]
        return m
