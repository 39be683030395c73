"""scripts/tables.py: the tables of designs; cycles and cells of three of them are held here, and a row of
docs/figures.md."""

import pytest

from eskin.choose.networks import network
from eskin.golden.core import PRESETS
from eskin.rtl.program.schedule import frame_cycles, mean_frame_cycles, step_cycles
from eskin.rtl.top.accelerator import Accelerator
from scripts import tables
from tests.support.random_models import random_integer_model
from tests.support.table import each_row

KINDS = dict(feature_kinds=("mean", "activity", "integral"), activity_rule="change", hop=144, window=288)


@each_row(
    "preset, changes, lanes, plain, ends, mean, quiet, step",
    [
        ("thesis", {}, 6, 23, 71, 21.163, 18, 195),
        ("synthetic", KINDS | dict(activity_block=24), 4, 26, 202, 25.032, 19.188, 565),
        ("pvdf", {}, 4, 15, 31, 12.374, 12.188, 215),
    ],
)
def test_cycles_of_three_designs(preset, changes, lanes, plain, ends, mean, quiet, step):
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
    assert new.endswith("| thesis, linear, P = 4 | linear |\n\nb | c\n") and "old" not in new


def test_the_page_of_figures_names_tables_that_there_are():
    made = {found[2] for found in tables.MADE.finditer(tables.PAGE.read_text())}
    assert made == set(tables.TABLES) - {"runs", "stress"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "scene, cell, lanes, cells",
    [
        ("thesis", "gru", 1, (578, 245, 29, 0)),
        ("thesis", "gru", 4, (722, 401, 28, 0)),
        ("pvdf", "linear", 4, (836, 620, 10, 4)),
    ],
)
def test_three_of_the_twelve_designs_get_no_larger(scene, cell, lanes, cells):
    """Cells before placement."""
    front = network(PRESETS[scene].replace(feature_shift=()), cell, 12 if cell == "gru" else None)
    design = Accelerator(random_integer_model(front.with_lanes(lanes, "dsp"), 1).config)
    counts = tables.cells_of(design, hidden=("probe", "bus__r_"))  # nobody reads
    for kind, most in zip(("lut", "ff", "bram", "spram"), cells, strict=True):
        assert counts[kind] <= most, kind
