"""The chart of ``eskin baselines``: accuracy on unseen groups against the multiplies of a decision, a panel a split."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

COLOURS = {"ours": "#cc3311", "thesis": "#ee8866", "simple": "#4477aa", "tensor": "#228833", "tiles": "#aa3377", "transfer": "#777777"}
"""By family."""
FAMILIES = {
    "ours": "our recipe",
    "thesis": "thesis's protocol",
    "simple": "simple methods",
    "tensor": "tensor kernel",
    "tiles": "images over time",
    "transfer": "one image, transfer",
}


def chart(result: Mapping[str, Any]):
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
    handles = [Line2D([], [], marker="o", linestyle="", color=COLOURS[name], label=FAMILIES[name]) for name in families]
    handles.append(Line2D([], [], marker="s", markersize=9, linestyle="", color="black", label="eskin puts it into hardware"))
    handles.append(Line2D([], [], linestyle=":", color="black", label="a point below the best"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def _panel(axes, rows: list[Mapping[str, Any]]) -> None:
    best = max(row["accuracy"] for row in rows)
    axes.axhline(100 * best - 1, color="black", linestyle=":", linewidth=1)
    low = min(row["accuracy"] for row in rows)
    heights: list[tuple[float, float]] = []
    import math

    for row in sorted(rows, key=lambda row: -row["accuracy"]):
        x, y = max(row["multiplies"], 1), 100 * row["accuracy"]
        marker, size = ("s", 70) if row["hardware"] else ("o", 35)
        axes.scatter(x, y, color=COLOURS[row["family"]], marker=marker, s=size, edgecolors="black" if row["hardware"] else "none", zorder=3)
        # a name goes down until it meets no other: 1.1 decades wide, a 28th of the axis high
        step = max(100 - 100 * low, 5) / 28
        place = y
        while any(abs(math.log10(x) - lx) < 1.1 and abs(place - ly) < step for lx, ly in heights):
            place -= step
        heights.append((math.log10(x), place))
        axes.annotate(
            row["method"], (x, y), xytext=(x * 1.22, place), textcoords="data", fontsize=8, va="center",
            arrowprops={"arrowstyle": "-", "color": "#bbbbbb", "linewidth": 0.5} if place < y - step / 2 else None,
        )  # fmt: skip
    axes.set_xscale("log")
    right = max(max(row["multiplies"], 1) for row in rows)
    axes.set_xlim(0.5, right * 14)
    axes.set_ylim(min(low * 100, min(h for _, h in heights)) - 3, max(101.0, 100 * best + 2))
    axes.set_ylabel("accuracy (%)")
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(True, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
