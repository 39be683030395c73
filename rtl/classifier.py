"""From logits to decisions: the local one at every step, the global one at the end of a touch."""

from __future__ import annotations

from amaranth.hdl import Array, Cat, Const, Module, Mux, Signal, Value, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from golden.config import AcceleratorConfig
from rtl.collisions import before_an_adder
from rtl.onset_detector import exceeds

decision_layout = data.StructLayout({"class": 5, "margin": 16, "step": 8, "is_global": 1, "partial": 1, "unsure": 1})
"""A decision: class index, margin (logit LSBs; votes for a global vote), step (0-based), global or local, partial touch, global
with a margin below ``margin_threshold``."""


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


def below_threshold(config: AcceleratorConfig, margin: Signal) -> Value:
    """High where a global decision's margin is below ``margin_threshold``: by gates, and for votes only as wide as they get."""
    if config.decision == "vote":
        margin = margin[: config.steps.bit_length()]
    return Const(1) if config.margin_threshold >> len(margin) else ~exceeds(margin, config.margin_threshold - 1)


class Classifier(wiring.Component):
    """argmax and margin of each step's logits, and the global decision: the last step's, an early one or the vote's (ties: lowest index).

    Members
    -------
    logit : In(struct)
        Class by class, never held up.
    o : Out(stream of decision_layout)
        Offered classes + 4 cycles after the step's last logit (`rtl.schedule.logit_to_decision`); the global decision follows the last
        local one (vote: 2 classes + 4 cycles later).
    finish : In(1)
        Pulse while idle: the recording has ended; a touch with at least one step gets its global decision, marked partial.
    idle : Out(1)
        No logits under way, no decision waiting: logits are taken.
    ended : Out(1)
        The last decision of a touch is taken in this cycle: its global one, or the last step's where the global one was early; or the
        recording ends after an early one.
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
        # ---------------------------------------------------------------- the largest score and its distance from the next
        # Scores (logits, or votes) are kept in offset binary. Each is read back once it is written, which finds the largest, and then
        # once more, which finds the largest of the others. `number` is the class that is written or looked for, `reading` the one
        # that is read a cycle later, `compared` the one whose score has come a cycle after that.
        width = max(config.logit_format.width, 10)
        m.submodules.scores = scores = Memory(shape=unsigned(width), depth=config.classes, init=[], attrs=before_an_adder(platform))
        write, read = scores.write_port(), scores.read_port()
        number = Signal(range(config.classes))
        reading, compared, best = (Signal(range(config.classes), name=name, reset_less=True) for name in ("reading", "compared", "best"))
        last, compared_last = number == config.classes - 1, compared == config.classes - 1
        searching, reading_others, others = Signal(), Signal(), Signal()  # the second time
        fetched, comparing, subtracting, taken_unseen = Signal(), Signal(), Signal(), Signal()
        # Complement of the largest so far, at last the margin. One cell a bit: the carries compare, the same cells give what is loaded.
        held = Signal(width, reset_less=True)
        total = Cat(subtracting, held) + Cat(subtracting, read.data)
        exceeds = total[-1]  # strictly: ties stay with the lowest class
        found = others & compared_last
        m.d.comb += [write.addr.eq(number), read.addr.eq(Mux(found, best, reading))]
        m.d.sync += [
            reading.eq(number), fetched.eq(write.en | searching), reading_others.eq(searching),
            compared.eq(reading), comparing.eq(fetched), others.eq(reading_others),
            subtracting.eq(found), taken_unseen.eq((fetched & (reading == 0)) | found),
        ]  # fmt: skip
        with m.If(write.en | searching):
            m.d.sync += [number.eq(Mux(last, 0, number + 1)), searching.eq(searching ^ last)]
        # The first score is taken unseen; where it is the largest one itself, the least there is. (The carries come late: one gate
        # behind them enables both registers. A choice by gates: a multiplexer would be made an enable of its own.)
        is_best, settled = others & (compared == best), others | subtracting
        with m.If(taken_unseen | (comparing & ~is_best & exceeds)):
            m.d.sync += [
                held.eq(Mux(is_best & ~subtracting, -1, Mux(subtracting, total >> 1, ~read.data))),
                best.eq((best & settled.replicate(len(best))) | (compared & (~settled).replicate(len(best)))),
            ]  # fmt: skip

        # ---------------------------------------------------------------- steps and decisions
        step = Signal(range(config.steps))  # of the last logits
        busy, begun, partial, offered, is_global = Signal(), Signal(), Signal(), Signal(), Signal()
        tallying, voting = Signal(), Signal()  # votes become the scores; the scores are votes
        votes = Array(Signal(range(config.steps + 1), name=f"votes_{k}") for k in range(config.classes))
        finished = Signal()  # one cycle after `finish`, which comes late in its cycle
        step_done, taken, closes = self.logit.valid & last, offered & self.o.ready, Signal()
        local_taken, final = taken & ~is_global, Signal()
        ends = finished | (local_taken & final)
        if config.decision == "early":
            given = Signal()  # the touch has had its global decision, early
            decides = margin_held(m, config, local_taken=local_taken, best=best, margin=held, ended=self.ended)
            m.d.comb += [
                closes.eq((ends | (local_taken & decides)) & ~given),
                self.ended.eq((taken & is_global & (final | partial)) | (ends & given)),
            ]
            m.d.sync += given.eq((given | (taken & is_global)) & ~self.ended)
        else:
            m.d.comb += [closes.eq(ends), self.ended.eq(taken & is_global)]
        m.d.comb += [
            write.en.eq(self.logit.valid),
            write.data.eq(self.logit.value ^ (1 << width - 1)),
            self.idle.eq(~busy),
            self.o.valid.eq(offered),
            self.o.p["class"].eq(best),
            self.o.p.margin.eq(held),
            self.o.p.step.eq(step),
            self.o.p.is_global.eq(is_global),
            self.o.p.partial.eq(partial),
            self.o.p.unsure.eq(is_global & below_threshold(config, held)),
        ]
        m.d.sync += [
            step.eq(step + (step_done & begun)), final.eq(step == config.steps - 1),
            begun.eq(begun | step_done),
            finished.eq(self.finish & begun),
            partial.eq(partial | finished),
            busy.eq(busy | self.logit.valid | (self.finish & begun)),
        ]
        with m.If(subtracting):
            m.d.sync += [offered.eq(1), is_global.eq(voting)]
        with m.If(taken):
            m.d.sync += offered.eq(0)
        with m.If(taken & ~closes):
            m.d.sync += busy.eq(0)
        with m.If(closes):
            m.d.sync += [signal.eq(1) for signal in ((voting, tallying) if config.decision == "vote" else (offered, is_global))]
        with m.If(self.ended):
            m.d.sync += [signal.eq(0) for signal in (is_global, step, partial, begun, voting, *votes)]
            if config.decision == "early":  # without a decision to be taken, where the recording ends after an early one
                m.d.sync += busy.eq(0)
        if config.decision == "vote":
            with m.If(taken & ~is_global):
                m.d.sync += votes[best].eq(votes[best] + 1)
            with m.If(tallying):
                m.d.comb += [write.en.eq(1), write.data.eq(votes[number])]
                m.d.sync += tallying.eq(~last)
        return m
