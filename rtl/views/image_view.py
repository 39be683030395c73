"""The passes of a network for images made visible: cycles layer by layer.

Everything is read off `eskin.rtl.program.image_passes`, whose cycles are the hardware's.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from eskin.golden.core import Record, write_json
from eskin.rtl.program.image_passes import ImagePlan, Pass
from eskin.rtl.views.schedule_view import save_figure

COLUMNS = ("layer", "map before", "map behind", "multiplies", "taps", "cycles", "over multiplies / P")


def name(layer: Pass) -> str:
    """A pass in words."""
    words = f"dense {layer.outputs}" if layer.dense else f"conv {layer.kernel} {layer.outputs}"
    return words + ", pool" * layer.pool


def rows(plan: ImagePlan) -> list[Record]:
    """A row a pass, and one of all. taps: cycles in which the lanes multiply."""
    table: list[Record] = [
        {
            "layer": name(layer),
            "before": (layer.rows, layer.columns, layer.channels),
            "behind": layer.result,
            "multiplies": layer.multiplies,
            "taps": sum(slot.taps for slot in layer.slots(plan.lanes)),
            "cycles": layer.cycles(plan.lanes),
        }
        for layer in plan.passes
    ]
    whole = {key: sum(row[key] for row in table) for key in ("multiplies", "taps", "cycles")}
    table.append({"layer": "all", "before": table[0]["before"], "behind": table[-1]["behind"], **whole})
    return [row | {"ratio": row["cycles"] * plan.lanes / row["multiplies"]} for row in table]


def cells(plan: ImagePlan) -> list[tuple[str, ...]]:
    """`rows` as text, in the order of `COLUMNS`."""
    table = (
        row | {key: " x ".join(map(str, row[key])) for key in ("before", "behind")} for row in rows(plan)
    )
    return [tuple(f"{v:.3f}" if isinstance(v, float) else str(v) for v in row.values()) for row in table]


def title(plan: ImagePlan) -> str:
    """Title of the drawing."""
    return f"an image in {plan.cycles} cycles on {plan.lanes} lanes, {plan.multiplies} multiplies"


def drawing(plan: ImagePlan):
    """A figure: the passes one after the other."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 1.6), layout="constrained")
    axes, begin = figure.subplots(), 0
    for number, layer in enumerate(plan.passes):
        cycles = layer.cycles(plan.lanes)
        axes.barh(0, cycles, left=begin, color=f"C{number}")
        axes.text(begin + cycles / 2, 0, name(layer), ha="center", va="center", fontsize=7)
        begin += cycles
    axes.set(yticks=[], xlim=(0, begin), xlabel="cycles since the image is whole", title=title(plan))
    return figure


def drawing_files(plan: ImagePlan) -> dict[str, Callable[[Path], None]]:
    """Output files of a drawing: name -> function that writes the file."""
    values = {"lanes": plan.lanes, "passes": rows(plan)}
    return {
        "schedule.svg": partial(save_figure, drawing(plan)),
        "schedule.json": lambda path: write_json(path, values),
    }
