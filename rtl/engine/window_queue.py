"""Two buffers of windows in front of an engine: the next fills while a step is computed
(docs/specification.md, section 4)."""

from amaranth.hdl import Module, Signal
from amaranth.lib import data, stream, wiring

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import centred_layout, drive, inputs, outputs, wrapping_increment


class WindowQueue(wiring.Component):
    """Tracks which buffer is written and which is read. The words themselves are in the engine's memory.

    Members
    -------
    i : In(stream of ``centred_layout``)
        Sums as they come; a beat is taken while there is room, a buffer is full a cycle late.
    hold : In(1)
        No beat is taken in this cycle: the memory's port is needed.
    released : In(1)
        The window that is read is done with.
    started, step_done : In(1)
        A step starts, ends with this cycle.
    take : Out(1)
        A beat is taken: it is ``taxel`` of buffer ``writing``.
    writing, reading : Out(1), taxel : Out
        Buffers, and the taxel of the next beat.
    waiting : Out(1)
        The buffer ``reading`` holds a window.
    length, final : Out
        The window's length (index), and whether it is the last of its touch.
    any, computing, open : Out(1)
        A window waits; a step is computed, from the cycle after its start; either.
    partial : Out(1)
        ``window_mode`` whole: its touch was the longest.
    overrun : Out(1)
        A window arrives while both buffers are full; with ``window_mode`` whole it may wait.
    """

    def __init__(self, config: AcceleratorConfig, taxel_bits: int):
        self._inputs, self._follows = config.inputs, config.follows_touch
        layout = centred_layout(config)
        super().__init__(
            inputs("hold", "released", "started", "step_done", i=stream.Signature(layout))
            | outputs(
                "take",
                "writing",
                "reading",
                "waiting",
                "final",
                "partial",
                "any",
                "computing",
                "open",
                "overrun",
                taxel=taxel_bits,
                length=layout["length"].shape,
            )
        )

    def elaborate(self, platform):
        m = Module()
        full = self.full = Signal(2)
        writing = self.writing
        reading = self.reading
        taxel = self.taxel
        take = self.take
        lengths = Signal(data.ArrayLayout(self.length.shape(), 2))
        finals = self.finals = Signal(2)
        # Registered, because it stalls everything in front: one cycle late, and low while the buffers change.
        room = Signal()
        computing = self.computing
        m.d.sync += room.eq(~full.bit_select(writing, 1) & ~(take & self.i.p.last))
        m.d.comb += [self.i.ready.eq(room & ~self.hold), take.eq(self.i.valid & self.i.ready)]
        drive(
            m,
            self,
            waiting=full.bit_select(reading, 1),
            length=lengths[reading],
            final=finals.bit_select(reading, 1),
            any=full.any(),
            open=full.any() | computing,
            overrun=self.i.valid & self.i.p.first & full.all() & (not self._follows),
        )
        if self._follows:
            partials = Signal(2)
            m.d.comb += self.partial.eq(partials.bit_select(reading, 1))
            with m.If(take):
                m.d.sync += partials.bit_select(writing, 1).eq(self.i.p.partial)
        with m.If(take):
            m.d.sync += [
                taxel.eq(wrapping_increment(taxel, self._inputs)),
                lengths[writing].eq(self.i.p.length),
                finals.bit_select(writing, 1).eq(self.i.p.final),
            ]
        with m.If(take & self.i.p.last):
            m.d.sync += [full.bit_select(writing, 1).eq(1), writing.eq(~writing)]
        with m.If(self.released):
            m.d.sync += [full.bit_select(reading, 1).eq(0), reading.eq(~reading)]
        with m.If(self.started | self.step_done):
            m.d.sync += computing.eq(self.started)
        return m
