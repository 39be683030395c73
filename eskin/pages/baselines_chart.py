"""The chart of ``eskin baselines``: accuracy on unseen groups against the multiplies of a decision, a panel a
split."""

import math

from eskin.golden.core import Record

COLOURS = {
    "ours": "#cc3311",
    "thesis": "#ee8866",
    "simple": "#4477aa",
    "tensor": "#228833",
    "tiles": "#aa3377",
    "transfer": "#777777",
}
"""By family."""
FAMILIES = {
    "ours": "our recipe",
    "thesis": "thesis's protocol",
    "simple": "simple methods",
    "tensor": "tensor kernel",
    "tiles": "images over time",
    "transfer": "one image, transfer",
}


def chart(result: Record):
    """A matplotlib Figure of a result, as baselines.json has it. Methods without multiplies stand at 1."""
    from matplotlib.figure import Figure  # slow to import, and only a picture needs it
    from matplotlib.lines import Line2D

    splits = list(dict.fromkeys(row["split"] for row in result["rows"]))
    figure = Figure(figsize=(9, 1.3 + 4.6 * len(splits)), layout="constrained")
    panels = figure.subplots(len(splits), 1, squeeze=False)[:, 0]
    for axes, split in zip(panels, splits, strict=True):
        _panel(axes, [row for row in result["rows"] if row["split"] == split])
        axes.set_title(f"unseen {split}", loc="left", fontsize=10)
    panels[-1].set_xlabel("multiplies a decision (1: none, trees compare)")
    families = list(dict.fromkeys(row["family"] for row in result["rows"]))
    handles = [
        Line2D([], [], marker="o", linestyle="", color=COLOURS[name], label=FAMILIES[name])
        for name in families
    ]
    handles.append(
        Line2D(
            [], [], marker="s", markersize=9, linestyle="", color="black", label="eskin puts it into hardware"
        )
    )
    handles.append(Line2D([], [], linestyle=":", color="black", label="a point below the best"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


NAME_WIDTH = 1.1
"""Decades that a name takes at most."""


def _panel(axes, rows: list[Record]) -> None:
    """Every method and its name; a name goes down until it covers neither another one nor a mark."""
    points = [(math.log10(max(row["multiplies"], 1)), 100 * row["accuracy"]) for row in rows]
    top, bottom = max(y for _, y in points), min(y for _, y in points)
    axes.axhline(top - 1, color="black", linestyle=":", linewidth=1)
    pad = 0.08 * max(top - bottom, 2.0)
    step = (top - bottom + 2 * pad) / 24
    names: list[tuple[float, float]] = []
    for row, (x, y) in sorted(zip(rows, points, strict=True), key=lambda pair: -pair[1][1]):
        marker, size, edge = ("s", 70, "black") if row["hardware"] else ("o", 35, "none")
        axes.scatter(10**x, y, color=COLOURS[row["family"]], marker=marker, s=size, edgecolors=edge, zorder=3)
        place, end = y, x + 0.1 + NAME_WIDTH * len(row["method"]) / 13
        while any(
            abs(x - beside) < NAME_WIDTH and abs(place - height) < step for beside, height in names
        ) or any(x + 0.05 < beside < end and abs(place - height) < 0.8 * step for beside, height in points):
            place -= step / 4
        names.append((x, place))
        line = {"arrowstyle": "-", "color": "#bbbbbb", "linewidth": 0.5} if place < y - step / 2 else None
        axes.annotate(
            row["method"], (10**x, y), (10 ** (x + 0.09), place), fontsize=8, va="center", arrowprops=line
        )
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")  # text is no mathematics on a page: not 10^2
    axes.set_xlim(0.5, 10 ** (max(x for x, _ in points) + NAME_WIDTH))
    axes.set_ylim(min(bottom, min(height for _, height in names)) - pad, top + pad)
    axes.set_ylabel("accuracy (%)")
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(True, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
