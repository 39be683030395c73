"""Decisions: one local a step, one global a touch, steps and votes in range."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import enum

from eskin.golden.core import PRESETS
from eskin.rtl.decision.classifier import Classifier
from eskin.rtl.program.timing import holds_two_largest
from formal.proof import Bug, assume, free, keeps_its_beat, placed, proof, prove

CLASSES, STEPS = 3, 3
CONFIG = PRESETS["thesis"].replace(
    taxels=4, steps=STEPS, lanes=1, feature_shift=(4,), class_names=("a", "b", "c"), margin_threshold=7
)
HOLDING = CONFIG.replace(lanes=4)
"""The two largest scores are held as they come."""


def _decisions(m: Module, config) -> None:
    """Drives the classifier as the engine does, and compares the number of its outputs with the number of its
    inputs."""
    dut = placed(Classifier(config))
    free(dut.logit.valid, dut.logit.value, dut.o.ready, dut.finish)
    logits = Signal(range(CLASSES))  # of the step under way
    m.d.sync += logits.eq(Mux(dut.logit.valid, Mux(logits == CLASSES - 1, 0, logits + 1), logits))
    # the engine begins phase B while the classifier is idle, and the host's finish comes when engine and
    # classifier are
    assume(~dut.logit.valid | (logits != 0) | dut.idle)
    assume(~dut.finish | (dut.idle & (logits == 0) & ~dut.logit.valid))
    keeps_its_beat(dut.o, "o")

    accepted = dut.o.valid & dut.o.ready
    local, overall = accepted & ~dut.o.p.is_global, accepted & dut.o.p.is_global
    stepped = dut.logit.valid & (logits == CLASSES - 1)
    steps, locals_, globals_ = (
        Signal(range(STEPS + 2), name=name) for name in ("steps", "locals", "globals")
    )
    finished = Signal()
    m.d.sync += [
        steps.eq(Mux(dut.ended, 0, steps + stepped)),
        locals_.eq(Mux(dut.ended, 0, locals_ + local)),
        globals_.eq(Mux(dut.ended, 0, globals_ + overall)),
        finished.eq((finished | (dut.finish & (steps != 0))) & ~dut.ended),
    ]
    prove(~local | (locals_ < steps), "a local decision is of a step")
    prove(~local | (dut.o.p.step == locals_), "local decisions come in order")
    prove(~dut.ended | ((globals_ + overall) == 1), "a touch ends with exactly one global decision")
    prove(~overall | (globals_ == 0), "no second global decision")
    prove(~dut.ended | ((locals_ + local) == steps), "every step has had its local decision")
    prove(~dut.ended | finished | (steps == STEPS), "a touch ends with its last step or with the recording")
    prove(~accepted | (dut.o.p["class"] < CLASSES), "a class that there is")
    prove(~overall | (dut.o.p.partial == finished), "partial where the recording ended first")
    prove(~dut.idle | (locals_ == steps), "idle: nothing owed")
    small = dut.o.p.margin < config.network.margin_threshold
    if config.network.decision != "vote":
        prove(
            ~dut.o.valid | (dut.o.p.unsure == (dut.o.p.is_global & small)),
            "unsure: a global decision below the threshold",
        )
    # ---- for the induction: where the classifier is, step by step
    phase = Signal(Phase)
    vote, number = config.network.decision == "vote", dut.search.number
    final = locals_ + 1 == STEPS
    given = globals_ != 0
    # the two largest are held as the scores come: a score is compared in the cycle after it
    once = holds_two_largest(config)
    search, searching = dut.search, Phase.READ if once else Phase.SEARCH
    with m.Switch(phase):
        with m.Case(Phase.IDLE):
            with m.If(dut.logit.valid):
                m.d.sync += phase.eq(Phase.LOGITS)
            with m.Elif(dut.finish & (steps != 0)):
                m.d.sync += phase.eq(Phase.FINISH)
        with m.Case(Phase.LOGITS), m.If(stepped):
            m.d.sync += phase.eq(searching)
        with m.Case(Phase.FINISH):
            m.d.sync += phase.eq(Mux(given, Phase.IDLE, Phase.TALLY if vote else Phase.OFFER))
        with m.Case(Phase.TALLY), m.If(number == CLASSES - 1):
            m.d.sync += phase.eq(searching)
        with m.Case(Phase.SEARCH), m.If(number == CLASSES - 1):
            m.d.sync += phase.eq(Phase.READ)
        read = Phase.SUBTRACT if once else Phase.COMPARE
        for state, following in (
            (Phase.READ, read),
            (Phase.COMPARE, Phase.SUBTRACT),
            (Phase.SUBTRACT, Phase.OFFER),
        ):
            with m.Case(state):
                m.d.sync += phase.eq(following)
        with m.Case(Phase.OFFER), m.If(accepted):
            closes = (
                ~dut.o.p.is_global
                & ~given
                & (final | (dut.decides if config.network.decision == "early" else 0))
            )
            m.d.sync += phase.eq(Mux(closes, Phase.TALLY if vote else Phase.OFFER, Phase.IDLE))
    searched = (
        (phase == Phase.SEARCH) | (phase == Phase.READ) | (phase == Phase.COMPARE) | (phase == Phase.SUBTRACT)
    )
    owed = (searched & ~dut.voting) | ((phase == Phase.OFFER) & ~dut.o.p.is_global)
    prove(dut.idle == (phase == Phase.IDLE), "idle")
    prove(dut.o.valid == (phase == Phase.OFFER), "offered")
    if once:
        arrives, of = search.arriving, search.compared
        prove((arrives & (of == CLASSES - 1)) == (phase == Phase.READ), "the last score is compared")
        prove(~arrives | (of == CLASSES - 1) | (number == of + 1), "a score of the class before")
        prove(
            ~arrives | (phase == Phase.READ) | (phase == Phase.LOGITS) | (phase == Phase.TALLY),
            "a score of this step or vote",
        )
        prove(~search.judged | ~dut.idle, "a lead of this step or vote")
    else:
        prove(search.searching == (phase == Phase.SEARCH), "searching")
    prove(dut.tallying == (phase == Phase.TALLY), "tallying")
    prove(search.found == (phase == Phase.SUBTRACT), "ending")
    prove(dut.finished == (phase == Phase.FINISH), "finished")
    counts = (phase == Phase.LOGITS) | (phase == Phase.TALLY) | (phase == Phase.SEARCH)
    prove(Mux(counts, number < CLASSES, number == 0), "class numbers in range")
    prove((phase != Phase.LOGITS) | (number == logits), "the class of a logit")
    prove((phase == Phase.LOGITS) == (logits != 0), "logits of a step come before anything else")
    prove(~dut.o.p.is_global | (phase == Phase.OFFER) | given, "global while it is offered")
    prove(dut.o.p["class"] < CLASSES, "the best is a class")
    if vote:
        prove(dut.voting <= ((phase == Phase.TALLY) | searched | (phase == Phase.OFFER)), "voting")
        prove((phase != Phase.TALLY) | dut.voting, "tallies for the vote")
        prove((phase != Phase.OFFER) | (dut.o.p.is_global == dut.voting), "the vote is the global decision")
        prove(sum(dut.votes) == locals_, "as many votes as local decisions")
    else:
        prove(~dut.voting & (phase != Phase.TALLY), "no vote")
    prove(dut.begun == (steps != 0), "begun")
    prove(dut.o.p.step == Mux(steps == 0, 0, steps - 1), "the step of the last logits")
    prove((steps <= STEPS) & (logits < CLASSES), "steps in range")
    prove(steps == locals_ + owed, "a local decision is owed to the last step at most")
    prove(
        globals_ <= (config.network.decision == "early"),
        "no touch goes on after its global decision, but for an early one",
    )
    prove(finished == (dut.finished | dut.o.p.partial), "partial")
    prove(~finished | ~owed, "all local decisions are out when the recording ends")
    prove(
        ~finished
        | (phase == Phase.FINISH)
        | (phase == Phase.TALLY)
        | (searched & dut.voting)
        | (phase == Phase.OFFER),
        "then the last",
    )
    prove((phase != Phase.FINISH) | ((steps != 0) & ~dut.o.p.partial), "finish")
    prove((steps != STEPS) | (phase != Phase.IDLE), "the last step ends the touch")
    prove((steps != STEPS) | (phase != Phase.LOGITS), "no logits after the last step")
    prove((steps == STEPS) | finished | ~dut.voting, "a vote at the end")
    if config.network.decision == "early":
        prove(dut.given == given, "given")
        prove(~(dut.o.p.is_global & given & (phase == Phase.OFFER)), "one global decision")
    else:
        prove((steps == STEPS) | finished | ~dut.o.p.is_global, "a global decision at the end")


class Phase(enum.Enum, shape=4):
    """Phases of the classifier."""

    IDLE = 0
    LOGITS = 1
    SEARCH = 2
    READ = 3
    COMPARE = 4
    SUBTRACT = 5
    OFFER = 6
    TALLY = 7
    FINISH = 8


BUGS = (
    Bug(
        "the touch ends with its first decision",
        "self.ended.eq(accepted & is_global)",
        "self.ended.eq(accepted)",
    ),
    Bug(
        "an offer is withdrawn",
        "with m.If(accepted):\n            m.d.sync += offered.eq(0)",
        "with m.If(offered):\n            m.d.sync += offered.eq(0)",
    ),
    Bug("the step counter is not cleared", "(is_global, step, partial,", "(is_global, partial,"),
)


@proof(
    "one local decision a step, in order, and exactly one global decision a touch, unsure below the "
    "threshold only (last)",
    depth=6,
    reduced="3 classes, 3 steps",
    bugs=(
        *BUGS[:2],
        Bug(
            "a margin at the threshold is unsure",
            "config.network.margin_threshold - 1)",
            "config.network.margin_threshold)",
        ),
    ),
)
def last(m: Module) -> None:
    _decisions(m, CONFIG)


@proof("the same for a vote, but for unsure", depth=6, reduced="3 classes, 3 steps", bugs=BUGS[:2])
def vote(m: Module) -> None:
    _decisions(m, CONFIG.replace(decision="vote", margin_threshold=2))


@proof(
    "the first touch's vote is unsure below the threshold only",
    method="bounded",
    depth=60,
    reduced="3 classes, 3 steps, no pauses",
    bugs=(
        Bug(
            "a bit of the votes is not compared",
            "margin[: config.windows.steps.bit_length()]",
            "margin[: config.windows.steps.bit_length() - 1]",
        ),
    ),
)
def unsure_vote(m: Module) -> None:
    config = CONFIG.replace(decision="vote", margin_threshold=2)
    dut = Classifier(config)
    m.submodules.dut = dut
    free(dut.logit.value)
    logits, steps, votes = (
        Signal(range(CLASSES), name="logits"),
        Signal(range(STEPS + 1), name="steps"),
        Signal(2, name="votes_seen"),
    )
    m.d.comb += [dut.o.ready.eq(1), dut.logit.valid.eq((dut.idle | (logits != 0)) & (steps != STEPS))]
    with m.If(dut.logit.valid):
        m.d.sync += [
            logits.eq(Mux(logits == CLASSES - 1, 0, logits + 1)),
            steps.eq(steps + (logits == CLASSES - 1)),
        ]
    m.d.sync += votes.eq(votes + (dut.o.valid & dut.o.p.is_global))
    prove(
        ~dut.o.valid
        | (dut.o.p.unsure == (dut.o.p.is_global & (dut.o.p.margin < config.network.margin_threshold))),
        "unsure",
    )
    cycle = Signal(range(64))
    m.d.sync += cycle.eq(cycle + 1)
    prove((cycle < 58) | (votes == 1), "the vote comes")


@proof(
    "the same for an early decision, which is not followed by a second one",
    depth=6,
    reduced="3 classes, 3 steps",
    bugs=(
        Bug(
            "an early decision ends the touch",
            "(accepted & is_global & (final | partial))",
            "(accepted & is_global)",
        ),
    ),
)
def early(m: Module) -> None:
    _decisions(m, CONFIG.replace(decision="early", early_steps=2, early_margin=5))


@proof(
    "the same where the two largest scores are held as they come",
    depth=6,
    reduced="3 classes, 3 steps",
    bugs=(
        *BUGS[:2],
        Bug(
            "the search ends with the class before the last",
            "arriving & (compared == last_class)",
            "arriving & (compared == last_class - 1)",
            file="rtl/decision/score_search.py",
        ),
    ),
)
def once(m: Module) -> None:
    _decisions(m, HOLDING.replace(decision="last"))


@proof(
    "the same for a vote where the two largest scores are held, but for unsure",
    depth=6,
    reduced="3 classes, 3 steps",
    bugs=BUGS[:2],
)
def vote_once(m: Module) -> None:
    _decisions(m, HOLDING.replace(decision="vote", margin_threshold=2))
