"""The turns of the fast oscillator: two domains whose edges come at any time, the fast one's only while its output is on."""

from itertools import pairwise

from amaranth.hdl import DomainRenamer, EnableInserter, Module, Mux, Signal, Value

from eskin.rtl.top.standby import StandbyControl
from formal.proof import Bug, assume, before, free, placed, proof, prove, registers

START, QUIET = 2, 2


class _AnyEdges(StandbyControl):
    """Each domain has its edges where ``slow`` and ``fast`` say."""

    def elaborate(self, platform):
        self.slow, self.fast = Signal(), Signal()
        edges = EnableInserter({"slow": self.slow, "sync": self.fast})(super().elaborate(platform))
        return DomainRenamer({"slow": "sync"})(edges)


@proof(
    "while the fast oscillator's output is off nothing is under way; it is on no sooner than `start` slow cycles after its "
    "power, and by then; each due scan is begun once, with the first slow edge at which the turn before is over",
    depth=3,
    reduced="2 slow cycles of start, 2 quiet fast ones",
    quick=True,
    bugs=(
        Bug("the oscillator goes off while the chain works", "self.scan | ~self.resting", "self.scan"),
        Bug("it goes off at the first quiet cycle", "still != self._quiet", "still != 0"),
        Bug("the start is not awaited", "timer.eq(self._start - 1)", "timer.eq(0)"),
        Bug("a scan that is due while the chain works is lost", "waiting | self.due", "0"),
        Bug("one of two that are due is lost", "waiting.eq(waiting & self.due)", "waiting.eq(0)"),
        Bug("a turn begins while the one before goes on", "(request == is_done) &", "1 &"),
    ),
)
def turns(m: Module) -> None:
    dut = placed(_AnyEdges(START, QUIET))
    slow, fast = dut.slow, dut.fast
    free(slow, fast, dut.due, dut.resting)
    assume(~fast | dut.output)  # the oscillator
    assume(
        ~(slow & dut.due & dut.waiting & (dut.request != dut.is_done)), "a turn takes less than two periods"
    )

    # the chain: it works from the cycle after a scan on, and rests for one that has been quiet
    working, rested = Signal(), Signal(range(QUIET + 1))
    with m.If(fast):
        m.d.sync += working.eq(dut.scan | (working & ~dut.resting))
        m.d.sync += rested.eq(Mux(dut.scan | ~dut.resting, 0, Mux(rested == QUIET, QUIET, rested + 1)))
    prove(rested == dut.still, "quiet cycles are counted")
    prove(~working | ~rested.any(), "it rests once it is through")
    prove(~working | (dut.begun != dut.done), "it works in its turn")

    # one turn at a time goes around the ring of toggles
    to_slow, to_fast = (each for each in registers() if each.name == "stage0")
    ring = (dut.request, dut.settled, to_fast, dut.go, dut.begun, dut.done, to_slow, dut.is_done)
    changes = sum(((left != right) for left, right in pairwise(ring)), start=Value.cast(0))
    prove(changes <= 1, "one turn at a time")

    begun, due = fast & dut.scan, slow & dut.due
    owed = Signal(3)
    m.d.sync += owed.eq(owed + due - begun)
    prove(owed == dut.waiting + (dut.request != dut.begun), "each due scan is begun once")
    prove(~begun | owed.any(), "no scan is begun that was not due")
    over = dut.request == dut.is_done
    prove(~before(due & over, "due_and_over") | dut.power, "a scan that is due has its turn at once")
    prove(~before(slow & dut.waiting & over, "waiting_and_over") | dut.power, "one that waited, too")

    since = Signal(range(START + 2))  # slow cycles with power
    with m.If(~dut.power):
        m.d.sync += since.eq(0)
    with m.Elif(slow & (since <= START)):
        m.d.sync += since.eq(since + 1)
    prove(~dut.output | (since >= START), "the start is awaited")
    prove(dut.output | ~dut.power | (since + dut.timer == START - 1), "slow cycles to go")
    prove(~dut.output & dut.power | ~dut.timer.any(), "none to go")
    prove(~dut.output | dut.power, "no output without power")
    edges = Signal(3)  # fast ones since the output is on
    with m.If(~dut.output):
        m.d.sync += edges.eq(0)
    with m.Elif(fast & (edges != 7)):
        m.d.sync += edges.eq(edges + 1)
    prove((edges < 1) | (to_fast == dut.settled), "the first synchroniser has it")
    prove((edges < 2) | (dut.go == dut.settled), "the second has it")
    prove((edges < 3) | (dut.begun == dut.settled), "a scan begins with the third fast edge at the latest")
    went_off = before(dut.output, "output_before") & ~dut.output
    prove(dut.output | ~working, "nothing is under way without a clock")
    prove(~went_off | (rested == QUIET), "it has been quiet for long enough")
