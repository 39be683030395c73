"""The list scheduler: what must hold for any program on any number of lanes, and the reference's cycles against the ideal."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from golden.config import PRESETS, AcceleratorConfig
from golden.formats import QFormat
from rtl.schedule import ELEMENT_TO_STATE, ROW_TO_ADDEND, ROW_TO_GATE, ROW_TO_PARTIAL, ROW_TO_TABLE, Run, element_slots, schedule

CELLS = [("gru", "before"), ("gru", "after"), ("lstm", "before")]


def reference(cell: str = "gru", reset: str = "before", lanes: int = 4, **changes) -> AcceleratorConfig:
    return PRESETS["thesis"].replace(cell=cell, reset=reset, lanes=lanes, state_format=QFormat(4, 12), **changes)


@pytest.mark.parametrize(("lanes", "limit"), [(1, 1.15), (2, 1.15), (4, 1.15), (6, 1.15), (12, 1.40)])
def test_reference_cycles_against_the_ideal(lanes, limit):
    """Issue 2 asks 1.25 for P = 1, 2, 4; the next asks these."""
    plan = schedule(reference(lanes=lanes))
    assert plan.step_cycles <= limit * plan.config.step_ideal


@settings(max_examples=60, derandomize=True, deadline=None)
@given(
    cell=st.sampled_from(CELLS), lanes=st.integers(1, 16), hidden=st.integers(4, 32), taxels=st.integers(4, 40),
    classes=st.integers(2, 32), lane_type=st.sampled_from(["plain", "serial"]),
)  # fmt: skip
def test_every_multiply_is_placed_once_and_no_hazard_is_left(cell, lanes, hidden, taxels, classes, lane_type):
    names = tuple(f"class{k}" for k in range(classes))
    plan = schedule(reference(*cell, lanes, hidden=hidden, taxels=taxels, class_names=names, lane_type=lane_type))
    slots = element_slots(plan.config)
    phases = [(op, False) for op in plan.mac_before] + [(op, True) for op in plan.mac_after]

    # every weight of every matrix once
    read = [
        (matrix, group.first_row + lane, column) for group, matrix, column in plan.weight_words for lane in range(group.rows)
    ]
    shapes = {"W": (hidden, taxels), "U": (hidden, hidden), "V": (classes, hidden)}
    wanted = {(m, row, column) for m in {r[0] for r in read} for row in range(shapes[m[0]][0]) for column in range(shapes[m[0]][1])}
    assert len(read) == len(set(read)) and set(read) == wanted

    # one lane issue and one element issue a cycle; with one multiplier one of either
    for after in (False, True):
        cycles = [op.cycle for op, phase in phases if phase == after]
        assert len(cycles) == len(set(cycles))
    element_cycles = [issue.cycle for issue in plan.elements]
    assert all(two >= one + slots for one, two in pairwise(element_cycles))
    if plan.shared:
        assert not set(element_cycles) & {op.cycle for op in plan.mac_after}

    # capture registers, table port
    base = plan.slots_before
    lasts = [(op.cycle + (base if after else 0), plan.groups[op.group]) for op, after in phases if op.last]
    for (one, group), (two, _) in pairwise(lasts):
        assert two >= one + group.rows
    table = [
        cycle + ROW_TO_TABLE + row for cycle, group in lasts if group.block.dest not in ("partial", "logit") for row in range(group.rows)
    ]
    final = {(i.op.name, i.index): base + i.cycle + slots - 1 for i in plan.elements if i.term == len(i.op.terms) - 1}
    table += [cycle + 4 for (name, _), cycle in final.items() if next(o for o in plan.program.elements if o.name == name).activated]
    assert len(table) == len(set(table))

    # partial sums are there when their addend is addressed
    partial_ready = {group.dest + row: cycle + ROW_TO_PARTIAL + row for cycle, group in lasts if group.block.dest == "partial"
                     for row in range(group.rows)}  # fmt: skip
    for cycle, group in lasts:
        if not group.block.bias:
            assert all(partial_ready[group.addend + row] <= cycle + ROW_TO_ADDEND + row for row in range(group.rows))

    # operands of rows: features and other new states are read after they were written
    state_ready = {(op.state, index): final[op.name, index] + ELEMENT_TO_STATE for op in plan.program.elements if op.state
                   for index in range(taxels if op.state == "x" else hidden)}  # fmt: skip
    for op, after in phases:
        if after:
            assert state_ready[op.region, op.index] <= base + op.cycle
    gates = {(group.block.region, group.first_row + row): cycle + ROW_TO_GATE + row for cycle, group in lasts
             if group.block.dest in ("sigmoid", "tanh", "value") for row in range(group.rows)}  # fmt: skip
    for issue in plan.elements:
        a, b = issue.op.terms[issue.term]
        for region in [b, *(part[2:] for part in a.split("-") if part.startswith("T."))]:
            if (region, issue.index) in gates:
                assert gates[region, issue.index] <= base + issue.cycle


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("lanes", [1, 4])
def test_runs_unpack_to_the_placed_operations(cell, lanes):
    """What the sequencers execute is what was scheduled, cycle by cycle."""
    plan = schedule(reference(*cell, lanes))
    held = {issue.cycle for issue in plan.elements} if plan.shared else set()
    runs, _ = plan.mac_runs
    placed = []
    time = 0
    for run in runs[next(k for k, run in enumerate(runs) if run.wait) :]:
        for k in range(run.length):
            while time in held:
                time += 1
            if run.op is not None:
                placed.append((time, run.op, run.index + k, run.first and k == 0, run.last and k == run.length - 1))
            time += 1
    assert placed == [(op.cycle, op.region, op.index, op.first, op.last) for op in plan.mac_after]
    elements, again = plan.element_runs
    unpacked, time = [], 0
    for run in elements[again:]:
        for k in range(run.length):
            if run.op is None:
                time += 1
                continue
            for term in range(len(run.op.terms)):
                unpacked.append((time, run.op.name, term, run.index + k))
                time += element_slots(plan.config)
    assert unpacked == [(i.cycle, i.op.name, i.term, i.index) for i in plan.elements]
    assert time == plan.slots_after
    assert [run.wait for run in elements[again:]] == [True] + [False] * (len(elements) - again - 1)
    assert [run.end for run in elements].count(True) == 1 and isinstance(elements[0], Run)
