"""scripts/tables.py: the tables of designs; cycles and cells of three of them are held here, and a row of
docs/figures.md."""

import pytest

from eskin.choose.networks import network
from eskin.golden.core import PRESETS
from eskin.golden.model import random_integer_model
from eskin.rtl.fpga.synthesis import Chain
from eskin.rtl.program.schedule import frame_cycles, mean_frame_cycles, step_cycles
from scripts import tables
from tests.support.table import each_row

KINDS = dict(feature_kinds=("mean", "activity", "integral"), activity_rule="change", hop=144, window=288)


@each_row(
    ("preset", "changes", "lanes", "plain", "ends", "quiet", "step"),
    [
        ("thesis", {}, 6, 23, 71, 19, 195),
        ("synthetic", KINDS | dict(activity_block=24), 4, 26, 202, 19, 565),
        ("pvdf", {}, 4, 15, 31, 15, 215),
    ],
)
def test_cycles_of_three_designs(preset, changes, lanes, plain, ends, quiet, step):
    config = PRESETS[preset].with_lanes(lanes, "plain").replace(**changes)
    assert frame_cycles(config, ends_window=False, ends_block=False) == plain
    assert frame_cycles(config) == ends and step_cycles(config) == step
    touch, found = mean_frame_cycles(config)
    assert found == quiet and plain < touch < plain + 2
    assert mean_frame_cycles(config.replace(one_port=True)) == (touch, found)


<<<<<<< HEAD
=======
def test_a_row_a_design_as_soon_as_it_is_known(monkeypatch, capsys):
    monkeypatch.setattr(tables, "placed", lambda config: (f"{config.hardware.lanes} {config.network.cell}",))
    tables.main(["designs", "thesis"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[2:] == [
        "| thesis, gru, P = 1 | 1 gru |",
        "| thesis, gru, P = 4 | 4 gru |",
        "| thesis, linear, P = 4 | 4 linear |",
    ]


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
    assert made == set(tables.TABLES)


>>>>>>> main
@pytest.mark.parametrize(
    ("scene", "cell", "lanes", "cells", "cycles"),
    [
        ("thesis", "gru", 1, (578, 245, 29, 0), (23.2, 19.0, 1172)),
        ("thesis", "gru", 4, (722, 401, 28, 0), (23.2, 19.0, 281)),
        ("pvdf", "linear", 4, (836, 620, 10, 4), (15.2, 15.0, 27)),
    ],
)
def test_three_of_the_twelve_designs_get_no_worse(scene, cell, lanes, cells, cycles):
    """Cells before placement; cycles of a frame (touch, quiet) and of a step."""
    front = network(PRESETS[scene].replace(feature_shift=()), cell, 12 if cell == "gru" else None)
    config = random_integer_model(front.with_lanes(lanes, "dsp"), 1).config
    touch, quiet = mean_frame_cycles(config)
    assert (round(touch, 1), round(quiet, 1), step_cycles(config)) == cycles
    counts = tables.cells_of(Chain(config, readable=False))
    for kind, most in zip(("lut", "ff", "bram", "spram"), cells, strict=True):
        assert counts[kind] <= most, kind
<<<<<<< HEAD
=======


@pytest.mark.slow
def test_cells_of_the_thesis_design():
    cells, memories, _, touch, quiet, step, *_ = tables.placed(PRESETS["thesis"].with_lanes(4, "dsp"))
    assert cells <= 797 and memories == "28 + 0" and (touch, quiet, step) == ("23.2", "19.0", 281)


LEAN = dict.fromkeys(("weight_format", "recurrent_format", "dense_format"), "SQ(2,6)") | dict(
    bias_format="SQ(2,14)",
    dense_bias_format="SQ(0,16)",
    feature_format="SQ(4,12)",
    logit_format="SQ(7,9)",
    feature_shift=(8, 8),
    aligned_means=True,
)
"""What ``eskin quantise --formats lean`` chooses for the thesis configuration."""


class NoBus(Chain):
    """Onset to decision, no taxel masked, constants as they are: without a bus."""

    def __init__(self, config, images=None, *, readable=False):
        self._accelerator, self._bus = make_accelerator(config, images), ()
        ports = self._accelerator.signature.members
        wiring.Component.__init__(self, {name: ports[name] for name in ("i", "o", "busy")})


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    ("loadable", "chain", "begins"),
    [
        (True, Chain, "| iCE40UP5K | 1 dsp | no |"),
        (False, Chain, "| the same, ROM |"),
        (False, NoBus, "| ROM, no bus, no mask |"),
    ],
)
def test_the_smallest_rows_of_the_boards_are_of_the_present_design(loadable, chain, begins, monkeypatch):
    page = Path(__file__).resolve().parents[2] / "docs" / "figures.md"
    row = next(line for line in page.read_text().splitlines() if line.startswith(begins))
    config = PRESETS["thesis"].replace(**LEAN, loadable=loadable).with_lanes(1, "dsp")
    arrays = random_integer_model(config.replace(aligned_means=False), 1).arrays
    arrays = {**arrays, "mean": arrays["mean"] >> 8 << 8}
    monkeypatch.setattr("eskin.rtl.fpga.wiring.Chain", chain)
    request = build_job.BuildRequest(
        config=config, arrays=arrays, target=target("icebreaker"), link=False, seeds=1
    )
    built = build_job.build(request)[0]
    assert [built["logic_cells"], built["dsp"], built["bram"]] == [int(cell) for cell in row.split("|")[4:7]]
>>>>>>> main
