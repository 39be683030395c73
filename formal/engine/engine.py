"""The engine's control: windows in and steps out, addresses in range, back to waiting from every state."""

from amaranth.hdl import Module, Mux, Signal

from eskin.rtl.engine.engine import Engine
from formal import proof as words
from formal.engine.sequencer import SMALL, Program, follows, table
from formal.proof import Bug, assume, before, free_inputs, keeps_its_beat, opened_up, proof, prove

QUEUE = "rtl/engine/window_queue.py"
REDUCED = "4 taxels, 4 units, 2 classes, 2 steps, 4 lanes"


class _Bench:
    """The engine with its input as the normaliser gives it: whole windows, first and last taxel marked."""

    def __init__(self, m: Module, config=SMALL) -> None:
        self.config, self.m = config, m
        self.dut = dut = Engine(config)
        self.inside = inside = opened_up(dut)
        free_inputs(dut, but=("blank",))
        keeps_its_beat(dut.i, "i", assume)
        if words.EAGER:
            assume(dut.i.valid & dut.decider_idle)
        self.taken = dut.i.valid & dut.i.ready
        self.beats = Signal(range(config.sensor.taxels), name="beats")  # of the window that comes in
        with m.If(self.taken):
            m.d.sync += self.beats.eq(Mux(self.beats == config.sensor.taxels - 1, 0, self.beats + 1))
        assume(
            ~dut.i.valid
            | (dut.i.p.first == (self.beats == 0))
            & (dut.i.p.last == (self.beats == config.sensor.taxels - 1))
        )
        assume(~dut.i.valid | (dut.i.p.length < len(config.window_lengths)))
        queue = self.queue = inside.parts["WindowQueue"]
        self.code, self.enable, self.word = Program(inside.code), inside.enable, inside.word
        followed = follows(m, self.code, inside.sequencer, inside.parts["Sequencer"])
        self.slot = followed.slot
        released = [number for number, slot in enumerate(self.code.slots) if slot.get("released")]
        assert len(released) == 1 and released[0] < self.code.judges, (
            "one slot of a step reads the window's last taxel"
        )
        self.reading = Signal(name="reading_a_window")  # from the slot after the waiting one on
        m.d.comb += self.reading.eq((self.slot > self.code.wait) & (self.slot <= released[0]))
        come = self.taken & (self.beats == config.sensor.taxels - 1)
        self.held = Signal(range(3), name="held")  # whole windows in the buffers
        gone = self.enable & (self.slot == released[0])
        m.d.sync += self.held.eq(self.held + come - gone)
        prove(self.held <= 2, "two windows at most")
        prove(
            ~inside.sequencer.go | (self.slot != self.code.wait) | (self.held != 0),
            "it goes on with a window",
        )
        prove(~self.reading | (self.held != 0), "a window that is read is whole")
        prove(queue.full[0] + queue.full[1] == self.held, "full buffers")
        prove((queue.writing ^ queue.reading) == (self.held == 1), "whose turn it is")
        prove((self.held != 1) | queue.full.bit_select(queue.reading, 1), "the full one is read")
        prove(~dut.i.ready | ~queue.full.bit_select(queue.writing, 1), "no beat into a full buffer")
        prove(queue.taxel == self.beats, "taxel")
        # the touch's last window, and the step that it gives
        ends = [Signal(name=f"ends_touch_{k}") for k in range(2)]  # of the windows held, the older one first
        self.last_step = Signal(name="last_step")
        newest = self.held - gone  # the place of a window that comes
        with m.If(gone):
            m.d.sync += [self.last_step.eq(ends[0]), ends[0].eq(ends[1])]
        for k in range(2):
            with m.If(come & (newest == k)):
                m.d.sync += ends[k].eq(dut.i.p.final)
        marks = queue.finals.bit_select(queue.reading, 1), queue.finals.bit_select(~queue.reading, 1)
        for k in range(2):
            prove((self.held <= k) | (marks[k] == ends[k]), f"whether window {k} ends its touch")
        prove(inside.final == self.last_step, "the last step's mark")
        self.step = Signal(name="step")  # of the touch, of two
        # weights of its own for every window: here windows come as the front end numbers them
        if config.sets > 1:
            assert config.windows.steps == 2
            ended, coming = (
                self.enable & (self.slot == len(self.code.slots) - 1),
                Signal(name="number_of_the_window_that_comes"),
            )
            m.d.sync += [self.step.eq(self.step ^ ended), coming.eq(coming ^ come)]
            assume(~dut.i.valid | (dut.i.p.final == coming))
            prove(inside.parts["Sequencer"].primed | ~self.step, "the first step")
            was_read = self.slot > released[0]
            prove(coming == self.step ^ was_read ^ self.held[0], "the window that comes")
            for k in range(2):
                prove((self.held <= k) | (ends[k] == self.step ^ was_read ^ k), f"the number of window {k}")
            prove(~was_read | (self.last_step == self.step), "the second step is the last")
        prove(
            (self.slot <= self.code.judges) | (followed.restarts == self.last_step),
            "a touch's last step is followed by the prologue",
        )
        prove(self.beats < config.sensor.taxels, "beats")

    def per_slot(self, values: list[int], name: str) -> Signal:
        return table(self.m, values, self.slot, name)


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
            depth=16,
        ),
        Bug(
            "does not wait for the window",
            "sequencer.waiting & queue.waiting & self.decider_idle",
            "sequencer.waiting & self.decider_idle",
            depth=36,
        ),
        Bug(
            "the next window goes to the same buffer",
            "writing.eq(~writing)",
            "writing.eq(writing)",
            file=QUEUE,
            depth=8,
        ),
        Bug(
            "room is not taken back with a window's last taxel",
            "& ~(take & self.i.p.last))",
            ")",
            file=QUEUE,
            depth=16,
        ),
        Bug(
            "the next window says whether this step is the last",
            "self.final.eq(finals.bit_select(reading, 1))",
            "self.final.eq(finals.bit_select(~reading, 1))",
            file=QUEUE,
            depth=60,
            eager=True,
        ),
    ),
)
def windows(m: Module) -> None:
    bench = _Bench(m)
    dut = bench.dut
    prove(
        ~(bench.taken & (bench.queue.writing == bench.queue.reading)) | ~bench.reading,
        "no beat into the buffer that is read",
    )
    none = bench.code.layout.window_none
    prove(~(bench.enable & (bench.word.window < none)) | (bench.held != 0), "only whole windows are read")
    prove(
        dut.overrun == (dut.i.valid & (bench.beats == 0) & (bench.held == 2)),
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
    assert sum(slot.get("logit", 0) for slot in slots) == bench.config.classes and slots[-1].get(
        "logit", 0
    ) in (0, 1)
    logits = Signal(range(bench.config.classes + 1))
    m.d.sync += logits.eq(Mux(bench.enable & (bench.slot == len(slots) - 1), 0, logits + dut.logit.valid))
    prove(logits == bench.per_slot(given, "given"), "logits of the step so far")
    prove(
        ~dut.step_done | (dut.logit.valid & (logits == bench.config.classes - 1)),
        "a step is done with its last logit",
    )
    prove(~dut.logit.valid | (logits < bench.config.classes), "no logit too many")
    prove(
        dut.step_done
        == (bench.enable & bench.per_slot([slot.get("ends_step", 0) for slot in slots], "ends")),
        "step done",
    )


@proof(
    "every address the program makes lies in its memory; the weights of a step are counted in range; at most "
    "taxels + units products go into a row's sum (formal/engine/lanes.py: row_sums_fit)",
    depth=1,
    reduced=REDUCED,
    bugs=(
        Bug(
            "the weight address counts every slot", "weight_address + word.mac", "weight_address + 1", depth=8
        ),
    ),
)
def ranges(m: Module) -> None:
    _ranges(m, SMALL)


def _ranges(m: Module, config) -> None:
    bench = _Bench(m, config)
    inside, code, word = bench.inside, bench.code, bench.word
    layout, slots, primed = code.layout, code.slots, inside.parts["Sequencer"].primed
    macs = [sum(slot.get("mac", 0) for slot in slots[:number]) for number in range(len(slots))]
    first = macs[code.again]
    assert first == 0, "the prologue multiplies nothing"
    # where every window has weights of its own; 0 elsewhere
    of_step = bench.step * len(code.plan.weight_words)
    # behind the last weight the counter may wrap
    expected = (bench.per_slot(macs, "macs") + of_step)[: len(inside.weight_address)]
    prove(~primed | (inside.weight_address == expected), "weights in the order of the slots")
    prove(primed | (inside.weight_address == 0), "from the first")
    prove(
        ~(bench.enable & word.mac) | (inside.weight_address < code.plan.weight_depth),
        "a weight that there is",
    )
    prove(
        ~primed | (word.vector < layout.state_depth) & (word.element < layout.state_depth), "state addresses"
    )
    of_a_step = primed & (bench.slot >= code.again)
    prove(~(primed & word.state_write) | (word.state_to < layout.state_depth), "state words that there are")
    prove(
        ~(of_a_step & word.state_write) | (word.state_to < layout.state_zero),
        "the zero of the state is written by the prologue alone",
    )
    if code.plan.program.t_regions:
        prove(~primed | (word.t < layout.t_depth), "T addresses")
        prove(~(primed & word.t_write) | (word.result <= layout.t_zero), "T words that there are")
        prove(
            ~(of_a_step & word.t_write) | (word.result < layout.t_zero),
            "the zero of the T memory is written by the prologue alone",
        )
    lengths = len(config.window_lengths)
    prove((bench.queue.lengths[0] < lengths) & (bench.queue.lengths[1] < lengths), "lengths")
    prove(~primed | (inside.coefficients.address < layout.gate_depth), "gate addresses")
    prove(
        ~(primed & word.gate_write) | (word.result < layout.constants),
        "constants are never written by the program",
    )
    prove(
        ~primed
        | (word.addend < code.plan.addend_words)
        & (~word.partial | (word.partial_to < code.plan.addend_words)),
        "addend addresses",
    )
    # what formal/engine/lanes.py assumes of the schedule
    accumulates = any(len(op.terms) > 1 for op in code.plan.program.elements)
    shared = code.plan.shared  # one lane for rows and elements
    # `valid` in the slot in which the product is added: the plain lane is told a slot before
    valid, element_valid, issued = (
        word.valid,
        word.element_valid,
        [{}, *slots[:-1]] if code.plan.timing.early else slots,
    )
    if code.plan.timing.early:
        assert not any(
            slots[end].get(name) for end in (-1, code.again - 1) for name in ("valid", "element_valid")
        )
        valid, element_valid = Signal(name="adds_row_product"), Signal(name="adds_element_product")
        with m.If(bench.enable):
            m.d.sync += [valid.eq(word.valid), element_valid.eq(word.element_valid)]
        for flag, name in ((valid, "valid"), (element_valid, "element_valid")):
            prove(primed | ~flag, "none before the first slot")
            prove(
                ~primed | (flag == bench.per_slot([slot.get(name, 0) for slot in issued], name)),
                "products are told a slot before",
            )
    if config.hardware.lane_type == "dsp":
        prove(~(primed & word.swap & valid), "load and product of a row never in one slot")
    if shared:
        prove(~(primed & word.swap & word.element_first), "a shared lane begins one sum at a time")
        prove(~(primed & valid & element_valid), "and adds one product at a time")
    elif not accumulates:
        prove(
            ~(of_a_step & word.element_first) | element_valid, "in a step a sum of one product begins with it"
        )
    elif config.hardware.lane_type == "dsp":
        prove(
            ~(primed & word.element_first & element_valid), "load and product of an element never in one slot"
        )
    begins, adds = word.swap | (shared & word.element_first), valid | (shared & element_valid)
    # products since the accumulators began anew: the most by any way through the program
    most = [0] * len(slots)
    for _ in range(3):
        for number, slot in enumerate(slots):
            begun = slot.get("swap", 0) or (shared and slot.get("element_first", 0))
            added = issued[number].get("valid", 0) or (shared and issued[number].get("element_valid", 0))
            after = (0 if begun else most[number]) + added
            for following in [number + 1] if number + 1 < len(slots) else [0, code.again]:
                most[following] = max(most[following], after)
    count = Signal(range(2 * max(most) + 2), name="products")
    with m.If(bench.enable):
        m.d.sync += count.eq(Mux(begins, 0, count) + adds)
    prove(count <= bench.per_slot(most, "most"), "products of a sum")
    prove(
        ~(primed & adds)
        | ((Mux(begins, 0, count)) < config.inputs + config.network.hidden * config.recurrent),
        "as many as the accumulator is made for",
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
            depth=60,
            eager=True,
        ),
    ),
)
def returns_to_idle(m: Module) -> None:
    bench = _Bench(m)
    dut, wait, length = bench.dut, bench.code.wait, len(bench.code.slots)
    primed = bench.inside.parts["Sequencer"].primed
    waiting = Signal(range(3), name="unread")  # windows whose step has not begun
    m.d.comb += waiting.eq(bench.held - bench.reading)
    rank = Signal(range(12 * length))
    to_wait = Mux(bench.slot <= wait, wait - bench.slot, length - bench.slot + wait)
    asked = (bench.slot == wait) & bench.inside.sequencer.go  # the window that is there was seen
    m.d.comb += rank.eq(2 * (to_wait + ~primed + waiting * 2 * length) + ((waiting != 0) & ~asked))
    calm = ~bench.taken & dut.decider_idle & dut.busy & (bench.beats == 0)
    prove(~before(calm, "was_calm") | (rank < before(rank, "rank_before")), "every cycle brings idle nearer")
    prove((rank != 0) | (bench.beats != 0) | ~dut.busy, "at the end it is idle")
    prove(dut.busy | (rank == 0), "and it is idle at the end only")
    prove(rank <= 10 * length + 1, "the way is no longer")


OTHERS = {
    "lstm": ("an LSTM on 2 lanes", SMALL.replace(cell="lstm", lanes=2)),
    "after": ("a GRU with reset after", SMALL.replace(reset="after")),
    "dsp": ("a GRU on DSP lanes", SMALL.replace(lane_type="dsp")),
    "shared": ("a GRU on one lane", SMALL.replace(lanes=1)),
    "linear": ("a linear cell", SMALL.replace(cell="linear", lanes=2, class_names=("a", "b", "c"))),
}
"""Programs of other cells and lanes, by the name of their proof of ranges."""
COUNTS_EVERY_SLOT = Bug(
    "the weight address counts every slot", "weight_address + word.mac", "weight_address + 1", depth=8
)


@proof(
    f"the same ranges for {OTHERS['lstm'][0]}",
    depth=1,
    reduced=REDUCED.replace("4 lanes", "2 lanes"),
    bugs=(COUNTS_EVERY_SLOT,),
)
def ranges_lstm(m: Module) -> None:
    _ranges(m, OTHERS["lstm"][1])


@proof(
    f"the same ranges for {OTHERS['linear'][0]}, the weights of each window behind those of the window "
    "before",
    depth=1,
    reduced="4 taxels, 3 classes, 2 steps, 2 lanes",
    bugs=(
        COUNTS_EVERY_SLOT,
        Bug(
            "every window has the first one's weights",
            "& (final if config.sets > 1 else 1)",
            "& 1",
            depth=60,
            eager=True,
        ),
    ),
)
def ranges_linear(m: Module) -> None:
    _ranges(m, OTHERS["linear"][1])


@proof(f"the same ranges for {OTHERS['after'][0]}", depth=1, reduced=REDUCED, bugs=(COUNTS_EVERY_SLOT,))
def ranges_after(m: Module) -> None:
    _ranges(m, OTHERS["after"][1])


NO_GAP = Bug(
    "a schedule without the gap of DSP lanes",
    'gap=int(kind == "dsp")',
    "gap=0",
    file="rtl/program/timing.py",
    depth=60,
    eager=True,
)


@proof(
    f"the same ranges for {OTHERS['dsp'][0]}, load and product never in one slot",
    depth=1,
    reduced=REDUCED,
    bugs=(NO_GAP,),
)
def ranges_dsp(m: Module) -> None:
    _ranges(m, OTHERS["dsp"][1])


@proof(
    f"the same ranges for {OTHERS['shared'][0]} for rows, element-wise operations and the dense layer "
    "beside the constants; one sum begun "
    "and one product added at a time",
    depth=1,
    reduced=REDUCED.replace("4 lanes", "1 lane"),
    bugs=(COUNTS_EVERY_SLOT,),
)
def ranges_shared(m: Module) -> None:
    _ranges(m, OTHERS["shared"][1])
