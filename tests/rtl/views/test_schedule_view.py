"""The schedule made visible: every operation drawn once, figures those of the schedule."""

import json
from itertools import pairwise
from pathlib import Path

import pytest

from eskin.rtl.program.microcode import Microcode
from eskin.rtl.program.schedule import schedule
from eskin.rtl.program.scheduler import Schedule
from eskin.rtl.program.timing import logit_to_decision
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


@each_row(("lanes", "lane_type"), [*KINDS[:2], *KINDS[3:]])
def test_figures_text_and_picture_are_the_schedules(lanes, lane_type):
    plan = schedule(reference(lanes=lanes, lane_type=lane_type))
    s, steps = view.summary(plan), plan.step_cycles
    assert (s["step_cycles"], s["decision_cycles"], s["busy_share"]) == (
        steps,
        plan.decision_cycles,
        plan.busy_share,
    )
    assert s["phase_a_cycles"] == plan.slots_before == s["step_cycles"] - s["decision_cycles"]
    assert s["ideal_cycles"] == plan.config.step_ideal and s["ratio"] == steps / s["ideal_cycles"]
    assert shares(plan, view.LANES) / (lanes * steps) == plan.busy_share
    assert shares(plan, view.ELEMENTS) / steps == s["element_share"]
    assert s["prologue_cycles"] == Microcode(plan).again
    head, _, body = view.text(plan).partition("what\n")
    for name, words in view.figures(plan):
        assert f"{name:30} {words}\n" in head
    *rows, last = (line.split(maxsplit=2) for line in body.splitlines())
    assert last[0] == str(steps)
    assert sorted(row[:2] for row in rows) == sorted(
        [f"{span.slot}..{span.last_slot}", "A" if span.before else "B"] for span in view.spans(plan)
    )
    assert max(int(cycles.split("..")[1]) for cycles, *_ in rows) == steps - logit_to_decision(plan.config)
    figure = view.timeline(plan)
    drawn = 0.0
    for axes in figure.axes:
        for path in (path for bars in axes.collections for path in bars.get_paths()):
            (left, top), (right, bottom) = path.vertices.min(axis=0), path.vertices.max(axis=0)
            assert axes.get_xlim()[0] <= left and right <= axes.get_xlim()[1]
            drawn += (right - left) * (bottom - top)
    assert round(drawn) == sum(shares(plan, name) for name in view.UNITS)
    limits = [axes.get_xlim() for axes in figure.axes]
    assert limits[0][0] == 0 and all(before[1] == after[0] for before, after in pairwise(limits))
    lines = [line.get_xdata()[0] for axes in figure.axes for line in axes.lines]
    assert lines == [plan.slots_before, steps]
    legend = [entry.get_text() for entry in figure.legends[0].get_texts()]
    assert sorted(legend[:-1]) == sorted({span.block for span in view.spans(plan)})


# ---------------------------------------------------------------------- the verb
@pytest.fixture
def call(call, monkeypatch, tmp_path):
    """Of ``eskin schedule`` in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return lambda *words: call("schedule", *words)


@each_row(
    ("words", "part"),
    [
        (["nothing"], "nothing"),
        (["thesis", "--lanes", 0], "lanes"),
        (["thesis", "--lanes", 65], "1..64"),
        (["thesis", "--out", "file"], "file"),
        (["damaged"], "config.json"),
        (["thesis", "--out", "file/x"], "file"),
    ],
)
def test_bad_input_is_one_sentence_and_status_2(call, words, part):
    Path("file").write_text("")
    Path("damaged").mkdir(exist_ok=True)
    Path("damaged/config.json").write_text("{")
    before = sorted(Path().rglob("*"))
    status, out, err = call(*words)
    assert status == 2 and out == "" and sorted(Path().rglob("*")) == before
    assert err.startswith("eskin: ") and err.count("\n") == 1 and part in err


def test_drawing_of_a_model_folder(call):
    config = reference("lstm", lanes=4)
    Path("model").mkdir()
    Path("model/config.json").write_text(config.to_json())
    assert call("model", "--lanes", 6, "--out", "one")[0] == 0
    status, out, _ = call("model", "--lanes", 6, "--out", "two")
    plan = schedule(config.replace(lanes=6))
    assert status == 0 and f"{plan.step_cycles} cycles" in out and f"{plan.config.step_ideal} cycles" in out
    files = {path.name: path.read_bytes() for path in Path("one").iterdir()}
    assert sorted(files) == ["schedule.json", "schedule.png", "schedule.svg", "schedule.txt"]
    assert files == {path.name: path.read_bytes() for path in Path("two").iterdir()}
    values = json.loads(files["schedule.json"])
    assert values["summary"] == view.summary(plan) and [
        view.Span(**span) for span in values["spans"]
    ] == list(view.spans(plan))
    assert files["schedule.txt"].decode() == view.text(plan)
    assert (
        files["schedule.png"].startswith(b"\x89PNG")
        and f"{plan.step_cycles} cycles a step".encode() in files["schedule.svg"]
    )
