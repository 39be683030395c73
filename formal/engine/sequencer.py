"""The sequencer: exactly the microcode's slots, in order, and back to its waiting word after every step."""

from types import SimpleNamespace

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib.memory import Memory

from eskin.golden.core import PRESETS, QFormat
from eskin.rtl.engine.sequencer import Sequencer
from eskin.rtl.program.microcode import ADDRESSES, CONTROLS, Microcode
from eskin.rtl.program.schedule import schedule
from formal import proof as words
from formal.proof import Bug, assume, free, placed, proof, prove

SMALL = PRESETS["thesis"].replace(
    taxels=4,
    hidden=4,
    class_names=("a", "b"),
    steps=2,
    lanes=4,
    feature_shift=(4,),
    state_format=QFormat(4, 12),
    hop=2,
    window=4,
    touch_frames=6,
    pretrigger_frames=0,
)


def table(m: Module, values: list[int], index: Value, name: str) -> Signal:
    """``values[index]``; 0 beyond them."""
    memory = Memory(shape=max(1, max(values).bit_length()), depth=len(values), init=values)
    m.submodules[f"table_{name}"] = memory
    port = memory.read_port(domain="comb")
    m.d.comb += port.addr.eq(index)
    return port.data


class Program:
    """The microcode as the sequencer runs it: slots that do nothing in front of the program's.

    Attributes
    ----------
    slots, wait, again, last:
        As of `Microcode`, counted from the first slot of all; the last one.
    words:
        Every word: as of `Microcode`, in front of them the idle ones.
    """

    def __init__(self, code: Microcode) -> None:
        self.code, self.plan, self.layout, idle = code, code.plan, code.layout, code.idle_words
        self.slots: list[dict[str, int]] = [{}] * idle + code.slots
        self.wait, self.again, self.last = code.wait + idle, code.again + idle, len(self.slots) - 1
        always = {name for name in CONTROLS if all(word[name] for word in code.words)}
        # what no slot leaves out has no bit in the program's memory; it must be harmless
        assert always <= {"minus", "add"}, always
        first = code.words[0]
        nothing = {name: first[name] for name in ADDRESSES} | {name: int(name in always) for name in CONTROLS}
        self.words = [nothing | {"repeat": 0, "wait": 0, "end": 0}] * idle + code.words
        self.unrolled = [nothing] * idle + list(code.unrolled())
        self.word_of = [number for number, word in enumerate(self.words) for _ in range(word["repeat"] + 1)]
        self.count_of = [count for word in self.words for count in range(word["repeat"] + 1)]
        self.judges = max(number for number, word in enumerate(self.word_of) if word == len(self.words) - 3)
        """Slot with whose end ``restart`` is looked at."""


def follows(m: Module, program: Program, dut: Sequencer, reset: Value | int = 0) -> SimpleNamespace:
    """Prove that the sequencer is in the slot of the program in which it should be; ``slot``: that slot's
    number, ``restarts``: after the last the program restarts.

    The slot is what a counter says that knows nothing of words and repeats: one more with every slot that
    ends, after the last back to the program's ``again``, or to 0 where ``restart`` was high as slot
    `Program.judges` ended.
    """
    last = program.last
    slot = Signal(range(last + 1))
    restarts = Signal()
    with m.If(dut.enable):
        m.d.sync += slot.eq(Mux(slot == last, Mux(restarts, 0, program.again), slot + 1))
        with m.If(slot == program.judges):
            m.d.sync += restarts.eq(dut.restart)
    with m.If(reset):
        m.d.sync += slot.eq(0)
    repeats, primed, size = (
        [program.words[number]["repeat"] for number in program.word_of],
        dut.primed,
        len(program.words),
    )
    word, before_last = table(m, program.word_of, slot, "word"), size - 2
    prove(slot <= last, "a slot of the program")
    prove(primed | (slot == 0) & (dut.pc == 0) & (dut.count == 0) & ~dut.turn & ~dut.ends, "the first slot")
    prove(
        ~primed | (dut.turn == ((word == before_last) & ~restarts)), "turns back behind the last word but one"
    )
    back = Mux(restarts, 0, program.word_of[program.again])
    prove(~primed | (dut.pc == Mux(slot == last, back, word + 1)), "the word to fetch")
    prove(~primed | (dut.count == table(m, program.count_of, slot, "count")), "the repetition")
    fields = [getattr(dut.word, name) for name in (*ADDRESSES, *CONTROLS)]
    words, turns = [], [int(number == size - 3) for number in program.word_of]
    for instruction in program.unrolled:
        whole, at = 0, 0
        for name, signal in zip((*ADDRESSES, *CONTROLS), fields, strict=True):
            whole, at = whole | instruction[name] << at, at + len(signal)
        words.append(whole)
    prove(~primed | (Cat(fields) == table(m, words, slot, "fields")), "all fields of the slot")
    repetitions = [max(0, repeat - 1) for repeat in repeats]
    prove(
        ~primed | (dut.fetch.data.repeat == table(m, repetitions, slot, "repeat")),
        "the word's last repetition but one",
    )
    once = [int(not repeat) for repeat in repeats]
    ends = [int(0 < repeat == count) for repeat, count in zip(repeats, program.count_of, strict=True)]
    prove(~primed | (dut.fetch.data.once == table(m, once, slot, "once")), "the words without repetitions")
    prove(~primed | (dut.ends == table(m, ends, slot, "last_ones")), "a repeated word's last slot")
    prove(~primed | (dut.fetch.data.turns == table(m, turns, slot, "turns")), "the word that turns back")
    prove(~primed | (dut.fetch.data.wait == (slot == program.wait)), "the waiting slot")
    prove(~primed | (dut.fetch.data.end == (slot == last)), "the last slot")
    return SimpleNamespace(slot=slot, restarts=restarts)


@proof(
    "after any reset every slot of the program in order, with all its fields, whatever the waits; held at "
    "the waiting word and "
    "nowhere else, and back there after as many slots as the program has",
    depth=1,
    reduced="4 taxels, 4 units, 2 classes, 4 lanes: 64 words",
    bugs=(
        Bug(
            "a repeated word that does not count",
            "(count if name in self.spec.counted else 0)",
            "0",
            eager=True,
        ),
        Bug("waits at every word", '(~field("wait") | self.go)', "self.go"),
        Bug("a word too few", 'count == field("repeat")', 'count >= (field("repeat") >> 1)', eager=True),
        Bug("the word before a reset turns back the program", "turn.eq(primed & fetch", "turn.eq(fetch"),
    ),
)
def order(m: Module) -> None:
    code, reset = Microcode(schedule(SMALL)), Signal(name="reset_sequencer")
    program, dut = Program(code), placed(Sequencer(code), reset=reset)
    free(dut.go, dut.restart, reset)
    if words.EAGER:
        assume(dut.go & ~reset)
    slot = follows(m, program, dut, reset).slot
    prove(dut.waiting == (dut.primed & (slot == program.wait)), "waits at one slot only")
    prove(~(dut.waiting & ~dut.go) | ~dut.enable, "waits until go")
    prove(dut.enable == (dut.primed & (dut.go | ~dut.waiting)), "everything else goes on")
    prove(dut.ended == (dut.enable & (slot == program.last)), "ends with the last slot")
    away = Signal(range(2 * len(program.slots)))  # slots since it waited, or was reset
    with m.If(dut.enable):
        m.d.sync += away.eq(Mux(dut.waiting, 0, away + 1))
    with m.If(reset):
        m.d.sync += away.eq(0)
    most = Mux(slot > program.wait, slot - program.wait - 1, program.last - program.wait + slot)
    prove(away <= most, "back at the waiting word in time")
