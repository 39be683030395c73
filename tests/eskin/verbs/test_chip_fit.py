"""Which network of a sweep fits so many tiles: what is tried, what is chosen, what is refused."""

import json

import pytest
from typer.testing import CliRunner

from eskin.cli.main import app
from eskin.golden.core import PRESETS, InputError
from eskin.golden.model import random_integer_model
from eskin.pages.views import words
from eskin.study.sweep import make_points
from eskin.verbs import asic_job, chip_fit
from tests.support.table import each_row

GRID = [
    {"cell": "linear", "lanes": 1},
    {"cell": "gru", "hidden": [4, 8, 12, 16, 20], "weight_bits": [8, 4], "state_bits": 12, "lanes": 1},
]
ACCURACY = {"linear": 0.90, 4: 0.93, 8: 0.975, 12: 0.97, 16: 0.99, 20: 0.995}


def sweep(tmp_path, error: float = 0.01):
    base = PRESETS["thesis"]
    rows = []
    for point in make_points(base, GRID):
        network = point.config.network
        accuracy = ACCURACY["linear" if network.cell == "linear" else network.hidden] - 0.035 * (
            point.config.weight_bits == 4
        )
        row = {
            "name": point.name,
            "config": point.to_dict(),
            "widths": dict(point.widths),
            "accuracy": accuracy,
            "standard_error": error,
        }
        rows.append(row | {"cycles_step": 100})
    path = tmp_path / "sweep.json"
    path.write_text(json.dumps({"base": base.to_dict(), "points": rows}))
    return path


def area_of(asked):
    def area(model):
        config = model.config
        asked.append(config)
        assert config.hardware.clock_gate and config.hardware.lane_type == "plain"
        units = config.network.hidden if config.recurrent else 0
        return 1e5 + 1e3 * units * config.weight_bits

    return area


def search(path, monkeypatch, room=2e5, **options):
    monkeypatch.setattr(asic_job, "room_um2", lambda *tiles: room)
    asked: list = []
    return chip_fit.searched(chip_fit.points_of(path), "1x1", area_of(asked), rom=True, **options), asked


def test_the_smallest_of_those_as_good_as_the_best_that_fits_and_no_synthesis_beyond_a_misfit(
    tmp_path, monkeypatch
):
    result, asked = search(sweep(tmp_path), monkeypatch)
    rows = result["rows"]
    assert len(rows) == 11 and len(asked) == 10  # GRU 20 of 8 bits is not asked for: 16 was too large
    assert all(not config.hardware.loadable for config in asked)
    fits = {row["name"]: row["fits"] for row in rows}
    assert fits["GRU 12, 8 bit, 1 lane"]
    assert not fits["GRU 16, 8 bit, 1 lane"]
    assert not fits["GRU 20, 8 bit, 1 lane"]
    assert fits["GRU 20, 4 bit, 1 lane"]
    assert rows[result["best"]]["name"] == rows[result["chosen"]]["name"] == "GRU 8, 8 bit, 1 lane"
    assert rows[-1]["area_um2"] is None
    assert "does not fit" in words("fit", tiles="1x1", pdk="", **result).splitlines()[-1]


def test_an_error_decides_how_much_less_is_enough(tmp_path, monkeypatch):
    result, _ = search(sweep(tmp_path, 0.05), monkeypatch)
    assert result["rows"][result["best"]]["name"] == "GRU 8, 8 bit, 1 lane"
    assert result["rows"][result["chosen"]]["name"] == "GRU 4, 8 bit, 1 lane"


def test_nothing_fits(tmp_path, monkeypatch):
    result, _ = search(sweep(tmp_path), monkeypatch, room=1e4)
    assert result["best"] is None
    assert result["chosen"] is None
    assert not any(row["fits"] for row in result["rows"])


def test_lanes_asked_for_make_each_network_one_point(tmp_path, monkeypatch):
    result, asked = search(sweep(tmp_path), monkeypatch, lanes=4)
    assert len(result["rows"]) == 11 and {config.hardware.lanes for config in asked} == {4}


def test_lanes_are_halved_until_they_fit():
    model = random_integer_model(asic_job.chip_config(PRESETS["thesis"], 6, True), 1)
    area = {6: 4.0, 3: 2.5, 1: 1.0}
    for room, tried in ((5.0, [6]), (3.0, [6, 3]), (0.5, [6, 3, 1])):
        unit = asic_job.room_um2(1, 1) / room
        made, rows = chip_fit.fitted(model, "1x1", lambda m, unit=unit: unit * area[m.config.hardware.lanes])
        assert [row["lanes"] for row in rows] == tried and made.config.hardware.lanes == tried[-1]
        assert all(row["tiles_filled"] > 1 for row in rows[:-1])


def test_tiles_by_their_number():
    assert asic_job.room_um2(8, 2) == pytest.approx(0.7 * 0.541e6, rel=1e-3) and chip_fit.tiles_of("8x2") == (
        8,
        2,
    )
    for text in ("8", "0x2", "8x", "axb", "8x2x1"):
        with pytest.raises(InputError, match="--fit"):
            chip_fit.tiles_of(text)


def test_the_verb_writes_and_tells(tmp_path, monkeypatch):
    monkeypatch.setattr(chip_fit, "areas", lambda *_, **__: area_of([]))
    (tmp_path / "x.lib").touch()
    common = ["asic", str(tmp_path), "--pdk", "ihp-sg13g2", "--liberty", str(tmp_path / "x.lib"), "--rom"]
    common += ["--sweep", str(sweep(tmp_path)), "--out", str(tmp_path / "o")]
    done = CliRunner().invoke(app, [*common, "--fit", "4x2"])
    assert done.exit_code == 0, done.output
    kept = json.loads((tmp_path / "o" / "fit.json").read_text())
    assert kept["rows"][kept["chosen"]]["name"] == "GRU 8, 8 bit, 1 lane" and kept["tiles"] == "4x2"
    assert "| most accurate that fits, chosen |" in (tmp_path / "o" / "fit.md").read_text()
    assert CliRunner().invoke(app, [*common, "--fit", "1x1"]).exit_code == 1
    with pytest.raises(InputError, match="--sweep: is for --fit"):
        CliRunner().invoke(app, common, catch_exceptions=False)


@each_row(
    ("content", "said"),
    [
        ("{", "is no result of eskin sweep"),
        ("[]", "is no result of eskin sweep"),
        (json.dumps({"points": []}), "is no result of eskin sweep"),
        (json.dumps({"base": PRESETS["thesis"].to_dict(), "points": []}), "has no point"),
        (
            json.dumps({"base": PRESETS["thesis"].to_dict(), "points": [{"config": {}, "accuracy": "x"}]}),
            "is no result of eskin sweep",
        ),
    ],
)
def test_another_file_is_refused_in_a_sentence(tmp_path, content, said):
    path = tmp_path / "sweep.json"
    path.write_text(content)
    with pytest.raises(InputError, match=said):
        chip_fit.points_of(path)
    with pytest.raises(InputError, match="No such file"):
        chip_fit.points_of(tmp_path / "none.json")
