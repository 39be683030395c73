"""A schedule made visible: which unit does what in which cycle, as spans, text, a picture, and the table of
cycles against the ideal.

Everything is read off a `eskin.rtl.program.scheduler.Schedule`, the same object that becomes the sequencer's
microcode. Cycles count from the start of phase A. Lanes and the element-wise lane are shown where an
operation is issued, its memories are addressed. The compact engine (the serial lane) is shown cycle by cycle:
a row or an element-wise operation from its first to its last, planes of its operands' bits one after the
other.
"""

from __future__ import annotations

import csv
import itertools
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.rtl.program.cells import ElementOp, RowBlock
from eskin.rtl.program.compact_program import CompactSchedule, Kind, Op
from eskin.rtl.program.microcode import Microcode
from eskin.rtl.program.schedule import lowest_clock_hz, schedule
from eskin.rtl.program.scheduler import Schedule
from eskin.rtl.program.timing import product_cycles

UNITS = ("lanes", "element-wise lane", "row chain", "activation table", "state write", "classifier")
LANES, ELEMENTS, CHAIN, TABLE, STATE, CLASSIFIER = UNITS
"""The units of a drawing, from top to bottom."""

TABLE_CELLS = (("gru", "before"), ("gru", "after"), ("lstm", "before"))
TABLE_SIZES = ((16, 12, 3), (8, 8, 5), (64, 32, 32))  # taxels, hidden, classes
TABLE_LANES = (1, 2, 4, 6, 12)


@dataclass(frozen=True)
class Span:
    """Consecutive slots in which one unit works on one block.

    Parameters
    ----------
    unit:
        One of ``UNITS``.
    block:
        The gate, layer or element-wise operation that the work is for; phase A's partial sums count as their
        gate.
    before:
        Phase A: needs no feature.
    slot, slots:
        First slot, from the start of phase A, and how many.
    rows:
        Lanes at work (1 for every other unit).
    what:
        The work in words.
    first, last:
        Index of the first and the last element, operation or row.
    """

    unit: str
    block: str
    before: bool
    slot: int
    slots: int
    rows: int
    what: str
    first: int
    last: int

    @property
    def last_slot(self) -> int:
        """Slot, that is cycle, in which the work ends."""
        return self.slot + self.slots - 1


def spans(plan: Schedule | CompactSchedule) -> tuple[Span, ...]:
    """Everything every unit does in one step, each operation once: in the order of ``UNITS``, by time within
    a unit."""
    found: list[Span] = []
    single = _compact(plan) if isinstance(plan, CompactSchedule) else _single(plan)
    for span in sorted(single, key=lambda span: (UNITS.index(span.unit), span.slot)):
        previous = found[-1] if found else span
        alike = (previous.unit, previous.block, previous.before, previous.rows, previous.what) == (
            span.unit,
            span.block,
            span.before,
            span.rows,
            span.what,
        )
        # an operation of two terms stays at its index for both
        if (
            found
            and alike
            and previous.slot + previous.slots == span.slot
            and span.first - previous.last in (0, 1)
        ):
            found[-1] = replace(previous, slots=previous.slots + span.slots, last=span.last)
        else:
            found.append(span)
    return tuple(found)


def _compact(plan: CompactSchedule) -> Iterator[Span]:
    """One span a row or element-wise operation, and one for each thing that it stores."""
    unit_at = {address: unit for unit in plan.compact.units for address in range(unit.first, unit.end)}
    inside = (one for one in plan.compact.step if one.address in unit_at)
    for (address, index), group in itertools.groupby(
        inside, key=lambda one: (unit_at[one.address].first, one.index)
    ):
        unit, done = unit_at[address], list(group)
        rows, name, work, begin = isinstance(unit.work, RowBlock), unit.name, unit.work, done[0].cycle
        what = (
            " + ".join(f"{matrix} {region}" for matrix, region in work.terms)
            if isinstance(work, RowBlock)
            else _formula(work)
        )
        length = done[-1].cycle + done[-1].cycles - begin
        yield Span(LANES if rows else ELEMENTS, name, False, begin, length, 1, what, index, index)
        for one in done:
            instruction, where = one.instruction, (name, False, one.cycle, 1, 1)
            if instruction.op != Op.STORE:
                continue
            if instruction.kind == Kind.INDEX:
                yield Span(
                    TABLE, *where, f"{'tanh' if instruction.tanh else 'sigmoid'} of {name}", index, index
                )
            elif instruction.kind == Kind.LOGIT:
                yield Span(CLASSIFIER, *where, "logit", index, index)
            elif not (instruction.table or isinstance(work, RowBlock)) and work.state:
                yield Span(STATE, *where, work.state, index, index)


def _single(plan: Schedule) -> Iterator[Span]:
    """One span an operation of the schedule, and one for each thing that follows from it further down the
    pipeline."""
    timing = plan.timing
    for ops, base, before in ((plan.mac_before, 0, True), (plan.mac_after, plan.slots_before, False)):
        for op in ops:
            group = plan.groups[op.group]
            block, name = group.block, _gate(group.block)
            rows = f"rows {group.first_row}..{group.first_row + group.rows - 1}"
            what = f"{block.terms[op.term][0]} {op.region}, {rows}"
            yield Span(LANES, name, before, base + op.cycle, 1, group.rows, what, op.index, op.index)
            for row in range(group.rows if op.last else 0):
                number, slot = group.first_row + row, base + op.cycle + row

                def one(
                    unit: str, what: str, slot=slot + timing.row, name=name, number=number, before=before
                ) -> Span:
                    return Span(unit, name, before, slot, 1, 1, what, number, number)

                yield one(CHAIN, f"{block.name}: sum to {_target(block)}")
                if block.dest in ("sigmoid", "tanh"):
                    yield one(TABLE, f"{block.dest} of {block.name}")
                if block.dest == "logit":
                    yield one(CLASSIFIER, "logit")
    for issue in plan.elements:
        work, slot, index = issue.op, plan.slots_before + issue.cycle, issue.index
        yield Span(ELEMENTS, work.name, False, slot, 1, 1, _formula(work), index, index)
        if issue.term == len(work.terms) - 1:
            if work.activated:
                yield Span(
                    TABLE,
                    work.name,
                    False,
                    slot + timing.element_to_table,
                    1,
                    1,
                    f"tanh of {work.name}",
                    index,
                    index,
                )
            if work.state:
                yield Span(
                    STATE,
                    work.name,
                    False,
                    slot + timing.element_to_state - 1,
                    1,
                    1,
                    work.state,
                    index,
                    index,
                )


def _gate(block: RowBlock) -> str:
    return block.region if block.dest == "partial" else block.name


def _target(block: RowBlock) -> str:
    targets = {
        "partial": "the partial sums",
        "sigmoid": "a gate",
        "tanh": "T memory",
        "value": "T memory",
        "logit": "the classifier",
    }
    return targets[block.dest]


def _formula(op: ElementOp) -> str:
    operands = [(a.replace("S.", "").replace("T.", ""), b) for a, b in op.terms]
    terms = " + ".join(f"{f'({a})' if '-' in a else a} {b}" for a, b in operands) + f" + {op.add}" * bool(
        op.add
    )
    return " and ".join(
        [f"{op.state} = {terms}"] * bool(op.state) + [f"{op.activated} = tanh({terms})"] * bool(op.activated)
    )


# ---------------------------------------------------------------------- figures
def summary(plan: Schedule | CompactSchedule) -> dict[str, Any]:
    """The figures of a schedule. ``ideal_cycles`` = ceil(multiplies / lanes), times the cycles of a product
    on the bit-serial lane."""
    config = plan.config
    ideal = config.step_ideal * product_cycles(config)
    prologue = plan.prologue_cycles if isinstance(plan, CompactSchedule) else Microcode(plan).again
    return {
        "cell": config.network.cell,
        "reset": config.network.reset if config.network.cell == "gru" else None,
        "taxels": config.sensor.taxels,
        "hidden": config.network.hidden if config.recurrent else None,
        "inputs": config.inputs,
        "sets": config.sets,
        "classes": config.classes,
        "lanes": config.hardware.lanes,
        "lane_type": config.hardware.lane_type,
        "multiplies": config.multiplies,
        "phase_a_cycles": plan.slots_before,
        "decision_cycles": plan.decision_cycles,
        "step_cycles": plan.step_cycles,
        "ideal_cycles": ideal,
        "ratio": plan.step_cycles / ideal,
        "busy_share": plan.busy_share,
        "element_share": plan.element_cycles / plan.step_cycles,
        "shared_multiplier": plan.shared,
        "prologue_cycles": prologue,
        "lowest_clock_hz": lowest_clock_hz(config),
    }


def cell_name(cell: str, reset: str | None) -> str:
    """A cell in words."""
    return {"lstm": "LSTM", "linear": "linear"}.get(cell, f"GRU, reset {reset}")


def lanes_name(config: AcceleratorConfig) -> str:
    """The lanes in words."""
    return f"{config.hardware.lanes} {config.hardware.lane_type} lane" + "s" * (config.hardware.lanes > 1)


def title(plan: Schedule) -> str:
    """Two lines: what runs on what, and how well."""
    s = summary(plan)
    busy = f"lanes busy {100 * s['busy_share']:.1f} %"
    if plan.shared:
        busy = f"lane busy {100 * s['busy_share']:.1f} % with rows, {100 * s['element_share']:.1f} % with element-wise operations"
    cell, lanes = cell_name(s["cell"], s["reset"]), lanes_name(plan.config)
    middle = (
        f"{s['hidden']} hidden"
        if plan.config.recurrent
        else f"{s['sets']} set{'s' * (s['sets'] > 1)} of weights"
    )
    return (
        f"{cell}: {s['taxels']} taxels, {middle}, {s['classes']} classes on {lanes}\n"
        f"{s['step_cycles']} cycles a step, ideal {s['ideal_cycles']} (ratio {s['ratio']:.3f}), {busy}"
    )


def text(plan: Schedule) -> str:
    """The schedule to read: the figures, then every run of every unit with its cycles."""
    lines = [title(plan).splitlines()[0], "", *(f"{name:30} {value}" for name, value in figures(plan)), ""]
    lines += [
        "Cycles count from the start of phase A. Lanes and the element-wise lane are shown where an "
        "operation is issued.",
        "",
    ]
    lines.append(f"{'cycles':>15}  {'phase':5}  {'unit':17}  {'block':10}  what")
    for span in sorted(spans(plan), key=lambda span: (span.slot, UNITS.index(span.unit))):
        what = f"{span.what}, {_range(span)}"
        lines.append(
            f"{f'{span.slot}..{span.last_slot}':>15}  {'AB'[not span.before]:5}  {span.unit:17}  "
            f"{span.block:10}  {what}"
        )
    lines.append(f"{plan.step_cycles:>15}  {'B':5}  {CLASSIFIER:17}  {'':10}  decision offered")
    return "\n".join(lines) + "\n"


def figures(plan: Schedule) -> list[tuple[str, str]]:
    """The `summary` in words: (name, value with its unit)."""
    s, product = summary(plan), product_cycles(plan.config)
    prologue = (
        "clears the state, fills the chain" if plan.config.recurrent else "begins the sums with the biases"
    )
    return [
        ("phase A, before the features", f"{s['phase_a_cycles']} cycles"),
        ("phase B, features to decision", f"{s['decision_cycles']} cycles"),
        ("step", f"{s['step_cycles']} cycles"),
        (
            "ideal",
            f"{s['ideal_cycles']} cycles: {s['multiplies']} multiplies / {s['lanes']} "
            f"lanes{f' x {product} cycles' * (product > 1)}",
        ),
        ("ratio", f"{s['ratio']:.3f}"),
        ("lanes busy", f"{100 * s['busy_share']:.1f} % of {s['lanes']} x {s['step_cycles']} lane cycles"),
        (
            "element-wise busy",
            f"{100 * s['element_share']:.1f} %" + ", on the lane's multiplier" * plan.shared,
        ),
        ("prologue", f"{s['prologue_cycles']} cycles more, once before a touch: {prologue}"),
        ("lowest clock", f"{s['lowest_clock_hz'] / 1e3:.1f} kHz: every frame taken when due, no window lost"),
    ]


def _range(span: Span) -> str:
    lanes = "columns" if ", rows" in span.what else "rows"  # the compact engine's spans are whole rows
    word = {LANES: lanes, ELEMENTS: "i =", STATE: "i =", CLASSIFIER: "classes"}.get(span.unit, "rows")
    return f"{word} {span.first}" + (f"..{span.last}" if span.last > span.first else "")


# ---------------------------------------------------------------------- picture
LINE_SLOTS = 200  # slots a line of the picture holds well; more where lines would be too many
MOST_LINES = 12
TRACKS_MOST = 12  # height of the lane array, in tracks: more lanes get thinner ones
PALETTE = (
    "#4477aa",
    "#ee6677",
    "#228833",
    "#aa3377",
    "#66ccee",
    "#ccbb44",
    "#ee8866",
    "#77aadd",
    "#bbcc33",
    "#999933",
    "#882255",
    "#44bb99",
)


def timeline(plan: Schedule):
    """The picture, a matplotlib Figure: one row a unit (one a lane for the lanes), coloured by block, pale
    where only the old state is needed; long steps go on in further lines of the same scale."""
    from matplotlib.figure import Figure  # slow to import, and only a picture needs it
    from matplotlib.patches import Patch

    found, end = spans(plan), plan.step_cycles + 1
    lines = min(MOST_LINES, -(-end // LINE_SLOTS))
    length = -(-end // lines)
    names = dict.fromkeys(
        [*map(_gate, (*plan.program.before, *plan.program.after)), *(op.name for op in plan.program.elements)]
    )
    colours = {name: PALETTE[k % len(PALETTE)] for k, name in enumerate(names)}

    tracks = min(plan.config.hardware.lanes, TRACKS_MOST)
    rows = tracks + 0.4 + 1.25 * (len(UNITS) - 1)
    height = lines * (0.21 * rows + 0.75) + 1.35
    figure = Figure(figsize=(15, height), layout="constrained")
    figure.suptitle(title(plan), fontsize=12)
    panels = figure.subplots(lines, 1, squeeze=False)[:, 0]
    for line, axes in enumerate(panels):
        _draw_line(axes, plan, found, colours, line * length, length)
    panels[-1].set_xlabel("cycle, from the start of phase A")
    patches = [Patch(color=colour, label=name) for name, colour in colours.items()]
    patches.append(Patch(facecolor=_pale("#777777"), edgecolor="#777777", label="pale: phase A"))
    figure.legend(
        handles=patches,
        loc="outside lower center",
        ncols=len(patches),
        fontsize=9,
        frameon=False,
        handlelength=1.2,
    )
    return figure


def _pale(colour: str) -> tuple[float, float, float]:
    from matplotlib.colors import to_rgb

    red, green, blue = (1 - 0.55 * (1 - part) for part in to_rgb(colour))
    return red, green, blue


def _luminance(colour: Any) -> float:
    from matplotlib.colors import to_rgb

    return sum(part * weight for part, weight in zip(to_rgb(colour), (0.3, 0.59, 0.11), strict=True))


def _draw_line(
    axes, plan: Schedule, found: Iterable[Span], colours: dict[str, str], begin: int, length: int
) -> None:
    """One line of the picture: slots ``begin`` to ``begin + length``."""
    config = plan.config
    lanes = config.hardware.lanes
    track = min(1.0, TRACKS_MOST / lanes)
    array = lanes * track
    tops = {unit: array + 0.4 + 1.25 * k for k, unit in enumerate(UNITS[1:])}
    bottom = array + 0.4 + 1.25 * (len(UNITS) - 1)
    switch, decision = plan.slots_before, plan.step_cycles
    left, right = begin, begin + length

    bars: dict[tuple[float, float, Any], list[tuple[float, float]]] = {}
    letters = 13 / (right - left) / 0.075  # of a label that fit into a cycle, about
    for span in found:
        first, wide = max(span.slot, left), min(span.last_slot + 1, right) - max(span.slot, left)
        if wide <= 0:
            continue
        y, tall = (0.0, span.rows * track) if span.unit == LANES else (tops[span.unit], 1.0)
        colour = _pale(colours[span.block]) if span.before else colours[span.block]
        bars.setdefault((y, tall, colour), []).append((first, wide))
        label = next(
            (words for words in (span.what.partition(",")[0], span.block) if len(words) + 1 < wide * letters),
            "",
        )
        # within a lane, not on a line between two
        middle = y + (span.rows // 2 + 0.5) * track if span.unit == LANES else y + 0.5
        ink = "white" if _luminance(colour) < 0.45 else "black"
        axes.text(first + wide / 2, middle, label, ha="center", va="center", fontsize=7, color=ink)
    for (y, tall, colour), places in bars.items():
        axes.broken_barh(places, (y, tall), facecolors=[colour], edgecolors="white", linewidths=0.3)
    for lane in range(1, lanes if track == 1 else 0):
        axes.axhline(lane, color="white", linewidth=0.5)

    axes.axvspan(left, min(max(left, switch), right), color="#f1f1f1", zorder=-2, linewidth=0)
    room = right - left
    for mark, until, letter, words in (
        (0, switch, "A", "the old state is enough"),
        (switch, decision, "B", "the features are there"),
    ):
        taken = 0.28 * room if letter == "B" and left <= decision < right else 0.0  # by the decision's words
        free = min(until, right) - max(mark, left) - taken
        if free > 0.02 * room:
            label = f" {letter}: {words}" if free > 0.14 * room else f" {letter}"
            axes.text(max(mark, left), -0.25, label, fontsize=8, va="bottom", color="#444444")
    for mark, style in ((switch, "--"), (decision, "-")):
        if left <= mark < right:
            axes.axvline(mark, color="black", linewidth=1.0, linestyle=style)
    if left <= decision < right:
        late = decision > left + 0.75 * room
        words = f"decision in cycle {decision}, {plan.decision_cycles} after the features"
        axes.text(
            decision,
            -0.25,
            f" {words} ",
            fontsize=8,
            va="bottom",
            ha="right" if late else "left",
            weight="bold",
        )

    axes.set_xlim(left, right)
    axes.set_ylim(bottom, -0.15)
    ticks = (
        [(lane + 0.5, f"lane {lane}") for lane in range(lanes)]
        if track == 1
        else [(array / 2, f"lanes 0..{lanes - 1}")]
    )
    shared = {ELEMENTS: "element-wise, on lane 0"} if plan.shared else {}
    ticks += [(top + 0.5, shared.get(unit, unit)) for unit, top in tops.items()]
    axes.set_yticks([mark for mark, _ in ticks], [words for _, words in ticks], fontsize=8)
    axes.tick_params(axis="y", length=0)
    axes.tick_params(axis="x", labelsize=8)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)


def save_figure(figure, kind: str) -> Callable[[Path], None]:
    """What writes ``figure`` as ``kind`` (svg or png) to a path of any name; the same figure gives the same
    file."""

    def write(path: Path) -> None:
        from matplotlib import rc_context

        with rc_context({"svg.hashsalt": "eskin", "svg.fonttype": "none"}):
            figure.savefig(path, format=kind, dpi=120, metadata={"Date": None} if kind == "svg" else None)

    return write


def drawing_files(plan: Schedule) -> dict[str, Callable[[Path], None]]:
    """The files of a drawing by name, each as what writes it to a path."""
    picture = timeline(plan)
    values = {"summary": summary(plan), "spans": [asdict(span) for span in spans(plan)]}
    return {
        "schedule.svg": save_figure(picture, "svg"),
        "schedule.png": save_figure(picture, "png"),
        "schedule.txt": lambda path: path.write_text(text(plan)),
        "schedule.json": lambda path: path.write_text(json.dumps(values) + "\n"),
    }


# ---------------------------------------------------------------------- table
def resized(config: AcceleratorConfig, *, taxels: int, hidden: int, classes: int) -> AcceleratorConfig:
    """``config`` for other sizes. No count of cycles depends on its pins, which are left out, or on its
    clock, which is raised where it would be too slow for the taxels."""
    return config.replace(
        taxels=taxels,
        hidden=hidden,
        class_names=tuple(f"class{k}" for k in range(classes)),
        masked_taxels=(),
        converter="none",
        position=False,
        stimulator="none",
        clock_hz=max(config.hardware.clock_hz, 2.0 * taxels * config.sensor.sample_rate_hz),
    )


def ratio_table(config: AcceleratorConfig) -> tuple[list[dict[str, Any]], list[str]]:
    """The `summary` of every cell, size and lane count of the table that fits ``config``, whose formats and
    lane type it has; and for the others sentences that say why not."""
    rows, reasons = [], []
    for (cell, reset), (taxels, hidden, classes), lanes in itertools.product(
        TABLE_CELLS, TABLE_SIZES, TABLE_LANES
    ):
        try:
            sized = resized(config, taxels=taxels, hidden=hidden, classes=classes)
            rows.append(summary(schedule(sized.replace(cell=cell, reset=reset, lanes=lanes))))
        except InputError as error:
            reasons.append(str(error))
    return rows, list(dict.fromkeys(reasons))


RATIO_NOTE = (
    "Ideal = multiplies / lanes, rounded up, and counts the element-wise products of the cell, which have a "
    "multiplier of their own from "
    "two lanes on: a ratio can be below 1. Cycles of the normaliser's products, of the pipeline and of the "
    "decision are overhead."
)
RATIO_COLUMNS = (
    "cell",
    "taxels",
    "hidden",
    "classes",
    "lanes",
    "cycles",
    "ideal",
    "ratio",
    "busy share",
    "features to decision",
)


def ratio_cells(row: dict[str, Any]) -> tuple[str, ...]:
    """A row of the table as words, by ``RATIO_COLUMNS``."""
    numbers = (
        str(row[key]) for key in ("taxels", "hidden", "classes", "lanes", "step_cycles", "ideal_cycles")
    )
    last = (f"{row['ratio']:.3f}", f"{100 * row['busy_share']:.1f} %", str(row["decision_cycles"]))
    return (cell_name(row["cell"], row["reset"]), *numbers, *last)


def markdown(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table for a README; the first column is words, the others are numbers."""
    lines = [columns, [":--", *["--:"] * (len(columns) - 1)], *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def write_csv(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """``rows``, which share their keys, with a heading."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def table_files(rows: Sequence[dict[str, Any]]) -> dict[str, Callable[[Path], None]]:
    """The table's files by name, each as what writes it to a path."""
    return {
        "ratios.json": lambda path: path.write_text(json.dumps(rows, indent=2) + "\n"),
        "ratios.csv": lambda path: write_csv(rows, path),
        "ratios.md": lambda path: path.write_text(
            f"{markdown(RATIO_COLUMNS, map(ratio_cells, rows))}\n{RATIO_NOTE}\n"
        ),
    }
