"""The engine of trees: every step ends in its cycles, every walk in its depth, whatever the nodes hold."""

from unittest import mock

from amaranth.hdl import Module, Signal

from eskin.golden.core import PRESETS
from eskin.rtl.engine.forest import ForestEngine
from formal import proof as words
from formal.proof import Bug, assume, placed_free, proof, prove

TREES, DEPTH, INPUTS, CLASSES, SCALING = 2, 2, 1, 2, 4
CYCLES = 2 * CLASSES + SCALING * INPUTS + 2 * TREES * DEPTH + 3
SMALL = PRESETS["thesis"].replace(
    cell="trees",
    taxels=INPUTS,
    steps=2,
    feature_shift=(4,),
    class_names=("a", "b"),
    trees=TREES,
    depth=DEPTH,
    nodes=4,
    decision="last",
)


@proof(
    "a walk makes as many comparisons as the depth at most and gives one vote at most, none behind it is read, "
    "and a step gives its logits in the cycles of its schedule, whatever the host has loaded",
    depth=2,
    reduced="1 input, scales of one bit, 2 steps, 2 classes, 2 trees of depth 2, 4 nodes",
    bugs=(
        Bug(
            "a walk is one comparison longer",
            "(visit == forest.depth - 1)",
            "(visit == forest.depth)",
            eager=True,
        ),
        Bug("a vote is given again", "judging & leaf & ~ended", "judging & leaf", eager=True),
        Bug("the last tree is left out", "tree == forest.trees - 1", "tree == forest.trees - 2", eager=True),
        Bug(
            "logits begin before the last vote is added",
            "adding & ~walking",
            "judging & ~walking",
            eager=True,
        ),
    ),
)
def walks_end(m: Module) -> None:
    with mock.patch.multiple("eskin.rtl.engine.forest", SCALE_BITS=1, SCALING_CYCLES=SCALING):
        dut = placed_free(ForestEngine(SMALL))
    if words.EAGER:
        assume(dut.i.valid & dut.decider_idle & (dut.i.p.value == 0))
    clearing, scaling, walking, judging, adding, giving, given = dut.phases
    age = Signal(range(CYCLES + 1))  # cycles since a step's first, counted from 1; 0: none
    ends = age == CYCLES
    with m.If(dut.started):
        m.d.sync += age.eq(1)
    with m.Elif(age != 0):
        m.d.sync += age.eq(age + 1)
    with m.If(ends):
        m.d.sync += age.eq(0)
    prove(ends == dut.status.step_done, "a step gives its last logit in its last cycle")
    prove(age <= CYCLES, "cycles of a step")
    prove(~dut.started | (age == 0), "no step begins within another")
    scales, walks = CLASSES, CLASSES + SCALING * INPUTS
    gives = walks + 2 * TREES * DEPTH + 2
    for phase, first, last in (
        (clearing, 0, scales),
        (scaling, scales, walks),
        (walking, walks, gives - 2),
        (giving, gives, gives + CLASSES),
        (given, gives + 1, gives + CLASSES + 1),
    ):
        prove(phase == ((age > first) & (age <= last)), f"phase {phase.name}")
    numbers = dut.counters
    prove(~clearing | (age == 1 + numbers["number"]), "classes cleared")
    prove(~giving | (age == gives + 1 + numbers["number"]), "classes given")
    place = numbers["column"] * SCALING + numbers["turn"]
    prove(~scaling | (age == scales + 1 + place), "inputs scaled")
    place = 2 * (numbers["tree"] * DEPTH + numbers["visit"]) + dut.looks
    prove(~walking | (age == walks + 1 + place), "comparisons made")
    for name, count, phase in (
        ("number", CLASSES, clearing | giving),
        ("column", INPUTS, scaling),
        ("turn", SCALING, scaling),
        ("tree", TREES, walking),
        ("visit", DEPTH, walking),
    ):
        prove(numbers[name] < count, f"{name} in range")
        prove(phase | (numbers[name] == 0), f"{name} begins at 0")
    prove(walking | ~dut.looks, "no comparison outside the walks")
    prove(judging == ((age > walks + 1) & (age <= gives - 1) & ~dut.looks), "each comparison judged")
    prove(
        adding == ((age > walks + 2) & (age <= gives) & (dut.looks | ~walking) & ~judging), "each vote added"
    )

    # of the walk whose node is judged: comparisons so far, and whether it has voted
    made = Signal(range(DEPTH + 2))
    voted = Signal()
    with m.If(dut.looks):
        m.d.sync += made.eq(made + ~dut.ended)
    with m.If(dut.votes):
        m.d.sync += voted.eq(1)
    with m.If(walking & ~dut.looks & (numbers["visit"] == 0)):
        m.d.sync += [made.eq(0), voted.eq(0)]
    prove(made <= DEPTH, "comparisons of a walk")
    prove(~dut.looks | dut.ended | (made == numbers["visit"]), "a comparison a visit, until the vote")
    prove(dut.looks | ~walking | (numbers["visit"] == 0) | (made <= numbers["visit"]), "comparisons judged")
    prove(~dut.votes | ~voted, "one vote a walk")
    prove(~dut.looks | (voted == dut.ended), "a walk ends with its vote")
    prove(~voted | ~dut.node_enable | (numbers["visit"] == 0), "no node is read behind a vote")
