"""The engine's program: what each cell computes, as data, and the list scheduler that turns it into cycles.

A cell is a `CellProgram`: blocks of rows (matrix-vector products) for the lanes and element-wise operations for the element-wise
lane. `schedule` places every multiply of one recurrent step in a cycle, knowing the pipeline's latencies below, then packs the
placed operations into the runs that the sequencers execute. The cycle count of a step is read off the result; nothing is estimated.

A step has two phases. Phase A needs only the old state and starts as soon as the step before has ended; phase B starts when the
features' window is complete. Partial sums of phase A wait in the addend memory at full accumulator width.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

from golden.config import AcceleratorConfig

# Latencies of the engine's pipeline in cycles, from the issue of a lane's last element (row p of a group is p cycles later) or of an
# element-wise operation's last term to the first cycle in which the result can be addressed. rtl/engine.py is built to these.
ROW_TO_TABLE = 6  # index or value is in its register: the table port is used in this cycle
ROW_TO_GATE = ROW_TO_TABLE + 2  # gate or T memory written in the cycle after the table access
ROW_TO_PARTIAL = 6  # partial sum readable in the addend memory
ROW_TO_ADDEND = 3  # the addend of row 0 is addressed
ROW_TO_LOGIT = 6  # the classifier takes the logit
ELEMENT_TO_STATE = 4  # result readable in the state memory
ELEMENT_TO_TABLE = 4  # tanh index of the result at the table port
ELEMENT_TO_ACTIVATED = ELEMENT_TO_TABLE + 2  # its tanh readable in the T memory

# All of these are slots. A slot is the time a lane needs for one product: one cycle, or one a weight bit for bit-serial lanes. An
# element-wise product, whose operands have 16 bits, may take several slots; then its latencies grow by all but one of them.
ELEMENT_OPERAND_BITS = 16

FRAME_EXTRA_CYCLES = 7  # beyond those of its taxels: the way to the windows 3, the verdict on an onset 3, the read of the mean 1


def logit_to_decision(config: AcceleratorConfig) -> int:
    """Cycles from the one in which a step's last logit is taken to the one in which its decision is offered: two readings of the scores."""
    return 2 * config.classes + 2


def slot_cycles(config: AcceleratorConfig) -> int:
    """Cycles of a slot."""
    return config.weight_bits if config.lane_type == "serial" else 1


def element_slots(config: AcceleratorConfig) -> int:
    """Slots of an element-wise product."""
    return -(-ELEMENT_OPERAND_BITS // config.weight_bits) if config.lane_type == "serial" else 1


@dataclass(frozen=True)
class RowBlock:
    """Rows of one gate (or of the dense layer) that are computed alike.

    Parameters
    ----------
    name:
        Unique in the program.
    terms:
        (weight matrix, state-memory region) pairs added up in one dot product.
    dest:
        ``sigmoid`` (gate memory), ``tanh`` or ``value`` (T memory), ``partial`` (addend memory) or ``logit``.
    region:
        Region of the gate or T memory; for ``partial`` the block that picks the sum up.
    bias:
        Array of the integer model that holds the rows' bias codes; empty when the addend is a partial sum.
    narrowing:
        The narrowing the bias' rounding half belongs to: ``sigmoid``, ``tanh``, ``value`` or ``logit``.
    """

    name: str
    terms: tuple[tuple[str, str], ...]
    dest: str
    region: str = ""
    bias: str = ""
    narrowing: str = ""


@dataclass(frozen=True)
class ElementOp:
    """One kind of element-wise operation, done for every index i of a vector on the element-wise lane.

    Each term is a product ``a * b``: a = ``S.region[i]`` (state memory), ``T.region[i]`` (T memory), ``S.h-T.n`` (their difference) or
    ``X`` (the centred window sums); b = a region of the gate memory, ``one``, ``zero`` or ``scale``. ``add`` names a T region added at
    product scale. Result: narrowed by gate_frac, to the feature format for ``feature`` operations, else to the state format.

    Parameters
    ----------
    name:
        Unique in the program.
    terms:
        One or two (a, b) pairs; two terms take two cycles and are rounded once.
    state:
        Region of the state memory that gets the result; empty for none.
    activated:
        Region of the T memory that gets the tanh of the result; empty for none.
    add:
        T region added to the first term at product scale; empty for none.
    """

    name: str
    terms: tuple[tuple[str, str], ...]
    state: str = ""
    activated: str = ""
    add: str = ""


@dataclass(frozen=True)
class CellProgram:
    """A recurrent cell as data: rows before the features arrive, rows after, element-wise operations, regions of the memories.

    ``state_regions[0]`` is ``x`` and holds the features; ``cleared`` regions are zeroed before a touch. ``hidden`` names the region of
    the hidden state.
    """

    before: tuple[RowBlock, ...]
    after: tuple[RowBlock, ...]
    elements: tuple[ElementOp, ...]
    state_regions: tuple[str, ...]
    gate_regions: tuple[str, ...]
    t_regions: tuple[str, ...]
    cleared: tuple[str, ...] = ("h",)
    hidden: str = "h"


NORMALISE = ElementOp("normalise", (("X", "scale"),), state="x")
DENSE = RowBlock("dense", (("V", "h"),), "logit", bias="b_y", narrowing="logit")


def _gate_in_two_parts(gate: str, kind: str) -> tuple[RowBlock, RowBlock]:
    """U h + b before the features, + W x after."""
    return (
        RowBlock(f"{gate}_before", ((f"U_{gate}", "h"),), "partial", gate, f"b_{gate}", kind),
        RowBlock(gate, ((f"W_{gate}", "x"),), kind, gate),
    )


def gru_reset_before() -> CellProgram:
    """z, r = s(W x + U h + b); n = tanh(W x + U (r h) + b); h' = n + z (h - n)."""
    z_before, z = _gate_in_two_parts("z", "sigmoid")
    r_before, r = _gate_in_two_parts("r", "sigmoid")
    n = RowBlock("n", (("W_n", "x"), ("U_n", "rh")), "tanh", "n", "b_n", "tanh")
    reset = ElementOp("reset", (("S.h", "r"),), state="rh")
    blend = ElementOp("blend", (("S.h-T.n", "z"),), state="h", add="n")
    return CellProgram((r_before, z_before), (r, z, n, DENSE), (NORMALISE, reset, blend), ("x", "h", "rh"), ("z", "r"), ("n",))


def gru_reset_after() -> CellProgram:
    """z, r as above; n = tanh(r (U h + bh) + (W x + b)); h' = n + z (h - n)."""
    z_before, z = _gate_in_two_parts("z", "sigmoid")
    r_before, r = _gate_in_two_parts("r", "sigmoid")
    hn = RowBlock("hn", (("U_n", "h"),), "value", "hn", "bh_n", "value")
    wx = RowBlock("wx", (("W_n", "x"),), "value", "wx", "b_n", "value")
    reset = ElementOp("reset", (("T.hn", "r"), ("T.wx", "one")), activated="n")
    blend = ElementOp("blend", (("S.h-T.n", "z"),), state="h", add="n")
    return CellProgram((r_before, z_before, hn), (r, wx, z, DENSE), (NORMALISE, reset, blend), ("x", "h"), ("z", "r"), ("n", "hn", "wx"))


def lstm() -> CellProgram:
    """i, f, o = s(.); g = tanh(.); c' = f c + i g; h' = o tanh(c')."""
    parts = [_gate_in_two_parts(gate, "tanh" if gate == "g" else "sigmoid") for gate in "ifgo"]
    cell = ElementOp("cell", (("S.c", "f"), ("T.g", "i")), state="c", activated="tc")
    hidden = ElementOp("hidden", (("T.tc", "o"),), state="h")
    return CellProgram(
        tuple(before for before, _ in parts), (*(after for _, after in parts), DENSE), (NORMALISE, cell, hidden),
        ("x", "h", "c"), ("i", "f", "o"), ("g", "tc"), cleared=("h", "c"),
    )  # fmt: skip


CELLS: dict[tuple[str, str], Callable[[], CellProgram]] = {
    ("gru", "before"): gru_reset_before,
    ("gru", "after"): gru_reset_after,
    ("lstm", "before"): lstm,
    ("lstm", "after"): lstm,
}
"""Program of each (cell, reset); an LSTM has no reset gate."""


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


@dataclass(frozen=True)
class Run:
    """Consecutive cycles with counting index, as a sequencer executes them. ``op`` None is a gap."""

    length: int
    op: object | None = None  # (region) for the lanes, (ElementOp) for the element-wise lane
    index: int = 0
    first: bool = False
    last: bool = False
    wait: bool = False  # hold at the run's first cycle until the window is complete
    end: bool = False  # the step's last run


@dataclass(frozen=True)
class Schedule:
    """A scheduled step. All ``cycle`` fields and counts called slots count slots from the phase's first; see ``slot_cycles``."""

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
    shared: bool = field(default=False)  # one multiplier serves lanes and element-wise operations

    @property
    def decision_slots(self) -> int:
        """Slots from the start of phase B to the one in which the last logit is taken."""
        last = max(op.cycle for op in self.mac_after if op.last)
        return last + ROW_TO_LOGIT + self.groups[-1].rows - 1

    @property
    def decision_cycles(self) -> int:
        """Cycles from the start of phase B to the cycle in which the decision is offered."""
        return self.decision_slots * slot_cycles(self.config) + logit_to_decision(self.config)

    @property
    def step_cycles(self) -> int:
        """Cycles of one step: both phases' issue and the drain to the decision, whole slots up to the last logit."""
        slots = self.slots_before + self.decision_slots + 1
        return slots * slot_cycles(self.config) - 1 + logit_to_decision(self.config)

    @property
    def busy_share(self) -> float:
        """Share of the lane cycles of a step in which a lane multiplies for a real row."""
        useful = sum(self.groups[op.group].rows for op in (*self.mac_before, *self.mac_after))
        return useful * slot_cycles(self.config) / (self.config.lanes * self.step_cycles)

    @cached_property
    def weight_words(self) -> tuple[tuple[RowGroup, str, int], ...]:
        """For each word of the weight memories, in address order: the group, the matrix and the column its lanes read."""
        ops = (*self.mac_before, *self.mac_after)
        return tuple((self.groups[op.group], self.groups[op.group].block.terms[op.term][0], op.index) for op in ops)

    @cached_property
    def prologue(self) -> tuple[Run, ...]:
        """Element-wise runs that clear the state before a touch."""
        clear = [ElementOp(f"clear_{region}", (("S.h", "zero"),), state=region) for region in self.program.cleared]
        return tuple(Run(self.config.hidden, op, first=True, last=True) for op in clear)

    @cached_property
    def prologue_slots(self) -> int:
        """Slots of the prologue until the cleared state can be read."""
        slots = element_slots(self.config)
        return sum(run.length for run in self.prologue) * slots + ELEMENT_TO_STATE + slots - 1

    @cached_property
    def mac_runs(self) -> tuple[tuple[Run, ...], int]:
        """(runs, index of the run a further step of the touch starts at) of the lanes' sequencer."""
        prologue = (Run(self.prologue_slots),)
        before = _pack_rows(self.mac_before, self.slots_before, ())
        after = _pack_rows(self.mac_after, self.slots_after, self.elements if self.shared else ())
        return (*prologue, *before, *_wait_and_end(after)), len(prologue)

    @cached_property
    def element_runs(self) -> tuple[tuple[Run, ...], int]:
        """(runs, index of the run a further step of the touch starts at) of the element-wise sequencer."""
        after = _pack_elements(self.elements, self.slots_after, element_slots(self.config))
        return (*self.prologue, *_wait_and_end(after)), len(self.prologue)


def _wait_and_end(runs: list[Run]) -> tuple[Run, ...]:
    """``runs`` of phase B, the first of which waits for the window and the last of which ends the step."""
    marked = [Run(**{**run.__dict__, "wait": k == 0, "end": k == len(runs) - 1}) for k, run in enumerate(runs)]
    return tuple(marked)


def _pack_rows(ops: tuple[MacOp, ...], cycles: int, holds: tuple[ElementIssue, ...]) -> list[Run]:
    """Runs of consecutive cycles, gaps included, that fill ``cycles``. A cycle taken by an issue in ``holds`` holds the sequencer: it
    is no cycle of any run."""
    held = {issue.cycle for issue in holds}
    local = [0]  # sequencer time before each cycle
    for cycle in range(cycles):
        local.append(local[-1] + (cycle not in held))
    runs: list[Run] = []
    time = 0
    for op in ops:
        start = local[op.cycle]
        if start > time:
            runs.append(Run(start - time))
        previous = runs[-1] if runs else None
        joins = previous is not None and previous.op == op.region and start == time and not op.first and not previous.last
        if joins and previous.index + previous.length == op.index:
            runs[-1] = Run(previous.length + 1, op.region, previous.index, previous.first, op.last)
        else:
            runs.append(Run(1, op.region, op.index, op.first, op.last))
        time = start + 1
    if time < local[cycles]:
        runs.append(Run(local[cycles] - time))
    return runs


def _pack_elements(issues: tuple[ElementIssue, ...], cycles: int, slots: int) -> list[Run]:
    """Runs of one operation with counting index; a term takes ``slots`` slots. Lengths count indices."""
    runs: list[Run] = []
    time = 0
    for issue in issues:
        if issue.cycle > time:
            runs.append(Run(issue.cycle - time))
        previous = runs[-1] if runs else None
        joins = previous is not None and previous.op == issue.op and issue.cycle == time and previous.index + previous.length == issue.index
        if issue.term == 0 and joins:
            runs[-1] = Run(previous.length + 1, issue.op, previous.index, True, True)
        elif issue.term == 0:
            runs.append(Run(1, issue.op, issue.index, True, True))
        time = issue.cycle + slots
    if time < cycles:
        runs.append(Run(cycles - time))
    return runs


def cell_program(config: AcceleratorConfig) -> CellProgram:
    """The program of the configured cell."""
    return CELLS[config.cell, config.reset]()


@lru_cache(maxsize=64)
def schedule(config: AcceleratorConfig, program: CellProgram | None = None) -> Schedule:
    """Place one step of ``program`` (the configured cell's by default) on ``config.lanes`` lanes and one element-wise lane.

    One plain lane shares its multiplier with the element-wise operations: each holds the lane for its cycle.
    """
    program = program or cell_program(config)
    groups, bias_rows, partial_rows = _groups(config, program)
    return _Scheduler(config, program, groups, bias_rows, partial_rows).run()


def lowest_clock_hz(config: AcceleratorConfig) -> float:
    """The lowest clock at which every frame is taken when it is due and no window is ever lost, known before anything is simulated.

    A frame that ends a window passes the windows at three cycles a taxel, four for windows of 2 hop + 1, and the verdict on the onset
    takes some more (FRAME_EXTRA_CYCLES). Steps must keep up with hops; windows that end closer together than that, as the last two of
    the thesis do, wait in the two buffers. Latency budgets ask for more: see cosim.
    """
    keep_up = schedule(config).step_cycles * config.sample_rate_hz / config.hop
    per_taxel = 3 + config.window - 2 * config.hop
    return max((per_taxel * config.taxels + FRAME_EXTRA_CYCLES) * config.sample_rate_hz, keep_up)


def _rows_of(config: AcceleratorConfig, block: RowBlock) -> int:
    return config.classes if block.dest == "logit" else config.hidden


def _groups(config: AcceleratorConfig, program: CellProgram):
    """Row groups in issue order, the addend memory's loaded rows, and the number of partial rows behind them."""
    blocks = (*program.before, *program.after)
    bias_rows = tuple((block, row) for block in blocks if block.bias for row in range(_rows_of(config, block)))
    bias_base = {}
    for address, (block, row) in enumerate(bias_rows):
        bias_base.setdefault(block.name, address - row)
    partial_base = {}
    partial_rows = 0
    for block in blocks:
        if block.dest == "partial":
            partial_base[block.region] = len(bias_rows) + partial_rows
            partial_rows += _rows_of(config, block)
    groups = []
    for block in blocks:
        addend = bias_base[block.name] if block.bias else partial_base[block.name]
        dest = partial_base[block.region] if block.dest == "partial" else 0
        total = _rows_of(config, block)
        for row in range(0, total, config.lanes):
            groups.append(RowGroup(block, row, min(config.lanes, total - row), addend + row, dest + row))
    return tuple(groups), bias_rows, partial_rows


class _Scheduler:
    """Cycle-by-cycle list scheduling: rows in program order, element-wise operations as soon as their operands are there."""

    def __init__(self, config, program, groups, bias_rows, partial_rows) -> None:
        self.config, self.program, self.groups = config, program, groups
        self.bias_rows, self.partial_rows = bias_rows, partial_rows
        self.shared = config.lanes == 1 and config.lane_type == "plain"
        self.slots = element_slots(config)
        self.table_busy: set[int] = set()
        self.ready: dict[tuple[str, str, int], int] = {}  # (memory, region, index) -> first cycle it can be addressed
        # Cycle of the newest group's last element and its rows; before phase A that is the dense layer of the step before.
        self.last_capture = (-1, groups[-1].rows)

    def run(self) -> Schedule:
        before_groups = [g for g, group in enumerate(self.groups) if group.block in self.program.before]
        after_groups = [g for g, group in enumerate(self.groups) if group.block not in self.program.before]
        mac_before, _, slots_before = self._phase(before_groups, [])
        # Phase B counts from its own start: what phase A left in flight is known to the cycle.
        self.ready = {key: cycle - slots_before for key, cycle in self.ready.items()}
        self.table_busy = {cycle - slots_before for cycle in self.table_busy}
        self.last_capture = (self.last_capture[0] - slots_before, self.last_capture[1])
        pending = [(op, index) for op in self.program.elements for index in range(self._length(op))]
        for op in self.program.elements:  # results of this step must not be taken from the step before
            for memory, region in (("S", op.state), ("T", op.activated)):
                if region and not self._reads_old(op, region):
                    for index in range(self._length(op)):
                        self.ready[memory, region, index] = 10**9
        for g in after_groups:
            block = self.groups[g].block
            if block.dest in ("sigmoid", "tanh", "value"):
                for index in range(self.config.hidden):
                    self.ready["B" if block.dest == "sigmoid" else "T", block.region, index] = 10**9
        mac_after, elements, slots_after = self._phase(after_groups, pending)
        return Schedule(
            self.config, self.program, self.groups, tuple(mac_before), tuple(mac_after), tuple(elements),
            slots_before, slots_after, self.bias_rows, self.partial_rows, self.shared,
        )  # fmt: skip

    def _length(self, op: ElementOp) -> int:
        return self.config.taxels if op.state == "x" else self.config.hidden

    def _reads_old(self, op: ElementOp, region: str) -> bool:
        """True when an operation of this step reads the old content of the state region that ``op`` writes."""
        return any(f"S.{region}" in term[0].split("-") for other in self.program.elements for term in other.terms)

    def _operands(self, op: ElementOp, term: int, index: int):
        a, b = op.terms[term]
        for part in a.split("-"):
            if part != "X":
                yield (*part.split("."), index)
        if b in self.program.gate_regions:
            yield "B", b, index
        if op.add and term == 0:
            yield "T", op.add, index

    def _phase(self, group_numbers: list[int], pending: list[tuple[ElementOp, int]]):
        elements_of = [
            (g, term, region, index)
            for g in group_numbers
            for term, (_, region) in enumerate(self.groups[g].block.terms)
            for index in range(self.config.taxels if region == "x" else self.config.hidden)
        ]
        written = {op.state for op, _ in pending if op.state}
        new_state: dict[tuple[str, int], int] = {}  # results of this phase, for rows that need the new value
        rows: list[MacOp] = []
        issues: list[ElementIssue] = []
        pending = list(pending)
        second_term: tuple[ElementOp, int] | None = None
        position, cycle, group_start, element_free = 0, 0, True, 0
        while position < len(elements_of) or pending or second_term:
            issued = None
            if cycle < element_free:
                pass
            elif second_term:
                issued, second_term = (*second_term, 1), None
            else:
                for k, (op, index) in enumerate(pending):
                    if self._element_ready(op, index, cycle):
                        issued = (op, index, 0)
                        del pending[k]
                        break
            if issued:
                op, index, term = issued
                issues.append(ElementIssue(cycle, op, term, index))
                element_free = cycle + self.slots
                finished = cycle + self.slots - 1
                last_term = len(op.terms) - 1
                if op.activated and term == 0:  # reserved at once: the rows' results are placed in the meantime
                    self.table_busy.add(finished + last_term * self.slots + ELEMENT_TO_TABLE)
                if term < last_term:
                    second_term = (op, index)
                else:
                    if op.state:
                        new_state[op.state, index] = finished + ELEMENT_TO_STATE
                        self.ready["S", op.state, index] = finished + ELEMENT_TO_STATE
                    if op.activated:
                        self.ready["T", op.activated, index] = finished + ELEMENT_TO_ACTIVATED
            if position < len(elements_of) and not (issued and self.shared):
                g, term, region, index = elements_of[position]
                group = self.groups[g]
                last = position + 1 == len(elements_of) or elements_of[position + 1][0] != g
                known = new_state.get((region, index)) if region in written else 0
                if known is not None and known <= cycle and (not last or self._capture_ready(group, cycle)):
                    rows.append(MacOp(cycle, g, term, region, index, group_start, last))
                    if last:
                        self._finish(group, cycle)
                    group_start = last
                    position += 1
            cycle += 1
            if cycle > 10**6:
                raise RuntimeError("the program cannot be scheduled: an operation waits for a result that nothing writes")
        # The next phase may read any result of this one, and the element-wise lane is free for it.
        return rows, issues, max([cycle, element_free, *new_state.values()])

    def _element_ready(self, op: ElementOp, index: int, cycle: int) -> bool:
        for term in range(len(op.terms)):
            if any(self.ready.get(key, 0) > cycle + term * self.slots for key in self._operands(op, term, index)):
                return False
        finished = cycle + len(op.terms) * self.slots - 1
        return not (op.activated and finished + ELEMENT_TO_TABLE in self.table_busy)

    def _capture_ready(self, group: RowGroup, cycle: int) -> bool:
        """A group's last element may issue when the group before has left the capture registers and its addends are readable."""
        previous, rows = self.last_capture
        if cycle < previous + rows:
            return False
        if any(cycle + ROW_TO_TABLE + row in self.table_busy for row in range(group.rows)) and group.block.dest not in ("partial", "logit"):
            return False
        if group.block.bias:
            return True
        addends = (("P", "", group.addend + row) for row in range(group.rows))
        return all(self.ready.get(key, 0) <= cycle + ROW_TO_ADDEND + row for row, key in enumerate(addends))

    def _finish(self, group: RowGroup, cycle: int) -> None:
        self.last_capture = (cycle, group.rows)
        for row in range(group.rows):
            dest = group.block.dest
            if dest == "partial":
                self.ready["P", "", group.dest + row] = cycle + ROW_TO_PARTIAL + row
            elif dest != "logit":
                self.table_busy.add(cycle + ROW_TO_TABLE + row)
                self.ready["B" if dest == "sigmoid" else "T", group.block.region, group.dest + row] = cycle + ROW_TO_GATE + row
