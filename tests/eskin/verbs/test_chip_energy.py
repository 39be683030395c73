"""Energy of a chip: what is made of the counts of frames, and a small netlist played from random contents,
whole and with a wrong cell."""

import random
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from eskin.cosim.device import Design, Device
from eskin.cosim.simulation import Simulation
from eskin.golden.core import PRESETS
from eskin.rtl.asic.liberty import WireLoad, read
from eskin.rtl.asic.nets import Nets, costs
from eskin.rtl.asic.synthesis import process_of
from eskin.rtl.program.schedule import schedule
from eskin.study.touch_ends import with_touches
from eskin.verbs import asic
from eskin.verbs.cosim import cosimulate
from tests.support.random_models import random_integer_model
from tests.support.table import refused
from tests.support.tiny_cells import MEMORY_PINS, liberty_files
from tests.support.traffic_case import CONFIG as TINY
from tests.support.traffic_case import Case

CONFIG = PRESETS["thesis"].replace(steps=4, feature_shift=(4,), hop=50, window=100, pretrigger_frames=10)
SMALL = TINY.replace(hop=12, window=24, touch_frames=60, rearm_frames=30)


CLK, D, EN, GCLK, A, B, X, L = range(2, 10)
GATED = {
    "a": ("dfrbpq_1", dict(CLK=[CLK], D=[D], RESET_B=["1"], Q=[A])),
    "gate": ("lgcp_1", dict(CLK=[CLK], GATE=[EN], GCLK=[GCLK])),
    "x": ("xor2_1", dict(A=[A], B=[B], X=[X])),
    "b": ("dfrbpq_1", dict(CLK=[GCLK], D=[X], RESET_B=["1"], Q=[B])),
    "l": ("dlhq_1", dict(GATE=[GCLK], D=[A], Q=[L])),
    "m": ("ram", {pin: ["1"] for pin in MEMORY_PINS} | dict(A_CLK=[GCLK], A_WEN=[D])),
}
"""d -> flip-flop a; behind the gate that en opens: flip-flop b of a ^ b, latch l of a, and a memory that d writes."""


def test_a_netlist_counts_what_its_changes_cost(tmp_path):
    cells = read(liberty_files("tiny", tmp_path)[1]).cells
    ports = {"clk": ("input", CLK), "d": ("input", D), "en": ("input", EN)}
    ports |= {"a": ("output", A), "b": ("output", B), "l": ("output", L)}
    module = {"ports": {name: dict(direction=way, bits=[net]) for name, (way, net) in ports.items()}}
    module["cells"] = {
        name: dict(type=f"sg13g2_{kind}", connections=pins) for name, (kind, pins) in GATED.items()
    }
    nets, wire = Nets(module, cells), WireLoad(lengths={1: 2.0}, slope=1.0, farad=1e-15)
    cost = costs(nets, 2.0, wire)
    assert cost.kind == {
        D: "input", EN: "input", GCLK: "clock", A: "flip-flop", B: "flip-flop", X: "logic", L: "latch"
    }  # fmt: skip
    # cells, and half of C V^2: a wire of 2 fF, 1 more for each further receiver, and pins; both edges of a clock
    own, pin = cells["sg13g2_xor2_1"].pins["X"].toggle_j, cells["sg13g2_dfrbpq_1"].pins["D"].capacitance
    assert own > 0 and cost.joule[X] == pytest.approx(own + (2e-15 + pin) * 2**2 / 2)
    assert cost.joule[GCLK] == pytest.approx(2 * (own + (4e-15 + 2 * pin + 0.01e-12) * 2**2 / 2))
    device, rng = Device(Design(asic.counting(nets, cost), asic.BUILDS)), random.Random(4)

    def counted() -> np.ndarray:
        return np.array([device.get("edges__count"), device.get("joule__count") * asic.ZEPTO])

    device.put("en", 1)
    device.cycle(3)  # nothing is random any more
    (a, b, l), seen = map(device.get, "abl"), {}
    for _ in range(200):  # an edge counts what has changed since the one before, and that one itself
        d, en = rng.getrandbits(1), rng.getrandbits(1)
        device.put("d", d)
        device.put("en", en)
        last, seen, before = seen, {D: d, EN: en, A: a, B: b, X: a ^ b, L: l}, counted()
        device.cycle()
        a, b, l = d, *((a ^ b, d) if en else (b, l))
        assert [device.get(name) for name in "ab"] == [a, b]
        if not last:
            continue
        access = cells["sg13g2_ram"].access_j["write" if last[D] else "read"]
        spent = (cost.joule[GCLK] + access) * last[EN]
        spent += sum(cost.joule[net] * (last[net] != seen[net]) for net in seen)
        edges, joule = counted() - before
        assert edges == 1 and joule == pytest.approx(spent, abs=1e-19)


def test_a_step_costs_what_frames_around_its_decision_cost_more():
    frames, plain, quiet, step = 400, 3e-9, 1e-9, 2e-8
    decisions = np.zeros(frames)
    joule = np.where(np.arange(frames) < 100, quiet, plain)
    for number, row in enumerate((150, 200, 250, 300)):
        decisions[row] = 1 + (number == 3)
        joule[row - 1 : row + 1] += step / 2
    found = asic.summary(CONFIG, decisions, np.full(frames, 50), joule, 100, 1e-14, 4e-6, 627e3)
    period, rate = 627e3 / 3000, 3000
    assert found.step_j == pytest.approx(step)
    still = 1e-14 * (period - 50)
    assert found.interval_j == pytest.approx(50 * (plain + still) + step + 4e-6 * 50 / rate)
    assert found.idle_w == pytest.approx(4e-6 + rate * (quiet + still))
    assert found.average_w == pytest.approx(found.idle_w + 4 * step)


def test_recordings_may_end_with_their_touch():
    """A hop after it is taken where there is one; else its last frame is held for a hop."""
    case, hop = Case(SMALL), SMALL.windows.hop
    model = random_integer_model(SMALL, 5)
    _, longer = with_touches(model, case.recordings, 1)
    ending = longer.until(longer.lengths - hop)
    _, played = with_touches(model, ending, 1)
    assert played.lengths == longer.lengths - hop
    held = asic._resting(played, hop)
    assert held.lengths == longer.lengths and (held.samples[-hop:] == played.samples[-1]).all()
    with refused("none has a whole touch; energy needs one: give touches as strong"):
        with_touches(model, ending.until(ending.lengths - 1), 1)


@pytest.mark.slow
@pytest.mark.parametrize("cells, rom", [("tiny", True), ("tiny", False), ("real", True)])
def test_a_small_chip_decides_as_the_golden_model_and_a_wrong_cell_is_seen(tmp_path, monkeypatch, cells, rom):
    paths = liberty_files(cells, tmp_path)
    libraries = asic.libraries_of(paths)
    process = process_of("ihp-sg13g2", libraries["typ"])
    case = Case(asic.chip_config(SMALL, 1, rom))
    model = replace(random_integer_model(case.config, 5), config=case.config)
    monkeypatch.setattr(asic, "CACHE", tmp_path / "chips")
    netlist = asic.netlist_of(case.config, model.arrays, process)
    nets, wire = Nets(netlist.module, process.cells), process.library.wire_loads["10k"]
    played = partial(asic.measured, model, nets, process.library.voltage, wire, 1e-6, case.recordings)
    whole = played()
    assert whole.bit_exact and whole.compared_values > 3 and whole.step_j > 0
    if rom:  # another model's weights are not in this chip
        other = replace(random_integer_model(case.config, 6), config=case.config)
        assert not asic.measured(other, *played.args[1:]).bit_exact
    # every stage, at the declared pace too, and as placed; one wrong cell is seen
    how = Simulation(
        level="netlist", target="asic", pdk="ihp-sg13g2", liberty=list(paths), rom=rom, cocotb=()
    )
    for pace in ("full", "declared"):
        at_pace = replace(how, pace=pace, clock_hz=1e6)
        played = cosimulate(model, case.recordings, at_pace, work=tmp_path / pace)
        assert played.passed and played.bulk_recordings == 2
        assert all(not row.mismatches for row in played.stages.values())
        assert {"sum", "feature", "state", "logit", "decision", "status"} <= {
            n for n, row in played.stages.items() if row.compared_values
        }
        assert played.without_probes.bit_exact
        assert played.cycles.step_max == schedule(case.config).step_cycles
    if cells == "tiny":  # registers begin at random there, too, before the reset
        on_icarus = replace(how, simulator="icarus")
        icarus = cosimulate(model, case.recordings, on_icarus, work=tmp_path / "icarus")
        assert icarus.passed and icarus.cocotb_recordings == 2
    monkeypatch.setattr(
        asic, "shorten_names", lambda text: text.replace("sg13g2_nand2_1 ", "sg13g2_nor2_1 ", 1)
    )
    wrong = cosimulate(model, case.recordings, replace(how, waves=False), work=tmp_path / "wrong")
    assert wrong.mismatches and not wrong.passed
