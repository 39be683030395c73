"""What `eskin asic` says of a netlist, with OpenSTA and where it is missing; a tiny netlist stands for the
chip's."""

import dataclasses

import pytest

from eskin.golden.core import PRESETS
from eskin.pages import views
from eskin.rtl.asic import timing
from eskin.rtl.asic.synthesis import process_of, synthesise
from eskin.rtl.program.schedule import decision_cycles, schedule
from eskin.verbs import asic
from tests.rtl.asic.test_synthesis import Words
from tests.support.random_models import random_integer_model
from tests.support.table import each_row
from tests.support.tiny_cells import liberty_files
from tests.support.traffic_case import CONFIG


@each_row(
    "clock_hz, decide_within_s, in_one",
    [(12e6, 0.0, True), (786e3, 0.0, False), (786e3, 0.001, True), (12e6, 1e-5, False)],
)
def test_rows_in_one_phase_where_the_clock_decides_in_time(clock_hz, decide_within_s, in_one):
    config = PRESETS["thesis"].replace(clock_hz=clock_hz, decide_within_s=decide_within_s)
    chip = asic.chip_config(config, 4, True)
    assert chip.hardware.one_phase == in_one and schedule(chip).partial_rows == (0 if in_one else 24)
    assert (decision_cycles(chip) <= clock_hz * (decide_within_s or 1 / 3000)) == (in_one or clock_hz < 1e6)


def test_a_missing_opensta_is_named_with_its_command(tmp_path, monkeypatch):
    check(tmp_path, monkeypatch, "tiny", measured=False)


@pytest.mark.skipif(not timing.has_sta(), reason="OpenSTA is not installed: apt-get install opensta")
@pytest.mark.slow
@each_row("cells", ["tiny", "real"])
def test_the_clock_by_opensta(tmp_path, monkeypatch, cells):
    check(tmp_path, monkeypatch, cells, measured=True)


def test_other_cells_or_macros_make_another_netlist(tmp_path):
    process = process_of("ihp-sg13g2", asic.libraries_of(liberty_files("tiny", tmp_path))["typ"])
    macro, *others = process.macros
    changes = {"pdk": "sky130hd"}, {"macros": (dataclasses.replace(macro, area=1.0), *others)}
    kinds = [process, *(dataclasses.replace(process, **change) for change in changes)]
    keys = {*map(asic.content_of, 2 * kinds)}
    process.library.path.write_text("other cells")
    assert len({*keys, asic.content_of(process)}) == 4


def check(tmp_path, monkeypatch, cells, *, measured):
    paths = liberty_files(cells, tmp_path)
    model = random_integer_model(CONFIG, 5)
    model = dataclasses.replace(model, config=asic.chip_config(model.config, 1, True))
    process = process_of("ihp-sg13g2", asic.libraries_of(paths)["typ"])
    netlist = synthesise(Words(), process, tmp_path / "words", top=asic.TOP)
    monkeypatch.setattr(asic, "netlist_of", lambda *_, **__: netlist)

    def said() -> tuple[asic.Chip, str]:
        result, _ = asic.asic(model, "ihp-sg13g2", paths)
        return result, dict(next(views.tables(views.words("asic", **dict(result)))).cells)["highest clock"]

    if measured:
        result, words = said()
        assert "OpenSTA, wire load 10k" in words and result.fmax_hz["typ"] > result.fmax_hz["slow"]
        return
    monkeypatch.setattr(timing.shutil, "which", lambda _: None)
    without, words = said()
    assert "sudo apt-get install opensta" in words and without.fmax_hz == {"typ": None, "slow": None}
    monkeypatch.undo()
    monkeypatch.setattr(asic, "netlist_of", lambda *_, **__: netlist)
    no_slow, _ = asic.asic(model, "ihp-sg13g2", [path for path in paths if "slow" not in path.name])
    assert no_slow.fmax_hz["slow"] is None and "slow: no file of cells" in asic.words("asic", **dict(no_slow))
