"""Which network of a sweep fits so many tiles: what is tried, what is chosen, what is refused."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from eskin.cli.main import app
from eskin.golden.core.config import PRESETS
from eskin.golden.core.errors import InputError
from eskin.golden.studies.sweep import make_points
from eskin.verbs import asic_job, chip_fit
from tests.support.table import each_row

GRID = [{"cell": "linear", "lanes": 1}, {"cell": "gru", "hidden": [4, 8, 12, 16, 20], "weight_bits": [8, 4], "state_bits": 12, "lanes": 1}]
ACCURACY = {"linear": 0.90, 4: 0.93, 8: 0.975, 12: 0.97, 16: 0.99, 20: 0.995}


def sweep(tmp_path, error: float = 0.01):
    base = PRESETS["thesis"]
    rows = []
    for point in make_points(base, GRID):
        network = point.config.network
        accuracy = ACCURACY["linear" if network.cell == "linear" else network.hidden] - 0.035 * (point.config.weight_bits == 4)
        row = {"name": point.name, "config": point.to_dict(), "widths": dict(point.widths), "accuracy": accuracy, "standard_error": error}
        rows.append(row | {"cycles_step": 100})
    path = tmp_path / "sweep.json"
    path.write_text(json.dumps({"base": base.to_dict(), "points": rows}))
    return path


def area_of(asked):
    def area(config):
        asked.append(config)
        assert config.hardware.clock_gate and config.hardware.lane_type == "plain"
        units = config.network.hidden if config.recurrent else 0
        return 1e5 + 1e3 * units * config.weight_bits

    return area


def test_the_smallest_of_those_as_good_as_the_best_that_fits_and_no_synthesis_beyond_a_misfit(tmp_path):
    asked: list = []
    points = chip_fit.points_of(sweep(tmp_path))
    found = chip_fit.searched(points, 2e5, area_of(asked), rom=True)
    rows = found["rows"]
    assert len(rows) == 11 and len(asked) == 10  # GRU 20 of 8 bits is not asked for: 16 was too large
    assert all(not config.hardware.loadable for config in asked)
    fits = {row["name"]: row["fits"] for row in rows}
    assert fits["GRU 12, 8 bit, 1 lane"] and not fits["GRU 16, 8 bit, 1 lane"] and not fits["GRU 20, 8 bit, 1 lane"]
    assert fits["GRU 20, 4 bit, 1 lane"]
    assert rows[found["best"]]["name"] == "GRU 8, 8 bit, 1 lane"
    assert rows[found["chosen"]]["name"] == "GRU 8, 8 bit, 1 lane"
    assert rows[-1]["area_um2"] is None and "does not fit" in chip_fit.table(found | {"tiles": "1x1"})[-1][3]


def test_an_error_decides_how_much_less_is_enough(tmp_path):
    found = chip_fit.searched(chip_fit.points_of(sweep(tmp_path, 0.05)), 2e5, area_of([]), rom=True)
    assert found["rows"][found["best"]]["name"] == "GRU 8, 8 bit, 1 lane"
    assert found["rows"][found["chosen"]]["name"] == "GRU 4, 8 bit, 1 lane"


def test_nothing_fits(tmp_path):
    found = chip_fit.searched(chip_fit.points_of(sweep(tmp_path)), 1e4, area_of([]), rom=False)
    assert found["best"] is None and found["chosen"] is None and not any(row["fits"] for row in found["rows"])


def test_the_verb_writes_and_tells(tmp_path, monkeypatch):
    monkeypatch.setattr(asic_job, "libraries_of", lambda paths: {"typ": []})
    monkeypatch.setattr(chip_fit, "process_of", lambda pdk, found: type("P", (), {"library": type("L", (), {"cells": {}}), "macros": ()}))
    monkeypatch.setattr(chip_fit, "searched", lambda points, room, area, **more: _searched(points, room, area_of([]), **more))
    path = sweep(tmp_path)
    lib = tmp_path / "x.lib"
    lib.write_text("")
    common = [
        "asic",
        str(tmp_path),
        "--pdk",
        "ihp-sg13g2",
        "--liberty",
        str(lib),
        "--rom",
        "--sweep",
        str(path),
        "--out",
        str(tmp_path / "o"),
    ]
    done = CliRunner().invoke(app, [*common, "--fit", "4x2"])
    assert done.exit_code == 0, done.output
    kept = json.loads((tmp_path / "o" / "fit.json").read_text())
    assert kept["rows"][kept["chosen"]]["name"] == "GRU 8, 8 bit, 1 lane" and "chosen" in (tmp_path / "o" / "fit.md").read_text()
    assert CliRunner().invoke(app, [*common, "--fit", "1x1"]).exit_code == 1
    with pytest.raises(InputError, match="--sweep: is for --fit"):
        CliRunner().invoke(app, common, catch_exceptions=False)


_searched = chip_fit.searched


@each_row(
    ("content", "said"),
    [
        ("{", "is no result of eskin sweep"),
        ("[]", "is no result of eskin sweep"),
        (json.dumps({"points": []}), "is no result of eskin sweep"),
        (json.dumps({"base": PRESETS["thesis"].to_dict(), "points": []}), "has no point"),
        (json.dumps({"base": PRESETS["thesis"].to_dict(), "points": [{"config": {}, "accuracy": "x"}]}), "is no result of eskin sweep"),
    ],
)
def test_another_file_is_refused_in_a_sentence(tmp_path, content, said):
    path = tmp_path / "sweep.json"
    path.write_text(content)
    with pytest.raises(InputError, match=said):
        chip_fit.points_of(path)
    with pytest.raises(InputError, match="No such file"):
        chip_fit.points_of(tmp_path / "none.json")
