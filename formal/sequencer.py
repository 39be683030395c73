"""The sequencer: exactly the microcode's slots, in order, and back to its waiting word after every step."""

from __future__ import annotations

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib.memory import Memory

from formal.proof import Bug, Inside, free, opened_up, proof, prove
from golden.config import PRESETS
from golden.formats import QFormat
from rtl.microcode import ADDRESSES, CONTROLS, Microcode
from rtl.schedule import schedule
from rtl.sequencer import Sequencer

FILE = "rtl/sequencer.py"
SMALL = PRESETS["thesis"].replace(
    taxels=4, hidden=4, class_names=("a", "b"), steps=2, lanes=4, feature_shift=(4,), state_format=QFormat(4, 12), hop=2, window=4,
    touch_frames=6, pretrigger_frames=0,
)  # fmt: skip


def table(m: Module, values: list[int], index: Value, name: str) -> Signal:
    """``values[index]``; 0 beyond them."""
    memory = Memory(shape=max(1, max(values).bit_length()), depth=len(values), init=values)
    m.submodules[f"table_{name}"] = memory
    port = memory.read_port(domain="comb")
    m.d.comb += port.addr.eq(index)
    return port.data


def follows(m: Module, code: Microcode, dut: Sequencer, inside: Inside) -> Signal:
    """Prove that the sequencer is in the slot of the program in which it should be; gives that slot's number.

    The slot is what a counter says that knows nothing of words and repeats: one more with every slot that ends, back to the program's
    ``again`` (or 0) after the last.
    """
    last = len(code.slots) - 1
    slot = Signal(range(last + 1), name="slot")
    with m.If(dut.enable):
        m.d.sync += slot.eq(Mux(slot == last, Mux(dut.restart, 0, code.again), slot + 1))
    unrolled = list(code.unrolled())
    word_of = [number for number, word in enumerate(code.words) for _ in range(word["repeat"] + 1)]
    count_of = [count for word in code.words for count in range(word["repeat"] + 1)]
    primed = inside.primed
    prove(m, slot <= last, "a slot of the program")
    prove(m, primed | (slot == 0) & (inside.pc == 0) & (inside.count == 0), "the first slot")
    prove(m, ~primed | (inside.pc == table(m, word_of, slot, "word") + 1), "the word to fetch")
    prove(m, ~primed | (inside.count == table(m, count_of, slot, "count")), "the repetition")
    fields = [getattr(dut.word, name) for name in (*ADDRESSES, *CONTROLS)]
    wanted = []
    for word in unrolled:
        whole, at = 0, 0
        for name, signal in zip((*ADDRESSES, *CONTROLS), fields, strict=True):
            whole, at = whole | word[name] << at, at + len(signal)
        wanted.append(whole)
    prove(m, ~primed | (Cat(fields) == table(m, wanted, slot, "fields")), "all fields of the slot")
    repeats = [word["repeat"] for word in unrolled]
    prove(m, ~primed | (inside.field("repeat") == table(m, repeats, slot, "repeat")), "the word's repetitions")
    wait = [int(number == code.wait) for number in range(last + 1)]
    prove(m, ~primed | (inside.field("wait") == table(m, wait, slot, "wait")), "the waiting slot")
    prove(m, ~primed | (inside.field("end") == (slot == last)), "the last slot")
    return slot


@proof(
    "every slot of the program in order, with all its fields, whatever the ticks and waits; held at the waiting word and nowhere else, and "
    "back there after as many slots as the program has",
    depth=1, reduced="4 taxels, 4 units, 2 classes, 4 lanes: a program of 62 slots",
    bugs=(
        Bug("a repeated word that does not count", FILE, 'vector.eq(field("vector") + count)', 'vector.eq(field("vector"))',
            depth=30),
        Bug("waits at every word", FILE, '(~field("wait") | self.go)', "self.go"),
        Bug("a word too few", FILE, "last.eq(count == field(\"repeat\"))", "last.eq(count >= (field(\"repeat\") >> 1))", depth=30),
    ),
)  # fmt: skip
def order(m: Module) -> None:
    code = Microcode(schedule(SMALL))
    dut = Sequencer(code)
    inside = opened_up(m, "dut", dut)
    for signal in (dut.tick, dut.go, dut.restart):
        free(m, signal)
    slot = follows(m, code, dut, inside)
    prove(m, dut.waiting == (inside.primed & (slot == code.wait)), "waits at one slot only")
    prove(m, ~(dut.waiting & ~dut.go) | ~dut.enable, "waits until go")
    prove(m, dut.enable == (inside.primed & dut.tick & (dut.go | ~dut.waiting)), "everything else goes on with the tick")
    prove(m, dut.ended == (dut.enable & (slot == len(code.slots) - 1)), "ends with the last slot")
    away = Signal(range(2 * len(code.slots)), name="away")  # slots since it waited
    with m.If(dut.enable):
        m.d.sync += away.eq(Mux(dut.waiting, 0, away + 1))
    prove(
        m, away <= Mux(slot > code.wait, slot - code.wait - 1, len(code.slots) - 1 - code.wait + slot), "back at the waiting word in time"
    )
