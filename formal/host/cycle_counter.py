"""The counter of cycles: it counts the selected quantity, and the longest is the longest."""

from amaranth.hdl import Module, Mux, Signal

from eskin.rtl.host.cycle_counter import COUNTER_BITS, CycleCounter
from formal.proof import Bug, before, placed_free, proof, prove


@proof(
    "the longest is at least what is counted and grows with it only, one by one up to 65535, for anything "
    "measured, whatever begins anew",
    depth=3,
    reduced="whole",
    quick=True,
    bugs=(
        Bug("the count goes on over its end", "with m.If(ends):", "with m.If(ends & 0):"),
        Bug("the longest grows with every count", "(counts & (elapsed == longest)", "(counts"),
        Bug(
            "a new recording goes on counting",
            "in_frame.eq(0), counts.eq(0), elapsed.eq(0)",
            "in_frame.eq(0)",
        ),
    ),
)
def longest(m: Module) -> None:
    dut = placed_free(CycleCounter())
    frames, engine = dut.frames, dut.engine
    stops = dut.clear | dut.anew
    open_before, elapsed = Signal(name="open_before"), Signal(COUNTER_BITS, name="elapsed_here")
    is_open = open_before | (frames.offered & frames.first)
    m.d.sync += open_before.eq(is_open & ~(frames.taken & frames.last) & ~dut.clear)
    counted = Mux(dut.measure == 0, is_open, Mux(dut.measure == 1, engine.slot_done, engine.windows_open))
    ended = Mux(
        dut.measure == 0,
        frames.taken & frames.last,
        Mux(dut.measure == 1, engine.step_done, ~engine.windows_open),
    )
    counts, ends = before(counted & ~stops, "counts_now"), before(ended, "ends_now")
    m.d.sync += elapsed.eq(Mux(ends | stops, 0, elapsed + counts))
    whole = Signal(init=1)  # nothing was forgotten since the count began
    m.d.sync += whole.eq(ends | stops | whole & ~dut.forget)
    prove(dut.elapsed == elapsed, "cycles of what is measured, an event a cycle late")
    prove(
        (dut.counts == counts) & (dut.ends == ends) & (dut.in_frame == open_before), "the counter's own state"
    )
    prove(dut.awake == (dut.counts | dut.ends ^ ended), "an edge counts, or an end comes or goes")
    prove(~whole | (dut.longest >= elapsed), "the longest is at least as long")
    was, grows = before(dut.longest, "longest_before"), before(counts & (elapsed == dut.longest), "grows")
    prove(
        Mux(
            before(dut.forget, "forgotten"),
            dut.longest == 0,
            dut.longest == Mux(grows & ~was.all(), was + 1, was),
        )
        | (whole & (was == 0) & ~grows),
        "one by one",
    )
