"""scripts/design_table.py: the table of designs; the cycles of three of them are held here, cells of one."""

import pytest

from eskin.golden.core.config import PRESETS
from eskin.rtl.program.schedule import frame_cycles, mean_frame_cycles, step_cycles
from scripts import design_table
from tests.support.table import each_row

KINDS = dict(feature_kinds=("mean", "activity", "integral"), activity_rule="change", hop=144, window=288)


@each_row(
    ("preset", "changes", "lanes", "plain", "ends", "quiet", "step"),
    [
        ("thesis", {}, 6, 23, 71, 19, 199),
        ("synthetic", KINDS | dict(activity_block=24), 4, 26, 202, 19, 569),
        ("pvdf", {}, 4, 15, 31, 15, 221),
    ],
)
def test_cycles_of_three_designs(preset, changes, lanes, plain, ends, quiet, step):
    config = PRESETS[preset].with_lanes(lanes, "plain").replace(**changes)
    assert frame_cycles(config, ends_window=False, ends_block=False) == plain
    assert frame_cycles(config) == ends and step_cycles(config) == step
    touch, found = mean_frame_cycles(config)
    assert found == quiet and plain < touch < plain + 2
    assert mean_frame_cycles(config.replace(one_port=True)) == (touch, found)


def test_a_row_a_design_as_soon_as_it_is_known(monkeypatch, capsys):
    monkeypatch.setattr(
        design_table, "placed", lambda config: (f"{config.hardware.lanes} {config.network.cell}",)
    )
    design_table.main(["thesis"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[2:] == [
        "| thesis, gru, P = 1 | 1 gru |",
        "| thesis, gru, P = 4 | 4 gru |",
        "| thesis, linear, P = 4 | 4 linear |",
    ]


@pytest.mark.slow
def test_cells_of_the_thesis_design():
    cells, memories, _, touch, quiet, step, *_ = design_table.placed(PRESETS["thesis"].with_lanes(4, "dsp"))
    assert int(cells) <= 806 and memories == "29 + 0" and (touch, quiet, step) == ("23.2", "19.0", "285")
