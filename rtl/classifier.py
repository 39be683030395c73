"""From logits to decisions: the local one at every step, the global one at the end of a touch."""

from __future__ import annotations

from amaranth.hdl import Array, Cat, Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out
from amaranth.utils import ceil_log2

from golden.config import AcceleratorConfig
from rtl.collisions import NO_COLLISION

decision_layout = data.StructLayout({"class": 5, "margin": 16, "step": 8, "is_global": 1, "partial": 1})
"""A decision: class index, margin (logit LSBs; votes for a global vote), step (0-based), global or local, partial touch."""


def margin_held(m: Module, config: AcceleratorConfig, *, local_taken: Signal, best: Signal, margin: Signal, ended: Signal) -> Signal:
    """High where the local decision that is offered is the ``early_steps``-th in a row of one class with a margin of ``early_margin``.

    Parameters
    ----------
    local_taken, ended:
        A local decision is taken; the touch ends, which forgets what was seen.
    best, margin:
        Class and margin (not negative) of the local decision that is offered.
    """
    agreed = Signal(range(config.early_steps))  # decisions just before this one that count, early_steps - 1 at most
    before = Signal.like(best)
    counts, held = Signal(), Signal()
    m.d.comb += counts.eq((agreed == config.early_steps - 1) & ((best == before) | (config.early_steps == 1)))
    enough = margin >= config.early_margin
    m.d.comb += held.eq(enough & counts)
    with m.If(local_taken):
        m.d.sync += before.eq(best)
        if config.early_steps > 1:
            follows = (agreed != 0) & (best == before)
            m.d.sync += agreed.eq(Mux(enough, Mux(follows, Mux(counts, agreed, agreed + 1), 1), 0))
    with m.If(ended):
        m.d.sync += agreed.eq(0)
    return held


class Classifier(wiring.Component):
    """argmax and margin of each step's logits, and the global decision: the last step's, an early one or the vote's (ties: lowest index).

    Members
    -------
    logit : In(struct)
        Class by class, never held up.
    o : Out(stream of decision_layout)
        Offered 2 classes + 2 cycles after the step's last logit (`rtl.schedule.logit_to_decision`); the global decision follows the last
        local one (vote: 3 classes + 2 cycles later).
    finish : In(1)
        Pulse while idle: the recording has ended; a touch with at least one step gets its global decision, marked partial.
    idle : Out(1)
        No logits under way, no decision waiting: logits are taken.
    ended : Out(1)
        The last decision of a touch is taken in this cycle: its global one, or the last step's where the global one was early.
    """

    def __init__(self, config: AcceleratorConfig) -> None:
        self._config = config
        super().__init__(
            {
                "logit": In(data.StructLayout({"valid": 1, "value": signed(config.logit_format.width)})),
                "o": Out(stream.Signature(decision_layout)), "finish": In(1), "idle": Out(1), "ended": Out(1),
            }
        )  # fmt: skip

    def elaborate(self, platform):
        m = Module()
        config = self._config
        # Scores (logits, or votes) are kept in offset binary, then read twice: for the largest, and for the largest of the others.
        width = max(config.logit_format.width, 10)
        attributes = {"ram_style": "block"} | NO_COLLISION
        m.submodules.scores = scores = Memory(shape=unsigned(width), depth=config.classes, init=[], attrs=attributes)
        write, read = scores.write_port(), scores.read_port()
        number, compared, best_class = Signal(range(config.classes)), Signal(range(config.classes)), Signal(range(config.classes))
        comparing_next = Signal()
        others, comparing, comparing_others, offered = Signal(), Signal(), Signal(), Signal()
        first, last = number == 0, number == config.classes - 1
        inverted = Signal(width)  # complement of the largest so far: one adder compares, without inverters, and gives the margin
        total = Signal(width + 1)
        m.d.comb += [
            total.eq((Cat(offered, read.data) + Cat(offered, inverted)) >> 1),
            write.addr.eq(number),
            read.addr.eq(number),
            read.en.eq(0),
        ]
        exceeds = total[-1]  # strictly: ties stay with the lowest class
        with m.If(write.en | (comparing & ~comparing_others & (compared == config.classes - 1))):
            m.d.sync += inverted.eq(-1)
        with m.Elif(comparing & exceeds & ~(comparing_others & (compared == best_class))):
            m.d.sync += inverted.eq(~read.data)
        with m.If(write.en):
            m.d.sync += best_class.eq(0)
        with m.Elif(comparing & exceeds & ~comparing_others):
            m.d.sync += best_class.eq(compared)
        with m.If(write.en | comparing_next):
            m.d.sync += number.eq(Mux(last, 0, number + 1))
        m.d.sync += [comparing.eq(comparing_next), comparing_others.eq(others), compared.eq(number)]

        before_first = (1 << ceil_log2(config.steps)) - 1
        step = Signal(ceil_log2(config.steps), init=before_first)  # of the last logits
        begun, partial, voting = Signal(), Signal(), Signal()  # voting: the scores are votes
        votes = Array(Signal(range(config.steps + 1), name=f"votes_{k}") for k in range(config.classes))
        taken = self.o.valid & self.o.ready
        early = config.decision == "early"
        given = Signal()  # the touch has had its global decision, early
        final = step == config.steps - 1
        score = self.logit.value ^ (1 << width - 1)
        m.d.comb += [
            write.data.eq(Mux(voting, votes[number], score) if config.decision == "vote" else score),
            self.o.p["class"].eq(best_class),
            self.o.p.margin.eq(total[:width]),
            self.o.p.step.eq(step),
            self.o.p.partial.eq(partial),
        ]
        forget = [step.eq(before_first), partial.eq(0), begun.eq(0), voting.eq(0), given.eq(0), *(vote.eq(0) for vote in votes)]
        if early:
            local_taken = taken & ~self.o.p.is_global
            held = margin_held(m, config, local_taken=local_taken, best=best_class, margin=total[:width], ended=self.ended)
        with m.FSM():
            with m.State("COLLECT"):
                m.d.comb += [
                    self.idle.eq(first),
                    write.en.eq(self.logit.valid),
                ]
                with m.If(self.logit.valid & last):
                    m.d.sync += [begun.eq(1), step.eq(step + 1)]
                    m.next = "SCAN"
                with m.Elif(self.finish & given):
                    m.d.comb += self.ended.eq(1)
                    m.d.sync += forget
                with m.Elif(self.finish & begun):
                    m.d.sync += [partial.eq(1), voting.eq(config.decision == "vote")]
                    m.next = "TALLY" if config.decision == "vote" else "GLOBAL"
            with m.State("SCAN"):
                m.d.comb += [read.en.eq(1), comparing_next.eq(1)]
                with m.If(last):
                    m.d.sync += others.eq(~others)
                    with m.If(others):
                        m.next = "MARGIN"
            with m.State("MARGIN"):  # the last comparison; the largest is read once more
                m.d.comb += [read.en.eq(1), read.addr.eq(best_class)]
                with m.If(voting):
                    m.next = "GLOBAL"
                with m.Else():
                    m.next = "LOCAL"
            with m.State("LOCAL"):
                m.d.comb += [offered.eq(1), self.o.valid.eq(1)]
                with m.If(taken):
                    m.d.sync += votes[best_class].eq(votes[best_class] + 1)
                    with m.If((final | held) & ~given if early else final):
                        m.d.sync += voting.eq(config.decision == "vote")
                        m.next = "TALLY" if config.decision == "vote" else "GLOBAL"
                    with m.Else():
                        m.next = "COLLECT"
                        with m.If(final):
                            m.d.comb += self.ended.eq(1)
                            m.d.sync += forget
            if config.decision == "vote":
                with m.State("TALLY"):
                    m.d.comb += write.en.eq(1)
                    with m.If(last):
                        m.next = "SCAN"
            with m.State("GLOBAL"):
                m.d.comb += [offered.eq(1), self.o.valid.eq(1), self.o.p.is_global.eq(1)]
                with m.If(taken):
                    m.d.sync += given.eq(early)
                    m.next = "COLLECT"
                    with m.If(final | partial | (not early)):
                        m.d.comb += self.ended.eq(1)
                        m.d.sync += forget
        return m
