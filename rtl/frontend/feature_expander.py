"""Feature expander: one deviation becomes one beat for each kind of feature (docs/specification.md, section
2)."""

from typing import Any

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value, signed
from amaranth.lib import data, stream
from amaranth.lib.memory import Memory

from eskin.golden.core import EXTREMES, AcceleratorConfig, signed_bits
from eskin.rtl.common import (
    NO_COLLISION,
    Block,
    beat_layout,
    biased_magnitude,
    comes,
    frame_gap,
    inputs,
    logarithm,
    outputs,
    reaches,
    window_layout,
    wrapping_increment,
)

EARLIEST = {"mean": 0, "activity": 1, "integral": 2, "highest": 1, "lowest": 1}
"""First cycle, counted from the cycle that sees a deviation, in which the beat of each kind can be made."""


def slots_of(config: AcceleratorConfig) -> dict[str, int]:
    """The cycle in which the beat of each kind is made: one after the other."""
    slots: dict[str, int] = {}
    for kind in config.features.feature_kinds:
        slots[kind] = max([EARLIEST[kind], *(slot + 1 for slot in slots.values())])
    return slots


class FeatureExpander(Block):
    """Makes of each deviation a beat for each of ``feature_kinds`` that has a value in its frame, in their
    order; later blocks see more taxels.

    - ``mean``: the deviation e itself, in every frame.
    - ``activity``: the block's activity, in the last frame of each ``activity_block`` frames. A taxel's state
      is the sum s of its block so far and, with rule ``change``, r = s - (the last block's s). r begins as
      e - s, so neither needs a third operand.
    - ``integral``: the sum S of the deviations since the first frame of the touch's first window, companded,
      in frames that end a window. In ``window_mode`` touch the sum begins with the first frame that arrives.
      In mode free, S falls back to the sum C of the previous hop with every hop that begins outside a touch,
      so at an onset it covers what the first window has seen. (A touch continues after a frame with ``emit``
      but without ``end``.)
    - ``highest``, ``lowest``: the extreme of these deviations, in these frames, and begun like S.

    State is written by the first beats of a recording or touch before it is used, whatever was in the memory.
    Bounds: |s| <= B times ``deviation_bound``; |r| <= ``block_bound``; |C| <= hop times ``deviation_bound``;
    an extreme is a deviation; |S| <= ``integral_bound``: a touch has ``last_frame`` frames from its first window on, and with no touch S
    spans two hops at most. (Opens at once: S runs on beyond the touch, and wraps, but no window takes it
    then.)

    Parameters
    ----------
    config:
        The accelerator's configuration, ``feature_kinds`` other than the mean alone.

    Ports
    -----
    i : In(stream of ``window_layout``)
        The deviations, as complements.
    o : Out(stream of ``beat_layout``)
        Complements; marks belong to the deviation, on each of its beats.
    frame_last : Out(1)
        The deviation at ``i`` is its frame's last.
    holds : Out(1)
        A beat is offered, or state is not yet written.

    Timing
    ------
    A deviation takes a cycle while ``o`` is taken, or as many as the slot (``slots_of``) of the last kind that
    comes asks for. The beat of each kind is offered in the cycle after its slot: the mean 1 cycle after the
    deviation was seen, activity 2, the integral 3, an extreme 2 or one after the kind before it. After each
    frame of fewer than 3 taxels the state is read again: 3 - taxels cycles (``frame_gap``).
    """

    def ports(self, config: AcceleratorConfig):
        return inputs(i=stream.Signature(window_layout(config))) | outputs(
            "frame_last", "holds", o=stream.Signature(beat_layout(config))
        )

    def elaborate(self, platform):
        config, m = self.spec, Module()
        kinds = config.features.feature_kinds
        taxel = Signal(range(config.sensor.taxels))
        slot_of = slots_of(config)
        slot = Signal(range(1 + max(1, *slot_of.values())))
        advance = Signal()
        step = Signal()
        last_slot = Signal()
        at_last = reaches(taxel, config.sensor.taxels - 1)
        taken = Signal()
        frame_taken = Signal()
        gap = frame_gap(m, config.sensor.taxels, frame_taken)
        free = advance & ~gap
        m.d.comb += [
            self.frame_last.eq(at_last),
            advance.eq(~self.o.valid | self.o.ready),
            step.eq(free & self.i.valid),
            self.i.ready.eq(free & last_slot),
            taken.eq(step & last_slot),
            frame_taken.eq(taken & at_last),
        ]
        with m.If(step):
            m.d.sync += slot.eq(Mux(last_slot, 0, slot + 1))
        with m.If(taken):
            m.d.sync += taxel.eq(wrapping_increment(taxel, config.sensor.taxels))

        # --- what follows from the frame: the first of all (of the recording, or of the touch)
        first = Signal(init=1)
        ends = self.i.p.end if config.windows.window_mode == "touch" else Const(0)
        if config.follows_touch:
            ends = ~self.i.p.touch | self.i.p.end
        with m.If(frame_taken):
            m.d.sync += first.eq(ends)

        # --- state of a taxel: read with the beat before it, renewed in its first slot, written back in the cycle after
        deviation = ~self.i.p.complement
        fields: dict[str, int] = {}  # bits of each value kept between frames
        next_state: dict[str, Value] = {}
        present_state: dict[str, Value] = {}

        def keep(name: str, bits: int) -> Value:
            fields[name] = bits
            present_state[name] = Signal(signed(bits), name=f"kept_{name}")
            return present_state[name]

        block, bound = config.features.activity_block, config.deviation_bound
        block_last, amount = Const(1, 1), deviation
        compares = Const(1, 1)  # a block before this one is there, or none is needed
        if "activity" in kinds:
            block_first, lone = Const(1, 1), first  # first frame of a block; the first block of all
            if block > 1:
                frame_in_block = Signal(range(block))
                block_first, block_last = frame_in_block == 0, reaches(frame_in_block, block - 1)
                with m.If(frame_taken):
                    m.d.sync += frame_in_block.eq(Mux(block_last | ends, 0, frame_in_block + 1))
            if block > 1 or config.features.activity_rule == "change":
                old = keep("block", signed_bits(block * bound))
                next_state["block"] = Mux(block_first, 0, old) + deviation if block > 1 else deviation
            if config.features.activity_rule == "change":
                if block > 1:
                    lone = Signal(init=1)
                    with m.If(frame_taken & block_last):
                        m.d.sync += lone.eq(ends)
                    with m.If(frame_taken & ends):
                        m.d.sync += lone.eq(1)
                    next_state["change"] = (
                        Mux(block_first, -old, keep("change", signed_bits(config.block_bound))) + deviation
                    )
                else:
                    next_state["change"] = deviation - old
                compares = ~lone
        falls_back = config.windows.window_mode == "free" and not config.opens_at_once
        if falls_back:
            hop_first = Signal(init=1)
            falls = Signal(init=1)
            with m.If(frame_taken):
                m.d.sync += [
                    hop_first.eq(self.i.p.hop_last),
                    falls.eq(self.i.p.hop_last & ~(self.i.p.emit & ~self.i.p.end)),
                ]
        joins: dict[str, Any] = {  # the value with this deviation; without: there is none before
            "total": lambda without, before: Mux(without, 0, before) + deviation,
            "highest": lambda without, before: Mux(without | (deviation > before), deviation, before),
            "lowest": lambda without, before: Mux(without | (deviation < before), deviation, before),
        }
        wide, narrow = config.integral_bits, signed_bits(bound)
        of_touch = (
            {"total": (wide, "hop", signed_bits(config.windows.hop * bound))} if "integral" in kinds else {}
        )
        of_touch |= {kind: (narrow, f"{kind}_of_hop", narrow) for kind in EXTREMES if kind in kinds}
        for name, (bits, hop_name, hop_bits) in of_touch.items():
            begins_from = keep(name, bits)
            if falls_back:
                of_hop = keep(hop_name, hop_bits)
                next_state[hop_name] = joins[name](hop_first, of_hop)
                begins_from = Mux(falls, of_hop, begins_from)
            next_state[name] = joins[name](first, begins_from)
        widths = fields | ({"change": signed_bits(config.block_bound)} if "change" in next_state else {})
        start = {
            name: Signal(signed(widths[name]), name=f"fresh_{name}", reset_less=True) for name in next_state
        }
        with m.If(step & (slot == 0)):
            m.d.sync += [start[name].eq(value) for name, value in next_state.items()]
        if fields:
            m.submodules.state = state = Memory(
                shape=data.StructLayout({name: bits for name, bits in fields.items()}),
                depth=config.sensor.taxels,
                init=[],
                attrs=NO_COLLISION,
            )
            read, write = state.read_port(), state.write_port()
            written = Signal()
            taxel_next = wrapping_increment(taxel, config.sensor.taxels)
            m.d.sync += written.eq(step & (slot == 0))
            m.d.comb += [
                read.addr.eq(Mux(gap, 0, taxel_next)),
                read.en.eq(taken | gap),
                *(present_state[name].eq(read.data[name]) for name in fields),
                write.addr.eq(taxel_of_fresh := Signal.like(taxel, name="taxel_of_fresh")),
                write.en.eq(written),
                *(write.data[name].eq(start[name]) for name in fields),
            ]
            with m.If(step & (slot == 0)):
                m.d.sync += taxel_of_fresh.eq(taxel)
        m.d.comb += self.holds.eq(Cat(self.o.valid, written if fields else 0, gap).any())

        # --- beats: each in its slot
        complement = {"mean": self.i.p.complement}
        if "activity" in kinds:
            amount = start.get("change", start.get("block", deviation))
            negative = amount[-1]
            # ~|a| = ~a, or a - 1 where it is negative
            complement["activity"] = Mux(compares, Mux(negative, amount, ~amount) - negative, -1)
        if "integral" in kinds:
            most = config.integral_bound + (1 << config.features.integral_knee)
            biased = Signal(range(most + 1), reset_less=True)
            below = Signal()
            with m.If(step & (slot == 1)):
                m.d.sync += [
                    biased.eq(biased_magnitude(~start["total"], config.features.integral_knee)),
                    below.eq(start["total"][-1]),
                ]
            size = Signal(config.beat_bits - 1)
            logarithm(m, size, biased, config.features.integral_knee, config.features.integral_frac)
            complement["integral"] = Mux(below, size - 1, ~Cat(size, Const(0, 1)))
        complement |= {kind: ~start[kind] for kind in EXTREMES if kind in kinds}
        # the last slot belongs to the last kind that comes; a frame in which none does takes one
        marks = [name for name, _ in window_layout(config) if name != "complement"]
        beat = Signal(beat_layout(config))
        m.d.comb += [beat.block_last.eq(block_last), *(beat[name].eq(self.i.p[name]) for name in marks)]
        made_now, slots = Const(0), Const(0, len(slot))
        for kind in kinds:
            made_now |= (slot == slot_of[kind]) & comes(kind, beat)
            slots = Mux(comes(kind, beat), slot_of[kind], slots)
            with m.If(slot == slot_of[kind]):
                m.d.comb += beat.complement.eq(complement[kind])
        m.d.comb += last_slot.eq(slot == slots)
        with m.If(advance):
            m.d.sync += self.o.valid.eq(step & made_now)
        with m.If(step):
            m.d.sync += self.o.p.eq(beat)
        return m
