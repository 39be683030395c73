"""The schedule made visible: every operation drawn once, figures those of the schedule, later units as the
hardware does them."""

from __future__ import annotations

import csv
import json
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from eskin.cli import main as command_line
from eskin.golden.core.config import PRESETS, AcceleratorConfig
from eskin.golden.core.formats import QFormat
from eskin.golden.model.model import random_integer_model
from eskin.rtl.engine.engine import Engine
from eskin.rtl.engine.sequencer import Sequencer
from eskin.rtl.program.compact_program import Kind, Op
from eskin.rtl.program.memory_map import memory_images
from eskin.rtl.program.microcode import Microcode
from eskin.rtl.program.schedule import schedule
from eskin.rtl.program.scheduler import Schedule
from eskin.rtl.program.timing import logit_to_decision
from eskin.rtl.views import schedule_view as view
from tests.rtl.engine.test_engine import beats, small, windows
from tests.support.stream_bench import Bench
from tests.support.table import each_row

CELLS = [("gru", "before"), ("gru", "after"), ("lstm", "before")]
KINDS = [(1, "plain"), (4, "plain"), (12, "plain"), (40, "plain"), (1, "dsp"), (4, "dsp")]


def reference(cell: str = "gru", reset: str = "before", lanes: int = 4, **changes) -> AcceleratorConfig:
    return PRESETS["thesis"].replace(
        cell=cell, reset=reset, lanes=lanes, state_format=QFormat(4, 12), **changes
    )


def unit(plan: Schedule, name: str) -> list[view.Span]:
    return [span for span in view.spans(plan) if span.unit == name]


# ---------------------------------------------------------------------- spans
@each_row(("lanes", "lane_type"), KINDS)
@each_row("cell", CELLS)
def test_every_operation_is_in_one_span(cell, lanes, lane_type):
    plan = schedule(reference(*cell, lanes, lane_type=lane_type))
    drawn = [
        (
            span.before,
            span.slot + k,
            span.first + k,
            span.rows,
            span.what.split()[0],
            span.what.split()[1].rstrip(","),
        )
        for span in unit(plan, view.LANES)
        for k in range(span.slots)
    ]
    assert all(span.last - span.first + 1 == span.slots for span in unit(plan, view.LANES))
    placed = [
        (
            before,
            base + op.cycle,
            op.index,
            plan.groups[op.group].rows,
            plan.groups[op.group].block.terms[op.term][0],
            op.region,
        )
        for ops, base, before in ((plan.mac_before, 0, True), (plan.mac_after, plan.slots_before, False))
        for op in ops
    ]
    assert drawn == placed

    terms = {op.name: len(op.terms) for op in plan.program.elements}
    drawn, placed = (
        [],
        [
            (plan.slots_before + issue.cycle, issue.op.name, issue.term, issue.index)
            for issue in plan.elements
        ],
    )
    for span in unit(plan, view.ELEMENTS):
        assert span.slots == (span.last - span.first + 1) * terms[span.block]
        for k in range(span.slots):
            index, term = divmod(k, terms[span.block])
            drawn.append((span.slot + k, span.block, term, span.first + index))
    assert drawn == placed

    # every row's sum leaves once, and each unit does one thing at a time
    assert sum(span.slots for span in unit(plan, view.CHAIN)) == sum(group.rows for group in plan.groups)
    assert sum(span.slots for span in unit(plan, view.CLASSIFIER)) == plan.config.classes
    for name in view.UNITS:
        times = [span.slot + k for span in unit(plan, name) for k in range(span.slots)]
        assert len(times) == len(set(times))


@each_row(
    ("cell", "lanes", "lane_type"),
    [
        (CELLS[0], 1, "plain"),
        (CELLS[1], 2, "plain"),
        (CELLS[2], 4, "plain"),
        (CELLS[1], 1, "dsp"),
        (CELLS[0], 3, "dsp"),
    ],
)
def test_later_units_are_drawn_when_the_hardware_does_it(cell, lanes, lane_type, monkeypatch):
    """Features, hidden states and logits of every step leave the engine when they are drawn to; so do rows
    the chain."""
    sequencers: list[Sequencer] = []
    monkeypatch.setattr(
        "eskin.rtl.engine.engine.Sequencer", lambda code: sequencers.append(Sequencer(code)) or sequencers[-1]
    )
    config = small(*cell, lanes, lane_type=lane_type)
    model = random_integer_model(config, seed=3)
    plan = schedule(model.config)
    engine = Engine(model.config, memory_images(model.config, model.arrays))
    bench = Bench(engine, quiet=3000, max_cycles=40_000)
    bench.drive(engine.i, beats(model.config, windows(model.config, touches=1, seed=1)))
    bench.process(lambda ctx: _set(ctx, engine.decider_idle))
    word, enable = sequencers[0].word, sequencers[0].enable
    seen = {
        name: bench.watch(signal)
        for name, signal in (
            ("started", engine.started),
            ("feature", engine.feature.valid),
            ("state", engine.state.valid),
            ("logit", engine.logit.valid),
            ("direct", enable & (word.partial | word.logit | word.t_write & word.value)),
            ("activated", enable & word.activated),
            ("tabled", enable & (word.gate_write | word.t_write & ~word.value)),
        )
    }
    bench.run()
    steps = config.windows.steps
    for name, of, wanted in (
        ("feature", view.STATE, "x"),
        ("state", view.STATE, "h"),
        ("logit", view.CLASSIFIER, "logit"),
    ):
        drawn = [
            span.slot + k - plan.slots_before
            for span in unit(plan, of)
            if span.what == wanted
            for k in range(span.slots)
        ]
        happened = np.array(seen[name]).reshape(steps, -1) - np.array(seen["started"])[:, None]
        assert happened.tolist() == [drawn] * steps, name
    # what is looked up in a slot is written in the next
    seen["table"] = [cycle - 1 for cycle in seen["tabled"]]
    seen["rows"] = sorted([*seen["direct"], *({*seen["table"]} - {*seen["activated"]})])
    for name, of in (("table", view.TABLE), ("rows", view.CHAIN)):
        drawn = [span.slot + k - plan.slots_before for span in unit(plan, of) for k in range(span.slots)]
        drawn = [cycle for cycle in drawn if cycle >= 0]  # phase A's last ones leave in phase B
        for start in seen["started"]:
            happened = [cycle - start for cycle in seen[name] if start <= cycle <= start + max(drawn)]
            assert happened == drawn, name


async def _set(ctx, signal) -> None:
    ctx.set(signal, 1)


# ---------------------------------------------------------------------- figures and text
@each_row(("lanes", "lane_type"), KINDS)
def test_figures_are_the_schedules(lanes, lane_type):
    plan = schedule(reference(lanes=lanes, lane_type=lane_type))
    s = view.summary(plan)
    assert (s["step_cycles"], s["decision_cycles"], s["busy_share"]) == (
        plan.step_cycles,
        plan.decision_cycles,
        plan.busy_share,
    )
    assert s["phase_a_cycles"] == plan.slots_before
    assert s["phase_a_cycles"] + s["decision_cycles"] == s["step_cycles"]
    assert s["ideal_cycles"] == plan.config.step_ideal and s["ratio"] == plan.step_cycles / s["ideal_cycles"]
    busy = sum(span.slots * span.rows for span in unit(plan, view.LANES))
    assert busy / (lanes * plan.step_cycles) == plan.busy_share
    assert s["prologue_cycles"] == Microcode(plan).again
    assert s["element_share"] == sum(span.slots for span in unit(plan, view.ELEMENTS)) / plan.step_cycles


@each_row(("lanes", "lane_type"), [(1, "plain"), (4, "plain"), (1, "serial")])
def test_text_has_every_span_and_the_figures(lanes, lane_type):
    plan = schedule(reference(lanes=lanes, lane_type=lane_type))
    head, _, body = view.text(plan).partition("what\n")
    found = view.spans(plan)
    figures = dict(line.split("   ", maxsplit=1) for line in head.splitlines() if "   " in line)
    shown = {name: value.strip() for name, value in figures.items()}
    assert (
        shown["phase A, before the features"] == f"{plan.slots_before} cycles"
        and shown["step"] == f"{plan.step_cycles} cycles"
    )
    assert (
        shown["ratio"]
        == f"{plan.step_cycles / plan.config.step_ideal / (1 if lane_type == 'plain' else plan.config.weight_bits):.3f}"
    )
    assert shown["lanes busy"].startswith(f"{100 * plan.busy_share:.1f} % of {lanes} x {plan.step_cycles} ")
    rows = [line.split(maxsplit=2) for line in body.splitlines()]
    assert rows.pop()[0] == str(plan.step_cycles)
    assert sorted((cycles, phase) for cycles, phase, _ in rows) == sorted(
        (f"{span.slot}..{span.last_slot}", "A" if span.before else "B") for span in found
    )
    assert max(int(cycles.split("..")[1]) for cycles, _, _ in rows) == plan.step_cycles - logit_to_decision(
        plan.config
    )


# ---------------------------------------------------------------------- one serial lane
@each_row("cell", CELLS)
def test_the_compact_engine_is_shown_when_it_works(cell):
    """Everything that adds or stores is in one span, at its cycle; rows and element-wise operations never
    overlap."""
    plan = schedule(reference(*cell, 1, lane_type="serial"))
    found = view.spans(plan)
    work = [
        span.slot + k for span in found if span.unit in (view.LANES, view.ELEMENTS) for k in range(span.slots)
    ]
    assert len(work) == len(set(work))
    adding = {
        one.cycle + k for one in plan.compact.step if one.instruction.op == Op.MAC for k in range(one.cycles)
    }
    assert adding <= set(work) and len(work) < 1.1 * len(adding)
    stores = [(one.cycle, one.instruction) for one in plan.compact.step if one.instruction.op == Op.STORE]
    tabled = [cycle for cycle, instruction in stores if instruction.kind == Kind.INDEX]
    logits = [cycle for cycle, instruction in stores if instruction.kind == Kind.LOGIT]
    assert [span.slot for span in unit(plan, view.TABLE)] == tabled
    assert [span.slot for span in unit(plan, view.CLASSIFIER)] == logits and len(
        logits
    ) == plan.config.classes
    states = [span.what for span in unit(plan, view.STATE)]
    assert states.count("x") == plan.config.sensor.taxels and states.count("h") == plan.config.network.hidden
    s = view.summary(plan)
    assert (
        (s["step_cycles"], s["decision_cycles"])
        == (plan.step_cycles, plan.decision_cycles)
        == (logits[-1] + 7,) * 2
    )
    assert s["ideal_cycles"] == 8 * plan.config.step_ideal
    assert s["element_share"] * plan.step_cycles == pytest.approx(
        sum(span.slots for span in unit(plan, view.ELEMENTS))
    )
    rows = sum(span.slots for span in unit(plan, view.LANES))
    assert (
        0.9 * rows < s["busy_share"] * plan.step_cycles <= rows
        and plan.weights == s["busy_share"] * plan.step_cycles / 8
    )
    assert f"{plan.step_cycles} cycles" in view.text(plan)
    assert view.timeline(plan).axes


# ---------------------------------------------------------------------- picture
@each_row(
    ("cell", "lanes", "lane_type"), [(CELLS[0], 1, "plain"), (CELLS[1], 4, "plain"), (CELLS[2], 3, "dsp")]
)
def test_picture_shows_every_cycle_of_every_unit(cell, lanes, lane_type):
    plan = schedule(reference(*cell, lanes, lane_type=lane_type))
    figure = view.timeline(plan)
    areas = dict.fromkeys(view.UNITS, 0.0)
    for axes in figure.axes:
        tops = {
            label.get_text(): place
            for place, label in zip(axes.get_yticks(), axes.get_yticklabels(), strict=True)
        }
        named = {
            unit: next((tops[label] - 0.5 for label in tops if label.startswith(unit[:12])), 0.0)
            for unit in view.UNITS
        }
        for bars in axes.collections:
            for path in bars.get_paths():
                (left, top), (right, bottom) = path.vertices.min(axis=0), path.vertices.max(axis=0)
                left_limit, right_limit = axes.get_xlim()
                assert left_limit <= left and right <= right_limit
                areas[max((u for u in view.UNITS if named[u] <= top + 0.01), key=named.get)] += (
                    right - left
                ) * (bottom - top)
    for name in view.UNITS:
        wanted = sum(span.slots * span.rows for span in unit(plan, name))
        assert round(areas[name]) == wanted, name

    limits = [axes.get_xlim() for axes in figure.axes]
    assert limits[0][0] == 0 and all(one[1] == two[0] for one, two in pairwise(limits))
    for place in (plan.slots_before, plan.step_cycles):
        lines = [
            line.get_xdata()[0] for axes in figure.axes for line in axes.lines if line.get_color() == "black"
        ]
        assert lines.count(place) == 1
    legend = [entry.get_text() for entry in figure.legends[0].get_texts()]
    assert legend[:-1] == list(dict.fromkeys(legend[:-1])) and set(legend[:-1]) == {
        span.block for span in view.spans(plan)
    }


SQUAT = {"taxels": 4, "hidden": 32, "reset": "after"}  # little to do with the features: phase B is short


@each_row(
    "config",
    [
        reference(lanes=1),
        reference(lanes=12),
        PRESETS["pvdf"].replace(lanes=2),
        reference(lanes=64, **SQUAT),
        reference(lanes=16, **SQUAT),
        *(
            reference("lstm", lanes=lanes, taxels=4, hidden=hidden)
            for hidden in (4, 9)
            for lanes in (1, 3, 5)
        ),
    ],
)
def test_words_overlap_nothing(config):
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = view.timeline(schedule(config))
    renderer = FigureCanvasAgg(figure).get_renderer()
    figure.draw(renderer)
    boxes = [axes.get_tightbbox(renderer) for axes in figure.axes]
    boxes += [figure.legends[0].get_window_extent(renderer), figure._suptitle.get_window_extent(renderer)]
    assert not [(k, n) for k, one in enumerate(boxes) for n, two in enumerate(boxes[:k]) if one.overlaps(two)]
    for axes in figure.axes:
        above = [words for words in axes.texts if words.get_va() == "bottom"]
        boxes = [words.get_window_extent(renderer) for words in above]
        assert above and all(box.x1 <= axes.get_window_extent(renderer).x1 + 5 for box in boxes)
        assert not [one for k, one in enumerate(boxes) if any(one.overlaps(two) for two in boxes[:k])]


# ---------------------------------------------------------------------- the verb
@pytest.fixture
def call(monkeypatch, capsys, tmp_path):
    """``call("thesis", "--lanes", 4)`` -> (status, standard output, standard error) of ``eskin schedule`` in
    an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def run(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["eskin", "schedule", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            command_line.main()
        shown = capsys.readouterr()
        return end.value.code or 0, shown.out, shown.err

    return run


@each_row(
    ("words", "part"),
    [
        (["nothing"], "nothing"),
        (["thesis", "--lanes", 0], "lanes"),
        (["thesis", "--lanes", 65], "1..64"),
        (["thesis", "--out", "file"], "file"),
        (["thesis", "--complexity", "--out", "file"], "file"),
        (["thesis", "--table", "--lanes", 4], "--lanes"),
        (["thesis", "--table", "--complexity"], "--complexity"),
        (["damaged"], "config.json"),
        (["thesis", "--table", "--out", "file/x"], "file"),
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


def test_table_has_every_row_and_the_schedules_figures(call, monkeypatch):
    """Small sizes beside the reference: the third size of the real table takes seconds."""
    monkeypatch.setattr(view, "TABLE_SIZES", (*view.TABLE_SIZES[:2], (9, 6, 4)))
    status, out, _ = call("fabric", "--table", "--out", "table")
    rows = json.loads(Path("table/ratios.json").read_text())
    keys = [
        (row["cell"], row["reset"], row["taxels"], row["hidden"], row["classes"], row["lanes"])
        for row in rows
    ]
    assert sorted(keys, key=str) == sorted(
        (
            (cell, reset, *size, lanes)
            for cell, reset in (("gru", "before"), ("gru", "after"), ("lstm", None))
            for size in ((16, 12, 3), (8, 8, 5), (9, 6, 4))
            for lanes in (1, 2, 4, 6, 12)
        ),
        key=str,
    )
    for row in rows:
        sizes = {
            "taxels": row["taxels"],
            "hidden": row["hidden"],
            "class_names": tuple(map(str, range(row["classes"]))),
        }
        plan = schedule(reference(row["cell"], row["reset"] or "before", row["lanes"], **sizes))
        assert (row["step_cycles"], row["ideal_cycles"], row["busy_share"]) == (
            plan.step_cycles,
            plan.config.step_ideal,
            plan.busy_share,
        )
        assert (
            row["decision_cycles"] == plan.decision_cycles
            and row["ratio"] == plan.step_cycles / plan.config.step_ideal
        )
    lines = Path("table/ratios.md").read_text().splitlines()
    assert [tuple(line.strip("| ").split(" | ")) for line in lines[2:47]] == [
        view.ratio_cells(row) for row in rows
    ]
    with Path("table/ratios.csv").open() as file:
        assert [int(row["step_cycles"]) for row in csv.DictReader(file)] == [
            row["step_cycles"] for row in rows
        ]
    shown = [
        [cell.strip() for cell in line.strip("│").split("│")]
        for line in out.splitlines()
        if line.startswith("│")
    ]
    assert status == 0 and [tuple(line) for line in shown] == [view.ratio_cells(row) for row in rows]
    assert sorted(path.name for path in Path("table").iterdir()) == ["ratios.csv", "ratios.json", "ratios.md"]


def test_table_alone_writes_nothing(call, monkeypatch):
    monkeypatch.setattr(view, "TABLE_SIZES", ((4, 4, 2),))
    assert call("thesis", "--table")[0] == 0 and not list(Path().iterdir())


def test_sizes_of_the_table():
    assert view.TABLE_SIZES == ((16, 12, 3), (8, 8, 5), (64, 32, 32)) and view.TABLE_LANES == (1, 2, 4, 6, 12)
