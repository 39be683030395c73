"""Exact sums over overlapping windows, made of sums of hops (docs/specification.md, section 2: windows and
sums)."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, unsigned
from amaranth.lib import enum, stream

from eskin.golden.core import SUMMED, AcceleratorConfig
from eskin.rtl.common import (
    Block,
    beat_layout,
    comes,
    drive,
    expands,
    frame_gap,
    inputs,
    outputs,
    reaches,
    sum_layout,
    working_memory,
    wrapping_increment,
)
from eskin.rtl.frontend.registered_adder import RegisteredAdder


class Operation(enum.Enum, shape=2):  # type: ignore[call-arg]
    """Operations on a beat, in this order: it is added to the sum of its hop; where a window ends, the sums
    of the hop before the last and of the last hop are added to that. Bit 0: the adder continues from its last
    result."""

    NEWEST = 0
    OLDER = 3
    PREVIOUS = 1


class WindowAverager(Block):
    """Sums over overlapping windows, in one memory with one adder: each beat is added to the sum of its hop,
    and a window's hops are added up in the frame that ends it.

    ::

        frames      |   hop 0   |   hop 1   |   hop 2   |          thesis: hop 307, window 615 = 2 hop + 1
        bank 0      |<--------->|           |<--------->|          window 1: hop 0, hop 1, x
        bank 1                  |<--------->|x                     x = first frame of hop 2

    A hop's sum lives in the bank of its parity. It starts as the first deviation itself, so nothing is ever
    cleared and old memory contents do not matter. A window ends with the last frame of its second hop
    (2 hop frames: one more operation), or with the first frame of the next hop (2 hop + 1: two more, and the
    sum of the hop that begins takes the bank that was just read). A clipped window ends with frame
    ``touch_frames``; if several end with it, all but the first are read out in passes that take no beat.
    Integrals and extremes (`eskin.rtl.frontend.feature_expander`) are not added up: a window has the value of
    its last frame.

    Deviations come as complements and sums leave as complements: ``~(d + e) = ~d - e = ~d + ~e + 1``, so that
    neither this adder nor the normaliser's needs an inverter.

    Parameters
    ----------
    config:
        The accelerator's configuration.

    Ports
    -----
    i : In(stream of ``beat_layout``)
        Touch: frames s..e of each touch. Free: every frame.
    o : Out(stream of ``sum_layout``)
        ``steps`` windows a touch, ``inputs`` beats each. ``length`` and ``final`` are the window's on each of
        its beats.
    frame_last : Out(1)
        The beat at ``i`` is its frame's last.
    holds : Out(1)
        A sum is offered or not yet written, or passes take no beat.

    Timing
    ------
    One beat a cycle while ``o`` is taken. In a frame that ends a window one every 2 cycles, for windows of
    2 hop + 1 every 3; a clipped window of one hop takes 1. The first sum leaves as many cycles after its beat
    was seen. A further pass takes a cycle an input, or 2 for a window of two hops. After each frame and pass
    of fewer than 3 taxels the first word is read again: 3 - taxels cycles (``frame_gap``).
    """

    def ports(self, config: AcceleratorConfig):
        return inputs(i=stream.Signature(beat_layout(config))) | outputs(
            "frame_last", "holds", o=stream.Signature(sum_layout(config))
        )

    def elaborate(self, platform):
        config, m = self.spec, Module()
        kinds, windows = config.features.feature_kinds, config.windows
        index = Signal(range(config.sensor.taxels))
        index_next = Signal(range(config.sensor.taxels))
        operation = Signal(Operation)
        operation_next = Signal(Operation)
        advance = Signal()
        step = Signal()
        beat_done = Signal()

        # --- windows that end with the touch's last frame: the frame itself is the first one's pass
        last_hop = (config.last_frame - 1) // windows.hop
        together = [k for k, (_, end) in enumerate(config.window_spans) if end == config.last_frame]
        passes = Signal(range(len(together)))
        hops = Signal(2)  # how many are added to this one
        draining, last_pass = passes != 0, passes == len(together) - 1
        at_end, emits = self.i.p.end | draining, self.i.p.emit | draining
        length = Signal(range(max(2, len(config.window_lengths))))
        with m.If(emits & ~at_end):
            m.d.comb += hops.eq(windows.window - 2 * windows.hop + 1)
        for number, k in enumerate(together):
            with m.If(at_end & (passes == number)):
                m.d.comb += [hops.eq(last_hop - k), length.eq(config.length_index[k])]

        # --- beats: the kinds that come, taxel by taxel
        several, kind, kind_next, last_kind = len(kinds) > 1, Cat(), Cat(), Const(1, 1)
        if several:
            kind = Signal(range(len(kinds)))
            kind_next = Signal(range(len(kinds)))
            last_kind = Signal()
            more = [~draining & ~comes(name, self.i.p) for name in kinds[1:]]
            m.d.comb += [
                last_kind.eq(Cat(*more, Const(1, 1)).bit_select(kind, 1)),
                kind_next.eq(Mux(beat_done, Mux(last_kind, 0, kind + 1), kind)),
            ]
        at_last = reaches(index, config.sensor.taxels - 1) & last_kind
        pass_ends = beat_done & at_last
        gap = frame_gap(m, config.sensor.taxels, step & pass_ends)
        free = advance & ~gap
        m.d.comb += [
            advance.eq(~self.o.valid | self.o.ready),
            step.eq(free & (self.i.valid | draining)),
            beat_done.eq(Mux(operation.as_value()[0], operation == Operation.PREVIOUS, hops == 0)),
            self.i.ready.eq(free & beat_done & ~draining),
            self.frame_last.eq(at_last),
            index_next.eq(Mux(beat_done & last_kind, wrapping_increment(index, config.sensor.taxels), index)),
        ]
        with m.If(~beat_done):
            more_hops = hops[1] & (operation == Operation.NEWEST)
            m.d.comb += operation_next.eq(Mux(more_hops, Operation.OLDER, Operation.PREVIOUS))

        # --- the hop: its bank, and whether its first beat of a kind is still to come
        turns = Signal()
        parity = Signal()
        passes_next = Signal.like(passes)
        begins, begins_next = (
            {name: Signal(init=1, name=f"begins_{name}") for name in kinds} for _ in range(2)
        )
        m.d.comb += [
            turns.eq(pass_ends & (draining | self.i.p.hop_last) & (~at_end | last_pass)),
            passes_next.eq(Mux(pass_ends, Mux(at_end & ~last_pass, passes + 1, 0), passes)),
        ]
        for name in kinds:
            over = pass_ends & (comes(name, self.i.p) if expands(config) else 1)
            m.d.comb += begins_next[name].eq((begins[name] & ~over) | turns | (name not in SUMMED))
            with m.If(step):
                m.d.sync += begins[name].eq(begins_next[name])
        # the next operation takes nothing from the memory: a hop's first, or a kind that no hop adds to
        alone = Signal(init=1)
        alone_next = Const(0)
        for number, name in enumerate(kinds):
            newest_next = (operation_next == Operation.NEWEST) & (passes_next == 0) & begins_next[name]
            joined_next = (operation_next != Operation.NEWEST) & (name not in SUMMED)
            alone_next |= (kind_next == number) & (newest_next | joined_next)
        with m.If(step):
            m.d.sync += [passes.eq(passes_next), parity.eq(parity ^ turns), alone.eq(alone_next)]

        # The word of the next operation is read while this one adds, or in the gap: an address comes back
        # after ``STATE_BEATS`` cycles at the earliest.
        # With it goes ``masked`` of its last frame, for the passes that take no beat.
        bits, has_faults = config.sum_bits, bool(config.faults.fault_frames)
        read, write = working_memory(m, "sums", unsigned(bits + has_faults), 2 << len(kind) + len(index))
        m.submodules.adder = adder = RegisteredAdder(config, bits, carry=1)
        total = adder.total
        bank = Signal(name="bank")
        fresh = Signal()
        word_next = Cat(kind_next, index_next, parity ^ turns ^ (operation_next == Operation.PREVIOUS))
        drive(m, read, addr=Mux(gap, Cat(kind, index, parity), word_next), en=step | gap)
        drive(
            m,
            write,
            addr=Cat(*([self.o.p.kind] if several else ()), self.o.p.taxel, bank),
            data=Cat(total, *([self.o.p.masked] if has_faults else ())),
            en=fresh,
        )
        m.d.comb += self.o.p.complement.eq(total)
        newest = ~operation.as_value()[0]
        m.d.sync += fresh.eq(step & newest & ~draining)
        m.d.comb += self.holds.eq(Cat(fresh, self.o.valid, draining, gap).any())
        addend = Mux(newest, self.i.p.complement | draining.as_signed(), total)
        drive(m, adder, step=step, alone=alone, word=read.data, addend=addend)
        with m.If(step):
            m.d.sync += [
                index.eq(index_next),
                operation.eq(operation_next),
                self.o.p.taxel.eq(index),
                *([kind.eq(kind_next), self.o.p.kind.eq(kind)] if several else ()),
                bank.eq(parity),
                self.o.p.length.eq(length),
                self.o.p.final.eq(at_end & last_pass),
            ]
            if has_faults:
                with m.If(newest):
                    m.d.sync += self.o.p.masked.eq(Mux(draining, read.data[bits], self.i.p.masked))
        with m.If(advance):
            m.d.sync += self.o.valid.eq(step & beat_done & emits)
        return m
