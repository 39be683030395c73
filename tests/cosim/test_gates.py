"""A chip's netlist in tables against what its cells mean, cycle by cycle, and what its changes cost."""

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
NO_MACROS = np.zeros(0), np.zeros(0)


def netlist(ports: dict, **cells) -> dict:
    """A module of ``name=(type, pin -> net)``; ports: name -> net."""
    placed = {
        name: {"type": kind, "connections": {pin: [net] for pin, net in pins.items()}}
        for name, (kind, pins) in cells.items()
    }
    shown = {name: {"direction": "input", "bits": [net]} for name, net in ({"clk": CLK} | ports).items()}
    for name in shown.keys() & {*"abxl"}:
        shown[name]["direction"] = "output"
    return {"cells": placed, "ports": shown}


def flop(clock: int, data: int, q: int) -> tuple[str, dict]:
    return "ff", {"CLK": clock, "D": data, "R": "1", "Q": q}


GATED = netlist(
    dict(d=D, en=EN, a=A, b=B, l=L),
    a=flop(CLK, D, A),
    gate=("gate", {"C": CLK, "E": EN, "O": GCLK}),
    x=("sg13g2_xor2_1", {"A": A, "B": B, "X": X}),
    b=flop(GCLK, X, B),
    l=("la", {"G": GCLK, "D": A, "Q": L}),
)
"""d -> flip-flop a; behind the gate that en opens: flip-flop b of a ^ b, latch l of a."""


@pytest.fixture
def cells(tmp_path):
    return dict(read(file(tmp_path, "cells.lib", CELLS + GATE)).cells)


@pytest.fixture
def step():
    """``step(device, names)``: a cycle with these inputs at random; their values."""
    rng = random.Random(4)

    def drawn(device: Device, *names: str) -> list[int]:
        values = [rng.getrandbits(1) for _ in names]
        for name, value in zip(names, values, strict=True):
            device.put(name, value)
        device.cycle()
        return values

    return drawn


@pytest.mark.timeout(1800)
def test_states_gates_and_what_changes_cost(cells, step, tmp_path):
    chip = Chip(GATED, cells, expression, seed=3, builds=tmp_path)
    assert chip.top is None and chip.gates == [GCLK]  # one flip-flop stands before the gate
    nets, joule, change = [D, EN, A, B, X, L], np.zeros(2), np.zeros(chip.nets)
    change[nets] = 1, 1, 10, 100, 1000, 10000
    kinds = np.zeros(chip.nets, np.uint8), np.ones(1, np.uint8)
    chip.count_into(joule, (change, kinds[0], np.array([5.0]), kinds[1], *NO_MACROS))
    device = Device(chip)
    a, b, seen, opened = device.get("a"), device.get("b"), None, 0
    for cycle in range(200):
        before = joule.copy()
        d, en = step(device, "d", "en")
        if en:  # b takes what a was; the latch is open when a is new
            b, l = a ^ b, d
        a = d
        now = {"a": a, "b": b} | ({"l": l} if opened or en else {})
        assert {name: device.get(name) for name in now} == now, cycle
        l = device.get("l")
        opened += en
        values = np.array([d, en, a, b, a ^ b, l])
        if seen is not None:
            assert (joule - before).tolist() == [(values != seen) @ change[nets], 5 * en]
        seen = values


@pytest.mark.parametrize("seen", ["Q", "QN"])
def test_a_flip_flop_with_an_enable_of_its_own(cells, step, seen):
    ff = cells["ff"]
    pins = ff.pins | {"DE": ff.pins["D"], "QN": dataclasses.replace(ff.pins["Q"], function="IQN")}
    state = ff.state | {"next_state": "(D*DE)+(IQ*!DE)"}
    cells["edf"] = dataclasses.replace(ff, name="edf", pins=pins, state=state)
    one = ("edf", {"CLK": CLK, "D": D, "DE": EN, "R": "1", seen: A})
    device = Device(Chip(netlist(dict(d=D, en=EN, a=A), e=one), cells, expression, seed=1))
    held = None
    for _ in range(100):
        d, en = step(device, "d", "en")
        held = d if en else held
        assert held is None or device.get("a") == (held if seen == "Q" else 1 - held)


def glitching(cells, first_s: float, second_s: float, **others) -> dict:
    """x = a ^ y with y = a ^ 0: nothing from cycle to cycle, a pulse while y is late. ``first_s``: delay of
    y; ``second_s``: of x."""
    for name, seconds in (("first", first_s), ("second", second_s)):
        xor = cells["sg13g2_xor2_1"]
        pins = xor.pins | {"X": dataclasses.replace(xor.pins["X"], delay_s=seconds)}
        cells[name] = dataclasses.replace(xor, name=name, pins=pins)
    y, x = ("first", {"A": A, "B": "0", "X": B}), ("second", {"A": A, "B": B, "X": X})
    return netlist(dict(d=D, x=X), a=flop(CLK, D, A), y=y, x=x, **others)


@pytest.mark.parametrize("first_s, second_s, pulses", [(4e-12, 2e-12, 1), (2e-12, 4e-12, 0)])
def test_a_pulse_counts_apart_unless_it_is_shorter_than_the_cell_is_slow(
    cells, step, first_s, second_s, pulses
):
    chip = Chip(glitching(cells, first_s, second_s), cells, expression, seed=1, delays=True)
    joule, change = np.zeros(2), np.zeros(chip.nets)
    change[X], change[A] = 1.0, 10.0
    chip.count_into(joule, (change, np.zeros(chip.nets), np.zeros(1), np.zeros(1), *NO_MACROS))
    device, seen = Device(chip), 0
    (last,) = step(device, "d")
    joule[:] = 0
    for _ in range(100):
        (d,) = step(device, "d")
        assert device.get("x") == 0
        seen, last = seen + (d != last), d
    assert seen > 30 and joule.tolist() == [10 * seen, 2 * pulses * seen]


@pytest.mark.parametrize("delays", [False, True])
def test_a_netlist_that_never_rests_is_an_error(cells, delays):
    others = dict(
        gate=("gate", {"C": CLK, "E": "1", "O": GCLK}),  # an open latch of its own opposite
        l=("la", {"G": GCLK, "D": EN, "Q": L}),
        n=("second", {"A": L, "B": "1", "X": EN}),
    )
    module = glitching(cells, 1e-12, 1e-12, **others)
    with pytest.raises(SimulationError, match="settle"):
        Device(Chip(module, cells, expression, seed=1, delays=delays)).cycle()


def test_costs_of_a_netlist(cells):
    wire = WireLoad(lengths={1: 2.0}, slope=1.0, farad=1e-15)
    found = costs(Nets(GATED, cells), 2.0, wire)
    kinds = {D: "input", EN: "input", GCLK: "clock", A: "flip-flop", B: "flip-flop", X: "logic", L: "latch"}
    assert found.kind == kinds
    # wires alone: half of C V^2 a change, C V^2 and both edges a cycle; 2 fF of one receiver, 3 of two
    joule = {X: 2e-15 * 2**2 / 2, A: 3e-15 * 2**2 / 2, GCLK: 3e-15 * 2**2}
    assert {net: found.joule[net] for net in joule} == pytest.approx(joule)
    assert found.root_j == pytest.approx(3e-15 * 2**2)
