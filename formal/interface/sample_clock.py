"""The sample clock: neither a frame too many nor one too few, over any time."""

from amaranth.hdl import Module, Mux, Signal

from eskin.rtl.interface.sample_clock import SampleClock
from formal.proof import Bug, before, free_inputs, opened_up, proof, prove

P, Q = 3, 17


@proof(
    "tick number k comes in cycle ceil(k q / p) from the first, k of any size; none without run, and a new "
    "run begins with a tick",
    depth=2,
    reduced="3 ticks in 17 cycles",
    bugs=(
        Bug("a cycle is lost at each tick", "since - Const(q - p)", "since - Const(q)", depth=20),
        Bug("the tick comes a cycle late", "due = since >= q - p", "due = since > q - p", depth=20),
        Bug("a new run goes on with the old count", "Mux(self.run, following, q - p)", "following", depth=40),
    ),
)
def exact(m: Module) -> None:
    dut = SampleClock(P, Q)
    inside = opened_up(dut)
    free_inputs(dut)
    was = before(dut.run, "was_running")
    # k q - p times the cycles since the first tick, k ticks so far: the next is due in the first cycle in
    # which that is 0 or less
    behind = Signal(range(-Q, Q + 1))
    first = dut.run & ~was
    due = first | (behind <= 0)
    m.d.sync += behind.eq(Mux(first, Q - P, Mux(behind <= 0, behind + Q - P, behind - P)))
    prove(dut.tick == (dut.run & due), "in its cycle")
    # ---- for the induction
    prove(~was | ((behind > -P) & (behind <= Q - P) & (inside.since + behind == Q - P)), "count")
    prove(was | (inside.since == Q - P), "a new run")
