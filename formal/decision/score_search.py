"""The two searches for the largest score: class and margin of any scores, and when they are there."""

from amaranth.hdl import Module, Signal

from eskin.golden.core import PRESETS, QFormat
from eskin.rtl.decision.score_search import make_search
from formal.proof import Bug, assume, free, proof, prove

CLASSES = 3
CONFIG = PRESETS["thesis"].replace(
    taxels=4,
    steps=3,
    lanes=1,
    feature_shift=(4,),
    class_names=("a", "b", "c"),
    logit_format=QFormat(4, 2),
    decision="last",
)
REDUCED = "3 classes, the second step, scores of 4 bits, no pauses"


def _right(m: Module, config, latency: int) -> None:
    """Whatever the scores, and those of the step before: the lowest class of the largest, by how much it is
    larger, ``latency`` cycles after the last score."""
    dut = make_search(config)
    m.submodules.dut = dut
    free(dut.score.value)
    assume(dut.score.value[4:] == 0)
    before, begun, given = Signal(range(CLASSES + 1)), Signal(), Signal(range(CLASSES + 1))
    m.d.sync += [before.eq(before + (before != CLASSES)), begun.eq(begun | dut.found)]
    m.d.comb += dut.score.valid.eq((before != CLASSES) | (begun & (given != CLASSES)))
    scores = [Signal.like(dut.score.value, name=f"score_{k}") for k in range(CLASSES)]
    with m.If(begun & dut.score.valid):
        m.d.sync += given.eq(given + 1)
        with m.Switch(given):
            for k, score in enumerate(scores):
                with m.Case(k):
                    m.d.sync += score.eq(dut.score.value)
    since, found = Signal(5, name="since"), Signal(name="found_before")
    m.d.sync += [since.eq(since + (given == CLASSES)), found.eq(found | (begun & dut.found))]
    in_time = (given == CLASSES) & (since == latency - 1) & ~found
    prove(~begun | (dut.found == in_time), "found once, in its cycle")
    for k, score in enumerate(scores):
        chosen = found & (dut.best == k)
        others = [other for other in range(CLASSES) if other != k]
        for other in others:
            prove(
                ~chosen | ((score > scores[other]) if other < k else (score >= scores[other])),
                f"class {k} before {other}",
            )
            prove(~chosen | (score - scores[other] >= dut.margin), f"margin of {k} over {other}")
        equal = [score - scores[other] == dut.margin for other in others]
        prove(~chosen | equal[0] | equal[1], f"margin of {k}")
    prove(~found | (dut.best < CLASSES), "a class that there is")
    prove(~begun | (given == CLASSES) | (dut.number == given), "the class of the next score")


@proof(
    "read back from a memory, scores give the lowest class of the largest, and by how much it is larger "
    "than every other, in its cycle",
    method="bounded",
    depth=21,
    reduced=REDUCED,
    bugs=(
        Bug(
            "the largest itself is compared with the others",
            "comparing & ~is_best & exceeds",
            "comparing & exceeds",
            depth=21,
        ),
        Bug(
            "the first of the others is not taken unseen",
            "(fetched & (reading == 0)) | search_ends",
            "fetched & (reading == 0) & ~others",
            depth=21,
        ),
    ),
)
def twice(m: Module) -> None:
    _right(m, CONFIG, CLASSES + 3)


@proof(
    "held as they come, scores give the lowest class of the largest, and by how much it is larger than "
    "every other, in its cycle",
    method="bounded",
    depth=13,
    reduced=REDUCED,
    quick=True,
    bugs=(
        Bug(
            "a tie goes to the later class",
            "difference = compared == 0, new + below",
            "difference = compared == 0, new + below + 1",
            depth=13,
        ),
        Bug(
            "the largest before is not the second once it is beaten",
            "unseen.eq(first | exceeds)",
            "unseen.eq(first)",
            depth=13,
        ),
        Bug(
            "the first is compared with those of the step before",
            "larger.eq(exceeds & ~first)",
            "larger.eq(exceeds)",
            depth=13,
        ),
        Bug("the distance is one too small", "above + 1", "above", depth=13),
    ),
)
def once(m: Module) -> None:
    _right(m, CONFIG.replace(cell="linear"), 2)
