"""From logits to decisions: the local one at every step, the global one at the end of a touch."""

from __future__ import annotations

from amaranth.hdl import Array, Module, Mux, Signal, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from golden.config import AcceleratorConfig

decision_layout = data.StructLayout({"class": 5, "margin": 16, "step": 8, "is_global": 1, "partial": 1})
"""A decision: class index, margin (logit LSBs; votes for a global vote), step (0-based), global or local, partial touch."""


class Classifier(wiring.Component):
    """argmax and margin of each step's logits, and the global decision: the last step's or the vote's (ties: lowest index).

    Members
    -------
    logit : In(struct)
        Class by class, never held up.
    o : Out(stream of decision_layout)
        Offered one cycle after the step's last logit; the global decision follows the last local one (vote: classes + 1 cycles later).
    finish : In(1)
        Pulse while idle: the recording has ended; a touch with at least one step gets its global decision, marked partial.
    idle : Out(1)
        No logits under way, no decision waiting.
    ended : Out(1)
        The global decision of a touch is taken in this cycle.
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
        value = Signal(signed(max(config.logit_format.width, 10)))
        valid = Signal()
        number = Signal(range(config.classes))
        best, second = Signal.like(value), Signal.like(value)
        best_class = Signal.like(number)
        last = number == config.classes - 1

        # The largest and the second largest of C values, one a cycle; strict comparison leaves ties to the lowest index.
        first = number == 0
        beats_best = first | (value > best)
        with m.If(valid):
            m.d.sync += number.eq(Mux(last, 0, number + 1))
            with m.If(beats_best):
                m.d.sync += [best.eq(value), best_class.eq(number)]
            floor = -(1 << len(value) - 1)
            m.d.sync += second.eq(Mux(first, floor, Mux(beats_best, best, Mux(value > second, value, second))))

        step = Signal(range(config.steps))
        partial = Signal()
        votes = Array(Signal(range(config.steps + 1), name=f"votes_{k}") for k in range(config.classes))
        taken = self.o.valid & self.o.ready
        m.d.comb += [
            self.o.p["class"].eq(best_class),
            self.o.p.margin.eq(best - second),
            self.o.p.step.eq(step),
            self.o.p.partial.eq(partial),
        ]
        with m.FSM():
            with m.State("COLLECT"):
                m.d.comb += [value.eq(self.logit.value), valid.eq(self.logit.valid), self.idle.eq(first)]
                begun = Signal()
                with m.If(self.logit.valid & last):
                    m.d.sync += begun.eq(1)
                    m.next = "LOCAL"
                with m.Elif(self.finish & begun):
                    m.d.sync += [partial.eq(1), step.eq(step - 1)]
                    m.next = "SCAN" if config.decision == "vote" else "GLOBAL"
            with m.State("LOCAL"):
                m.d.comb += self.o.valid.eq(1)
                with m.If(taken):
                    m.d.sync += votes[best_class].eq(votes[best_class] + 1)
                    with m.If(step == config.steps - 1):
                        m.next = "SCAN" if config.decision == "vote" else "GLOBAL"
                    with m.Else():
                        m.d.sync += step.eq(step + 1)
                        m.next = "COLLECT"
            if config.decision == "vote":
                with m.State("SCAN"):
                    m.d.comb += [value.eq(votes[number]), valid.eq(1)]
                    with m.If(last):
                        m.next = "GLOBAL"
            with m.State("GLOBAL"):
                m.d.comb += [self.o.valid.eq(1), self.o.p.is_global.eq(1), self.ended.eq(taken)]
                with m.If(taken):
                    m.d.sync += [step.eq(0), partial.eq(0), begun.eq(0), *(vote.eq(0) for vote in votes)]
                    m.next = "COLLECT"
        return m
