"""The chart of a sweep, from what sweep.json holds: accuracy against cost."""

import itertools
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter

from eskin.choose.cost import pareto
from eskin.golden.core import Record
from eskin.pages.charts import CLASS_COLOURS, STYLE, cost_axis, share_bars
from eskin.study.sweep import cell_name, network_name, split_name

MARKERS = "ovs^DPX*"
GREY, RECOMMENDED = "#777777", "#cc3311"

COSTS = {
    "latency_s": ("latency of a decision, from its last features (µs, {clock})", 1e6),
    "multiplies_decision": ("multiplies of a decision (all steps of a touch)", 1.0),
    "energy_j": ("energy of a touch, waiting included (µJ; estimate, clock stops when idle)", 1e6),
}
IMAGE_COSTS = {
    "latency_s": ("last pixel to decision (ms, {clock})", 1e3),
    "energy_j": ("energy of the computation of an image (µJ, estimate, iCE40UP5K)", 1e6),
    "memory_bytes": ("weights, biases and maps (kB)", 1e-3),
}
"""Costs that accuracy is set against: key of a point, label, factor."""


def accuracy_chart(result: Record) -> Figure:
    """A row a split: accuracy against latency, multiplies of a decision, and energy of a touch; of images
    against latency, energy and memory. A colour a cell or network, a marker the bits of a weight; the front is
    marked and named, and the recommended point."""
    points, images = result["points"], bool(result.get("images"))
    splits, kinds = points[0]["splits"], list(dict.fromkeys(map(_kind, points)))
    widths = sorted({point["config"]["weight_bits"] for point in points})
    colour = dict(zip(kinds, itertools.cycle(CLASS_COLOURS), strict=False))
    marker = dict(zip(widths, itertools.cycle(MARKERS), strict=False))
    with rc_context(STYLE | {"axes.grid": True}):
        figure = Figure(figsize=(20, 2.4 + 4.3 * len(splits)), layout="constrained")
        figure.suptitle(
            f"{result['data']}: accuracy on unseen {'images' if images else 'groups'} against cost\n"
            f"{result['recommendation']['sentence']}",
            fontsize=10,
        )
        panels = figure.subplots(len(splits), 3, squeeze=False)
        for number, row in enumerate(panels):
            for axes, (cost, (label, unit)) in zip(
                row, (IMAGE_COSTS if images else COSTS).items(), strict=True
            ):
                if (
                    images or cost != "energy_j"
                ):  # of a touch nearly all of it is waiting: no two are a factor apart
                    cost_axis(axes)
                for point in points:
                    look = {"color": colour[_kind(point)], "marker": marker[point["config"]["weight_bits"]]}
                    split = point["splits"][number]
                    bars = share_bars([split["accuracy"]], [split["spread"]])
                    place = [unit * point[cost]], [split["accuracy"]]
                    axes.errorbar(
                        *place, yerr=bars, elinewidth=0.7, markersize=5, markerfacecolor="none", **look
                    )
                _draw_front(axes, points, number, cost, unit)
                _draw_recommended(axes, points[result["recommended"]], number, cost, unit)
                axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0, symbol=""))
                title = f"unseen {split_name(splits[number]['groups'])}" + " (the split that is judged)" * (
                    number == 0
                )
                axes.set(
                    xlabel=label.format(clock=f"{points[0]['clock_hz'] / 1e6:g} MHz"),
                    ylabel="accuracy (%), mean and deviation over seeds",
                    title="" if images else title,
                )
        handles = [_handle(kind, colour[kind], markerfacecolor=colour[kind]) for kind in kinds]
        handles += [_handle(f"{bits}-bit weights", marker=marker[bits]) for bits in widths]
        handles.append(_handle("Pareto front of the panel", marker="", linestyle="-"))
        handles.append(_handle("recommended", RECOMMENDED, markersize=12))
        figure.legend(handles=handles, loc="outside lower center", ncols=5)
    return figure


def _handle(text: str, color: str = "black", marker: str = "o", **style: Any) -> Line2D:
    style = {"linestyle": "", "markerfacecolor": "none", **style}
    return Line2D([], [], color=color, marker=marker, label=text, **style)


def _kind(point: Record) -> str:
    """Common property of points of one colour: the cell, or the network for images."""
    return point["config"].get("network") or cell_name(point["config"])


def _name(point: Record) -> str:
    """``GRU 12, 8 bit`` or ``tactnet 28x50, 8 bit``."""
    config = point["config"]
    name = f"{config['network']} {config['size']}" if "network" in config else network_name(config)
    return f"{name}, {config['weight_bits']} bit"


def _draw_front(axes, points: list[Record], number: int, cost: str, unit: float) -> None:
    front = [points[i] for i in pareto(points, cost, lambda point: point["splits"][number]["accuracy"])]
    corners = [(unit * point[cost], point["splits"][number]["accuracy"]) for point in front]
    axes.step(*zip(*corners, strict=True), where="post", color="black", linewidth=1.2, zorder=1)
    # further right is further down, so that no line crosses a name
    line = {"arrowstyle": "-", "color": GREY, "linewidth": 0.5, "shrinkA": 0, "relpos": (0, 0)}
    style: Record = {"textcoords": axes.get_xaxis_transform(), "fontsize": 7, "va": "top", "arrowprops": line}
    low, high = axes.get_ylim()
    axes.set_ylim(low - 0.12 * (high - low), high + 0.5 * (high - low))  # room for names
    for k, (place, name) in enumerate(dict(zip(corners, map(_name, front), strict=True)).items()):
        axes.annotate(name, place, (place[0], 0.98 - 0.045 * k), **style)


def _draw_recommended(axes, point: Record, number: int, cost: str, unit: float) -> None:
    place = unit * point[cost], point["splits"][number]["accuracy"]
    ring = {"markersize": 13, "markerfacecolor": "none", "markeredgewidth": 1.8}
    axes.plot(*place, "o", color=RECOMMENDED, zorder=5, **ring)
    style: Record = {"textcoords": "axes fraction", "fontsize": 8.5, "color": RECOMMENDED, "ha": "center"}
    style["arrowprops"] = {"arrowstyle": "-", "color": RECOMMENDED, "shrinkB": 8}
    axes.annotate(f"recommended: {point['name']}", place, (0.5, 0.025), zorder=6, **style)
