"""Chips side by side: what is kept is not made again, what was not asked for is said, a wrong decision is an exit status."""

from __future__ import annotations

from eskin.golden.core.config import PRESETS
from eskin.golden.model.model import random_integer_model
from eskin.verbs import asic_job, chip_figures
from tests.support.table import each_row


def result(lanes: int, rom: bool, mismatches: int = 0) -> dict:
    energy = {"step_j": 1.56e-8, "interval_j": 1e-6, "waiting_cycle_j": 3e-14, "leakage_w": 3.8e-6, "touch_j": 2e-5, "average_w": 6.6e-6}
    energy |= {"interval_parts_j": {"leakage": 4e-7, "clock": 2e-7}, "battery_hours": 757000.0, "clock_hz": 627e3}
    energy |= {"compared_values": 21, "mismatches": mismatches, "glitches": {"step_j": 6e-9, "interval_j": 2.7e-8, "touch_j": 5e-7}}
    energy["glitches"] |= {"average_w": 1.3e-7, "battery_hours_with": 740000.0}
    made = {"pdk": "ihp-sg13g2", "lanes": lanes, "rom": rom, "area_um2": 379e3, "kge": 52.2, "area_by_kind_um2": {"logic": 135e3}}
    made |= {"flip_flops": 1119, "latches": 3357, "clock_gates": 214, "fmax_hz": {"typ": 96.4e6, "slow": None}, "energy": energy}
    return made


@each_row("mismatches, status", [(0, 0), (1, 1)])
def test_rows_are_kept_and_told(tmp_path, monkeypatch, capsys, mismatches, status):
    random_integer_model(PRESETS["thesis"], 1).save(tmp_path / "model")
    asked = []

    def asic(model, pdk, paths, *, recordings, wire_load="10k", delays="cells"):
        hardware = model.config.hardware
        asked.append((hardware.lanes, hardware.loadable, wire_load, delays))
        made = result(hardware.lanes, not hardware.loadable, mismatches)
        made["energy"]["step_j"] *= 1 if wire_load else 0.5
        made["energy"]["glitches"]["step_j"] *= 1 if delays == "cells" else 2
        return made, None

    monkeypatch.setattr(asic_job, "asic", asic)
    monkeypatch.setattr(chip_figures, "load_recordings", lambda data: None)
    out = tmp_path / "kept"
    (tmp_path / "x.lib").touch()
    common = [str(tmp_path / "model"), "--process", "ihp-sg13g2", str(tmp_path / "x.lib"), "--out", str(out)]
    assert chip_figures.main([*common, "--constants", "rom", "--lanes", "4", "--more"]) == status
    assert asked == [(4, False, "10k", "cells"), (4, False, "10k", "unit"), (4, False, "", "cells")]
    text = capsys.readouterr().out
    for words in ("0.379; 52.2", "96.4 typ, no file of slow cells", "15.6", "6.0", "step 12.0 nJ", "step 7.8 nJ", f"21, {mismatches}"):
        assert words in text
    assert chip_figures.main([*common, "--constants", "rom", "--lanes", "4", "--more"]) == status and len(asked) == 3
    assert chip_figures.main([*common, "--lanes", "4"]) == status and len(asked) == 5 and len(list(out.iterdir())) == 3
