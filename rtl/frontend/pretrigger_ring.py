"""The ring that gives a touch the frames before its onset (docs/specification.md, section 2: start frame
s)."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, unsigned
from amaranth.lib import stream
from amaranth.lib.memory import Memory
from amaranth.utils import ceil_log2

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import Block, before_an_adder, exceeds, frame_layout, inputs, outputs, touch_layout


class PreTriggerRing(Block):
    """A FIFO that keeps the last ``pretrigger_frames`` + 1 frames until an onset lets it run on.

    The oldest frame is dropped when half of another has come in. The onset is known with the last beat of
    frame f. The ring then holds exactly the frames s = max(1, f - pretrigger_frames) to f, and is read from
    there on. After the touch's last beat its contents become history again. The third term of s, e_prev + 1,
    is never the largest: rearm_frames is at least ``ring_frames``, so the reader also ends a touch before the
    next onset.

    Parameters
    ----------
    config:
        ``window_mode`` touch. With onset ``immediate`` there is no history and no memory: frames of the touch
        pass, others are dropped.

    Ports
    -----
    i : In(stream of ``frame_layout``)
        Every frame. ``ready`` is low from the cycle after ``ring_frames`` frames are held, and while frames
        are dropped for a touch. With fewer than 4 taxels, a frame's first beat arrives at least 3 cycles
        after the previous beat, as the detector sends them; an earlier beat would be counted as an extra
        frame.
    o : Out(stream of ``touch_layout``)
        Frames s..e of every touch, nothing else.
        Its reader's ``ready`` does not depend on ``valid``.
    touch_last : In(1)
        The beat offered at ``o`` is the last of frame e: the reader counts the frames. Wanted in the cycle in
        which the beat is taken.
    holds : Out(1)
        A beat is offered or fetched, a frame goes, or what follows from the number held is not yet known.

    Timing
    ------
    The first beat of frame s is offered 3 cycles (one taxel: 4) after the last beat of frame f was taken. Each
    frame still to be dropped adds 2 cycles, or 1 if its drop is under way (4 or 5 taxels, a beat a cycle). From
    then on a beat leaves every cycle, while one goes in. With ``one_port`` none is read while one goes in, so
    at full pace one goes in, and one leaves, every 2 cycles; from the second cycle on after the reader has
    taken the last beat held, each beat that comes passes the memory by in the same cycle, until the reader is
    not ready for one. Onset ``immediate``: combinational, 0 cycles.
    """

    def ports(self, config: AcceleratorConfig):
        return inputs("touch_last", i=stream.Signature(frame_layout(config))) | outputs(
            "holds", o=stream.Signature(touch_layout(config))
        )

    def elaborate(self, platform):
        config, m = self.spec, Module()
        if config.opens_at_once:
            m.d.comb += [
                self.o.valid.eq(self.i.valid & self.i.p.touch),
                self.o.p.complement.eq(self.i.p.complement),
                *([self.o.p.masked.eq(self.i.p.masked)] if config.faults.fault_frames else ()),
                self.i.ready.eq(self.o.ready | ~self.i.p.touch),
            ]
            return m

        # Plain unsigned samples: the complement's sign is always set and not stored. `fetched`, high while
        # a beat is offered, stands for it. A constant would give the upper bits of the window sums their
        # own flip-flop controls, which breaks the carry chain of their adder on iCE40.
        bits = config.deviation_bits - (config.rest_level.rest == "none" and not config.sensor.sample_signed)
        frame, capacity = config.sensor.taxels, config.ring_frames * config.sensor.taxels
        address_bits = ceil_log2(capacity + 2)
        word = unsigned(bits + bool(config.faults.fault_frames))
        m.submodules.ring = ring = Memory(
            shape=word, depth=1 << address_bits, init=[], attrs=before_an_adder(platform)
        )
        write, read = ring.write_port(), ring.read_port()
        # beats in the ring, one fetched in the cycle before included; the beat at the output is not counted
        held = self.held = Signal(address_bits)
        push = Signal()
        fetch = Signal()
        drop = Signal()
        fetched = self.fetched = Signal()
        counted = self.counted = Signal()

        # The flags made of `held` are registered, because its sum comes late.
        # surplus: a frame has begun beyond those that a touch begins with. The oldest one goes in any case.
        # full: only one more beat fits, or frames must be dropped before a touch begins and more beats would
        # upset the count. some: there is something to fetch.
        surplus = self.surplus = Signal()
        dropped = self.dropped = Signal()
        full = self.full = Signal()
        some = self.some = Signal()
        # frame f has come in, frame s - 1 may have to go; from then to frame e
        starting = self.starting = Signal()
        touch = self.touch = Signal()
        pushed = Signal()
        m.d.sync += [
            surplus.eq(exceeds(held, (config.windows.pretrigger_frames + 1) * frame + (frame // 2 or 1) - 1)),
            dropped.eq(drop),
            full.eq(exceeds(held, capacity - 1) | (starting & surplus)),
            some.eq(held[2:].any() | (held[:2] > counted + fetch)),
            counted.eq(fetch),
            pushed.eq(push),
        ]
        # the memory's output register is the output, or with one port what passes it by
        word_in = Cat(self.i.p.complement[:bits], *([self.i.p.masked] if config.faults.fault_frames else ()))
        word_out, shown, offered, written = read.data, fetched, fetched, self.i.valid & self.i.ready
        room = Const(0)
        if config.hardware.one_port:
            # The touch has caught up: what the reader takes at once is never written. Such a beat is offered
            # only where it is taken, so what waits is always the memory's output.
            passing = self.passing = Signal()
            passes = self.passes = Signal()
            m.d.comb += passes.eq(passing & self.i.valid & self.o.ready)
            word_out, shown = Mux(passing, word_in, read.data), fetched | passing
            offered, written = fetched | passes, written & ~passes
            room = ~full & self.i.valid
        ends = offered & self.o.ready & self.touch_last
        if config.hardware.one_port:
            nothing_left = ~push & (held == counted) & (~fetched | self.o.ready)
            m.d.sync += passing.eq(touch & ~ends & nothing_left)
        m.d.comb += [
            drop.eq(surplus & ~dropped & ~touch),
            fetch.eq(touch & some & ~room & (~fetched | (self.o.ready & ~self.touch_last))),
        ]
        begins = push & self.i.p.onset & ~touch
        if frame == 1:  # ``surplus`` is of the beats before this one, and it may be a beat too many
            begun = self.begun = Signal()
            m.d.sync += begun.eq(begins)
            begins = begun
        m.d.sync += [
            starting.eq(begins | (starting & surplus)),
            touch.eq((starting & ~surplus) | (touch & ~ends)),
            fetched.eq(fetch | (fetched & ~self.o.ready)),
        ]
        m.d.comb += [
            self.i.ready.eq(~full),
            push.eq(written),
            self.holds.eq(pushed | dropped | counted | surplus | starting | (touch & some) | offered),
            write.data.eq(word_in),
            write.en.eq(push),
            read.en.eq(fetch),
            self.o.valid.eq(offered),
            self.o.p.complement.eq(Cat(word_out[:bits], shown.replicate(config.deviation_bits - bits))),
        ]
        if config.faults.fault_frames:
            m.d.comb += self.o.p.masked.eq(word_out[bits])
        with m.If(push):
            m.d.sync += write.addr.eq(write.addr + 1)
        # (Never both: a beat is fetched in a touch, a frame dropped between touches. ``fetch`` comes late: it
        # only says whether the address moves.)
        with m.If(fetch | drop):
            m.d.sync += read.addr.eq(read.addr + Mux(drop, frame, 1))
        less = Mux(drop, Const(-frame, address_bits), 0) | counted.replicate(address_bits)
        m.d.sync += held.eq(held + less + push)
        return m
