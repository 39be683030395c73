"""The compact engine: its program in order, its one data memory written by one at a time, windows not
overwritten while they are read."""

from amaranth.hdl import Module, Mux, Signal, Value

from eskin.rtl.engine.compact_engine import CompactEngine
from eskin.rtl.program.compact_program import Kind, Limit, Op
from formal import proof as words
from formal.engine.sequencer import SMALL, table
from formal.proof import Bug, assume, free_inputs, keeps_its_beat, opened_up, proof, prove

QUEUE, SEQUENCER = "rtl/engine/window_queue.py", "rtl/engine/compact_sequencer.py"
CONFIG = SMALL.replace(lanes=1, lane_type="serial")


@proof(
    "instructions come in the program's order, a jump acting after the next one; a STORE and a window's sum "
    "never write in one cycle; a "
    "window is not overwritten while it waits or is read, and not read before it is whole; indices within "
    "their loops",
    depth=1,
    reduced="4 taxels, 4 units, 2 classes, 2 steps, one serial lane: 234 instructions",
    bugs=(
        Bug(
            "a sum is taken while a STORE writes", "queue.hold.eq(stores_next)", "queue.hold.eq(0)", depth=30
        ),
        Bug(
            "room is not taken back with a window's last taxel",
            "& ~(take & self.i.p.last))",
            ")",
            file=QUEUE,
            depth=16,
            eager=True,
        ),
        Bug(
            "a jump acts in the wrong loop",
            "jumps = self.jump & ~ends_loop",
            "jumps = self.jump",
            file=SEQUENCER,
            depth=60,
            eager=True,
        ),
        Bug(
            "does not wait for the window",
            "go.eq(queue.waiting & self.decider_idle)",
            "go.eq(self.decider_idle)",
            depth=50,
        ),
    ),
)
def order(m: Module) -> None:
    dut = CompactEngine(CONFIG)
    inside = opened_up(dut)
    free_inputs(dut, but=("blank",))
    keeps_its_beat(dut.i, "i", assume)
    if words.EAGER:
        assume(dut.i.valid & dut.decider_idle)
    taxels = CONFIG.sensor.taxels
    taken, beats = dut.i.valid & dut.i.ready, Signal(range(taxels), name="beats")
    with m.If(taken):
        m.d.sync += beats.eq(Mux(beats == taxels - 1, 0, beats + 1))
    assume(~dut.i.valid | (dut.i.p.first == (beats == 0)) & (dut.i.p.last == (beats == taxels - 1)))
    queue, sequencer = inside.parts["WindowQueue"], inside.parts["CompactSequencer"]
    program, size, code = sequencer.words, len(sequencer.words), sequencer.code.instructions

    # ---- the instruction under way, of a counter that knows the program
    primed, address, advance = sequencer.primed, sequencer.address, sequencer.advance
    at, delayed, target = (
        Signal(range(width), name=name) for width, name in ((size, "at"), (2, "delayed"), (size, "target"))
    )
    limits = {limit: sequencer.code.limit(limit) for limit in Limit if limit != Limit.STEPS}
    kinds = [int(instruction.op) for instruction in code]
    counter, steps = Signal.like(sequencer.index, name="loop"), Signal.like(sequencer.step, name="steps")
    goes_back, last_step = Signal(name="goes_back"), steps == CONFIG.windows.steps - 1
    of_limit = table(m, [int(instruction.limit) for instruction in code], at, "limit")
    back = table(m, [instruction.target for instruction in code], at, "target")
    is_jump = primed & (table(m, kinds, at, "op") == int(Op.JUMP))
    with m.Switch(of_limit):
        for limit, count in limits.items():
            with m.Case(int(limit)):
                m.d.comb += goes_back.eq(is_jump & (counter != count - 1))
        with m.Case(int(Limit.STEPS)):
            m.d.comb += goes_back.eq(is_jump)
    with m.If(primed & advance):
        m.d.sync += [at.eq(Mux(delayed, target, at + 1)), delayed.eq(goes_back)]
        with m.If(is_jump):
            m.d.sync += target.eq(Mux((of_limit == int(Limit.STEPS)) & last_step, 0, back))
            with m.If(of_limit == int(Limit.STEPS)):
                m.d.sync += steps.eq(Mux(last_step, 0, steps + 1))
            with m.Else():
                m.d.sync += counter.eq(Mux(goes_back, counter + 1, 0))
    prove(~primed | (sequencer.fetch.data == table(m, program, at, "word")), "the instruction under way")
    prove(~primed | (address == Mux(delayed, target, at + 1)), "the next one")
    prove(primed | (at == 0) & (address == 0) & ~delayed, "the first one")
    prove((at < size - 1) | (at == size - 1) & delayed, "the last one leads back")
    prove(
        (counter == sequencer.index) & (steps == sequencer.step) & (steps < CONFIG.windows.steps), "the loops"
    )
    jumps = [number for number, instruction in enumerate(code) if instruction.op == Op.JUMP]
    sources = [number + 1 for number in jumps]
    where_from = table(
        m, [code[number - 1].target if number in sources else 0 for number in range(size)], at, "back_from"
    )
    prove(~delayed | (target == where_from) | ((target == 0) & (at == size - 1)), "where a jump leads")
    prove(
        ~delayed | table(m, [int(number in sources) for number in range(size)], at, "behind_a_jump"),
        "only behind a jump",
    )
    assert all(code[number].op == Op.CONTROL and not code[number].wait for number in sources), (
        "what is behind a jump is done at once"
    )
    prove(counter < max(limits.values()), "index")

    # ---- one writes the data memory at a time
    idle = [
        instruction.op == Op.CONTROL and not (instruction.clear or instruction.wait or instruction.release)
        for instruction in code
    ]
    quiet = [
        idles or (instruction.op == Op.STORE and instruction.kind == Kind.INDEX)
        for idles, instruction in zip(idle, code, strict=True)
    ]
    writes = [int(instruction.op == Op.STORE and bool(int(instruction.kind) & 2)) for instruction in code]
    assert not any(writes[instruction.target] for instruction in code) and all(
        quiet[number - 1] for number in range(size) if writes[number]
    )
    prove(~(primed & table(m, writes, at, "writes")) | inside.stores_next, "announced")
    prove(~(inside.stores & taken), "a STORE and a sum never in one cycle")

    # ---- windows
    (wait,) = (number for number, instruction in enumerate(code) if instruction.wait)
    (release,) = (number for number, instruction in enumerate(code) if instruction.release)
    reading, held = Signal(name="reading_a_window"), Signal(range(3), name="held")
    m.d.comb += reading.eq(primed & (at > wait) & (at <= release))
    gone = primed & (at == release)
    m.d.sync += held.eq(held + (taken & (beats == taxels - 1)) - gone)
    prove((held <= 2) & (queue.full[0] + queue.full[1] == held), "full buffers")
    prove((queue.writing ^ queue.reading) == (held == 1), "whose turn it is")
    prove((held != 1) | queue.full.bit_select(queue.reading, 1), "the full one is read")
    prove(~queue.room | ~queue.full.bit_select(queue.writing, 1), "room")
    prove((queue.taxel == beats) & (beats < taxels), "taxel")
    prove(~reading | (held != 0), "a window that is read is whole")
    prove(~(taken & (queue.writing == queue.reading)) | ~reading, "no sum into the buffer that is read")
    prove(dut.started == (primed & (at == wait) & (held != 0) & dut.decider_idle), "started")
    prove(~reading | ~Value.cast(inside.sequencer.waits), "waits at one place only")
