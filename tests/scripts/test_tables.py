"""scripts/tables.py: the tables of designs; cycles and cells of some of them are held here, and a row of
docs/figures.md."""

import json
import re

import pytest
import typer

from eskin.golden.core import PRESETS
from eskin.rtl.program.schedule import frame_cycles, mean_frame_cycles, step_cycles
from scripts import tables
from tests.support.result_case import FROZEN, make_result
from tests.support.table import each_row

KINDS = dict(feature_kinds=("mean", "activity", "integral"), activity_rule="change", hop=144, window=288)


@each_row(
    "preset, changes, lanes, plain, ends, mean, quiet, step",
    [
        ("synthetic", KINDS | dict(activity_block=24), 4, 26, 202, 25.032, 19.188, 565),
        ("pvdf", {}, 4, 15, 31, 12.374, 12.188, 215),
    ],
)
def test_cycles_of_two_designs(preset, changes, lanes, plain, ends, mean, quiet, step):
    config = PRESETS[preset].with_lanes(lanes, "plain").replace(**changes)
    assert frame_cycles(config, ends_window=False, ends_block=False) == plain
    assert frame_cycles(config) == ends and step_cycles(config) == step
    assert mean_frame_cycles(config) == pytest.approx((mean, quiet), abs=1e-3)


def test_a_table_of_the_page_is_replaced(monkeypatch):
    monkeypatch.setattr(tables, "placed", lambda config: (config.network.cell,))
    page = "a\n\nMade by `python -m scripts.tables designs thesis` at commit `0`.\n\n| old |\n\nb | c\n"
    assert tables.rewritten(page, ["steps"], "abc") == page
    new = tables.rewritten(page, [], "abc")
    assert new.startswith(
        "a\n\nMade by `python -m scripts.tables designs thesis` at commit `abc`.\n\n| design |"
    )
    assert new.endswith("| thesis, 16 trees of depth 8, 1024 nodes | trees |\n\nb | c\n") and "old" not in new


def test_each_table_of_figures_has_its_command_and_commit():
    """Of the last section another test holds the table."""
    page = tables.PAGE.read_text()
    made = {found[2] for found in tables.MADE.finditer(page)}
    assert made == set(tables.TABLES) - {"stress"} and len(page.split()) <= 6300
    for section in page.split("\n## ")[1:-1]:
        assert re.search(r"\n(Made|Measured) by `[^`]+`.* at commit `\w{8}`[^|]*\.\n\n\|", section), section


def test_results_of_this_code_alone_fill_the_tables_of_every_page(tmp_path):
    make_result(tmp_path)
    result, file = json.loads((tmp_path / "run.json").read_text()), tmp_path / "run.json"
    with pytest.raises(typer.BadParameter, match="other code than this checkout's made it"):
        list(tables.quoted([str(tmp_path)]))
    candidate = FROZEN["run"]["candidates"][0] | dict(
        cell="gru", hidden=4, recipe="onset", chosen=True, front_end_words="a|b", energy_touch_j=1.234e-6
    )
    candidate |= dict(average_w=785e-6, decision_time_s=0.5, cells=900, block_memories=9)
    file.write_text(json.dumps(result | {"code": tables.CODE(), "candidates": [candidate]}))
    training = json.loads((tmp_path / "model/training.json").read_text())
    nested = FROZEN["training"]["cross_validation"][0]["nested"]
    nested |= dict(integer_accuracy=0.8712, float_accuracy=0.8823, standard_error=0.0345)
    split = training["cross_validation"][0] | {"nested": nested}
    (tmp_path / "model/training.json").write_text(json.dumps(training | {"cross_validation": [split]}))
    enrolled = {"mean": {"1": {"before": 0.77, "after": 0.953}}, "data": "few", "readout": "dense"}
    row = dict(label="GRU 12", split="seq", hardware=True, multiplies=10920, accuracy=0.823)
    for name, content in (("enrol", enrolled), ("base", {"rows": [row], "left_out": [], "data": "few"})):
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    lines = list(tables.quoted([str(tmp_path), *(f"{tmp_path}/{name}.json" for name in ("enrol", "base"))]))
    heads = [line.split(",")[0].strip() for line in lines if "commit" in line]
    assert heads == [*tables.PAGES, "docs/enrolment.md", "docs/results.md"]
    rows = [line.split(" | ") for line in lines if line.startswith("| made-up")]
    assert rows[0][2:7] == ["GRU 4", "87.1 %", "1.23 uJ", "785 uW", "36 days"] and set(rows[0][2:-1]) <= set(
        rows[2]
    )
    assert (
        "| few | dense | 1 | 77.0 % | 95.3 % |" in lines
        and "| few | 82.3 % | seq | GRU 12 | True | 10920 |" in lines
    )
