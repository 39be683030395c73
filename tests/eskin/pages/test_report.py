"""The report: every figure comes from the files, the page stands alone, a damaged result is one sentence."""

import base64
import io
import itertools
import json
import re
import shutil
from html.parser import HTMLParser

import numpy as np
import pytest

from eskin.golden.core import InputError, write_json
from eskin.pages import report
from eskin.pages.report import (
    Result,
    draw_candidates,
    draw_confusion,
    draw_step_accuracy,
    draw_trace,
    draw_training,
    summary,
    write_report,
)
from eskin.pages.views import count, hertz, percent, seconds
from tests.support.result_case import CONFIG, STAGE_COUNTS, cosimulation, edit, evaluation, make_result
from tests.support.table import each_row

SPACE = "\u202f"


@pytest.fixture(autouse=True)
def charts_without_ink(request, monkeypatch):
    """A chart takes half a second to write, and one test looks at what is written; others at what is drawn."""
    if request.node.name != "test_the_page_stands_alone_and_is_the_same_when_made_again":
        monkeypatch.setattr(report, "svg", lambda figure: "data:image/svg+xml;base64,")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return make_result(tmp_path_factory.mktemp("made") / "result")


@pytest.fixture(scope="module")
def words_before(made):
    return Page(write_report(made)).text


@pytest.fixture
def result(made, tmp_path):
    """A copy of the made-up result that a test may damage."""
    return shutil.copytree(made, tmp_path / "result")


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


def table_row(page: Page, first: str) -> str:
    """The words that follow a row's first cell."""
    words = plain(page.text)
    return words[words.index(first) + len(first) :][:120]


def judged(cell: str, hidden: int, accuracy: float, energy_j: float, **changes) -> dict:
    front_end = {"steps": 6, "window": 32, "hop": 16, "feature_kinds": ["mean"]}
    row = {"cell": cell, "hidden": hidden, "recipe": "linear", "accuracy": accuracy, "standard_error": 0.01}
    row |= {
        "float_accuracy": accuracy,
        "energy_touch_j": energy_j,
        "cells": 900,
        "block_memories": 12,
        "latency_s": 2e-6,
    }
    row |= {"fits": "icebreaker", "decision_time_s": 0.25, "front_end": front_end, "chosen": False}
    return row | changes


def test_candidates_stand_against_their_cost_on_the_first_screen(result):
    rows = [
        judged("linear", 0, 0.90, 1e-6, float_accuracy=0.977),
        judged("gru", 4, 0.96, 2e-6, chosen=True),
        judged("gru", 8, 0.95, 3e-6, fits=None, decision_time_s=None),
    ]
    figure = draw_candidates(rows)
    energy, time = figure.axes
    assert [text.get_text() for text in energy.texts] == ["GRU 4, mean: taken", "linear, mean"]
    assert [text.get_text() for text in time.texts] == ["GRU 4, mean: taken"]
    faces = {
        line.get_xdata()[0]: line.get_markerfacecolor() for line in energy.lines if line.get_marker() == "o"
    }
    assert [x for x, face in faces.items() if face == "white"] == pytest.approx([3.0])
    assert energy.get_xlabel() == "energy of a touch (µJ)" and "fits the icebreaker" in energy.get_title()
    edit(result / "run.json", candidates=rows)
    page = Page(write_report(result))
    text = plain(page.text)
    assert text.index("Accuracy against cost") < text.index("decided on folds integer")
    assert table_row(page, "GRU 4 6 windows of 32 every 16, mean").startswith(" 96.0 %")
    printed = summary(result)
    assert "candidates, integer, cross-validated" in printed
    for words in (text, " ".join(printed.split())):
        assert "97.7" in words
    older = [{"cell": "linear", "hidden": 0, "accuracy": 0.9}]  # before cost was asked for
    edit(result / "run.json", candidates=older)
    assert "Accuracy against cost" not in Page(write_report(result)).text


def test_names_of_candidates_cover_no_point_and_no_other_name():
    scene = [(0.842, 1.2), (0.954, 1.9), (0.975, 2.0), (0.984, 2.2), (0.977, 2.5)]
    rows = [judged("gru", 4 * k, share, 1e-6 * cost, chosen=k == 3) for k, (share, cost) in enumerate(scene)]
    rows[1]["decision_time_s"] = float(np.nextafter(0.25, 1))
    for axes, cost in zip(draw_candidates(rows).axes, ("energy_touch_j", "decision_time_s"), strict=True):
        low, high = axes.get_xlim()
        assert high / low > 1.1  # and no scale of last bits
        names = [text.get_window_extent() for text in axes.texts]
        factor = 1e6 if cost == "energy_touch_j" else 1
        points = axes.transData.transform([(factor * row[cost], row["accuracy"]) for row in rows])
        assert names and not any(name.contains(*point) for name in names for point in points)
        assert not any(a.overlaps(b) for a, b in itertools.combinations(names, 2))
    # one that lies behind the taken one has no name there
    rows = [judged("gru", 8, 0.9753, 1.2e-6, chosen=True), judged("gru", 12, 0.9772, 1.6e-6)]
    rows.append(judged("linear", 0, 0.72, 6e-7))
    named = [[text.get_text().split(",")[0] for text in axes.texts] for axes in draw_candidates(rows).axes]
    assert named == [["GRU 8", "GRU 12", "linear"], ["GRU 8"]]


def test_the_training_curve_is_drawn_of_trained_networks_only(result):
    curve = {"updates": [10, 20], "training_loss": [1.5, 0.5], "held_out_loss": [1.25, 0.75]}
    split, *others = json.loads((result / "model/training.json").read_text())["cross_validation"]
    assert draw_training([split]) is None
    assert "has no training curve" in Page(write_report(result)).text
    (axes,) = draw_training([split | {"training_curve": curve}, split]).axes
    assert [list(line.get_ydata()) for line in axes.lines] == [
        [1.5, 0.5],
        [1.25, 0.75],
    ] and axes.get_xlabel() == "updates of the weights"
    edit(result / "model/training.json", cross_validation=[split | {"training_curve": curve}, *others])
    words = Page(write_report(result)).text
    assert "has no training curve" not in words and "learns its recordings by heart" in words


def test_the_page_holds_the_figures_of_the_files(result):
    page = Page(write_report(result))
    words = plain(page.text)
    for figure in (
        "unseen person 3 96.4 % ± 2.3 % 97.3 % ± 1.2 % 99.13 %",
        "unseen recording 3 88.8 % ± 2.3 % 97.3 %",
        "98.4 %",
        "98.6 %",
        "99.54 %",
        "2 of them show no onset",  # evaluate
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
    assert "All 1 checks held, and no doubt" in words and "bit-exact" in words
    assert f"{97 / CONFIG.step_ideal:.3f}".rstrip("0") in words


def test_the_banner_is_green_only_without_a_doubt(result):
    page = write_report(result).read_text()
    assert 'class="verdict good"' in page and 'class="verdict warn"' not in page
    edit(result / "run.json", warnings=["a class is lost"])
    page = write_report(result).read_text()
    assert 'class="verdict good"' not in page and 'class="verdict warn"' in page and "a class is lost" in page
    edit(result / "run.json", checks=[{"name": "one", "held": False, "detail": "why"}])
    page = write_report(result).read_text()
    assert (
        'class="verdict bad"' in page
        and 'class="verdict warn"' in page
        and "hardware and model agree" not in page
    )


def test_chance_and_the_best_baseline_stand_beside_the_accuracy(result):
    assert "chance 50.0 %; integer network" in plain(Page(write_report(result)).text)
    rows = [
        {
            "name": name,
            "groups": groups,
            "accuracy": accuracy,
            "standard_error": 0.01,
            "multiplies": 77,
            "hardware": hardware,
        }
        for name, groups, accuracy, hardware in (
            ("linear classifier", ["person"], 0.91, True),
            ("RBF-SVM", ["person"], 0.93, False),
            ("linear classifier", [], 0.99, True),
        )
    ]
    edit(result / "run.json", baselines=rows)
    page = Page(write_report(result))
    assert "chance 50.0 %; best baseline 93.0 % (RBF-SVM); integer network" in plain(page.text)
    assert table_row(page, "RBF-SVM 93.0 %").startswith(" ± 1.0 % 77 no")
    assert "Leaving out recordings: linear classifier 99.0 %" in plain(page.text)


def test_where_something_was_chosen_the_figure_is_that_of_folds_that_chose_nothing(result):
    training = json.loads((result / "model/training.json").read_text())
    nested = {
        "groups": ["person"],
        "folds": 3,
        "seeds": [0],
        "integer_accuracy": 0.8712,
        "float_accuracy": 0.8823,
        "agreement": 0.99,
    }
    nested |= {"standard_error": 0.0345, "wall_s": 12.0}
    first, *others = training["cross_validation"]
    edit(result / "model/training.json", cross_validation=[first | {"nested": nested}, *others])
    words = plain(Page(write_report(result)).text)
    assert (
        "accuracy, unseen person 87.1 %" in words and "unseen person 3 87.1 % ± 3.5 % 88.2 % 99.00 %" in words
    )
    assert "person left out 3 96.4 %" in words and "unseen person 3 96.4 %" not in words
    assert "the network taken, on the folds it was chosen on, 96.4 %" in words
    out = io.StringIO()
    out.write(summary(result))
    assert "chosen anew without each fold" in out.getvalue() and "unseen person" in out.getvalue()


def test_recordings_held_back_stand_apart(result):
    row = {"recordings": 20, "integer_accuracy": 0.8, "float_accuracy": 0.9}
    held = evaluation(44) | {"source": "held.npz", "per_class": {"smooth": row}}
    edit(result / "run.json", test=held | {"integer_accuracy": 0.8123})
    words = plain(Page(write_report(result)).text)
    assert (
        "accuracy, recordings held back 81.2 % integer network, judged once on 44" in words
        and "smooth 20 80.0 % 90.0 %" in words
    )


def test_class_by_class_the_worst_first(result):
    words = plain(Page(write_report(result)).text)
    assert "class found mostly taken for rough<b> 83.3 % none 16.7 % smooth 94.4 % rough<b> 5.6 %" in words


def test_many_classes_are_drawn_without_figures():
    split = {"groups": [], "confusion": np.eye(30, 31, dtype=int).tolist()}
    figure = draw_confusion([split], [f"class {n}" for n in range(30)])
    assert not figure.axes[0].texts and figure.get_size_inches()[1] < 7
    figure = draw_confusion(
        [{"groups": [], "confusion": np.eye(12, 13, dtype=int).tolist()}], [f"class {n}" for n in range(12)]
    )
    assert len(figure.axes[0].texts) == 12


@each_row(
    ("file", "change", "expected"),
    [
        ("cosim.json", {"bit_exact": False, "mismatches": 31}, "DIFFERS"),
        (
            "cosim.json",
            {"bit_exact": False, "verdict": "gave up", "gave_up": {"recording": 7, "frame": 3}},
            "at recording 7, frame 3, so the bench stopped",
        ),
        ("cosim.json", {"verdict": "no decision"}, "nothing of the network was compared"),
        ("cosim.json", {"compared_values": 987654}, f"987{SPACE}654 values"),
        ("cosim_declared.json", {"clock_hz": 6e6}, "12.2 µs"),
        ("cosim_lowest.json", {"clock_hz": 1.25e6}, "1.25 MHz"),
        ("evaluate.json", {"integer_accuracy": 0.4321}, "43.2 %"),
        (
            "run.json",
            {"checks": [{"name": "one", "held": False, "detail": "why it fell"}]},
            "1 of 1 checks did not hold",
        ),
    ],
)
def test_a_changed_file_changes_the_page(words_before, result, file, change, expected):
    assert expected not in words_before
    edit(result / file, **change)
    assert expected in Page(write_report(result)).text


def test_mismatches_and_missed_budgets_are_shown(result):
    write_json(result / "cosim.json", cosimulation(10, mismatches=2) | {"waves": "waves_cosim"})
    write_json(result / "cosim_declared.json", cosimulation(2, pace="declared", missed="decision"))
    page = Page(write_report(result))
    assert "recording 3, stage state: number 1" in page.text and "waves_cosim" in page.text
    assert "missed" in table_row(page, " decision 8.00 ms") and "met" in table_row(page, " step 8.00 ms")
    assert "for comparison" in table_row(page, "reference: LSTM on a GPU")
    assert f" state {count(STAGE_COUNTS['state'])} 2 " in plain(page.text)


def test_no_lowest_clock_is_said(result):
    edit(result / "run.json", lowest_clock_hz=None)
    path = result / "run.json"
    write_json(path, json.loads(path.read_text()) | {"lowest_clock_hz": None})
    (result / "cosim_lowest.json").unlink()
    assert "not found" in Page(write_report(result)).text


def test_the_page_stands_alone_and_is_the_same_when_made_again(made):
    path = write_report(made)
    first = path.read_bytes()
    assert write_report(made).read_bytes() == first
    page = Page(path)
    assert len([a for a in page.addresses if a.startswith("data:image/svg+xml;base64,")]) == 3
    assert not [a for a in page.addresses if not a.startswith("data:")]
    assert "script" not in page.tags and "link" not in page.tags
    assert not re.search(r"url\(|@import", path.read_text())
    for address in page.addresses:
        image = base64.b64decode(address.partition(",")[2]).decode()
        assert image.rstrip().endswith("</svg>")
        assert not re.search(r'href="(?!#|data:)', image)
    assert path.stat().st_size < 3_000_000


def test_the_summary_has_the_headline(made):
    out = io.StringIO()
    out.write(summary(made))
    shown = out.getvalue().replace("\u00a0", " ")
    for words in (
        "made-up <set>",
        "bit-exact",
        "96.4 %",
        "711 kHz",
        "met",
        "for comparison",
        "held   hardware equals model",
    ):
        assert words in shown, words
    assert "MISSED" not in shown and "FAILED" not in shown


@each_row(
    "name",
    [
        "run.json",
        "evaluate.json",
        "cosim.json",
        "cosim_declared.json",
        "cosim_lowest.json",
        "model/training.json",
        "model/config.json",
        "trace.npz",
    ],
)
@each_row("damage", ["missing", "cut", "empty"])
def test_a_missing_or_damaged_file_is_named(result, name, damage):
    (result / "report.html").write_text("the page before")
    path, whole = result / name, (result / name).read_bytes()
    if damage == "missing":
        path.unlink()
    else:
        path.write_bytes(whole[:100] if damage == "cut" else b"")
    with pytest.raises(InputError) as caught:
        write_report(result)
    assert path.name in str(caught.value) and "\n" not in str(caught.value)
    assert (result / "report.html").read_text() == "the page before"
    path.write_bytes(whole)


@each_row(
    ("name", "field"),
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
    with pytest.raises(InputError, match=field) as caught:
        write_report(result)
    assert (result / name).name in str(caught.value)
    (result / name).write_bytes(whole)


def test_a_trace_without_an_array_is_named(result):
    with np.load(result / "trace.npz") as archive:
        arrays = {name: archive[name] for name in archive.files if name != "logits"}
    np.savez(result / "trace.npz", **arrays)
    with pytest.raises(InputError, match=r"trace\.npz.*logits"):
        write_report(result)


def test_no_folder_is_one_sentence(tmp_path):
    with pytest.raises(InputError, match="is no folder"):
        write_report(tmp_path / "nothing")


def test_the_drawing_shows_the_codes_of_the_trace(made):
    result = Result.load(made)
    figure = draw_trace(result.trace, CONFIG)
    raw, features, hidden, logits, decisions = figure.axes[:5]
    done = int(result.trace["completed"])
    assert (
        len([line for line in raw.lines if len(line.get_xdata()) == len(result.trace["samples"])])
        == CONFIG.sensor.taxels
    )
    np.testing.assert_array_equal(
        features.images[0].get_array(),
        result.trace["features"][:done].T / 2.0**CONFIG.formats.feature_format.frac_bits,
    )
    np.testing.assert_array_equal(
        hidden.images[0].get_array(),
        result.trace["hidden"][:done].T / 2.0**CONFIG.formats.state_format.frac_bits,
    )
    for index, line in enumerate(logits.lines):
        np.testing.assert_array_equal(
            line.get_ydata(),
            result.trace["logits"][:done, index] / 2.0**CONFIG.formats.logit_format.frac_bits,
        )
    heights = [bar.get_height() for bars in decisions.containers for bar in bars]
    np.testing.assert_allclose(
        sorted(heights), sorted(result.trace["margin"][:done] / 2.0**CONFIG.formats.logit_format.frac_bits)
    )
    assert CONFIG.network.class_names[int(result.trace["global_decision"])] in decisions.get_title()


@each_row("rate", [49.0, 3000.0])  # 49 * (1 / 49) is below 1
def test_a_partial_touch_from_frame_1_is_drawn(made, rate):
    at_once = {"start_frame": 1, "onset_frame": 0, "completed": 1, "partial": True}
    trace = Result.load(made).trace | {name: np.array(value) for name, value in at_once.items()}
    figure = draw_trace(trace, CONFIG.replace(sample_rate_hz=rate))
    assert figure.axes[0].get_xlim()[0] == pytest.approx(1 / rate)
    assert "ended early" in figure.axes[4].get_title()
    assert len([bar for bars in figure.axes[4].containers for bar in bars]) == 1


def test_accuracy_against_time_is_float_and_integer(made):
    split = Result.load(made).training["cross_validation"][0]
    ideal, integer = draw_step_accuracy([split], False).axes[0].lines
    for line, key in ((ideal, "float_accuracy"), (integer, "integer_accuracy")):
        np.testing.assert_array_equal(line.get_ydata(), [step[key] for step in split["per_step"]])
        np.testing.assert_array_equal(line.get_xdata(), [step["time_s"] for step in split["per_step"]])


@each_row(
    ("shown", "text"),
    [
        (percent(1.0), "100.0 %"),
        (percent(0.99999), "99.9 %"),
        (percent(0), "0.0 %"),
        (percent(1e-5), "below 0.1 %"),
        (percent(0.5), "50.0 %"),
        (percent(0.98765, 2), "98.77 %"),
        (seconds(1.98e-5), "19.8 µs"),
        (seconds(0.35), "350 ms"),
        (seconds(0), "0 s"),
        (seconds(83.4e-9), "83.4 ns"),
        (seconds(-2e-3), "-2.00 ms"),
        (seconds(129.4), "129 s"),
        (hertz(711000), "711 kHz"),
        (hertz(35.6), "35.6 Hz"),
        (hertz(12e6), "12 MHz"),
        (count(1234567), f"1{SPACE}234{SPACE}567"),
    ],
)
def test_figures_in_words(shown, text):
    assert shown.replace("\u00a0", " ") == text


@pytest.mark.parametrize(
    ("source", "name", "title"),
    [
        ("gloves/recordings.npz", None, "gloves"),
        ("gloves/left.csv", None, "left"),
        ("gloves/left.csv", "My glove", "My glove"),
    ],
)
def test_the_title_is_the_name_given_or_that_of_the_folder(result, source, name, title):
    path = result / "run.json"
    run = json.loads(path.read_text())
    path.write_text(json.dumps(run | {"name": name, "data": run["data"] | {"source": source}}))
    page = Page(write_report(result)).text
    assert f"{title}: " in page and f"eskin: {title}" in page
    for jargon in ("time since arm", "declared pace", "yardstick", "as recorded"):
        assert jargon not in page


def test_events_are_a_raster_units_are_the_archives_and_kinds_have_names(made):
    result = Result.load(made)
    trace = dict(result.trace)
    raw = draw_trace(trace, result.config, "pF").axes[0]
    assert raw.get_ylabel() == "pF from rest" and len(raw.lines) > CONFIG.sensor.taxels
    assert draw_trace(trace, result.config).axes[0].get_ylabel() == "mV from rest"
    trace["samples"] = np.zeros_like(trace["samples"])
    trace["samples"][5, 2] = 1
    raw = draw_trace(trace, result.config).axes[0]
    (dots,) = (line for line in raw.lines if line.get_marker() == "|")
    assert dots.get_ydata().tolist() == [2] and raw.get_ylabel() == "taxel"
    both = result.config.replace(feature_kinds=("mean", "activity"), feature_shift=())
    trace["features"] = np.repeat(trace["features"], 2, axis=1)
    trace["features"][:, 1::2] = 7
    panel = draw_trace(trace, both).axes[1]
    assert [label.get_text() for label in panel.get_yticklabels()] == ["mean", "activity"]
    shown = panel.images[0].get_array()
    assert (shown[CONFIG.sensor.taxels :] == both.formats.feature_format.to_real(7)).all()
