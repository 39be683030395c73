"""The early rule against a history of the last decisions."""

from amaranth.hdl import Module, Mux, Signal

from eskin.golden.core import PRESETS
from eskin.rtl.decision.early_rule import EarlyRule
from formal.proof import Bug, free, placed, proof, prove

CONFIG = PRESETS["thesis"].replace(
    taxels=4,
    steps=5,
    feature_shift=(4,),
    class_names=("a", "b", "c"),
    decision="early",
    early_steps=3,
    early_margin=5,
)


@proof(
    "met where this decision and the two before it are of one class with margin enough, and since the touch "
    "began",
    depth=3,
    reduced="3 classes, 3 decisions in a row, margins of 4 bits",
    quick=True,
    bugs=(
        Bug("one decision too few", "agreed == steps - 1", "agreed == steps - 2"),
        Bug("another class goes on counting", "(agreed != 0) & (self.best == before)", "agreed != 0"),
        Bug("the last touch's decisions count", "m.d.sync += agreed.eq(0)", "m.d.sync += agreed.eq(agreed)"),
    ),
)
def three_in_a_row(m: Module) -> None:
    dut = placed(EarlyRule(CONFIG, 4))
    free(dut.best, dut.margin, dut.taken, dut.ended)
    enough = dut.margin >= 5
    # the newest decision first: it is there, with margin enough
    good = [Signal(name=f"good_{k}") for k in range(2)]
    best = [Signal.like(dut.best, name=f"best_{k}") for k in range(2)]
    with m.If(dut.taken):
        m.d.sync += [good[0].eq(enough), best[0].eq(dut.best), good[1].eq(good[0]), best[1].eq(best[0])]
    with m.If(dut.ended):
        m.d.sync += [count.eq(0) for count in good]
    prove(dut.met == (enough & good[0] & good[1] & (dut.best == best[0]) & (best[0] == best[1])), "met")
    prove(~good[0] | (dut.before == best[0]), "the class before")
    prove(dut.agreed == Mux(good[0], Mux(good[1] & (best[0] == best[1]), 2, 1), 0), "decisions in a row")
