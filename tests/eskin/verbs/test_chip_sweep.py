"""Chips side by side: what is kept is not made again, what was not asked for is said, a wrong decision is an
exit status."""

import pytest

from eskin.data import synthetic_recordings
from eskin.golden.core import PRESETS
from eskin.golden.model import random_integer_model
from eskin.verbs import asic_job, chip_sweep


def result(lanes: int, rom: bool, mismatches: int = 0) -> dict:
    energy = {
        "step_j": 1.56e-8,
        "interval_j": 1e-6,
        "waiting_cycle_j": 3e-14,
        "leakage_w": 3.8e-6,
        "touch_j": 2e-5,
        "average_w": 6.6e-6,
        "idle_w": 6e-6,
    }
    energy |= {
        "interval_parts_j": {"leakage": 4e-7, "clock": 2e-7},
        "battery_hours": 757000.0,
        "clock_hz": 627e3,
        "clocked_share": 0.25,
        "interval_frames": 307,
    }
    energy |= {
        "compared_values": 21,
        "mismatches": mismatches,
        "glitches": {"step_j": 6e-9, "interval_j": 2.7e-8, "touch_j": 5e-7},
    }
    energy["glitches"] |= {"average_w": 1.3e-7, "method": "unit", "battery_hours_with": 740000.0}
    made = {
        "pdk": "ihp-sg13g2",
        "lanes": lanes,
        "rom": rom,
        "one_phase": False,
        "area_um2": 379e3,
        "kge": 52.2,
        "area_by_kind_um2": {"logic": 135e3},
    }
    made |= {
        "corner": "typ",
        "utilisation": 0.7,
        "tiles": 19.2,
        "timing_by": "OpenSTA",
        "wire_load": "10k",
        "paths": {},
    }
    made |= {
        "flip_flops": 1119,
        "latches": 3357,
        "clock_gates": 214,
        "fmax_hz": {"typ": 96.4e6, "slow": None},
        "energy": energy,
    }
    return made


@pytest.mark.parametrize("mismatches, status", [(0, 0), (1, 1)])
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
    monkeypatch.setattr(chip_sweep, "load_recordings", lambda data: None)
    out = tmp_path / "kept"
    (tmp_path / "x.lib").touch()
    common = [str(tmp_path / "model"), "--process", "ihp-sg13g2", str(tmp_path / "x.lib"), "--out", str(out)]
    assert chip_sweep.main([*common, "--constants", "rom", "--lanes", "4", "--more"]) == status
    assert asked == [(4, False, "10k", "cells"), (4, False, "", "cells"), (4, False, "10k", "unit")]
    text = capsys.readouterr().out
    clocks = "typ 96.4 MHz, slow: no file of cells"
    for words in (
        "0.379 mm2, 52.2 kGE",
        clocks,
        "15.6 nJ, glitches add 6.0",
        "step 12.0 nJ",
        "step 7.8 nJ",
        "86 years",
    ):
        assert words in text
    assert f"21 values compared, {mismatches} mismatches" in text
    assert chip_sweep.main([*common, "--constants", "rom", "--lanes", "4", "--more"]) == status
    assert len(asked) == 3
    assert chip_sweep.main([*common, "--lanes", "4"]) == status
    assert len(asked) == 5
    assert len(list(out.iterdir())) == 3


def test_chips_are_played_whole_and_with_a_wrong_cell(tmp_path, monkeypatch, capsys):
    config = PRESETS["thesis"]
    random_integer_model(config, 1).save(tmp_path / "model")
    seen = 20

    def cosimulate(model, recordings, *, numbers, chip, lanes, **_):
        assert len(numbers) == len(recordings)
        mismatches = seen if "flipped" in chip else 0
        counts = {
            "recordings": len(recordings),
            "steps": 4,
            "decisions": 4,
            "compared_values": 99,
            "stages": {},
        }
        return counts | {"mismatches": mismatches, "without_probes": {"compared_values": 8, "mismatches": 0}}

    monkeypatch.setattr(chip_sweep, "cosimulate", cosimulate)
    monkeypatch.setattr(chip_sweep, "load_recordings", lambda data: synthetic_recordings(persons=2, trials=1))
    (tmp_path / "x.lib").touch()
    common = [
        str(tmp_path / "model"),
        "--process",
        "ihp-sg13g2",
        str(tmp_path / "x.lib"),
        "--lanes",
        "1",
        "--constants",
        "rom",
    ]
    common += "--play 2 --windows 4".split()
    assert chip_sweep.main([*common, "--placed", "--out", str(tmp_path / "placed")]) == 0
    text = capsys.readouterr().out
    assert "99, 0" in text and "8, 0" in text and "20 mismatches" in text
    seen = 0
    assert chip_sweep.main([*common, "--out", str(tmp_path / "blind")]) == 1
    assert "not asked" in capsys.readouterr().out
