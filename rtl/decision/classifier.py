"""Classifier: the local decision at every step and the global one at the end of a touch, from the logits
(docs/specification.md, section 7)."""

from amaranth.hdl import Array, Const, Module, Signal, Value, signed
from amaranth.lib import stream

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.common import Block, decision_layout, drive, exceeds, inputs, margin_units, outputs, struct
from eskin.rtl.decision.early_rule import EarlyRule
from eskin.rtl.decision.score_search import make_search


def below_threshold(config: AcceleratorConfig, margin: Signal) -> Value:
    """High where a global decision's margin is below ``margin_threshold``.

    Votes are compared only as wide as they get.
    """
    if config.network.decision == "vote":
        margin = margin[: config.windows.steps.bit_length()]
    return (
        Const(1)
        if config.network.margin_threshold >> len(margin)
        else ~exceeds(margin, config.network.margin_threshold - 1)
    )


class Classifier(Block):
    """argmax and margin of each step's logits (or of other scores in ``score_format``), and the global
    decision: the last step's, an early one or the vote's (ties: lowest index).

    Members
    -------
    logit : In(struct)
        Class by class, never held up.
    o : Out(stream of decision_layout)
        Offered `eskin.rtl.program.timing.logit_to_decision` cycles after the step's last logit: 3 with linear
        cells and from 4 lanes on, else classes + 4. The global decision follows the last local one; with
        votes classes and as many cycles later.
    finish : In(1)
        Pulse while idle: the recording has ended; a touch with at least one step gets its global decision,
        marked partial.
    longest : In(1)
        ``window_mode`` whole: the touch was the longest, so its decision is marked partial.
    idle : Out(1)
        No logits under way, no decision waiting: logits are taken.
    far : In(1), only with ``unknown_above``
        The step is far from every prototype: its global decision is unsure.
    ended : Out(1)
        The last decision of a touch is taken in this cycle: its global one, or the last step's if the global
        one came early. Also when the recording ends after an early decision.
    """

    def ports(self, config: AcceleratorConfig):
        return (
            inputs("finish", "longest", logit=struct("valid", value=signed(config.score_format.width)))
            | outputs("idle", "ended", o=stream.Signature(decision_layout(config)))
            | (inputs("far") if config.readout_rule.unknown_above else {})
        )

    def elaborate(self, platform):
        m = Module()
        config = self.spec
        m.submodules.search = search = self.search = make_search(config)
        number, best, margin = search.number, search.best, search.margin
        last = number == config.classes - 1
        step = Signal(range(config.windows.steps))  # of the last logits
        busy = Signal()
        begun = self.begun = Signal()
        partial = Signal()
        offered = Signal()
        is_global = Signal()
        tallying = self.tallying = Signal()  # votes become the scores
        voting = self.voting = Signal()  # the scores are votes
        votes = self.votes = Array(
            Signal(range(config.windows.steps + 1), name=f"votes_{k}") for k in range(config.classes)
        )
        finished = self.finished = Signal()  # one cycle after `finish`, which comes late in its cycle
        step_done = self.logit.valid & last
        accepted = offered & self.o.ready
        closes = Signal()
        local_taken = accepted & ~is_global
        final = Signal()
        ends = finished | (local_taken & final)
        if config.network.decision == "early":
            given = self.given = Signal()  # the touch has had its global decision, early
            m.submodules.early_rule = early = EarlyRule(config, len(margin))
            decides = self.decides = early.met
            drive(m, early, best=best, margin=margin, taken=local_taken, ended=self.ended)
            m.d.comb += [
                closes.eq((ends | (local_taken & decides)) & ~given),
                self.ended.eq((accepted & is_global & (final | partial)) | (ends & given)),
            ]
            m.d.sync += given.eq((given | (accepted & is_global)) & ~self.ended)
        else:
            m.d.comb += [closes.eq(ends), self.ended.eq(accepted & is_global)]
        unsure = below_threshold(config, margin)
        if config.readout_rule.unknown_above:
            unsure |= self.far
        drive(
            m,
            search.score,
            valid=self.logit.valid,
            # the sign bit turned over makes offset binary, which the search compares as unsigned
            value=self.logit.value ^ (1 << len(margin) - 1),
        )
        m.d.comb += [self.idle.eq(~busy), self.o.valid.eq(offered), self.o.p["class"].eq(best)]
        drive(
            m,
            self.o.p,
            margin=margin_units(config, margin, is_global) if config.wide_decisions else margin,
            step=step,
            is_global=is_global,
            partial=partial | is_global & self.longest,
            unsure=is_global & unsure,
        )
        m.d.sync += [
            step.eq(step + (step_done & begun)),
            # a register, a cycle behind `step`: no decision of the step can be taken before
            final.eq(step == config.windows.steps - 1),
            begun.eq(begun | step_done),
            finished.eq(self.finish & begun),
            partial.eq(partial | finished),
            busy.eq(busy | self.logit.valid | (self.finish & begun)),
        ]
        with m.If(search.found):
            m.d.sync += [offered.eq(1), is_global.eq(voting)]
        with m.If(accepted):
            m.d.sync += offered.eq(0)
        with m.If(accepted & ~closes):
            m.d.sync += busy.eq(0)
        with m.If(closes):
            both = (voting, tallying) if config.network.decision == "vote" else (offered, is_global)
            m.d.sync += [signal.eq(1) for signal in both]
        with m.If(self.ended):
            m.d.sync += [signal.eq(0) for signal in (is_global, step, partial, begun, voting, *votes)]
            # without a decision to be taken, where the recording ends after an early one
            if config.network.decision == "early":
                m.d.sync += busy.eq(0)
        if config.network.decision == "vote":
            with m.If(accepted & ~is_global):
                m.d.sync += votes[best].eq(votes[best] + 1)
            with m.If(tallying):
                drive(m, search.score, valid=1, value=votes[number])
                m.d.sync += tallying.eq(~last)
        return m
