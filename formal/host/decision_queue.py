"""Decisions that wait: none is lost, doubled or overtaken."""

from amaranth.hdl import Module, Mux, Signal

from eskin.golden.core import PRESETS
from eskin.rtl.host.decision_queue import DecisionQueue, _places, decision_word
from formal.proof import Bug, assume, before, free, placed, proof, prove

CONFIG = PRESETS["thesis"].replace(taxels=4, feature_shift=(), margin_threshold=1)
WORD_MASK = 0x0FFF_8F83 | 0xF000_0000
"""Bits that a decision of 3 classes and 20 steps may have."""
DEPTH = 4
BUGS = (
    Bug("a full queue takes one", "room.eq(~Array(full)[newest])", "room.eq(1)"),
    Bug("one is read twice", "oldest.eq(oldest + takes)", "oldest.eq(oldest)"),
    Bug("local ones are always dropped", "dropped = self.global_only & ~", "dropped = ~"),
    Bug("ARM leaves one", "(oldest == k))) & ~self.clear)", "(oldest == k))))"),
    Bug(
        "a global one behind others is not told",
        "Cat(waiting, offered & self.i.p.is_global).any()",
        "waiting[0]",
    ),
    Bug("a word that nobody saw is taken", "self.take & shows", "self.take & self.waits"),
    Bug(
        "one that waits reads as none", "shows.eq(self.asked & self.waits)", "shows.eq(self.asked & full[0])"
    ),
)


@proof(
    "what is taken from the classifier and not dropped is read once, in order, until ARM; the word is all ones "
    "where none waits and 0 where it is not asked for",
    depth=2,
    reduced="a queue of 4, 3 classes, 20 steps",
    quick=True,
    bugs=BUGS,
)
def once_and_in_order(m: Module) -> None:
    dut = placed(DecisionQueue(CONFIG, DEPTH))
    free(dut.i.valid, dut.i.payload, dut.global_only, dut.clear, dut.take, dut.asked)
    request = before(dut.asked, "asked")
    assume(~dut.asked | ~request & ~dut.clear)
    count = Signal(range(DEPTH + 1), name="count")
    shown = before(dut.asked & (count != 0), "shown")
    stored = [Signal(32, name=f"kept_{k}") for k in range(DEPTH)]  # the oldest first
    dropped = dut.global_only & ~dut.i.p.is_global
    arrives, left = dut.i.valid & dut.i.ready & ~dropped, dut.take & shown
    rest = Signal.like(count, name="rest")
    m.d.comb += rest.eq(count - left)
    m.d.sync += count.eq(Mux(dut.clear, 0, rest + arrives))
    moved = [Mux(left, stored[k + 1], stored[k]) if k + 1 < DEPTH else stored[k] for k in range(DEPTH)]
    for k, word in enumerate(stored):
        m.d.sync += word.eq(Mux(arrives & (rest == k), decision_word(CONFIG, dut.i.p) & WORD_MASK, moved[k]))
    prove(dut.i.ready == (dropped | (count != DEPTH)), "taken where there is room")
    prove(dut.waits == (count != 0), "waits")
    prove(dut.word == Mux(request, Mux(shown, stored[0], 0xFFFF_FFFF), 0), "the oldest")
    globals_ = [(count > k) & word[29] for k, word in enumerate(stored)]
    offered = dut.i.valid & dut.i.p.is_global
    prove(dut.global_waits == (sum(globals_) + offered != 0), "a global one")
    # ---- for the induction: the ring holds them from its oldest on
    prove((dut.shows == shown) & (~shown | (count != 0) & (dut.index == dut.oldest)), "what is shown")
    prove(shown | (dut.index == request), "none")
    prove((count <= DEPTH) & (dut.newest == (dut.oldest + count)[:2]), "count")
    for place in range(DEPTH):
        for k in range(DEPTH):
            holds = dut.oldest == (place - k) % DEPTH
            prove(~holds | (dut.full[place] == (count > k)), "full")
            wide = sum(dut.entries[place][n] << bit for n, bit in enumerate(_places(CONFIG)))
            prove(~holds | (count <= k) | (wide == stored[k]), "kept")
