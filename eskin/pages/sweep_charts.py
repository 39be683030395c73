"""The chart of a sweep, from what sweep.json holds: accuracy against cost."""

import itertools
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter

from eskin.choose.cost import pareto
from eskin.golden.core import Record
from eskin.pages.charts import CLASS_COLOURS, STYLE, cost_axis, share_bars
from eskin.study.sweep import split_name

MARKERS = "ovs"
GREY, RECOMMENDED = "#777777", "#cc3311"

COSTS = {
    "latency_s": ("last features or pixel to decision (µs, {clock})", 1e6),
    "energy_j": ("energy of a touch or an image (µJ, estimate, iCE40UP5K)", 1e6),
}
"""Costs that accuracy is set against: key of a point, label, factor."""


def accuracy_chart(result: Record) -> Figure:
    """A row a split: accuracy against latency and energy. A colour a cell or network, a marker the bits of a weight;
    the front is marked and named, and the recommended point."""
    points, recommended = result["points"], result["points"][result["recommended"]]
    splits, kinds = points[0]["splits"], list(dict.fromkeys(map(_kind, points)))
    widths = sorted({point["config"]["weight_bits"] for point in points})
    colour = dict(zip(kinds, itertools.cycle(CLASS_COLOURS), strict=False))
    marker = dict(zip(widths, MARKERS, strict=False))
    with rc_context(STYLE | {"axes.grid": True}):
        figure = Figure(figsize=(14, 2.4 + 4.3 * len(splits)), layout="constrained")
        figure.suptitle(
            f"{result['data']}: accuracy on what was left out against cost\nrecommended: {result['sentence']}",
            fontsize=10,
        )
        panels = figure.subplots(len(splits), len(COSTS), squeeze=False)
        for number, row in enumerate(panels):
            for axes, (cost, (label, unit)) in zip(row, COSTS.items(), strict=True):
                cost_axis(axes)
                for point in points:
                    look = {"color": colour[_kind(point)], "marker": marker[point["config"]["weight_bits"]]}
                    split = point["splits"][number]
                    bars = share_bars([split["integer_accuracy"]], [float(np.std(split["integer_by_seed"]))])
                    place = [unit * point[cost]], [split["integer_accuracy"]]
                    axes.errorbar(
                        *place, yerr=bars, elinewidth=0.7, markersize=5, markerfacecolor="none", **look
                    )
                _draw_front(axes, points, number, cost, unit)
                place = unit * recommended[cost], recommended["splits"][number]["integer_accuracy"]
                ring = {"markersize": 13, "markerfacecolor": "none", "markeredgewidth": 1.8}
                axes.plot(*place, "o", color=RECOMMENDED, zorder=5, **ring)
                axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0, symbol=""))
                axes.set(
                    title=f"left out: {split_name(splits[number]['groups'])}",
                    xlabel=label.format(clock=f"{points[0]['clock_hz'] / 1e6:g} MHz"),
                    ylabel="accuracy (%), mean and deviation over seeds",
                )
        handles = [_handle(kind, colour[kind]) for kind in kinds]
        handles += [_handle(f"{bits}-bit weights", marker=marker[bits]) for bits in widths]
        handles.append(_handle("Pareto front of the panel", marker="", linestyle="-"))
        handles.append(_handle(f"recommended: {recommended['name']}", RECOMMENDED, markersize=12))
        figure.legend(handles=handles, loc="outside lower center", ncols=5)
    return figure


def _handle(text: str, color: str = "black", marker: str = "o", **style: Any) -> Line2D:
    style = {"linestyle": "", "markerfacecolor": "none", **style}
    return Line2D([], [], color=color, marker=marker, label=text, **style)


def _kind(point: Record) -> str:
    """Common property of points of one colour: the cell, or the network for images."""
    return point["config"]["network"].rstrip(" 0123456789")


def _draw_front(axes, points: list[Record], number: int, cost: str, unit: float) -> None:
    def accuracy(point):
        return point["splits"][number]["integer_accuracy"]

    front = [points[i] for i in pareto(points, cost, accuracy)]
    corners = [(unit * point[cost], accuracy(point)) for point in front]
    names = [f"{point['config']['network']}, {point['config']['weight_bits']} bit" for point in front]
    axes.step(*zip(*corners, strict=True), where="post", color="black", linewidth=1.2, zorder=1)
    # further right is further down, so that no line crosses a name
    line = {"arrowstyle": "-", "color": GREY, "linewidth": 0.5, "shrinkA": 0, "relpos": (0, 0)}
    style: Record = {"textcoords": axes.get_xaxis_transform(), "fontsize": 7, "va": "top", "arrowprops": line}
    low, high = axes.get_ylim()
    axes.set_ylim(low - 0.12 * (high - low), high + 0.5 * (high - low))  # room for names
    for k, (place, name) in enumerate(dict(zip(corners, names, strict=True)).items()):
        axes.annotate(name, place, (place[0], 0.98 - 0.045 * k), **style)
