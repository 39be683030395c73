"""A schedule made visible: the work of each unit in each cycle, as spans and a picture.

Everything is read off a `eskin.rtl.program.scheduler.Schedule`, the same object that becomes the sequencer's
microcode. Cycles count from the start of phase A. Lanes and the element-wise lane are shown where an
operation is issued, its memories are addressed.
"""

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
    """

    unit: str
    block: str
    before: bool
    slot: int
    slots: int = 1


def spans(plan: Schedule) -> tuple[Span, ...]:
    """Everything every unit does in one step: in the order of ``UNITS``, by time within a unit."""
    joined: list[Span] = []
    for span in sorted(set(_single(plan)), key=lambda span: (UNITS.index(span.unit), span.slot)):
        last = joined[-1] if joined else span
        if span == replace(last, slot=last.slot + last.slots, slots=1):
            joined[-1] = replace(last, slots=last.slots + 1)
        else:
            joined.append(span)
    return tuple(joined)


def _single(plan: Schedule) -> Iterator[Span]:
    """One span a slot for each operation of the schedule, and for each thing that follows from it further down the
    pipeline."""
    timing = plan.timing
    for ops, base, before in ((plan.mac_before, 0, True), (plan.mac_after, plan.slots_before, False)):
        for op in ops:
            group, slot = plan.groups[op.group], base + op.cycle
            name = _gate(group.block)
            yield Span(LANES, name, before, slot)
            further = {"sigmoid": TABLE, "tanh": TABLE, "logit": CLASSIFIER}.get(group.block.dest, CHAIN)
            for row in range(group.rows if op.last else 0):
                yield Span(CHAIN, name, before, slot + timing.row + row)
                yield Span(further, name, before, slot + timing.row + row)
    for issue in plan.elements:
        work, slot = issue.op, plan.slots_before + issue.cycle
        yield Span(ELEMENTS, work.name, False, slot)
        if issue.term == len(work.terms) - 1 and work.activated:
            yield Span(TABLE, work.name, False, slot + timing.element_to_table)
        if issue.term == len(work.terms) - 1 and work.state:
            yield Span(STATE, work.name, False, slot + timing.element_to_state - 1)


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
        "element_share": len(plan.elements) / plan.step_cycles,
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


COLUMNS = ("what", "value")


def cells(plan: Schedule) -> list[tuple[str, str]]:
    """The `summary` as text, in the order of `COLUMNS`."""
    return [
        (name.replace("_", " "), f"{value:g}" if isinstance(value, float) else str(value))
        for name, value in summary(plan).items()
    ]


# ---------------------------------------------------------------------- picture
LINE_SLOTS = 200  # slots a line of the picture holds well; more where lines would be too many
MOST_LINES = 12
PHASE_A = 0.4  # opacity of what needs only the old state


def timeline(plan: Schedule):
    """The picture, a matplotlib Figure: a row per unit, coloured by block, pale where only the old state is needed;
    long steps continue in further lines of the same scale."""
    from matplotlib.figure import Figure  # slow to import, and only a picture needs it
    from matplotlib.patches import Patch

    end = plan.step_cycles + 1
    lines = min(MOST_LINES, -(-end // LINE_SLOTS))
    length = -(-end // lines)
    blocks = map(_gate, (*plan.program.before, *plan.program.after))
    names = dict.fromkeys([*blocks, *(op.name for op in plan.program.elements)])
    colours = {name: f"C{k}" for k, name in enumerate(names)}
    figure = Figure(figsize=(15, 2.5 * lines + 1.35), layout="constrained")
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
    for span in spans(plan):
        first, top = max(span.slot, left), UNITS.index(span.unit)
        wide = min(span.slot + span.slots, left + length) - first
        if wide > 0:
            alpha, colour = PHASE_A if span.before else 1.0, colours[span.block]
            axes.broken_barh([(first, wide)], (top, 0.9), facecolors=colour, alpha=alpha, edgecolors="white")
            if len(span.block) < wide * 170 / length:
                axes.text(first + wide / 2, top + 0.45, span.block, ha="center", va="center", fontsize=7)
    for slot, words in ((plan.slots_before, "B: the features are there"), (plan.step_cycles, "decision")):
        if left <= slot < left + length:
            axes.axvline(slot, color="black", linewidth=1.0)
            side = "left" if slot < left + length / 2 else "right"
            axes.text(slot, -0.25, f" {words}, cycle {slot} ", fontsize=8, va="bottom", ha=side)
    axes.set(xlim=(left, left + length), ylim=(len(UNITS), -0.15))
    axes.set_yticks([top + 0.45 for top in range(len(UNITS))], UNITS, fontsize=8)
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
