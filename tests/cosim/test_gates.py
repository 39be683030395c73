"""The compiled netlist of a chip: what states take at an edge that passes, and what every change is counted
with."""

import dataclasses
import random

import numpy as np
import pytest

from eskin.cosim.device import Device
from eskin.cosim.gates import Chip
from eskin.golden.core import SimulationError
from eskin.rtl.asic.liberty import WireLoad, read
from eskin.rtl.asic.nets import Nets, costs
from eskin.rtl.asic.synthesis import expression
from tests.rtl.asic.test_liberty import CELLS, GATE, file

CLK, D, EN, GCLK, A, B, X, L = range(2, 10)
"""Nets: d -> flip-flop a; behind the gate that en opens: flip-flop b of a ^ b, latch l of a."""

NO_MACROS = np.zeros(0), np.zeros(0)


def module():
    cells = {
        "a": {"type": "ff", "connections": {"CLK": [CLK], "D": [D], "R": ["1"], "Q": [A]}},
        "gate": {"type": "gate", "connections": {"C": [CLK], "E": [EN], "O": [GCLK]}},
        "x": {"type": "sg13g2_xor2_1", "connections": {"A": [A], "B": [B], "X": [X]}},
        "b": {"type": "ff", "connections": {"CLK": [GCLK], "D": [X], "R": ["1"], "Q": [B]}},
        "l": {"type": "la", "connections": {"G": [GCLK], "D": [A], "Q": [L]}},
    }
    ports = {
        name: {"direction": "input", "bits": [net]} for name, net in (("clk", CLK), ("d", D), ("en", EN))
    }
    ports |= {name: {"direction": "output", "bits": [net]} for name, net in (("a", A), ("b", B), ("l", L))}
    return {"cells": cells, "ports": ports}


@pytest.mark.timeout(1800)
def test_states_gates_and_what_changes_cost(tmp_path):
    cells = read(file(tmp_path, "cells.lib", CELLS + GATE)).cells
    chip = Chip(module(), cells, expression, seed=3, builds=tmp_path)
    assert chip.program.top is None and chip.program.gates == [GCLK]  # one flip-flop stands before the gate
    joule = np.zeros(2)
    change = np.zeros(chip.program.nets)
    change[[D, EN, A, B, X, L]] = 1, 1, 10, 100, 1000, 10000
    kinds = np.zeros(chip.program.nets, np.uint8), np.ones(1, np.uint8)
    chip.count_into(joule, (change, kinds[0], np.array([5.0]), kinds[1], *NO_MACROS))
    device = Device(chip)
    rng, a, b = random.Random(4), device.get("a"), device.get("b")
    seen, opened = None, 0
    for cycle in range(200):
        d, en = rng.getrandbits(1), rng.getrandbits(1)
        device.put("d", d)
        device.put("en", en)
        before = joule.copy()
        device.cycle()
        if en:  # b takes what a was; the latch is open when a is new
            b, l = a ^ b, d
        a = d
        x = a ^ b
        now = {"a": a, "b": b} | ({"l": l} if opened or en else {})
        assert {name: device.get(name) for name in now} == now, cycle
        if not opened and not en:
            l = device.get("l")
        opened += en
        values = np.array([d, en, a, b, x, l])
        if seen is not None:
            assert joule[0] - before[0] == (values != seen) @ change[[D, EN, A, B, X, L]]
            assert joule[1] - before[1] == 5 * en
        seen = values


@pytest.mark.parametrize("seen", ["Q", "QN"])
def test_a_flip_flop_with_an_enable_of_its_own(tmp_path, seen):
    cells = dict(read(file(tmp_path, "cells.lib", CELLS + GATE)).cells)
    ff = cells["ff"]
    pins = ff.pins | {
        "DE": dataclasses.replace(ff.pins["D"]),
        "QN": dataclasses.replace(ff.pins["Q"], function="IQN"),
    }
    cells["edf"] = dataclasses.replace(
        ff, name="edf", pins=pins, state=ff.state | {"next_state": "(D*DE)+(IQ*!DE)"}
    )
    of = {"e": {"type": "edf", "connections": {"CLK": [CLK], "D": [D], "DE": [EN], "R": ["1"], seen: [A]}}}
    ports = {
        name: {"direction": "input", "bits": [net]} for name, net in (("clk", CLK), ("d", D), ("en", EN))
    }
    device = Device(
        Chip(
            {"cells": of, "ports": ports | {"a": {"direction": "output", "bits": [A]}}},
            cells,
            expression,
            seed=1,
        )
    )
    rng, state = random.Random(3), None
    for _ in range(100):
        d, en = rng.getrandbits(1), rng.getrandbits(1)
        device.put("d", d)
        device.put("en", en)
        device.cycle()
        state = d if en else state
        assert state is None or device.get("a") == (state if seen == "Q" else 1 - state)


def glitching(tmp_path, first_s: float, second_s: float):
    """x = a ^ y with y = a ^ 0: nothing from cycle to cycle, a pulse while y is late. ``first_s``: delay of
    y; ``second_s``: of x."""
    cells = dict(read(file(tmp_path, "cells.lib", CELLS + GATE)).cells)
    for name, seconds in (("first", first_s), ("second", second_s)):
        xor = cells["sg13g2_xor2_1"]
        cells[name] = dataclasses.replace(
            xor, name=name, pins=xor.pins | {"X": dataclasses.replace(xor.pins["X"], delay_s=seconds)}
        )
    of = {
        "a": {"type": "ff", "connections": {"CLK": [CLK], "D": [D], "R": ["1"], "Q": [A]}},
        "y": {"type": "first", "connections": {"A": [A], "B": ["0"], "X": [B]}},
        "x": {"type": "second", "connections": {"A": [A], "B": [B], "X": [X]}},
    }
    ports = {name: {"direction": "input", "bits": [net]} for name, net in (("clk", CLK), ("d", D))}
    return {"cells": of, "ports": ports | {"x": {"direction": "output", "bits": [X]}}}, cells


@pytest.mark.parametrize("first_s, second_s, pulses", [(4e-12, 2e-12, 1), (2e-12, 4e-12, 0)])
def test_a_pulse_counts_apart_unless_it_is_shorter_than_the_cell_is_slow(tmp_path, first_s, second_s, pulses):
    module, cells = glitching(tmp_path, first_s, second_s)
    chip = Chip(module, cells, expression, seed=1, delays=True)
    joule = np.zeros(2)
    change = np.zeros(chip.program.nets)
    change[X], change[A] = 1.0, 10.0
    chip.count_into(joule, (change, np.zeros(chip.program.nets), np.zeros(1), np.zeros(1), *NO_MACROS))
    device = Device(chip)
    rng, last, seen = random.Random(2), None, 0
    for cycle in range(100):
        d = rng.getrandbits(1)
        device.put("d", d)
        device.cycle()
        assert device.get("x") == 0
        if cycle == 0:
            joule[:] = 0
        else:
            seen += d != last
        last = d
    assert seen > 30 and joule.tolist() == [10 * seen, 2 * pulses * seen]


def test_a_netlist_that_never_rests_is_an_error(tmp_path):
    module, cells = glitching(tmp_path, 1e-12, 1e-12)
    module["cells"]["gate"] = {"type": "gate", "connections": {"C": [CLK], "E": ["1"], "O": [GCLK]}}
    for name, kind, pins in (
        ("l", "la", {"G": [GCLK], "D": [EN], "Q": [L]}),
        ("n", "second", {"A": [L], "B": ["1"], "X": [EN]}),
    ):
        module["cells"][name] = {"type": kind, "connections": pins}  # an open latch of its own opposite
    for delays in (False, True):
        with pytest.raises(SimulationError, match="settle"):
            Device(Chip(module, cells, expression, seed=1, delays=delays)).cycle()


def test_costs_of_a_netlist(tmp_path):
    cells = read(file(tmp_path, "cells.lib", CELLS + GATE)).cells
    wire = WireLoad(lengths={1: 2.0}, slope=1.0, farad=1e-15)
    found = costs(Nets(module(), cells), 2.0, wire)
    assert found.kind == {
        D: "input",
        EN: "input",
        GCLK: "clock",
        A: "flip-flop",
        B: "flip-flop",
        X: "logic",
        L: "latch",
    }
    # wires alone: half of C V^2 a change, C V^2 and both edges a cycle; 2 fF of one receiver, 3 of two
    assert found.joule[X] == pytest.approx(2e-15 * 2**2 / 2) and found.joule[A] == pytest.approx(
        3e-15 * 2**2 / 2
    )
    assert found.joule[GCLK] == pytest.approx(3e-15 * 2**2) and found.root_j == pytest.approx(3e-15 * 2**2)
