"""The list scheduler: what must hold for any program on any number of lanes, and the reference's cycles
against the ideal."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from eskin.rtl.program import cells
from eskin.rtl.program.cells import cell_program, in_one_phase
from eskin.rtl.program.schedule import decision_cycles, lowest_clock_hz, schedule, step_cycles
from eskin.rtl.program.scheduler import RowGroup, Schedule
from tests.rtl.engine.test_engine import small
from tests.support.small_designs import CELLS, reference
from tests.support.strategies import examples
from tests.support.table import each_row


@each_row("lanes, limit", [(1, 1.04), (2, 1.02), (4, 1.04), (6, 1.10), (12, 1.54)])
@each_row("cell", CELLS)
def test_reference_cycles_against_the_ideal(cell, lanes, limit):
    plan = schedule(reference(*cell, lanes=lanes))
    assert plan.step_cycles <= limit * plan.config.step_ideal
    close = plan.config.replace(hop=4, window=8)  # steps that take longer than the frames of a hop
    assert lowest_clock_hz(close) >= step_cycles(close) * close.sensor.sample_rate_hz / 4


CONFIGURATIONS = given(
    cell=st.sampled_from(CELLS),
    lanes=st.integers(1, 16),
    hidden=st.integers(4, 32),
    taxels=st.integers(4, 40),
    classes=st.integers(2, 32),
    lane_type=st.sampled_from(["plain", "dsp"]),
)


def planned(cell, lanes, hidden, taxels, classes, lane_type) -> Schedule:
    names = tuple(f"class{k}" for k in range(classes))
    return schedule(
        reference(*cell, lanes, hidden=hidden, taxels=taxels, class_names=names, lane_type=lane_type)
    )


def lasts_of(plan: Schedule) -> list[tuple[int, RowGroup]]:
    """(slot from the start of phase A, group) of every group's last element."""
    phases = [(op, 0) for op in plan.mac_before] + [(op, plan.slots_before) for op in plan.mac_after]
    return [(base + op.cycle, plan.groups[op.group]) for op, base in phases if op.last]


@examples(40, 400)
@CONFIGURATIONS
def test_every_multiply_is_placed_once_and_no_hazard_is_left(cell, lanes, hidden, taxels, classes, lane_type):
    plan = planned(cell, lanes, hidden, taxels, classes, lane_type)
    timing, base = plan.timing, plan.slots_before

    # every weight of every matrix once
    read = [
        (matrix, group.first_row + lane, column)
        for group, matrix, column in plan.weight_words
        for lane in range(group.rows)
    ]
    shapes = {"W": (hidden, taxels), "U": (hidden, hidden), "V": (classes, hidden)}
    wanted = {
        (m, row, column)
        for m in {r[0] for r in read}
        for row in range(shapes[m[0]][0])
        for column in range(shapes[m[0]][1])
    }
    assert len(read) == len(set(read)) and set(read) == wanted

    # one lane issue and one element issue a slot; with one multiplier one of either; a gap where an
    # accumulator is loaded separately
    rows = [(op.cycle, op) for op in plan.mac_before] + [(base + op.cycle, op) for op in plan.mac_after]
    assert all(two >= first + 1 + timing.gap * second.first for (first, _), (two, second) in pairwise(rows))
    elements = [(base + issue.cycle, issue) for issue in plan.elements]
    assert all(
        two >= first + 1 + plan.element_gap * (second.term == 0)
        for (first, _), (two, second) in pairwise(elements)
    )
    if plan.shared:
        assert lane_type == "plain" or plan.element_gap == 1
        on_the_lane = sorted(
            [(slot, op.first, op.group) for slot, op in rows]
            + [(slot, i.term == 0, None) for slot, i in elements]
        )
        for (begin, _, group), (two, begins, other) in pairwise(on_the_lane):
            assert two >= begin + 1 + timing.gap * begins
            assert begins or group == other, "an element-wise operation between the elements of a dot product"

    # the chain is empty when the next sums come, and the table has one index a slot
    lasts = lasts_of(plan)
    if timing.chain:
        assert all(two >= first + group.rows for (first, group), (two, _) in pairwise(lasts))
    tabled = [(slot, group) for slot, group in lasts if group.block.dest in ("sigmoid", "tanh")]
    table = [slot + timing.row + row for slot, group in tabled for row in range(group.rows)]
    final = {(i.op.name, i.index): slot for slot, i in elements if i.term == len(i.op.terms) - 1}
    activating = {op.name for op in plan.program.elements if op.activated}
    table += [slot + timing.element_to_table for (name, _), slot in final.items() if name in activating]
    assert len(table) == len(set(table))
    written = [slot + 1 for slot in table] + [
        slot + timing.row + row
        for slot, group in lasts
        if group.block.dest == "value"
        for row in range(group.rows)
    ]
    assert len(written) == len(set(written)), "gate and T memory share their address"

    # operands of rows: features and other new states are read after they were written, old ones before
    makers = {"x": set(), "rh": {"r"}, "c": set("ifg"), "h": set("z n hn wx i f g o r".split())}
    if cell == ("gru", "before"):
        makers["h"] = {"z", "n"}  # r acts through rh, which is new when n reads it
    blocks = [block.name for block in plan.program.after]
    for region, names in cells.makers(plan.program).items():
        assert names & set(blocks) == makers[region] & set(blocks)
    for op in plan.program.elements:
        for index in range((taxels if op.state == "x" else hidden) if op.state else 0):
            there = final[op.name, index] + timing.element_to_state
            for slot, row in rows:
                if (row.region, row.index) != (op.state, index):
                    continue
                position = blocks.index(plan.groups[row.group].block.name) if slot >= base else -1
                new = all(blocks.index(name) < position for name in makers[op.state] & set(blocks))
                assert slot >= there if new else slot < there, (op.name, index, row)
    # gates and T values are there for the element-wise operations
    delay = {"sigmoid": timing.row_to_gate, "tanh": timing.row_to_gate, "value": timing.row_to_stored}
    gates = {
        (group.block.region, group.first_row + row): slot + delay[group.block.dest] + row
        for slot, group in lasts
        if group.block.dest in delay
        for row in range(group.rows)
    }
    gates |= {
        (op.activated, i): final[op.name, i] + timing.element_to_activated
        for op in plan.program.elements
        if op.activated
        for i in range(hidden)
    }
    for slot, issue in elements:
        a, b = issue.op.terms[issue.term]
        added = [issue.op.add] if issue.op.add and issue.term == 0 else []
        for region in [b, *added, *(part[2:] for part in a.split("-") if part.startswith("T."))]:
            if (region, issue.index) in gates:
                assert gates[region, issue.index] <= slot

    # the step is over when its last results are written
    assert base + plan.slots_after >= max(
        *written, base + plan.decision_slots, *(s + timing.element_to_state - 1 for s in final.values())
    )


@each_row("cell", CELLS)
def test_one_phase_computes_the_same_rows_without_partial_sums(cell):
    """What one DSP lane runs: every weight once, the old state read before the new one is written, no addend
    that is computed."""
    two, in_block = schedule(reference(*cell, lanes=1)), schedule(reference(*cell, lanes=1, lane_type="dsp"))
    assert in_block.program == in_one_phase(two.program) == cell_program(in_block.config)
    assert cell_program(two.config.replace(one_phase=True)) == in_block.program
    assert not (in_block.mac_before or in_block.partial_rows or in_block.slots_before) and two.partial_rows
    words = (sorted((m, g.first_row, c) for g, m, c in plan.weight_words) for plan in (in_block, two))
    assert next(words) == next(words)
    assert in_block.decision_cycles > two.decision_cycles


def test_the_last_decision_of_a_whole_touch_where_steps_take_longest():
    """The detector, a store to halve, a window that leaves, two steps beside which others leave, the last one."""
    whole = small("gru", "before", 2, window_mode="whole", decision="last")
    assert decision_cycles(whole) == 1 + 132 + 85 + 2 * 130 + 94 == 4 * lowest_clock_hz(whole) / 3000
