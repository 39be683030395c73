"""The schedule made visible: every operation drawn once, figures those of the schedule."""

from eskin.rtl.program.microcode import Microcode
from eskin.rtl.program.schedule import schedule
from eskin.rtl.program.scheduler import Schedule
from eskin.rtl.views import schedule_view as view
from tests.support.small_designs import CELLS, reference
from tests.support.table import each_row

KINDS = [(1, "plain"), (4, "plain"), (40, "plain"), (1, "dsp"), (4, "dsp")]


def unit(plan: Schedule, name: str) -> list[view.Span]:
    return [span for span in view.spans(plan) if span.unit == name]


# ---------------------------------------------------------------------- spans
@each_row(("cell", "kind"), [*zip(CELLS * 2, KINDS, strict=False)])
def test_every_operation_is_in_one_span(cell, kind):
    plan = schedule(reference(*cell, kind[0], lane_type=kind[1]))
    drawn = [
        (span.before, span.slot + k, span.first + k, span.rows, *span.what.replace(",", "").split()[:2])
        for span in unit(plan, view.LANES)
        for k in range(span.slots)
    ]
    assert all(span.last - span.first + 1 == span.slots for span in unit(plan, view.LANES))
    assert drawn == [
        (before, base + op.cycle, op.index, group.rows, group.block.terms[op.term][0], op.region)
        for ops, base, before in ((plan.mac_before, 0, True), (plan.mac_after, plan.slots_before, False))
        for op in ops
        for group in [plan.groups[op.group]]
    ]
    terms = {op.name: len(op.terms) for op in plan.program.elements}
    drawn = [
        (span.slot + k, span.block, k % terms[span.block], span.first + k // terms[span.block])
        for span in unit(plan, view.ELEMENTS)
        for k in range((span.last - span.first + 1) * terms[span.block])
    ]
    assert drawn == [
        (plan.slots_before + issue.cycle, issue.op.name, issue.term, issue.index) for issue in plan.elements
    ]
    # later units where the microcode has their bits; what is looked up in a slot is written in the next
    code = Microcode(plan)
    words = list(enumerate(code.slots[code.again :]))
    for name, later, works in (
        (view.STATE, 0, lambda word: word.get("state_write")),
        (view.CLASSIFIER, 0, lambda word: word.get("logit")),
        (
            view.TABLE,
            1,
            lambda word: word.get("gate_write") or (word.get("t_write") and not word.get("value")),
        ),
    ):
        drawn = sorted(span.slot + k + later for span in unit(plan, name) for k in range(span.slots))
        assert drawn == [slot for slot, word in words if works(word)], name
    # every row's sum leaves once, and each unit does one thing at a time
    assert sum(span.slots for span in unit(plan, view.CHAIN)) == sum(group.rows for group in plan.groups)
    assert sum(span.slots for span in unit(plan, view.CLASSIFIER)) == plan.config.classes
    for name in view.UNITS:
        times = [span.slot + k for span in unit(plan, name) for k in range(span.slots)]
        assert len(times) == len(set(times))


# ---------------------------------------------------------------------- figures, text, picture
def shares(plan, name: str) -> int:
    """Lane cycles of a unit's spans."""
    return sum(span.slots * span.rows for span in unit(plan, name))


# ---------------------------------------------------------------------- the verb
