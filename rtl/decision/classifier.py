"""From logits to decisions: the local one at every step, the global one at the end of a touch (docs/specification.md, section 7)."""

from __future__ import annotations

from amaranth.hdl import Array, Cat, Const, Module, Mux, Signal, Value, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from eskin.golden.core.config import AcceleratorConfig
from eskin.rtl.common.compare import exceeds
from eskin.rtl.common.layouts import decision_layout
from eskin.rtl.common.memory_style import before_an_adder


def margin_held(m: Module, config: AcceleratorConfig, *, local_taken: Signal, best: Signal, margin: Signal, ended: Signal) -> Signal:
    """High where the local decision that is offered is the ``early_steps``-th in a row of one class with a margin of ``early_margin``.

    Parameters
    ----------
    local_taken, ended:
        A local decision is taken; the touch ends, which forgets what was seen.
    best, margin:
        Class and margin (not negative) of the local decision that is offered.
    """
    agreed = Signal(range(config.network.early_steps))  # decisions just before this one that count, early_steps - 1 at most
    before = Signal.like(best)
    counts, held = Signal(), Signal()
    m.d.comb += counts.eq((agreed == config.network.early_steps - 1) & ((best == before) | (config.network.early_steps == 1)))
    enough = margin >= config.network.early_margin
    m.d.comb += held.eq(enough & counts)
    with m.If(local_taken):
        m.d.sync += before.eq(best)
        if config.network.early_steps > 1:
            follows = (agreed != 0) & (best == before)
            m.d.sync += agreed.eq(Mux(enough, Mux(follows, Mux(counts, agreed, agreed + 1), 1), 0))
    with m.If(ended):
        m.d.sync += agreed.eq(0)
    return held


def below_threshold(config: AcceleratorConfig, margin: Signal) -> Value:
    """High where a global decision's margin is below ``margin_threshold``: by gates, and for votes only as wide as they get."""
    if config.network.decision == "vote":
        margin = margin[: config.windows.steps.bit_length()]
    return Const(1) if config.network.margin_threshold >> len(margin) else ~exceeds(margin, config.network.margin_threshold - 1)


class Classifier(wiring.Component):
    """argmax and margin of each step's logits, and the global decision: the last step's, an early one or the vote's (ties: lowest index).

    Members
    -------
    logit : In(struct)
        Class by class, never held up.
    o : Out(stream of decision_layout)
        Offered `eskin.rtl.program.timing.logit_to_decision` cycles after the step's last logit: classes + 4, in a linear cell 3; the
        global decision follows the last local one (vote: classes and as many cycles later).
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
                "logit": In(data.StructLayout({"valid": 1, "value": signed(config.formats.logit_format.width)})),
                "o": Out(stream.Signature(decision_layout)),
                "finish": In(1),
                "idle": Out(1),
                "ended": Out(1),
            }
        )

    def elaborate(self, platform):
        m = Module()
        config = self._config
        # ---------------------------------------------------------------- the largest score and its distance from the next
        # Scores (logits, or votes) come in offset binary; `number` is the class of the one that comes. At last `best` is the class of the
        # largest and `held` the margin, a cycle after `subtracting`.
        width = max(config.formats.logit_format.width, 10)
        number = Signal(range(config.classes))
        best, held = Signal(range(config.classes), reset_less=True), Signal(width, reset_less=True)
        subtracting, last = Signal(), number == config.classes - 1
        score_given, score = Signal(), Signal(width)
        if config.recurrent:
            self._search_twice(m, platform, score_given, score, number, last, best, held, subtracting)
        else:
            self._search_once(m, score_given, score, number, last, best, held, subtracting)

        # ---------------------------------------------------------------- steps and decisions
        step = Signal(range(config.windows.steps))  # of the last logits
        busy, begun, partial, offered, is_global = Signal(), Signal(), Signal(), Signal(), Signal()
        tallying, voting = Signal(), Signal()  # votes become the scores; the scores are votes
        votes = Array(Signal(range(config.windows.steps + 1), name=f"votes_{k}") for k in range(config.classes))
        finished = Signal()  # one cycle after `finish`, which comes late in its cycle
        step_done, taken, closes = self.logit.valid & last, offered & self.o.ready, Signal()
        local_taken, final = taken & ~is_global, Signal()
        ends = finished | (local_taken & final)
        if config.network.decision == "early":
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
            score_given.eq(self.logit.valid),
            score.eq(self.logit.value ^ (1 << width - 1)),
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
            step.eq(step + (step_done & begun)),
            final.eq(step == config.windows.steps - 1),
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
            m.d.sync += [signal.eq(1) for signal in ((voting, tallying) if config.network.decision == "vote" else (offered, is_global))]
        with m.If(self.ended):
            m.d.sync += [signal.eq(0) for signal in (is_global, step, partial, begun, voting, *votes)]
            if config.network.decision == "early":  # without a decision to be taken, where the recording ends after an early one
                m.d.sync += busy.eq(0)
        if config.network.decision == "vote":
            with m.If(taken & ~is_global):
                m.d.sync += votes[best].eq(votes[best] + 1)
            with m.If(tallying):
                m.d.comb += [score_given.eq(1), score.eq(votes[number])]
                m.d.sync += tallying.eq(~last)
        return m

    def _search_twice(self, m, platform, score_given, score, number, last, best, held, subtracting) -> None:
        """In few cells: each score is read back once it is written, which finds the largest, and then once more, which finds the largest
        of the others. `number` is the class that is written or looked for, `reading` the one that is read a cycle later, `compared` the one
        whose score has come a cycle after that."""
        classes = self._config.classes
        m.submodules.scores = scores = Memory(shape=unsigned(len(score)), depth=classes, init=[], attrs=before_an_adder(platform))
        write, read = scores.write_port(), scores.read_port()
        reading, compared = (Signal(range(classes), name=name, reset_less=True) for name in ("reading", "compared"))
        compared_last = compared == classes - 1
        searching, reading_others, others = Signal(), Signal(), Signal()  # the second time
        fetched, comparing, taken_unseen = Signal(), Signal(), Signal()
        # `held` is the complement of the largest so far, at last the margin. One cell a bit: the carries compare, the same cells give what
        # is loaded.
        total = Cat(subtracting, held) + Cat(subtracting, read.data)
        exceeds = total[-1]  # strictly: ties stay with the lowest class
        found = others & compared_last
        m.d.comb += [write.addr.eq(number), write.en.eq(score_given), write.data.eq(score), read.addr.eq(Mux(found, best, reading))]
        m.d.sync += [
            reading.eq(number),
            fetched.eq(write.en | searching),
            reading_others.eq(searching),
            compared.eq(reading),
            comparing.eq(fetched),
            others.eq(reading_others),
            subtracting.eq(found),
            taken_unseen.eq((fetched & (reading == 0)) | found),
        ]
        with m.If(write.en | searching):
            m.d.sync += [number.eq(Mux(last, 0, number + 1)), searching.eq(searching ^ last)]
        # The first score is taken unseen; where it is the largest one itself, the least there is. (The carries come late: one gate
        # behind them enables both registers. A choice by gates: a multiplexer would be made an enable of its own.)
        is_best, settled = others & (compared == best), others | subtracting
        with m.If(taken_unseen | (comparing & ~is_best & exceeds)):
            m.d.sync += [
                held.eq(Mux(is_best & ~subtracting, -1, Mux(subtracting, total >> 1, ~read.data))),
                best.eq((best & settled.replicate(len(best))) | (compared & (~settled).replicate(len(best)))),
            ]

    def _search_once(self, m, score_given, score, number, last, best, held, subtracting) -> None:
        """In few cycles: the two largest so far are held. `arriving` is a score a cycle after it was given, `compared` its class."""
        compared, arriving = Signal.like(number, reset_less=True), Signal()
        new, largest, second = (Signal.like(score, name=name, reset_less=True) for name in ("new", "largest", "second"))
        m.d.sync += [new.eq(score), compared.eq(number), arriving.eq(score_given)]
        m.d.sync += subtracting.eq(arriving & (compared == self._config.classes - 1))
        with m.If(score_given):
            m.d.sync += number.eq(Mux(last, 0, number + 1))
        first, exceeds = compared == 0, new > largest  # strictly: ties stay with the lowest class
        with m.If(arriving & (first | exceeds)):
            m.d.sync += [largest.eq(new), best.eq(compared), second.eq(Mux(first, 0, largest))]
        with m.Elif(arriving & (new > second)):
            m.d.sync += second.eq(new)
        with m.If(subtracting):
            m.d.sync += held.eq(largest - second)
