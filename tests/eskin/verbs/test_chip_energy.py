"""Energy of a chip: what is made of the counts of frames, and a small netlist played from random contents,
whole and with a wrong cell."""

import dataclasses
import random
import re
from functools import partial

import numpy as np
import pytest

from eskin.cosim.gates import Chip
from eskin.golden.core import PRESETS, InputError
from eskin.rtl.asic.nets import Nets
from eskin.rtl.asic.synthesis import process_of
from eskin.rtl.program.schedule import schedule
from eskin.study.energy import BATTERY_J
from eskin.verbs import asic_job, chip_energy
from eskin.verbs.flow import cosimulate
from tests.support.random_models import random_integer_model
from tests.support.tiny_cells import liberty_files
from tests.support.traffic_case import CONFIG as TINY
from tests.support.traffic_case import Case

CONFIG = PRESETS["thesis"].replace(steps=4, feature_shift=(4,), hop=50, window=100, pretrigger_frames=10)
SMALL = TINY.replace(hop=12, window=24, touch_frames=60, rearm_frames=30)


def test_a_step_costs_what_frames_around_its_decision_cost_more():
    frames, plain, quiet, step = 400, 3e-9, 1e-9, 2e-8
    rows = np.zeros((frames, 3))
    rows[:, 0], rows[:, 1] = 80, 50
    joule = np.where(np.arange(frames) < 100, quiet, plain)
    for number, row in enumerate((150, 200, 250, 300)):
        rows[row, 2] = 1 + (number == 3)
        joule[row - 1 : row + 1] += step / 2
    parts = {"logic": 0.75 * joule, "clock": 0.25 * joule}
    found = chip_energy.summary(CONFIG, rows, parts, 100, 1e-14, 4e-6, 627e3)
    period, rate = 627e3 / 3000, 3000
    assert found["step_j"] == pytest.approx(step)
    still = 1e-14 * (period - 50)
    assert found["interval_j"] == pytest.approx(50 * (plain + still) + step + 4e-6 * 50 / rate)
    assert sum(found["interval_parts_j"].values()) == pytest.approx(found["interval_j"])
    assert found["idle_w"] == pytest.approx(4e-6 + rate * (quiet + still))
    assert found["average_w"] == pytest.approx(found["idle_w"] + 4 * step)
    assert found["battery_hours"] == pytest.approx(BATTERY_J / found["average_w"] / 3600)
    assert found["clocked_share"] == pytest.approx(50 / period)


def test_recordings_may_end_with_their_touch():
    """A hop after it is taken where there is one; else its last frame is held for a hop."""
    case, hop = Case(SMALL), SMALL.windows.hop
    model = random_integer_model(SMALL, 5)
    _, longer = chip_energy.with_touches(model, case.recordings, 1)
    ending = longer.until(longer.lengths - hop)
    _, played = chip_energy.with_touches(model, ending, 1)
    assert played.lengths == longer.lengths - hop
    held = chip_energy._resting(played, hop)
    assert held.lengths == longer.lengths and (held.samples[-hop:] == played.samples[-1]).all()
    with pytest.raises(InputError, match="none has a whole touch; energy needs one"):
        chip_energy.with_touches(model, ending.until(ending.lengths - 1), 1)


def _parity(module, seed: int) -> str:
    """A cell of a netlist that is an exclusive or."""
    cells = (name for name, cell in module["cells"].items() if re.search(r"_xn?or2_\d$", cell["type"]))
    return random.Random(seed).choice(sorted(cells))


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(("cells", "rom"), [("tiny", True), ("tiny", False), ("real", True)])
def test_a_small_chip_decides_as_the_golden_model_and_a_wrong_cell_is_seen(tmp_path, monkeypatch, cells, rom):
    paths = liberty_files(cells, tmp_path)
    libraries = asic_job.libraries_of(paths)
    process = process_of("ihp-sg13g2", libraries["typ"])
    case = Case(asic_job.chip_config(SMALL, 1, rom))
    model = dataclasses.replace(random_integer_model(case.config, 5), config=case.config)
    monkeypatch.setattr(asic_job, "CACHE", tmp_path / "chips")
    netlist = asic_job.netlist_of(case.config, model.arrays, process)
    nets, wire = Nets(netlist.module, process.cells), process.library.wire_loads["10k"]
    played = partial(chip_energy.measured, model, nets, process.library.voltage, wire, 1e-6, case.recordings)
    whole = played()
    assert whole["bit_exact"] and whole["compared_values"] > 3 and whole["step_j"] > 0
    assert 0 < whole["glitches"]["step_j"] < 2 * whole["step_j"]
    parities = sorted(
        name for name, cell in nets.cells.items() if "xor2" in cell.name or "xnor2" in cell.name
    )
    wrong = random.Random(3).choice(parities)
    with monkeypatch.context() as patch:  # a cell that says the opposite
        patch.setattr(chip_energy, "Chip", lambda *given, **options: Chip(*given, wrong, **options))
        broken = played()
    assert not broken["bit_exact"]
    # every stage, at the declared pace too, and as placed; one wrong cell is seen
    chip = {"pdk": "ihp-sg13g2", "liberty": [str(path) for path in paths], "rom": rom}
    options = {"level": "netlist", "target": "asic", "simulator": "compiled"}
    for pace in ("full", "declared"):
        played = cosimulate(
            model, case.recordings, chip=chip, work=tmp_path / pace, pace=pace, clock_hz=1e6, **options
        )
        assert played["passed"]
        assert played["recordings"] == 2
        assert all(not row["mismatches"] for row in played["stages"].values())
        assert {"sum", "feature", "state", "logit", "decision", "status"} <= {
            n for n, row in played["stages"].items() if row["compared_values"]
        }
        assert played["without_probes"]["bit_exact"]
        assert played["cycles"]["step_max"] == schedule(case.config).step_cycles
    monkeypatch.setattr(asic_job, "Chip", lambda *given: Chip(*given, _parity(given[0], 5)))
    flipped = cosimulate(model, case.recordings, chip=chip, work=tmp_path / "flipped", **options)
    assert flipped["mismatches"] and not flipped["passed"]
