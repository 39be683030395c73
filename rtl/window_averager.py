"""Exact sums over overlapping windows, from one running total a taxel (SPECIFICATION.md, section 2: windows and sums)."""

from __future__ import annotations

from amaranth.hdl import Cat, Const, Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out
from amaranth.utils import ceil_log2

from golden.config import AcceleratorConfig
from rtl.onset_detector import frame_layout
from rtl.pretrigger_ring import touch_layout


def sum_layout(config: AcceleratorConfig) -> data.StructLayout:
    """One window sum: its value d, the index of the window's length in ``window_lengths``, last taxel, last window of the touch."""
    lengths = unsigned(max(1, ceil_log2(len(config.window_lengths))))
    return data.StructLayout({"value": signed(config.sum_bits), "length": lengths, "last": 1, "final": 1})


class WindowAverager(wiring.Component):
    """Sums over overlapping windows as differences of a running total: now, minus when the window began.

    ::

        frames      |   hop 0   |   hop 1   |   hop 2   |          thesis: hop 307, window 615 = 2 hop + 1
        window 1    |<--------------------->x                      x = first frame of hop 2
        window 2                |<--------------------->x
        noted       0           1           2           3          total before each hop, of the last four hops

    Every frame adds its deviation to the taxel's total. The total is noted with the last frame of each hop (for the next one) and, in a
    pass over the taxels that adds nothing, before each touch. A window ends with the first frame of the hop after its two (2 hop + 1
    frames), with the last frame of its second hop (2 hop), or clipped with frame ``touch_frames``; then d = total - noted. Where several
    windows end together all but the first come in further passes that add nothing. Totals wrap on purpose: d is exact modulo 2**sum_bits
    and fits ``sum_bits``, so no total is ever cleared and old memory contents do not matter.

    Parameters
    ----------
    config:
        The accelerator's configuration.

    Ports
    -----
    i : In(stream of ``touch_layout``, or in ``window_mode`` free of ``frame_layout``)
        Touch: frames s..e of each touch; hops are counted here. Free: every frame, hops are marked by the detector.
    o : Out(stream of ``sum_layout``)
        ``steps`` windows a touch, ``taxels`` beats each. ``length`` and ``final`` are the window's on each of its beats.

    Timing
    ------
    Latency 3 cycles from ``i`` to ``o``. One beat a cycle in, while ``o`` is taken; each further pass, the one after a reset and in touch
    mode the one after each touch hold ``i`` for ``taxels`` cycles.
    """

    def __init__(self, config: AcceleratorConfig):
        self.config = config
        layout = touch_layout(config) if config.window_mode == "touch" else frame_layout(config)
        super().__init__({"i": In(stream.Signature(layout)), "o": Out(stream.Signature(sum_layout(config)))})

    def elaborate(self, platform):
        config, m = self.config, Module()
        index = Signal(range(config.taxels))
        advance, take, pass_done = Signal(), Signal(), Signal()
        noting = Signal(init=1)  # the pass that notes the totals before hop 0
        schedule = self._touch_schedule if config.window_mode == "touch" else self._free_schedule
        adds_nothing, flags = schedule(m, noting, pass_done)
        at_last = index == config.taxels - 1
        m.d.comb += [
            advance.eq(~self.o.valid | self.o.ready),
            self.i.ready.eq(advance & ~adds_nothing),
            take.eq(advance & (adds_nothing | self.i.valid)),
            pass_done.eq(take & at_last),
        ]
        with m.If(take):
            m.d.sync += index.eq(Mux(at_last, 0, index + 1))

        layout = data.StructLayout({"valid": 1, "index": index.shape(), "last": 1} | {key: flag.shape() for key, flag in flags.items()})
        taken, added = Signal(layout), Signal(layout)
        value, total = Signal(signed(config.deviation_bits)), Signal(signed(config.sum_bits))
        m.submodules.totals = totals = Memory(shape=signed(config.sum_bits), depth=config.taxels, init=[])
        m.submodules.noted = noted = Memory(shape=signed(config.sum_bits), depth=4 << len(index), init=[])
        total_read, total_write = totals.read_port(), totals.write_port()
        noted_read, noted_write = noted.read_port(), noted.write_port()
        m.d.comb += [
            total_read.addr.eq(index),
            total_read.en.eq(advance),
            noted_read.addr.eq(Cat(taken.index, taken.begun)),
            noted_read.en.eq(advance),
            total_write.addr.eq(added.index),
            total_write.data.eq(total),
            total_write.en.eq(advance & added.valid),
            noted_write.addr.eq(Cat(added.index, added.next)),
            noted_write.data.eq(total),
            noted_write.en.eq(advance & added.valid & added.note),
        ]
        with m.If(advance):
            m.d.sync += [taken.valid.eq(take), taken.index.eq(index), taken.last.eq(at_last)]
            m.d.sync += [taken[key].eq(flag) for key, flag in flags.items()]
            m.d.sync += [
                value.eq(Mux(adds_nothing, 0, self.i.p.value)),
                added.eq(taken),
                total.eq(total_read.data + value),
                self.o.valid.eq(added.valid & added.emit),
                self.o.p.value.eq(total - noted_read.data),
                self.o.p.length.eq(added.length),
                self.o.p.last.eq(added.last),
                self.o.p.final.eq(added.final),
            ]
        return m

    def _free_schedule(self, m: Module, noting, pass_done):
        """As ``_touch_schedule``, from the detector's marks."""
        hop = Signal(2)
        with m.If(pass_done):
            m.d.sync += [noting.eq(0), hop.eq(hop + (~noting & self.i.p.hop_last))]
        return noting, {
            "emit": ~noting & self.i.p.emit, "final": self.i.p.end, "length": Const(0, 1), "begun": (hop - 1)[:2],
            "note": noting | self.i.p.hop_last, "next": Mux(noting, 0, hop + 1)[:2],
        }  # fmt: skip

    def _touch_schedule(self, m: Module, noting, pass_done):
        """Count the frames of a touch and insert the passes that add nothing.

        Returns whether this pass adds nothing, and flags of the pass: ``emit``, ``final`` and ``length`` of the window that ends; slot
        ``begun`` of the total noted where it began; whether to ``note`` the total, in slot ``next``.
        """
        config = self.config
        last_hop, last_place = divmod(config.last_frame - 1, config.hop)
        together = [k for k, (_, end) in enumerate(config.window_spans) if end == config.last_frame]
        hop, place = Signal(range(max(4, last_hop + 1))), Signal(range(config.hop))
        passes = Signal(range(len(together)))  # 0: the frame itself, then one for each further window
        at_end, last_pass = (hop == last_hop) & (place == last_place), passes == len(together) - 1
        hop_last = place == config.hop - 1
        with m.If(pass_done):
            with m.If(noting):
                m.d.sync += noting.eq(0)
            with m.Elif(~at_end):
                m.d.sync += [place.eq(Mux(hop_last, 0, place + 1)), hop.eq(hop + hop_last)]
            with m.Elif(~last_pass):
                m.d.sync += passes.eq(passes + 1)
            with m.Else():
                m.d.sync += [place.eq(0), hop.eq(0), passes.eq(0), noting.eq(1)]

        even = config.window == 2 * config.hop
        whole = (hop_last & (hop >= 1)) if even else ((place == 0) & (hop >= 2))
        begun, length = Signal(2), Signal(range(max(2, len(config.window_lengths))))
        m.d.comb += begun.eq(hop - (1 if even else 2))
        for number, k in enumerate(together):  # window k, from 0, began with hop k
            with m.If(at_end & (passes == number)):
                m.d.comb += [begun.eq(k % 4), length.eq(config.length_index[k])]
        return noting | (passes != 0), {
            "emit": ~noting & (whole | at_end), "final": at_end & last_pass, "length": length, "begun": begun,
            "note": noting | hop_last, "next": Mux(noting, 0, hop + 1)[:2],
        }  # fmt: skip
