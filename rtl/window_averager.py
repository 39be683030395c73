"""Exact sums over overlapping windows, from two sums a taxel (SPECIFICATION.md, section 2: windows and sums)."""

from __future__ import annotations

from types import SimpleNamespace

from amaranth.hdl import Const, Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out
from amaranth.utils import ceil_log2

from golden.config import AcceleratorConfig
from golden.formats import signed_bits
from rtl.onset_detector import frame_layout
from rtl.pretrigger_ring import touch_layout


def sum_layout(config: AcceleratorConfig) -> data.StructLayout:
    """One window sum: its value d, the index of the window's length in ``window_lengths``, last taxel, last window of the touch."""
    lengths = unsigned(max(1, ceil_log2(len(config.window_lengths))))
    return data.StructLayout({"value": signed(config.sum_bits), "length": lengths, "last": 1, "final": 1})


class WindowAverager(wiring.Component):
    """Adds deviations into hops and hops into windows that overlap by half.

    A = sum of the previous whole hop, B = sum of the current hop so far; every frame x::

        frames    |   hop 1   |   hop 2   |   hop 3   |          thesis: hop 307, window 615 = 2 hop + 1
        window 1  |<--------------------->x                      d = A + B + x in the first frame of hop 3
        window 2              |<--------------------->x

        first frame of a hop:  A <- B, B <- x        other frames:  B <- B + x        a window ends:  d = A + B + x, before that

    A window of 2 hop frames ends with the last frame of its second hop, a clipped one with frame ``touch_frames``. Where several
    windows end together, all but the first are read out in further passes over the taxels: d = A + B or, begun in this hop, B.
    Sums are exact: B needs hop + 1 deviations, d has ``sum_bits``. No first use needs clearing: B is overwritten in the first frame of a
    touch (or recording), and A is only read two hops later, or masked in windows that begin with their hop.

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
    Latency 3 cycles from ``i`` to ``o``. One beat a cycle in, while ``o`` is taken; a further pass holds ``i`` for ``taxels`` cycles.
    """

    def __init__(self, config: AcceleratorConfig):
        self.config = config
        layout = touch_layout(config) if config.window_mode == "touch" else frame_layout(config)
        super().__init__({"i": In(stream.Signature(layout)), "o": Out(stream.Signature(sum_layout(config)))})

    def elaborate(self, platform):
        config, m = self.config, Module()
        advance, take, frame_taken = Signal(), Signal(), Signal()
        index = Signal(range(config.taxels))
        m.d.comb += advance.eq(~self.o.valid | self.o.ready)
        with m.If(take):
            m.d.sync += index.eq(Mux(frame_taken, 0, index + 1))

        if config.window_mode == "touch":
            frame = self._schedule(m, index, advance, take, frame_taken)
        else:
            m.d.comb += [
                self.i.ready.eq(advance),
                take.eq(self.i.valid & advance),
                frame_taken.eq(take & self.i.p.last),
            ]
            frame = {
                "last": self.i.p.last, "hop_first": self.i.p.hop_first, "emit": self.i.p.emit, "final": self.i.p.end,
                "extra": Const(0, 1), "use_a": Const(config.hop > 1, 1), "length": Const(0, 1),
            }  # fmt: skip

        def stage(name: str, **fields) -> SimpleNamespace:
            """Registers that follow ``fields`` whenever the pipeline advances; constants stay constants."""
            registers = {
                key: value if isinstance(value, Const) else Signal(value.shape(), name=f"{name}_{key}") for key, value in fields.items()
            }
            with m.If(advance):
                m.d.sync += [registers[key].eq(value) for key, value in fields.items() if not isinstance(value, Const)]
            return SimpleNamespace(**registers)

        hop_bits = signed_bits((config.hop + 1) * config.deviation_bound)
        m.submodules.previous = previous = Memory(shape=signed(hop_bits), depth=config.taxels, init=[])
        m.submodules.current = current = Memory(shape=signed(hop_bits), depth=config.taxels, init=[])
        a_read, a_write = previous.read_port(), previous.write_port()
        b_read, b_write = current.read_port(), current.write_port()

        taken = stage("taken", valid=take, index=index, **frame, value=Mux(frame["extra"], 0, self.i.p.value))
        added = stage("added", valid=taken.valid, index=taken.index, **{key: getattr(taken, key) for key in frame},
                      value=taken.value, b=b_read.data, total=(b_read.data + taken.value)[:hop_bits].as_signed())  # fmt: skip
        moves = advance & added.valid & ~added.extra
        m.d.comb += [
            b_read.addr.eq(index),
            b_read.en.eq(advance),
            a_read.addr.eq(taken.index),
            a_read.en.eq(advance),
            b_write.addr.eq(added.index),
            b_write.data.eq(Mux(added.hop_first, added.value, added.total)),
            b_write.en.eq(moves),
            a_write.addr.eq(added.index),
            a_write.data.eq(added.b),
            a_write.en.eq(moves & added.hop_first),
        ]
        with m.If(advance):
            m.d.sync += [
                self.o.valid.eq(added.valid & added.emit),
                self.o.p.value.eq(Mux(added.use_a, a_read.data, 0) + added.total),
                self.o.p.length.eq(added.length),
                self.o.p.last.eq(added.last),
                self.o.p.final.eq(added.final),
            ]
        return m

    def _schedule(self, m: Module, index, advance, take, frame_taken) -> dict:
        """Count the frames of a touch and say for each what it ends; insert the further passes at the touch's end."""
        config = self.config
        last_hop, last_place = divmod(config.last_frame - 1, config.hop)
        # windows that end with the touch, in order, and whether each reaches back into the previous hop
        together = [k for k, (_, end) in enumerate(config.window_spans) if end == config.last_frame]
        reaches_back = [config.window_spans[k][0] <= last_hop * config.hop for k in together]
        if last_place == 0:  # A and B are moved on with this frame, so its own window still sees one hop further back
            reaches_back[0] = config.window_spans[together[0]][0] <= (last_hop - 1) * config.hop
        usually = config.window > 2  # hop 1, window 2: this frame and the last one, which is all B holds

        hop, place = Signal(range(last_hop + 1)), Signal(range(config.hop))
        at_end = (hop == last_hop) & (place == last_place)
        at_taxel = index == config.taxels - 1
        full = (place == config.hop - 1) & (hop >= 1) if config.window == 2 * config.hop else (place == 0) & (hop >= 2)
        passes = Signal(range(len(together)))  # 0: the frame itself, then one for each further window
        extra, last_pass = passes != 0, passes == len(together) - 1
        m.d.comb += [
            self.i.ready.eq(advance & ~extra),
            take.eq(advance & (extra | self.i.valid)),
            frame_taken.eq(take & at_taxel),
        ]
        with m.If(frame_taken):
            with m.If(~at_end):
                hop_over = place == config.hop - 1
                m.d.sync += [place.eq(Mux(hop_over, 0, place + 1)), hop.eq(hop + hop_over)]
            with m.Elif(last_pass):
                m.d.sync += [place.eq(0), hop.eq(0), passes.eq(0)]
            with m.Else():
                m.d.sync += passes.eq(passes + 1)

        use_a, length = Const(usually, 1), Const(config.length_index[0], unsigned(1))
        if any(back != usually for back in reaches_back):
            use_a = Signal()
            m.d.comb += use_a.eq(usually)
        if len(config.window_lengths) > 1:
            length = Signal(range(len(config.window_lengths)))
        for number, (k, back) in enumerate(zip(together, reaches_back, strict=True)):
            with m.If(at_end & (passes == number)):
                if not isinstance(use_a, Const):
                    m.d.comb += use_a.eq(back)
                if not isinstance(length, Const):
                    m.d.comb += length.eq(config.length_index[k])
        return {
            "last": at_taxel, "hop_first": place == 0, "emit": full | at_end, "final": at_end & last_pass,
            "extra": extra, "use_a": use_a, "length": length,
        }  # fmt: skip
