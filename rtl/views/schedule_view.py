"""A schedule made visible: the work of each unit in each cycle, as spans and a picture.

Everything is read off a `eskin.rtl.program.scheduler.Schedule`, the same object that becomes the sequencer's
microcode. Cycles count from the start of phase A. Lanes and the element-wise lane are shown where an
operation is issued, its memories are addressed.
"""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

from eskin.golden.core import Record, write_json
from eskin.rtl.program.cells import RowBlock
from eskin.rtl.program.microcode import Microcode
from eskin.rtl.program.schedule import lowest_clock_hz
from eskin.rtl.program.scheduler import Schedule

UNITS = ("lanes", "element-wise lane", "row chain", "activation table", "state write", "classifier")
LANES, ELEMENTS, CHAIN, TABLE, STATE, CLASSIFIER = UNITS
"""The units of a drawing, from top to bottom."""
WORK = ("unit", "block", "before", "rows", "what")
"""Fields in which spans that follow one another are alike when they are one."""


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


def spans(plan: Schedule) -> tuple[Span, ...]:
    """Everything every unit does in one step, each operation once: in the order of ``UNITS``, by time within
    a unit."""
    joined: list[Span] = []
    for span in sorted(_single(plan), key=lambda span: (UNITS.index(span.unit), span.slot)):
        last = joined[-1] if joined else None
        # an operation of two terms stays at its index for both
        if (
            last
            and last.slot + last.slots == span.slot
            and span == replace(span, **{name: getattr(last, name) for name in WORK})
            and span.first - last.last in (0, 1)
        ):
            joined[-1] = replace(last, slots=last.slots + span.slots, last=span.last)
        else:
            joined.append(span)
    return tuple(joined)


def _single(plan: Schedule) -> Iterator[Span]:
    """One span an operation of the schedule, and one for each thing that follows from it further down the
    pipeline."""
    timing = plan.timing
    for ops, base, before in ((plan.mac_before, 0, True), (plan.mac_after, plan.slots_before, False)):
        for op in ops:
            group = plan.groups[op.group]
            block, name, slot = group.block, _gate(group.block), base + op.cycle
            rows = f"rows {group.first_row}..{group.first_row + group.rows - 1}"
            label = f"{block.terms[op.term][0]} {op.region}, {rows}"
            yield Span(LANES, name, before, slot, 1, group.rows, label, op.index, op.index)
            ends = [(CHAIN, f"{block.name}: sum to {TARGETS[block.dest]}")]
            ends += [(TABLE, f"{block.dest} of {block.name}")] * (block.dest in ("sigmoid", "tanh"))
            ends += [(CLASSIFIER, "logit")] * (block.dest == "logit")
            for row, (unit, label) in itertools.product(range(group.rows if op.last else 0), ends):
                number = group.first_row + row
                yield Span(unit, name, before, slot + timing.row + row, 1, 1, label, number, number)
    for issue in plan.elements:
        work, slot, index = issue.op, plan.slots_before + issue.cycle, issue.index
        uses = [(ELEMENTS, 0, work.name)]
        if issue.term == len(work.terms) - 1:
            uses += [(TABLE, timing.element_to_table, f"tanh of {work.name}")] * bool(work.activated)
            uses += [(STATE, timing.element_to_state - 1, work.state)] * bool(work.state)
        for unit, later, label in uses:
            yield Span(unit, work.name, False, slot + later, 1, 1, label, index, index)


TARGETS = {
    "partial": "the partial sums",
    "sigmoid": "a gate",
    "tanh": "T memory",
    "value": "T memory",
    "logit": "the classifier",
}


def _gate(block: RowBlock) -> str:
    return block.region if block.dest == "partial" else block.name


# ---------------------------------------------------------------------- figures
def summary(plan: Schedule) -> Record:
    """The figures of a schedule. ``ideal_cycles`` = ceil(multiplies / lanes)."""
    config, ideal = plan.config, plan.config.step_ideal
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
        "prologue_cycles": Microcode(plan).again,
        "lowest_clock_hz": lowest_clock_hz(config),
    }


def title(plan: Schedule) -> str:
    """Two lines: the cell and its lanes, and how busy they are."""
    s = summary(plan)
    cell = f"{s['cell']}, reset {s['reset']}" if s["reset"] else s["cell"]
    middle = f"{s['hidden']} hidden" if plan.config.recurrent else f"sets of weights: {s['sets']}"
    return (
        f"{cell}: {s['taxels']} taxels, {middle}, {s['classes']} classes, {s['lanes']} x {s['lane_type']}\n"
        f"{s['step_cycles']} cycles a step, ideal {s['ideal_cycles']} (ratio {s['ratio']:.3f}), "
        f"lanes busy {s['busy_share']:.1%}, element-wise operations {s['element_share']:.1%}"
    )


def figures(plan: Schedule) -> list[tuple[str, str]]:
    """The `summary` as text: (name, value)."""
    return [
        (name.replace("_", " "), f"{value:g}" if isinstance(value, float) else str(value))
        for name, value in summary(plan).items()
    ]


# ---------------------------------------------------------------------- picture
LINE_SLOTS = 200  # slots a line of the picture holds well; more where lines would be too many
MOST_LINES = 12
TRACKS_MOST = 12  # height of the lane array, in tracks: more lanes get thinner ones
PITCH = 1.25  # from one of the other units to the next, in tracks
PHASE_A = 0.4  # opacity of what needs only the old state


def timeline(plan: Schedule):
    """The picture, a matplotlib Figure: a row per unit, that of the lanes as high as the number of busy
    lanes; coloured by block, pale where only the old state is needed; long steps continue in further lines of
    the same scale."""
    from matplotlib.figure import Figure  # slow to import, and only a picture needs it
    from matplotlib.patches import Patch

    end = plan.step_cycles + 1
    lines = min(MOST_LINES, -(-end // LINE_SLOTS))
    length = -(-end // lines)
    blocks = map(_gate, (*plan.program.before, *plan.program.after))
    names = dict.fromkeys([*blocks, *(op.name for op in plan.program.elements)])
    colours = {name: f"C{k}" for k, name in enumerate(names)}
    rows = min(plan.config.hardware.lanes, TRACKS_MOST) + PITCH * len(UNITS)
    figure = Figure(figsize=(15, lines * (0.21 * rows + 0.75) + 1.35), layout="constrained")
    figure.suptitle(title(plan), fontsize=12)
    panels = figure.subplots(lines, 1, squeeze=False)[:, 0]
    for line, axes in enumerate(panels):
        _draw_line(axes, plan, colours, line * length, length)
    panels[-1].set_xlabel("cycle, from the start of phase A")
    patches = [Patch(color=colour, label=name) for name, colour in colours.items()]
    patches.append(Patch(color="#777777", alpha=PHASE_A, label="pale: phase A"))
    figure.legend(handles=patches, loc="outside lower center", ncols=len(patches), fontsize=9, frameon=False)
    return figure


def _draw_line(axes, plan: Schedule, colours: dict[str, str], left: int, length: int) -> None:
    """One line of the picture: slots ``left`` to ``left + length``."""
    lanes, right = plan.config.hardware.lanes, left + length
    track = min(1.0, TRACKS_MOST / lanes)
    tops = {unit: lanes * track * (k > 0) + PITCH * k for k, unit in enumerate(UNITS)}
    for span in spans(plan):
        first = max(span.slot, left)
        wide = min(span.last_slot + 1, right) - first
        if wide <= 0:
            continue
        tall = span.rows * track if span.unit == LANES else 1.0
        place, alpha = (tops[span.unit], tall), PHASE_A if span.before else 1.0
        colour = colours[span.block]
        axes.broken_barh([(first, wide)], place, facecolors=colour, alpha=alpha, edgecolors="white")
        fits = (span.what.partition(",")[0], span.block, "")
        label = next(text for text in fits if len(text) < wide * 170 / length or not text)
        middle = first + wide / 2, tops[span.unit] + tall / 2
        axes.text(*middle, label, ha="center", va="center", fontsize=7)
    ends = {plan.slots_before: ("--", "B: the features are there"), plan.step_cycles: ("-", "decision")}
    for slot, (style, words) in ends.items():
        if left <= slot < right:
            axes.axvline(slot, color="black", linewidth=1.0, linestyle=style)
            side = "left" if slot < left + length / 2 else "right"
            axes.text(slot, -0.25, f" {words}, cycle {slot} ", fontsize=8, va="bottom", ha=side)
    axes.set(xlim=(left, right), ylim=(lanes * track + PITCH * len(UNITS), -0.15))
    shared = {ELEMENTS: "element-wise, on lane 0"} if plan.shared else {}
    names = {LANES: f"lanes: {lanes}"} | shared
    axes.set_yticks(
        [top + 0.5 for top in tops.values()], [names.get(unit, unit) for unit in tops], fontsize=8
    )
    axes.tick_params(axis="y", length=0)
    axes.spines[["top", "right", "left"]].set_visible(False)


def save_figure(figure, path: Path, kind: str = "svg") -> None:
    """Write ``figure`` as ``kind`` (svg or png) to a path of any name; the same figure gives the same file."""
    from matplotlib import rc_context

    with rc_context({"svg.hashsalt": "eskin", "svg.fonttype": "none"}):
        figure.savefig(path, format=kind, dpi=120, metadata={"Date": None} if kind == "svg" else None)


def drawing_files(plan: Schedule) -> dict[str, Callable[[Path], None]]:
    """Output files of a drawing: name -> function that writes the file."""
    values = {"summary": summary(plan), "spans": [asdict(span) for span in spans(plan)]}
    return {
        "schedule.svg": partial(save_figure, timeline(plan)),
        "schedule.json": lambda path: write_json(path, values),
    }
