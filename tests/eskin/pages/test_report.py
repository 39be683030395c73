"""The report: every figure comes from the files, the page stands alone, a damaged result is one sentence."""

import base64
import json
import os
import re
import shutil
from html.parser import HTMLParser
from typing import Any

import pytest

from eskin.choose.candidate import front_end_of
from eskin.pages.report import AXES, draw_candidates, draw_lanes, fewer_scans, summary, write_report
from eskin.pages.result import OnLanes
from eskin.pages.views import count, hertz, percent, seconds, tables
from eskin.training.record import CandidateRow, FrontEndRow, FrontEndRows
from tests.support.result_case import CONFIG, FROZEN, STAGE_COUNTS, but, edit, make_result, some
from tests.support.table import each_row, refused

SPACE = "\u202f"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return make_result(tmp_path_factory.mktemp("made") / "result")


@pytest.fixture(scope="module")
def words_before(made):
    return Page(write_report(made)).text


@pytest.fixture
def copied(made, tmp_path):
    """A copy of the made-up result that a test may damage."""
    return shutil.copytree(made, tmp_path / "result")


@pytest.fixture
def result(copied, monkeypatch):
    """The same for tests that read words: no chart is rendered."""
    monkeypatch.setattr("eskin.pages.report.svg", lambda figure: "data:,")
    return copied


class Page(HTMLParser):
    """Text, and every address of a page."""

    def __init__(self, path) -> None:
        super().__init__()
        self.text, self.addresses, self.tags = "", [], set()
        self.feed(path.read_text())

    def handle_starttag(self, tag, attributes):
        self.tags.add(tag)
        self.addresses += [
            value for name, value in attributes if name in ("src", "href", "data", "srcset", "action")
        ]

    def handle_data(self, data):
        self.text += data.replace("\u00a0", " ") + " "


def plain(text: str) -> str:
    """One blank between words; the narrow blanks inside numbers stay."""
    return re.sub(r"[ \n]+", " ", text)


def test_the_page_holds_the_figures_of_the_files(result):
    page = Page(write_report(result))
    words = plain(page.text)
    for figure in (
        "unseen person 3 96.4 % ± 2.3 % 97.3 % 99.13 %",
        "unseen recording 3 88.8 % ± 2.3 % 97.3 %",
        "GW1NR-9C (tangnano9k) unknown unknown unknown",
        "98.4 %",
        "98.6 %",
        "99.54 %",
        "no onset was found in 2 of them",  # evaluate
        "711 kHz",
        "12 MHz",
        "8.08 µs",
        "6.08 µs",
        "8.00 ms",  # 97 and 73 cycles at 12 MHz; the limit
        f"123{SPACE}456",
        f"82{SPACE}304",
        "abc123",
        "made for a test",
        "9.8.7",
        "12.3 s",
        "made-up <set>",
        "rough<b>",
        "person 0",
    ):
        assert figure in words, figure
    for stage, values in STAGE_COUNTS.items():
        assert f" {stage} {count(values)} 0 " in words, stage
    assert "All 1 checks held: hardware and model agree. There is no doubt" in words and "bit-exact" in words
    assert f"{97 / CONFIG.step_ideal:.3f}".rstrip("0") in words


def test_the_banner_is_green_only_without_a_doubt(result):
    def verdicts(**changes):
        edit(result / "run.json", **changes)
        page = write_report(result).read_text()
        return {kind for kind in ("good", "warn", "bad") if f'class="verdict {kind}"' in page}, page

    assert verdicts()[0] == {"good"}
    kinds, page = verdicts(warnings=["a class is lost"])
    assert kinds == {"warn"} and "a class is lost" in page
    kinds, page = verdicts(checks=[{"name": "one", "held": False, "detail": "why"}])
    assert kinds == {"bad", "warn"} and "1 of 1 checks failed" in page
    assert "hardware and model agree" not in page


GATES = [{"mode": "slow ramp", "figure": 0.0, "bound": 0.0, "held": True}]


def under_stress(held: bool) -> dict[str, Any]:
    """Of run.json: a candidate that was chosen, and what clean accuracy alone would choose, under two modes; and
    figures that the choice has not seen."""
    modes = [{"mode": "spikes", "figure": 0.99 if held else 0.5, "bound": 0.45, "held": held}]
    row = FROZEN["run"]["candidates"][0] | dict(
        cell="gru", hidden=4, recipe="onset", accuracy=0.97, standard_error=0.01, float_accuracy=0.97, score=0.9,
        stressed_accuracy=0.83, stress=modes, gate_modes=GATES, fits=None, decision_time_s=0.5, energy_touch_j=1e-6,
        average_w=1e-6, cells=900, latency_s=4e-6, front_end=front_end_of(CONFIG).plain(), front_end_words="made",
    )  # fmt: skip
    figures = [modes[0] | {"figure": modes[0]["figure"] - 0.1}]
    return dict(
        candidates=[row | {"chosen": taken, "calm": not taken} for taken in (True, False)], stress=figures,
        gate_modes=GATES, stressed_accuracy=0.71, undisturbed_accuracy=0.93, stress_held=int(held), stress_modes=1,
    )  # fmt: skip


def candidates() -> list[CandidateRow]:
    """The rows of `under_stress`."""
    return [CandidateRow(**row) for row in under_stress(True)["candidates"]]


def test_the_chart_shows_the_cheapest_tied_front_end_of_each_scan_every():
    def row(every, accuracy, energy, level):
        return some(FrontEndRow, scan_every=every, accuracy=accuracy, energy_touch_j=energy, level=level)

    best, cheaper, poor = row(1, 0.99, 4e-6, True), row(1, 0.98, 2e-6, True), row(1, 0.9, 1e-6, False)
    less, least = row(8, 0.97, 2e-7, False), row(8, 0.95, 1e-7, False)
    front_end = some(FrontEndRows, chosen=cheaper, rivals=[best, poor, least, less])
    assert fewer_scans(front_end) == [cheaper, less]
    rows = candidates()
    rows[-1] = but(rows[-1], accuracy=0.4, stress=[])  # not judged under disturbance
    axes = draw_candidates(rows, front_end, [0.71, 0.3]).axes[0]
    assert {"1/1", "1/8"} <= {text.get_text() for text in axes.texts} and 0.3 < axes.get_ylim()[0] < 0.4
    # the line of the chosen one ends at the figures as they are, none turned round
    assert [0.71, 0.3] in [[*line.get_ydata()] for line in axes.lines if len(line.get_ydata()) == 2]


LANES = [OnLanes(lanes=lanes, latency_s=1e-4 / lanes, cells=600 + 35 * lanes) for lanes in (1, 2, 4)]


def test_accuracy_is_drawn_against_each_cost_and_cells_against_the_time_of_each_number_of_lanes():
    rows = candidates()
    for cost, place in (("energy_touch_j", 1.0), ("latency_s", 4.0), ("cells", 900)):
        (axes,) = draw_candidates(rows, cost=cost).axes
        (name,) = (text for text in axes.texts if text.get_text().startswith("chosen: GRU 4"))
        assert name.xy == (place, 0.97) and axes.get_xlabel().startswith(AXES[cost][0])
    (axes,) = draw_candidates([but(row, standard_error=2.0) for row in rows]).axes
    assert axes.get_ylim() == (-0.05, 1.03)  # no accuracy lies beyond, whatever its error
    labels = map(axes.yaxis.get_major_formatter(), (-0.02, 0, 1, 1.02))
    assert [*labels] == ["", "0.0%", "100.0%", ""]
    (axes,) = draw_lanes(LANES, 2).axes
    line, filled = axes.lines
    assert line.get_xydata().tolist() == [[pytest.approx(1e6 * row.latency_s), row.cells] for row in LANES]
    assert filled.get_xydata().tolist() == [[pytest.approx(50.0), 670]]
    assert [text.get_text() for text in axes.texts] == ["1", "2", "4"]


@pytest.mark.parametrize("held", [True, False])
def test_the_verdict_counts_the_disturbances_that_it_held(result, held):
    edit(result / "run.json", **under_stress(held))
    words = plain(Page(write_report(result)).text)
    assert f"The network withstands {int(held)} of 1 disturbances" in words
    assert (
        "accuracy, under disturbance 71.0 % mean over 1 disturbances, recordings and disturbances that the"
        in words
    )
    assert "accuracy on the same recordings without a disturbance, 93.0 %" in words
    # unseen, bound, and both networks on the folds of the choice
    figures = "89.0 % 45.0 % held 99.0 % 99.0 %" if held else "40.0 % 45.0 % beyond 50.0 % 50.0 %"
    assert f"spikes {figures}" in words and "slow ramp: false onsets 0.0 % 0.0 % held" in words
    assert f"modes held {1 + held} of 2 The weakest is" in words
    for more, green in ((4, True), (5, held)):  # up to five beyond their bounds are green
        record = under_stress(held)
        for rows in (record["stress"], *(row["stress"] for row in record["candidates"])):
            rows += [rows[0] | {"mode": f"more {number}"} for number in range(more)]
        edit(result / "run.json", **record)
        page = write_report(result).read_text()
        assert ('class="verdict good"' in page) is ("checks held" in page) is green
    edit(result / "run.json", **under_stress(held))
    write_report(result)
    assert f"it withstands {int(held)} of 1 disturbances (93.0 % without), its gate 1 of 1" in plain(
        summary(result).replace("\u00a0", " ")
    )
    sentence = "Every figure is within its bound." if held else "No candidate does better in this mode."
    assert sentence in words and sentence in summary(result)


def test_the_weakest_disturbance_names_the_candidate_that_does_better_and_its_cost(result):
    record = under_stress(False)
    row = record["candidates"][1]
    better = [row["stress"][0] | {"figure": 0.8}]
    row |= dict(hidden=8, stress=better, energy_touch_j=1.5e-6, cells=950, accuracy=0.98)
    edit(result / "run.json", **record)
    words = plain(Page(write_report(result)).text)
    assert (
        "The weakest is 'spikes': 40.0 %, bound 45.0 %. On the folds of the choice it is 50.0 %, and 80.0 % with the best "
        "candidate: GRU 8" in words
    )
    assert (
        "it needs +0.50 uJ a touch, +0.00 uW on average and +50 logic cells" in words
        and "differs by +1.0 points" in words
    )


def test_where_something_was_chosen_the_figure_is_that_of_folds_that_chose_nothing(result):
    training = json.loads((result / "model/training.json").read_text())
    nested = dict(
        groups=["person"], folds=3, seeds=[0], integer_accuracy=0.8712, float_accuracy=0.8823, agreement=0.99,
        standard_error=0.0345, wall_s=12.0, per_fold=[], range=[0.701, 0.99], range_of="3 folds", disturbed={},
    )  # fmt: skip
    first, *others = training["cross_validation"]
    known = {"integer_accuracy": 0.975, "float_accuracy": 0.98, "folds": 5}
    splits = [first | {"nested": nested}, *others]
    edit(result / "model/training.json", cross_validation=splits, same_groups=known)
    words = plain(Page(write_report(result)).text)
    for figure in (
        "accuracy, unseen person 87.1 %",
        "unseen person 3 87.1 % ± 3.5 % 70.1 % 99.0 % 88.2 % 99.00 %",
        "expect this for a new person; 3 folds, each from 70.1 % to 99.0 %; integer",
        "lowest and highest are of 3 folds, and single new ones differ",
        "single recordings left out 97.5 % expect this for new recordings of a person that is in",
        "person left out 3 96.4 %",
        "the chosen network on the folds that chose it: 96.4 %",
    ):
        assert figure in words, figure
    assert "unseen person 3 96.4 %" not in words
    assert "nested cross-validation" in summary(result) and "unseen person" in summary(result)


def test_candidates_that_would_look_alike_are_told_apart_and_a_loss_has_its_reason(result):
    record = under_stress(True)
    first, second = record["candidates"]
    first["front_end_words"], second["front_end_words"] = "made, clip at 36 codes", "made, 2 of 2 checks"
    second["float_accuracy"] = 0.995
    first["gate_modes"] = []  # it has no gate, so what gates of other folds did is not shown
    edit(result / "run.json", **record)
    text = summary(result)
    assert "spikes" in text and "slow ramp" not in text
    (table,) = (part for part in tables(text) if part.title.startswith("candidates"))
    assert [cells[1].partition(", ")[2] for cells in table.cells] == ["clip at 36 codes", "2 of 2 checks"]
    for words in (text, Page(write_report(result)).text):
        assert re.search("integers of GRU 4, .*2 of 2 checks, lose 2.5 points: it has 99.5", plain(words))


@each_row(
    "file, change, expected",
    [
        ("cosim.json", {"verdict": "differs", "mismatches": 31}, "DIFFERS"),
        (
            "cosim.json",
            {"bit_exact": False, "verdict": "gave up", "gave_up": {"recording": 7, "frame": 3}},
            "at recording 7, frame 3, so the bench ended the run",
        ),
        ("cosim.json", {"verdict": "no decision"}, "the network was not compared"),
    ],
)
def test_a_changed_file_changes_the_page(words_before, result, file, change, expected):
    assert expected not in words_before
    edit(result / file, **change)
    assert expected in Page(write_report(result)).text


def test_the_page_stands_alone_and_is_the_same_when_made_again(copied):
    edit(copied / "run.json", **under_stress(True), lanes=[row.plain() for row in LANES])
    path = write_report(copied)
    first = path.read_bytes()
    assert write_report(copied).read_bytes() == first
    page = Page(path)
    assert len([a for a in page.addresses if a.startswith("data:image/svg+xml;base64,")]) == 5
    assert not [a for a in page.addresses if not a.startswith(("data:", "#"))]
    assert "script" not in page.tags and "link" not in page.tags
    assert not re.search(r"url\(|@import", path.read_text())
    for address in (a for a in page.addresses if a.startswith("data:")):
        image = base64.b64decode(address.partition(",")[2]).decode()
        assert image.rstrip().endswith("</svg>")
        assert not re.search(r'href="(?!#|data:)', image)
    assert path.stat().st_size < 3_000_000


@each_row(
    "name, field",
    [
        ("cosim.json", "stages"),
        ("cosim_declared.json", "budgets"),
        ("run.json", "timings"),
        ("model/training.json", "cross_validation"),
    ],
)
def test_a_missing_field_is_named(result, name, field):
    whole = (result / name).read_bytes()
    edit(result / name, **{field: None})
    with refused(rf"{name}, field {field}: field required"):
        write_report(result)
    (result / name).write_bytes(whole)


def test_a_pipe_in_the_place_of_a_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "run.json")
    with refused("not a regular file"):
        write_report(tmp_path)


@each_row(
    "shown, text",
    [
        (percent(1.0), "100.0 %"),
        (percent(0.99999), "99.9 %"),
        (percent(1e-5), "below 0.1 %"),
        (percent(0.98765, 2), "98.77 %"),
        (seconds(1.98e-5), "19.8 µs"),
        (seconds(0), "0 s"),
        (seconds(-2e-3), "-2.00 ms"),
        (seconds(129.4), "129 s"),
        (hertz(711000), "711 kHz"),
        (hertz(12e6), "12 MHz"),
        (count(1234567), f"1{SPACE}234{SPACE}567"),
    ],
)
def test_figures_in_words(shown, text):
    assert shown.replace("\u00a0", " ") == text
