"""Exact sums over overlapping windows, two at a time (docs/specification.md, section 2: windows and sums)."""

from __future__ import annotations

from types import SimpleNamespace

from amaranth.hdl import Cat, Const, Module, Mux, Signal, signed, unsigned
from amaranth.lib import enum, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from eskin.golden.core.config import AcceleratorConfig
from eskin.rtl.common.collisions import NO_COLLISION
from eskin.rtl.common.compare import reaches
from eskin.rtl.common.fixed import wrapping_increment
from eskin.rtl.common.layouts import beat_layout, sum_layout


class Operation(enum.Enum, shape=2):  # type: ignore[call-arg]
    """What is done with a beat, in this order: the window that began one hop ago, two hops ago (its last
    frame), with this hop."""

    OLDER = 0
    ENDING = 1
    NEWEST = 2


class WindowAverager(wiring.Component):
    """Sums over overlapping windows, in one memory with one adder: each beat is added to the window that is
    older, then to the newest.

    ::

        frames      |   hop 0   |   hop 1   |   hop 2   |          thesis: hop 307, window 615 = 2 hop + 1
        bank 0      |<------- window 1 ---->x<-- window 3 ...      x = first frame of hop 2
        bank 1                  |<------- window 2 ---->x

    A window's sum lives in the bank of its first hop's parity. It starts as the first deviation itself, so
    nothing is ever cleared and old memory contents do not matter. It ends with the last frame of its second
    hop (2 hop frames), or with the first frame of the next hop (2 hop + 1). The latter takes a third
    operation, because the window that begins with that frame uses the same bank. A clipped window ends with
    frame ``touch_frames``; if several end with it, all but the first are read out in passes that add nothing.
    Integrals (`eskin.rtl.frontend.feature_expander`) are not added up: a window has the value of its latest
    frame.

    Deviations come as complements and sums leave as complements: ``~(d + e) = ~d - e = ~d + ~e + 1``, so that
    neither this adder nor the normaliser's needs an inverter.

    Parameters
    ----------
    config:
        The accelerator's configuration.

    Ports
    -----
    i : In(stream of ``eskin.rtl.frontend.feature_expander.beat_layout``)
        Touch: frames s..e of each touch; hops are counted here. Free: every frame, hops are marked by the
        detector. A beat for each kind of each taxel.
    o : Out(stream of ``sum_layout``)
        ``steps`` windows a touch, ``inputs`` beats each. ``length`` and ``final`` are the window's on each of
        its beats.
    touch_last : Out(1), ``window_mode`` touch
        The beat at ``i`` is the touch's last: known from the second cycle on in which it is waited for, the
        first in which it is taken.

    Timing
    ------
    One beat every 2 cycles while ``o`` is taken, every 3 in a frame that ends a window of 2 hop + 1. The
    first sum leaves 1 cycle after its beat was seen where it ends with its second hop, 2 where it has the
    third operation. A further pass takes a cycle an input.
    """

    def __init__(self, config: AcceleratorConfig):
        self.config = config
        touch = config.windows.window_mode == "touch"
        ports = {
            "i": In(stream.Signature(beat_layout(config))),
            "o": Out(stream.Signature(sum_layout(config))),
        }
        super().__init__(ports | ({"touch_last": Out(1)} if touch else {}))

    def elaborate(self, platform):
        config, m = self.config, Module()
        index, index_next = Signal(range(config.sensor.taxels)), Signal(range(config.sensor.taxels))
        several, kind, kind_next = config.kinds > 1, Const(0, 0), Const(0, 0)
        if several:
            kind, kind_next = Signal(range(config.kinds)), Signal(range(config.kinds))
        operation, operation_next = Signal(Operation), Signal(Operation)
        advance, step = Signal(), Signal()
        at_last = reaches(index, config.sensor.taxels - 1)
        if several:
            last_kind = reaches(kind, config.kinds - 1)
            at_last &= last_kind
        beat_done = Signal()  # the last operation on this beat
        schedule = self._touch_schedule if config.windows.window_mode == "touch" else self._free_schedule
        now = schedule(m, operation, beat_done & at_last, step)
        m.d.comb += [
            advance.eq(~self.o.valid | self.o.ready),
            step.eq(advance & (self.i.valid | now.draining)),
            beat_done.eq((operation == Operation.NEWEST) | now.draining),
            self.i.ready.eq(advance & beat_done & ~now.draining),
            index_next.eq(
                Mux(
                    beat_done & last_kind if several else beat_done,
                    wrapping_increment(index, config.sensor.taxels),
                    index,
                )
            ),
        ]
        if several:
            m.d.comb += kind_next.eq(Mux(beat_done, wrapping_increment(kind, config.kinds), kind))
        with m.If(beat_done & at_last):
            m.d.comb += operation_next.eq(now.first_operation)
        with m.Elif(beat_done):
            m.d.comb += operation_next.eq(Mux(now.draining, operation, Operation.OLDER))
        with m.Else():
            is_older = operation == Operation.OLDER
            m.d.comb += operation_next.eq(Mux(is_older & now.ending, Operation.ENDING, Operation.NEWEST))

        # The word of the next operation is read while this one adds: an address comes back after 3 operations
        # at the earliest.
        # With it goes ``masked`` of its last frame, for the passes that add nothing.
        bits, has_faults = config.sum_bits, bool(config.faults.fault_frames)
        m.submodules.sums = sums = Memory(
            shape=unsigned(bits + has_faults), depth=2 << len(kind) + len(index), init=[], attrs=NO_COLLISION
        )
        read, write = sums.read_port(), sums.write_port()
        total, bank = Signal(signed(bits), reset_less=True), Signal()
        fresh = Signal()
        m.d.comb += [
            read.addr.eq(Cat(kind_next, index_next, now.parity_next ^ (operation_next == Operation.OLDER))),
            read.en.eq(step),
            write.addr.eq(Cat(*([self.o.p.kind] if several else ()), self.o.p.taxel, bank)),
            write.data.eq(Cat(total, *([self.o.p.masked] if has_faults else ()))),
            write.en.eq(fresh),
            self.o.p.complement.eq(total),
        ]
        # of a window that ends here nothing is kept: the one that takes its bank is written next
        m.d.sync += fresh.eq(step & (operation != Operation.ENDING) & ~now.draining)
        deviation = ~self.i.p.complement
        begins = now.begins & (operation == Operation.NEWEST) & ~now.draining
        if "integral" in config.features.feature_kinds:
            begins |= (kind == config.features.feature_kinds.index("integral")) & ~now.draining
        with m.If(step):
            m.d.sync += [
                index.eq(index_next),
                operation.eq(operation_next),
                total.eq(
                    Mux(
                        begins,
                        self.i.p.complement,
                        read.data[:bits].as_signed() - (Mux(now.draining, 0, deviation)),
                    )
                ),
                self.o.p.taxel.eq(index),
                *([kind.eq(kind_next), self.o.p.kind.eq(kind)] if several else ()),
                bank.eq(now.parity ^ (operation == Operation.OLDER)),
                self.o.p.length.eq(now.length),
                self.o.p.final.eq(now.final),
            ]
            if has_faults:
                m.d.sync += self.o.p.masked.eq(Mux(now.draining, read.data[bits], self.i.p.masked))
        with m.If(advance):
            m.d.sync += self.o.valid.eq(step & now.emit)
        if config.windows.window_mode == "touch":
            m.d.sync += self.touch_last.eq(now.at_end & at_last & ~now.draining)
        return m

    def _free_schedule(self, m: Module, operation, frame_ends, step) -> SimpleNamespace:
        """As ``_touch_schedule``, from the detector's marks."""
        parity, begins = Signal(), Signal(init=1)
        parity_next = parity ^ (frame_ends & self.i.p.hop_last)
        with m.If(step & frame_ends):
            m.d.sync += [parity.eq(parity_next), begins.eq(self.i.p.hop_last)]
        return SimpleNamespace(
            parity=parity,
            parity_next=parity_next,
            begins=begins,
            ending=Const(0, 1),
            draining=Const(0, 1),
            first_operation=Operation.OLDER,
            emit=self.i.p.emit & (operation == Operation.OLDER),
            final=self.i.p.end,
            length=Const(0, 1),
        )

    def _touch_schedule(self, m: Module, operation, frame_ends, step) -> SimpleNamespace:
        """Count the frames of a touch and insert the passes that add nothing, where ``step`` ends a pass with
        ``frame_ends``.

        Returns the parity of the hop, now and after this operation; whether the newest window ``begins`` with
        this frame and one is ``ending`` with it that takes the third operation; whether the pass is
        ``draining``, the next pass's ``first_operation``; of the operation under way whether to ``emit`` its
        sum, and the window's ``final`` and ``length``.
        """
        config = self.config
        last_hop, last_in_hop = divmod(config.last_frame - 1, config.windows.hop)
        together = [k for k, (_, end) in enumerate(config.window_spans) if end == config.last_frame]
        reads = [
            {2: Operation.ENDING, 1: Operation.OLDER, 0: Operation.NEWEST}[last_hop - k] for k in together
        ]
        hop, frame_in_hop = Signal(range(max(4, last_hop + 1))), Signal(range(config.windows.hop))
        passes = Signal(range(len(together)))  # 0: the frame itself, then one for each further window
        begins, at_end = Signal(init=1), reaches(hop, last_hop) & reaches(frame_in_hop, last_in_hop)
        last_pass = passes == len(together) - 1
        hop_last = reaches(frame_in_hop, config.windows.hop - 1)
        hop_next, passes_next = Signal.like(hop), Signal.like(passes)
        m.d.comb += [hop_next.eq(hop), passes_next.eq(passes)]
        with m.If(frame_ends):
            with m.If(~at_end):
                m.d.comb += hop_next.eq(hop + hop_last)
            with m.Elif(~last_pass):
                m.d.comb += passes_next.eq(passes + 1)
            with m.Else():
                m.d.comb += [hop_next.eq(0), passes_next.eq(0)]
        with m.If(step):
            m.d.sync += [hop.eq(hop_next), passes.eq(passes_next)]
            with m.If(frame_ends & ~at_end):
                m.d.sync += [frame_in_hop.eq(Mux(hop_last, 0, frame_in_hop + 1)), begins.eq(hop_last)]
            with m.If(frame_ends & at_end & last_pass):
                m.d.sync += [frame_in_hop.eq(0), begins.eq(1)]

        even = config.windows.window == 2 * config.windows.hop
        whole = (
            (operation == Operation.OLDER) & hop_last & (hop != 0) if even else operation == Operation.ENDING
        )
        clipped, length = Signal(), Signal(range(max(2, len(config.window_lengths))))
        first_operation = Signal(Operation)
        for number, k in enumerate(together):
            with m.If(at_end & (passes == number)):
                m.d.comb += [clipped.eq(operation == reads[number]), length.eq(config.length_index[k])]
                if number + 1 < len(together):
                    m.d.comb += first_operation.eq(reads[number + 1])
        return SimpleNamespace(
            parity=hop[0],
            parity_next=hop_next[0],
            begins=begins,
            ending=Const(0, 1) if even else begins & (hop >= 2),
            draining=passes != 0,
            first_operation=first_operation,
            at_end=at_end,
            emit=whole & (passes == 0) | clipped,
            final=at_end & last_pass,
            length=length,
        )
