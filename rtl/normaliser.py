"""Window sums to the operands of the feature products (SPECIFICATION.md, section 3)."""

from __future__ import annotations

from collections.abc import Sequence

from amaranth.hdl import Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out
from amaranth.utils import ceil_log2

from golden.config import AcceleratorConfig
from rtl.fixed import saturate, shape_of
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
        Bit k = 1: taxel k is out of use.
    load : In, only with ``config.loadable``
        ``enable`` writes ``data`` (16 bit) to ``address`` = q * ``config.mean_words`` + word, low word first. Only while no window passes.
    o : Out(stream of ``centred_layout``)

    Timing
    ------
    Latency 2 cycles, one beat every 2 cycles: ``i.ready`` is a register, and the mean is read while it is low.
    """

    def __init__(self, config: AcceleratorConfig, means: Sequence[int] | None = None):
        lengths = len(config.window_lengths)
        if len(config.feature_shift) != lengths:
            raise ValueError(f"feature_shift has {len(config.feature_shift)} values for {lengths} window lengths: quantise first")
        if means is None and not config.loadable:
            raise ValueError("means are needed where constants are in ROM")
        self.config, self.means = config, [int(mean) for mean in (means if means is not None else [0] * lengths)]
        bound = 1 << config.sum_bits - 1
        if len(self.means) != lengths or any(not -bound <= mean < bound for mean in self.means):
            raise ValueError(f"means {self.means}: {lengths} numbers of {config.sum_bits} bits are needed")
        ports = {
            "i": In(stream.Signature(sum_layout(config))),
            "mask": In(config.taxels),
            "o": Out(stream.Signature(centred_layout(config))),
        }
        if config.loadable:
            address = unsigned(max(1, ceil_log2(lengths * config.mean_words)))
            ports["load"] = In(wiring.Signature({"address": Out(address), "data": Out(16), "enable": Out(1)}))
        super().__init__(ports)

    def elaborate(self, platform):
        config, m = self.config, Module()
        words, sum_bits = config.mean_words, config.sum_bits
        low_word = (1 << 16 * words) - 1
        m.submodules.means = means = Memory(
            shape=unsigned(16 * words), depth=len(self.means), init=[mean & low_word for mean in self.means], attrs={"ram_style": "block"}
        )  # fmt: skip
        read = means.read_port()
        if config.loadable:
            write = means.write_port(granularity=16)
            for q in range(len(self.means)):
                for word in range(words):
                    with m.If(self.load.enable & (self.load.address == q * words + word)):
                        m.d.comb += [write.addr.eq(q), write.en.eq(1 << word)]
            m.d.comb += write.data.eq(self.load.data.replicate(words))

        # ready is a register that is high for one cycle at a time: it ends the ready chain, and the mean is known by then
        ready, advance, taken = Signal(), Signal(), Signal()
        centred = Signal(data.StructLayout({"valid": 1, "masked": 1, "length": self.i.p.length.shape(), "first": 1, "last": 1, "final": 1}))
        m.d.comb += [
            self.i.ready.eq(ready),
            taken.eq(self.i.valid & ready),
            advance.eq(~self.o.valid | self.o.ready),
            read.addr.eq(self.i.p.length),
        ]
        m.d.sync += ready.eq(self.i.valid & ~ready & (~centred.valid | advance))
        index = Signal(range(config.taxels))
        with m.If(taken):
            m.d.sync += index.eq(Mux(self.i.p.last, 0, index + 1))

        difference, shifted = Signal(signed(sum_bits + 1)), Signal(signed(sum_bits + 1))
        with m.Switch(centred.length):
            for q, shift in enumerate(config.feature_shift):
                with m.Case(q):
                    m.d.comb += shifted.eq(difference >> shift)
        with m.If(taken):
            m.d.sync += [
                centred.masked.eq(self.mask.bit_select(index, 1)),
                centred.length.eq(self.i.p.length),
                centred.first.eq(index == 0),
                centred.last.eq(self.i.p.last),
                centred.final.eq(self.i.p.final),
                difference.eq(self.i.p.value - read.data[:sum_bits].as_signed()),
            ]
        with m.If(taken | advance):
            m.d.sync += centred.valid.eq(taken)
        with m.If(advance):
            m.d.sync += [
                self.o.valid.eq(centred.valid),
                self.o.p.value.eq(Mux(centred.masked, 0, saturate(shifted, config.centred_format))),
                self.o.p.length.eq(centred.length),
                self.o.p.first.eq(centred.first),
                self.o.p.last.eq(centred.last),
                self.o.p.final.eq(centred.final),
            ]
        return m
