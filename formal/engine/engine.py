"""The engine's control: windows in and steps out, back to waiting from every state."""

from amaranth.hdl import Module, Mux, Signal

from eskin.rtl.engine.engine import Engine
from eskin.rtl.program.microcode import Microcode
from formal import proof as words
from formal.engine.sequencer import SMALL, Program, follows, table
from formal.proof import Bug, assume, before, keeps_its_beat, placed_free, proof, prove

QUEUE = "rtl/engine/window_queue.py"
TAXELS = SMALL.sensor.taxels
REDUCED = "4 taxels, 4 units, 2 classes, 2 steps, 4 lanes"


class _Bench:
    """The engine with its input as the normaliser gives it: whole windows, first and last taxel marked."""

    def __init__(self, m: Module) -> None:
        self.dut = dut = placed_free(Engine(SMALL), but=("blank",))
        keeps_its_beat(dut.i, "i", assume)
        if words.EAGER:
            assume(dut.i.valid & dut.decider_idle)
        self.accepted = dut.i.valid & dut.i.ready
        self.beats = Signal(range(TAXELS), name="beats")  # of the window that comes in
        with m.If(self.accepted):
            m.d.sync += self.beats.eq(Mux(self.beats == TAXELS - 1, 0, self.beats + 1))
        assume(
            ~dut.i.valid | (dut.i.p.first == (self.beats == 0)) & (dut.i.p.last == (self.beats == TAXELS - 1))
        )
        assume(~dut.i.valid | (dut.i.p.length < len(SMALL.window_lengths)))
        queue = self.queue = dut.queue
        self.code, self.enable = Program(Microcode(dut.plan)), dut.sequencer.enable
        followed = follows(m, self.code, dut.sequencer)
        self.slot = followed.slot
        released = [number for number, slot in enumerate(self.code.slots) if slot.get("released")]
        assert len(released) == 1 and released[0] < self.code.judges, (
            "one slot of a step reads the window's last taxel"
        )
        self.reading = Signal(name="reading_a_window")  # from the slot after the waiting one on
        m.d.comb += self.reading.eq((self.slot > self.code.wait) & (self.slot <= released[0]))
        come = self.accepted & (self.beats == TAXELS - 1)
        self.windows = Signal(range(3), name="held")  # whole windows in the buffers
        gone = self.enable & (self.slot == released[0])
        m.d.sync += self.windows.eq(self.windows + come - gone)
        prove(self.windows <= 2, "two windows at most")
        prove(
            ~dut.sequencer.go | (self.slot != self.code.wait) | (self.windows != 0),
            "it goes on with a window",
        )
        prove(~self.reading | (self.windows != 0), "a window that is read is whole")
        prove(queue.full[0] + queue.full[1] == self.windows, "full buffers")
        prove((queue.writing ^ queue.reading) == (self.windows == 1), "whose turn it is")
        prove((self.windows != 1) | queue.full.bit_select(queue.reading, 1), "the full one is read")
        prove(~dut.i.ready | ~queue.full.bit_select(queue.writing, 1), "no beat into a full buffer")
        prove(queue.taxel == self.beats, "taxel")
        # the touch's last window, and the step that it gives
        ends = [Signal(name=f"ends_touch_{k}") for k in range(2)]  # of the windows held, the older one first
        self.last_step = Signal(name="last_step")
        newest = self.windows - gone  # the place of a window that comes
        with m.If(gone):
            m.d.sync += [self.last_step.eq(ends[0]), ends[0].eq(ends[1])]
        for k in range(2):
            with m.If(come & (newest == k)):
                m.d.sync += ends[k].eq(dut.i.p.final)
        marks = queue.finals.bit_select(queue.reading, 1), queue.finals.bit_select(~queue.reading, 1)
        for k in range(2):
            prove((self.windows <= k) | (marks[k] == ends[k]), f"whether window {k} ends its touch")
        prove(dut.sequencer.restart == self.last_step, "the last step's mark")
        prove(
            (self.slot <= self.code.judges) | (followed.restarts == self.last_step),
            "a touch's last step is followed by the prologue",
        )
        prove(self.beats < TAXELS, "beats")


@proof(
    "windows are buffered, read and released in the order of their coming, not overwritten while they wait "
    "or are read, not read before "
    "they are whole; every window gives one step, every step one logit a class; the prologue follows the "
    "step of a touch's last window, "
    "and no other",
    depth=1,
    reduced=REDUCED,
    bugs=(
        Bug(
            "a buffer is filled again while it is read",
            "self.i.ready.eq(room & ~self.hold)",
            "self.i.ready.eq(1)",
            file=QUEUE,
        ),
        Bug(
            "does not wait for the window",
            "sequencer.waiting & queue.waiting & self.decider_idle",
            "sequencer.waiting & self.decider_idle",
        ),
        Bug(
            "the next window goes to the same buffer",
            "writing.eq(~writing)",
            "writing.eq(writing)",
            file=QUEUE,
        ),
        Bug(
            "room is not taken back with a window's last taxel", "& ~(take & self.i.p.last))", ")", file=QUEUE
        ),
        Bug(
            "the next window says whether this step is the last",
            "final=finals.bit_select(reading, 1)",
            "final=finals.bit_select(~reading, 1)",
            file=QUEUE,
            eager=True,
        ),
    ),
)
def windows(m: Module) -> None:
    bench = _Bench(m)
    dut = bench.dut
    prove(
        ~(bench.accepted & (bench.queue.writing == bench.queue.reading)) | ~bench.reading,
        "no beat into the buffer that is read",
    )
    none = bench.code.layout.window_none
    prove(
        ~(bench.enable & (dut.sequencer.word.window < none)) | (bench.windows != 0),
        "only whole windows are read",
    )
    prove(
        dut.status.overrun == (dut.i.valid & (bench.beats == 0) & (bench.windows == 2)),
        "overrun: a window comes and both buffers are full",
    )
    prove(dut.started == (bench.enable & (bench.slot == bench.code.wait)), "started")
    # slots after which the step's logits, so many, have been given
    slots, given = bench.code.slots, []
    for number in range(len(slots)):
        given.append(
            sum(slot.get("logit", 0) for slot in slots[bench.code.wait : number])
            if number > bench.code.wait
            else 0
        )
    assert sum(slot.get("logit", 0) for slot in slots) == SMALL.classes and slots[-1].get("logit", 0) in (
        0,
        1,
    )
    logits = Signal(range(SMALL.classes + 1))
    m.d.sync += logits.eq(Mux(bench.enable & (bench.slot == len(slots) - 1), 0, logits + dut.logit.valid))
    prove(logits == table(m, given, bench.slot, "given"), "logits of the step so far")
    prove(
        ~dut.status.step_done | (dut.logit.valid & (logits == SMALL.classes - 1)),
        "a step is done with its last logit",
    )
    prove(~dut.logit.valid | (logits < SMALL.classes), "no logit too many")
    prove(
        dut.status.step_done
        == (bench.enable & table(m, [slot.get("ends_step", 0) for slot in slots], bench.slot, "ends")),
        "step done",
    )


@proof(
    "with no further beats and decisions taken, the engine is idle again after at most five times its "
    "program's slots, idle words too, "
    "from every state",
    depth=1,
    reduced=REDUCED,
    bugs=(
        Bug(
            "a buffer is never released",
            "m.d.sync += [full.bit_select(reading, 1).eq(0), reading.eq(~reading)]",
            "m.d.sync += [reading.eq(~reading)]",
            file=QUEUE,
            eager=True,
        ),
    ),
)
def returns_to_idle(m: Module) -> None:
    bench = _Bench(m)
    dut, wait, length = bench.dut, bench.code.wait, len(bench.code.slots)
    primed = dut.sequencer.primed
    waiting = Signal(range(3), name="unread")  # windows whose step has not begun
    m.d.comb += waiting.eq(bench.windows - bench.reading)
    rank = Signal(range(12 * length))
    to_wait = Mux(bench.slot <= wait, wait - bench.slot, length - bench.slot + wait)
    fetched = (bench.slot == wait) & dut.sequencer.go  # the window that is there was seen
    m.d.comb += rank.eq(2 * (to_wait + ~primed + waiting * 2 * length) + ((waiting != 0) & ~fetched))
    quiet = ~bench.accepted & dut.decider_idle & dut.busy & (bench.beats == 0)
    prove(~before(quiet, "was_calm") | (rank < before(rank, "rank_before")), "every cycle brings idle nearer")
    prove((rank != 0) | (bench.beats != 0) | ~dut.busy, "at the end it is idle")
    prove(dut.busy | (rank == 0), "and it is idle at the end only")
    prove(rank <= 10 * length + 1, "the way is no longer")
