"""The ring that gives a touch the frames before its onset (SPECIFICATION.md, section 2: start frame s)."""

from __future__ import annotations

from amaranth.hdl import Cat, Module, Mux, Signal, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out
from amaranth.utils import ceil_log2

from golden.config import AcceleratorConfig
from rtl.onset_detector import frame_layout


def touch_layout(config: AcceleratorConfig) -> data.StructLayout:
    """One deviation of a frame that belongs to a touch; ``last``: last taxel of the frame."""
    return data.StructLayout({"value": signed(config.deviation_bits), "last": 1})


class PreTriggerRing(wiring.Component):
    """Keeps the last frames while no touch is open; at an onset replays them and goes on as a FIFO until the touch ends.

    Frames are written as they come, frame by frame into slots of 2**k beats. ``history`` counts the frames since reset up to
    ``pretrigger_frames``, so that at the onset, which is known with the last beat of frame f, the reader starts ``history`` slots before
    f: s = f - history = max(1, f - pretrigger_frames). The third term of s, e_prev + 1, is never the largest: rearm_frames is at least
    ``ring_frames``, which also lets the reader end a touch before the next onset. The frame that the detector marks ``end`` is read last.

    Parameters
    ----------
    config:
        ``window_mode`` touch. With onset ``immediate`` there is no history and no memory: frames of the touch pass, others are dropped.

    Ports
    -----
    i : In(stream of ``frame_layout``)
        Every frame. ``ready`` is low only when ``ring_frames`` whole frames are held, and one beat of the next.
    o : Out(stream of ``touch_layout``)
        Frames s..e of every touch, nothing else.

    Timing
    ------
    The first beat of frame s is offered 2 cycles after the last beat of frame f was taken; from then one beat a cycle out while one beat
    a cycle goes in. Onset ``immediate``: combinational, 0 cycles.
    """

    def __init__(self, config: AcceleratorConfig):
        self.config = config
        super().__init__({"i": In(stream.Signature(frame_layout(config))), "o": Out(stream.Signature(touch_layout(config)))})

    def elaborate(self, platform):
        config, m = self.config, Module()
        if config.opens_at_once:
            m.d.comb += [
                self.o.valid.eq(self.i.valid & self.i.p.touch),
                self.o.p.value.eq(self.i.p.value),
                self.o.p.last.eq(self.i.p.last),
                self.i.ready.eq(self.o.ready | ~self.i.p.touch),
            ]
            return m

        # one slot more than whole frames: `full` is a register, so one beat of the next frame may still come in
        slot_bits, taxel_bits = ceil_log2(config.ring_frames + 1), ceil_log2(config.taxels)
        m.submodules.ring = ring = Memory(shape=signed(config.deviation_bits), depth=1 << slot_bits + taxel_bits, init=[])
        write, read = ring.write_port(), ring.read_port()

        head, head_taxel = Signal(slot_bits), Signal(taxel_bits)
        tail, tail_taxel = Signal(slot_bits), Signal(taxel_bits)
        history = Signal(range(config.pretrigger_frames + 1))
        reading, full = Signal(), Signal()  # reading: a touch is being replayed or passed on
        stop, stopping = Signal(slot_bits), Signal()  # slot of frame e, once it is known

        # --- write side
        taken, pushed = Signal(), Signal()
        m.d.comb += [
            self.i.ready.eq(~full),
            taken.eq(self.i.valid & ~full),
            pushed.eq(taken & self.i.p.last),
            write.addr.eq(Cat(head_taxel, head)),
            write.data.eq(self.i.p.value),
            write.en.eq(taken),
        ]
        with m.If(taken):
            m.d.sync += head_taxel.eq(Mux(self.i.p.last, 0, head_taxel + 1))
        with m.If(pushed):
            m.d.sync += head.eq(head + 1)
            with m.If(self.i.p.end):
                m.d.sync += stop.eq(head)
            with m.If(history != config.pretrigger_frames):
                m.d.sync += history.eq(history + 1)
        m.d.sync += full.eq(reading & ((head - tail)[:slot_bits] == config.ring_frames))

        # --- read side: the memory's output register is the output
        fetched, fetched_last, fetch, popped = Signal(), Signal(), Signal(), Signal()
        at_last = tail_taxel == config.taxels - 1
        free = ~fetched | self.o.ready
        m.d.comb += [
            fetch.eq(reading & (tail != head) & free),
            popped.eq(fetch & at_last),
            read.addr.eq(Cat(tail_taxel, tail)),
            read.en.eq(fetch),
            self.o.valid.eq(fetched),
            self.o.p.value.eq(read.data),
            self.o.p.last.eq(fetched_last),
        ]
        with m.If(free):
            m.d.sync += [fetched.eq(fetch), fetched_last.eq(at_last)]
        with m.If(fetch):
            m.d.sync += tail_taxel.eq(Mux(at_last, 0, tail_taxel + 1))
        with m.If(popped):
            m.d.sync += tail.eq(tail + 1)
        with m.If(pushed & ~reading):  # the pointer follows every frame: the late onset bit drives one flip-flop only
            m.d.sync += tail.eq(head - history)
        m.d.sync += [
            reading.eq(Mux(reading, ~(popped & (stopping & (tail == stop))), pushed & self.i.p.onset)),
            stopping.eq(reading & (stopping | (pushed & self.i.p.end))),
        ]
        return m
