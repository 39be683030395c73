"""The longest frame, step or touch in cycles: the counter behind the register LONGEST."""

from amaranth.hdl import Module, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In

from eskin.rtl.common import ENGINE, FRAMES, inputs, outputs
from eskin.rtl.program.memory_map import Measure

COUNTER_BITS = 16


class CycleCounter(wiring.Component):
    """Counts the cycles of the quantity that ``measure`` selects and keeps the largest count; both saturate
    at 65535.

    Members
    -------
    measure : In(2)
        A `Measure`.
    clear, anew : In(1)
        Restart the count: ``clear`` for the next recording, ``anew`` when something else is to be measured.
    forget : In(1)
        The longest is 0 again.
    frames : In(FRAMES), engine : In(ENGINE)
    longest : Out(16)
    awake : Out(1)
        The next edge is counted, or ends a count.
    """

    def __init__(self) -> None:
        status = {"frames": In(FRAMES), "engine": In(ENGINE)}
        super().__init__(
            inputs("clear", "anew", "forget", measure=2) | outputs("awake", longest=COUNTER_BITS) | status
        )

    def elaborate(self, platform):
        m = Module()
        frames, engine = self.frames, self.engine
        in_frame = self.in_frame = Signal()
        frame_open, frame_taken = in_frame | (frames.offered & frames.first), frames.taken & frames.last
        m.d.sync += in_frame.eq(frame_open & ~frame_taken)
        counting = Signal()
        ending = Signal()
        counts = self.counts = Signal()
        ends = self.ends = Signal()
        m.d.sync += [counts.eq(counting), ends.eq(ending)]
        m.d.comb += self.awake.eq(counts | (ends ^ ending))
        with m.Switch(self.measure):
            with m.Case(Measure.FRAME):
                m.d.comb += [counting.eq(frame_open), ending.eq(frame_taken)]
            with m.Case(Measure.STEP):
                m.d.comb += [counting.eq(engine.slot_done), ending.eq(engine.step_done)]
            with m.Default():
                m.d.comb += [counting.eq(engine.windows_open), ending.eq(~engine.windows_open)]
        # The longest grows with the current one as soon as that is as long: no comparison of sizes, no copy.
        elapsed = self.elapsed = Signal(COUNTER_BITS)
        longest = self.longest
        # (Adding a bit takes one cell a bit where an addition under a condition takes two.)
        m.d.sync += [
            elapsed.eq(elapsed + counts),
            longest.eq(longest + (counts & (elapsed == longest) & ~longest.all())),
        ]
        with m.If(ends):
            m.d.sync += elapsed.eq(0)
        with m.If(self.clear):
            m.d.sync += [in_frame.eq(0), counts.eq(0), elapsed.eq(0)]
        with m.If(self.anew):
            m.d.sync += [counts.eq(0), elapsed.eq(0)]
        with m.If(self.forget):
            m.d.sync += longest.eq(0)
        return m
