"""The list scheduler, which turns a cell's program into cycles.

A cell is a `CellProgram`: blocks of rows (matrix-vector products) for the lanes, and element-wise operations
for the element-wise lane. `schedule` places every multiply of one recurrent step in a slot, by the pipeline's
latencies. rtl/program/microcode.py turns the placed operations into the words that the sequencer runs. The
cycle count of a step is read off the result; nothing is estimated. The cells' formulas stand in
docs/specification.md, section 5.

A step has two phases. Phase A needs only the old state and starts as soon as the step before has ended; phase
B starts when the features' window is complete. Partial sums of phase A wait in the addend memory at full
accumulator width.
"""

from dataclasses import dataclass
from functools import cached_property

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.program.cells import CellProgram, ElementOp, RowBlock, reads_new_state, row_count
from eskin.rtl.program.timing import Timing, logit_to_decision, shares_lane


@dataclass(frozen=True)
class RowGroup:
    """Up to P rows of a block, one a lane, that share their operands' order."""

    block: RowBlock
    first_row: int
    rows: int
    addend: int  # address of row 0's addend
    dest: int  # address (addend memory) or index (other memories) of row 0's result


@dataclass(frozen=True)
class MacOp:
    """One cycle of the lanes: element ``index`` of ``region`` times each lane's weight."""

    cycle: int
    group: int
    term: int
    region: str
    index: int
    first: bool
    last: bool


@dataclass(frozen=True)
class ElementIssue:
    """One cycle of the element-wise lane."""

    cycle: int
    op: ElementOp
    term: int
    index: int


def element_gap(config: AcceleratorConfig, program: CellProgram, shared: bool) -> int:
    """Slots lost between two element-wise operations, on a lane of their own or (``shared``) on the rows'."""
    accumulates = shared or any(len(op.terms) > 1 for op in program.elements)
    return Timing(config).gap if accumulates else 0


@dataclass(frozen=True)
class Schedule:
    """A scheduled step. All ``cycle`` fields and counts called slots count slots from the phase's first."""

    config: AcceleratorConfig
    program: CellProgram
    groups: tuple[RowGroup, ...]
    mac_before: tuple[MacOp, ...]
    mac_after: tuple[MacOp, ...]
    elements: tuple[ElementIssue, ...]
    slots_before: int
    slots_after: int
    bias_rows: tuple[tuple[RowBlock, int], ...]  # (block, row) of each addend word that is loaded
    partial_rows: int
    # several lanes: slots, from phase A's first, in which chain and accumulators change places
    swaps: tuple[int, ...] = ()
    # (group, slot of its row 0's address): addends on their way into the chain
    fills: tuple[tuple[int, int], ...] = ()
    shifts: frozenset[int] = frozenset()  # slots in which the chain moves on
    shared: bool = False  # one multiplier serves lanes and element-wise operations

    @property
    def timing(self) -> Timing:
        """Latencies of the lanes."""
        return Timing(self.config)

    @property
    def element_gap(self) -> int:
        """Slots lost between two element-wise operations: none where their lane never adds two products
        up."""
        return element_gap(self.config, self.program, self.shared)

    @property
    def half_address(self) -> int:
        """Address of the rounding half of element-wise operations in the addend memory, where rows and they
        share a lane."""
        return len(self.bias_rows) + self.partial_rows

    @property
    def zero_address(self) -> int:
        """Address of the addend 0 of a program with T values. From it the prologue makes the T memory's word
        for 0."""
        return self.half_address + int(self.shared)

    @property
    def constant_addends(self) -> list[int]:
        """Addresses of addends that no step writes."""
        return [*range(len(self.bias_rows)), *([self.half_address] if self.shared else [])]

    @property
    def addend_words(self) -> int:
        """Words of the addend memory: biases, partial sums, the half of a shared lane, a 0 where there are T
        values."""
        return self.zero_address + int(bool(self.program.t_regions))

    @property
    def decision_slots(self) -> int:
        """Slots from the start of phase B to the slot in which the last logit is taken."""
        last = max(op.cycle for op in self.mac_after if op.last)
        return last + self.timing.row + self.groups[-1].rows - 1

    @property
    def decision_cycles(self) -> int:
        """Cycles from the start of phase B to the cycle in which the decision is offered."""
        return self.decision_slots + logit_to_decision(self.config)

    @property
    def step_cycles(self) -> int:
        """Cycles of one step: both phases' issue, and the way of the last logit to the decision."""
        return self.slots_before + self.decision_slots + logit_to_decision(self.config)

    @property
    def busy_share(self) -> float:
        """Share of the lane cycles of a step in which a lane multiplies for a real row."""
        return self.weights / (self.config.hardware.lanes * self.step_cycles)

    @property
    def weights(self) -> int:
        """Weights that a step uses; the network has ``config.sets`` times as many."""
        return sum(self.groups[op.group].rows for op in (*self.mac_before, *self.mac_after))

    def beside(self, op: MacOp) -> bool:
        """True where the operation's weight lies beside the constants.

        That is a recurrent cell's dense layer on a shared lane, which reads constants anyway. The recurrent
        weights alone often just fill their block memories.
        """
        block = self.groups[op.group].block
        return self.shared and block.dest == "logit" and not block.carried

    @cached_property
    def weight_words(self) -> tuple[tuple[RowGroup, str, int], ...]:
        """For each word of the weight memories that a step reads, in address order: the group, the matrix and
        the column its lanes read."""
        ops = [op for op in (*self.mac_before, *self.mac_after) if not self.beside(op)]
        return tuple(
            (self.groups[op.group], self.groups[op.group].block.terms[op.term][0], op.index) for op in ops
        )

    @property
    def weight_depth(self) -> int:
        """Words of a weight memory: `weight_words` for every set of weights, one after the other."""
        return self.config.sets * len(self.weight_words)


def groups_of(config: AcceleratorConfig, program: CellProgram):
    """Row groups in issue order, the addend memory's loaded rows, and the number of partial rows behind
    them."""
    blocks = (*program.before, *program.after)
    bias_rows = tuple(
        (block, row) for block in blocks if block.bias for row in range(row_count(config, block))
    )
    bias_base: dict[str, int] = {}
    for address, (block, row) in enumerate(bias_rows):
        bias_base.setdefault(block.name, address - row)
    partial_base = {}
    partial_rows = 0
    for block in blocks:
        if block.dest == "partial" or block.carried:
            partial_base[block.name if block.carried else block.region] = len(bias_rows) + partial_rows
            partial_rows += row_count(config, block)
    groups = []
    for block in blocks:
        addend = bias_base[block.name] if block.bias and not block.carried else partial_base[block.name]
        dest = partial_base[block.region] if block.dest == "partial" else 0
        total = row_count(config, block)
        for row in range(0, total, config.hardware.lanes):
            groups.append(
                RowGroup(block, row, min(config.hardware.lanes, total - row), addend + row, dest + row)
            )
    return tuple(groups), bias_rows, partial_rows


class Scheduler:
    """Slot-by-slot list scheduling: rows in program order, element-wise operations as soon as their operands
    are ready.

    Slots are counted from the start of phase A through phase B: while the engine waits for the window between
    them, no slot passes. Where a row and an element-wise operation want the table in one slot, the operation
    that was issued first has it. With ``yields`` an element-wise operation waits for a group that ends within
    AHEAD slots.
    """

    NEVER, AHEAD, LONGEST = 10**9, 4, 10**6

    def __init__(self, config: AcceleratorConfig, program: CellProgram, yields: bool = False):
        self.config, self.program, self.yields = config, program, yields
        self.groups, self.bias_rows, self.partial_rows = groups_of(config, program)
        self.shared = shares_lane(config)
        self.timing = Timing(config)
        self.element_gap = element_gap(config, program, self.shared)
        # (group, term, region, index) of each product of the rows, in program order; the next one to place
        self.products = [
            (g, term, region, index)
            for g, group in enumerate(self.groups)
            for term, (_, region) in enumerate(group.block.terms)
            for index in self._indices(region)
        ]
        self.position = 0
        self.last_old = {  # region -> last product that reads its old state: no new state before that
            region: k for k, (g, _, region, _) in enumerate(self.products) if not self._reads_new(g, region)
        }
        self.start = 0  # first slot of the phase; operations that are placed count from it
        self.rows: list[MacOp] = []
        self.issues: list[ElementIssue] = []
        self.pending: list[tuple[ElementOp, int]] = []  # element-wise operations that wait, with their index
        self.second_term: tuple[ElementOp, int] | None = None  # its second product has to follow its first
        self.element_free = 0  # first slot in which an element-wise operation may be issued
        # (region, index) of the state that this step writes -> slot from which it can be read
        self.new_state: dict[tuple[str, int], int] = {}
        # slots in which the table is used; its result is written in the next
        self.table_busy: set[int] = set()
        # (memory, region, index) -> first slot in which it can be addressed
        self.ready: dict[tuple[str, str, int], int] = {}
        self.lane_free = 0  # first slot in which a dot product may begin
        # Chain of several lanes: when a step begins, group 0 is loaded. Group 1's addends are in the chain if
        # they are constants.
        self.last_swap = 0
        self.last_capture = (-1, 0)  # slot and rows of the newest captured group
        # group -> first slot of a swap that loads it; numbers go on into the next step's groups
        self.filled: dict[int, int] = {}
        self.finished: set[int] = set()
        self.late: set[int] = set()  # groups whose addends come after the group before was captured
        self.swaps: list[int] = []
        self.fills: list[tuple[int, int]] = []
        self.shifts: set[int] = set()
        second = self.groups[1:2]
        self.second_waits = bool(self.timing.chain and second and second[0].block.bias)
        if self.second_waits:
            self.filled[1] = 0

    def run(self) -> Schedule:
        for group in self.groups:
            if not group.block.bias:
                self.ready |= {("P", "", group.addend + row): self.NEVER for row in range(group.rows)}
        before = sum(self.groups[g].block in self.program.before for g, *_ in self.products)
        self.start = self._place(before)
        self.pending = [(op, index) for op in self.program.elements for index in self._indices(op.state)]
        # A result of this step is NEVER ready until it is placed: the memory still holds the step before's.
        for op, index in self.pending:
            for memory, region in (("S", op.state), ("T", op.activated)):
                if region and not self._reads_old(region):
                    self.ready[memory, region, index] = self.NEVER
        for block in self.program.after:
            if block.dest in ("sigmoid", "tanh", "value"):
                for index in range(self.config.network.hidden):
                    self.ready["B" if block.dest == "sigmoid" else "T", block.region, index] = self.NEVER
        end = self._place(len(self.products))
        # The step ends when its last logit is out, all that it writes can be read and the chain holds what the
        # next one begins with.
        last_slot, last_rows = self.last_capture
        end = max(end, last_slot + self.timing.chain + last_rows, *self.ready.values())
        if len(self.groups) in self.late:
            self._swap_late(len(self.groups))
            end = max(end, self.last_swap + 1)
        # group number len(groups) + 1 is group 1 of the next step
        if self.second_waits:
            self._fill(len(self.groups) + 1)
            end = max(end, self.filled[len(self.groups) + 1])
        return Schedule(
            self.config,
            self.program,
            self.groups,
            tuple(self.rows[:before]),
            tuple(self.rows[before:]),
            tuple(self.issues),
            self.start,
            end - self.start,
            self.bias_rows,
            self.partial_rows,
            tuple(self.swaps),
            tuple(self.fills),
            frozenset(self.shifts),
            self.shared,
        )

    def _indices(self, region: str) -> range:
        return range(self.config.inputs if region == "x" else self.config.network.hidden)

    def _reads_old(self, region: str) -> bool:
        """True when an operation of this step reads the old content of a state region."""
        return any(
            f"S.{region}" in term[0].split("-") for element in self.program.elements for term in element.terms
        )

    def _reads_new(self, g: int, region: str) -> bool:
        """Group ``g`` reads the state of ``region`` that this step writes."""
        return reads_new_state(self.program, self.groups[g].block, region)

    def _operands(self, op: ElementOp, term: int, index: int):
        a, b = op.terms[term]
        for part in a.split("-"):
            if part != "X":
                yield (*part.split("."), index)
        if b in self.program.gate_regions:
            yield "B", b, index
        if op.add and term == 0:
            yield "T", op.add, index

    # ------------------------------------------------------------------ one phase
    def _place(self, products: int) -> int:
        """Place the products up to that number, and all operations that wait. Gives the slot after the phase."""
        for cycle in range(self.start, self.start + self.LONGEST):
            if self.position == products and not self.pending and not self.second_term:
                return cycle
            element = self._next_element(cycle)
            if element:
                self._issue_element(cycle, *element)
            if not (self.shared and (element or self.second_term)):
                self._issue_row(cycle)
        raise RuntimeError(
            "the program cannot be scheduled: an operation waits for a result that nothing writes"
        )

    # ------------------------------------------------------------------ element-wise operations
    def _next_element(self, cycle: int) -> tuple[ElementOp, int, int] | None:
        """(operation, index, term) that the element-wise lane can issue in this slot; it is taken off those
        that wait."""
        if cycle < self.element_free:
            return None
        if self.second_term:
            (op, index), self.second_term = self.second_term, None
            return op, index, 1
        if self.shared and not (self._group_starts and cycle >= self.lane_free):
            return None
        rows = self._table_kept_for_rows(cycle)
        for k, (op, index) in enumerate(self.pending):
            state_is_read = self.position > self.last_old.get(op.state, -1)
            if state_is_read and self._element_ready(op, index, cycle, rows):
                del self.pending[k]
                return op, index, 0
        return None

    def _element_ready(self, op: ElementOp, index: int, cycle: int, rows: range) -> bool:
        for term in range(len(op.terms)):
            if any(self.ready.get(key, 0) > cycle + term for key in self._operands(op, term, index)):
                return False
        table = cycle + len(op.terms) - 1 + self.timing.element_to_table
        return not (op.activated and (table in self.table_busy or table in rows))

    def _table_kept_for_rows(self, cycle: int) -> range:
        """Slots of the table that an element-wise operation leaves to a group that ends soon (``yields``)."""
        # one product further than AHEAD, so that a group that goes on beyond it counts as longer
        coming = [g for g, *_ in self.products[self.position : self.position + self.AHEAD + 1]]
        todo = coming.count(coming[0]) if coming and self.yields else 0
        return self._table_slots(coming[0], cycle + todo - 1) if 0 < todo <= self.AHEAD else range(0)

    def _issue_element(self, cycle: int, op: ElementOp, index: int, term: int) -> None:
        """Place one term of an element-wise operation, and its results with the last one."""
        self.issues.append(ElementIssue(cycle - self.start, op, term, index))
        last_term = len(op.terms) - 1
        self.element_free = cycle + 1 + (self.element_gap if term == last_term else 0)
        if self.shared:
            self.lane_free = cycle + 1 + self.timing.gap
        # reserved at once: the rows' results are placed in the meantime
        if op.activated and term == 0:
            self.table_busy.add(cycle + last_term + self.timing.element_to_table)
        if term < last_term:
            self.second_term = (op, index)
            return
        if op.state:
            stored = cycle + self.timing.element_to_state
            self.ready["S", op.state, index] = self.new_state[op.state, index] = stored
        if op.activated:
            self.ready["T", op.activated, index] = cycle + self.timing.element_to_activated

    # ------------------------------------------------------------------ rows on the lanes
    @property
    def _group_starts(self) -> bool:
        """The next product is the first of its group."""
        return not self.rows or self.rows[-1].last

    def _issue_row(self, cycle: int) -> None:
        """Place the rows' next product in this slot if its operands and the way of its result are ready."""
        if self.position == len(self.products):
            return
        starts = self._group_starts
        g, term, region, index = self.products[self.position]
        last = self.position + 1 == len(self.products) or self.products[self.position + 1][0] != g
        if starts and not self._may_start(g, cycle):
            return
        operand = self.new_state.get((region, index), self.NEVER) if self._reads_new(g, region) else 0
        if operand > cycle or (last and not self._may_finish(g, cycle)):
            return
        if starts and g in self.late:
            self._swap_late(g)
        self.rows.append(MacOp(cycle - self.start, g, term, region, index, starts, last))
        self.position += 1
        if last:
            self._finish(g, cycle)

    def _may_start(self, g: int, cycle: int) -> bool:
        if cycle < self.lane_free:
            return False
        # an open row keeps element-wise operations off the lane: all it reads must be under way
        if self.shared:
            new = [region for _, region in self.groups[g].block.terms if self._reads_new(g, region)]
            if any(
                (region, index) not in self.new_state for region in new for index in self._indices(region)
            ):
                return False
            return self._addends_ready(g, cycle) == cycle
        if g in self.late:
            fill = self._addends_ready(g, self.last_swap)  # NEVER, less a few rows, while they are not known
            return cycle + self.timing.added - self.timing.gap >= fill + self.config.hardware.lanes + 1
        return True

    def _table_slots(self, g: int, last: int) -> range:
        """Slots in which a group uses the table when its last element issues in slot ``last``. A value takes
        no look-up and is written a slot sooner."""
        group, dest = self.groups[g], self.groups[g].block.dest
        first = last + self.timing.row - (dest == "value")
        return range(first, first + group.rows * (dest not in ("partial", "logit")))

    def _may_finish(self, g: int, cycle: int) -> bool:
        """A group's last element may issue when the group before has left the chain, the next one's addends
        are in it, and the table is free for its results."""
        capture = cycle + self.timing.acc
        if self.table_busy.intersection(self._table_slots(g, cycle)):
            return False
        if not self.timing.chain:
            return True
        if capture < self.last_capture[0] + self.last_capture[1]:
            return False
        if g + 1 not in self.filled:
            self._fill(g + 1)
        return g + 1 not in self.filled or capture >= self.filled[g + 1]

    def _finish(self, g: int, cycle: int) -> None:
        group, dest = self.groups[g], self.groups[g].block.dest
        self.lane_free = cycle + 1 + self.timing.gap
        capture = cycle + self.timing.acc
        self.last_capture = (capture, group.rows)
        self.finished.add(g)
        if self.timing.chain:
            self.swaps.append(capture)
            self.last_swap = capture
            self.shifts |= set(range(capture + 1, capture + group.rows))
            if g + 1 not in self.filled:
                self.late.add(g + 1)
        self.table_busy.update(self._table_slots(g, cycle))
        for row in range(group.rows):
            if dest == "partial" or group.block.carried:
                address = group.addend if group.block.carried else group.dest
                self.ready["P", "", address + row] = cycle + row + self.timing.row_to_stored
            elif dest != "logit":
                way = self.timing.row_to_stored if dest == "value" else self.timing.row_to_gate
                key = "B" if dest == "sigmoid" else "T", group.block.region, group.dest + row
                self.ready[key] = cycle + row + way

    # ------------------------------------------------------------------ addends
    def _addends_ready(self, g: int, earliest: int) -> int:
        """First slot, ``earliest`` or later, in which row 0's addend may be addressed; row k's follows k
        slots later. NEVER: not known yet."""
        group, next_step = self.groups[g % len(self.groups)], g >= len(self.groups)
        if group.block.carried and next_step and g - len(self.groups) not in self.finished:
            return self.NEVER
        if group.block.bias and not (group.block.carried and next_step):
            return earliest
        return max(earliest, *(self.ready["P", "", group.addend + row] - row for row in range(group.rows)))

    def _fill(self, g: int) -> None:
        """Place the addends of group ``g`` behind the sums that leave the chain; later, if they are not known
        yet."""
        start = self._addends_ready(g, self.last_swap)
        if start < self.NEVER // 2:  # NEVER may have lost a few rows by the subtraction
            self.fills.append((g % len(self.groups), start))
            self.shifts |= set(range(self.last_swap + 1, start + self.config.hardware.lanes + 1))
            self.filled[g] = start + self.config.hardware.lanes + 1

    def _swap_late(self, g: int) -> None:
        self._fill(g)
        self.swaps.append(self.filled[g])
        self.last_swap = self.filled[g]
        self.late.discard(g)
