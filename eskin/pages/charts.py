"""Common parts of the charts."""

import base64
import io
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font
from matplotlib.text import Text
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from eskin.choose.choice_table import network_name
from eskin.choose.cost import pareto
from eskin.golden.core import Record
from eskin.pages.views import count
from eskin.training.record import CandidateRow

CHOSEN, OTHERS, SCANS = "#0072B2", "#E69F00", "#888888"
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#444444",
    "legend.frameon": False,
    "svg.hashsalt": "eskin",
    "svg.fonttype": "path",
    "font.family": "DejaVu Sans",
    "text.parse_math": False,
    "axes.titlelocation": "left",
    "axes.axisbelow": True,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.7,
}


def svg(figure: Figure) -> str:
    """The figure as a data address for an ``img``: a separate image, so that ids of two figures never
    meet."""
    letters = {ord(letter) for text in figure.findobj(Text) for letter in text.get_text()}
    known = get_font(findfont(STYLE["font.family"])).get_charmap().keys() | {ord("\n")}
    # what the font has no letters for is left to the reader's browser, as text
    other: dict[Any, Any] = {} if letters <= known else {"svg.fonttype": "none"}
    buffer = io.BytesIO()
    with rc_context(other), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        if layout := figure.get_layout_engine():
            layout.execute(figure)
        figure.set_layout_engine("none")
        # the layout's last digits vary from call to call and would change the names inside the image
        for axes in figure.axes:
            axes.set_position(np.round(axes.get_position().bounds, 6))
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode()


def log_axis(axes: Axes) -> None:
    """A logarithmic axis along x whose ticks are plain figures."""
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(lambda value, _: count(value) if value >= 10 else f"{value:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())


def draw_costs(
    axes: Axes, rows: Sequence[CandidateRow], costs: Sequence[float], label: str, down: Sequence[float]
) -> None:
    """Accuracy of ``rows`` against their costs, with the front of those that none beats in both; the mark of a row that
    fits is filled, the chosen one has its name.

    down: accuracies to which a line leads down from the chosen one.
    """
    # rounded, so that costs that are equal but for their last bits are one
    places = [(float(f"{cost:.6g}"), row.accuracy) for cost, row in zip(costs, rows, strict=True)]
    axes.step(*zip(*pareto(places), strict=True), where="post", color="#999999", linewidth=1, zorder=1)
    for row, place in zip(rows, places, strict=True):
        chosen = row.chosen
        colour = CHOSEN if chosen else OTHERS
        if chosen and down:
            axes.vlines(place[0], min(down), place[1], color=colour, linewidth=0.8, alpha=0.6, zorder=1)
            axes.plot([place[0]] * len(down), down, ls="", marker="_", color=colour, alpha=0.6, zorder=1)
        axes.errorbar(
            *place,
            yerr=row.standard_error,
            fmt="o",
            capsize=2,
            elinewidth=0.8,
            color=colour,
            markersize=9 if chosen else 6,
            markerfacecolor=colour if row.fits else "white",
            zorder=3 if chosen else 2,
        )
        if chosen:
            style: Record = {"textcoords": "offset points", "fontsize": 8, "weight": "bold", "ha": "center"}
            axes.annotate(f"chosen: {network_name(row)}", place, (0, 9), zorder=4, **style)
    axes.margins(x=0.15, y=0.15)
    low, high = axes.get_ylim()
    if down:  # the worst figure may lie below the drawing
        low = min(down[0], *(row.accuracy for row in rows)) - 0.05
    axes.set_ylim(max(low, -0.05), min(high, 1.03))  # an error bar may reach beyond what a share can be
    log_axis(axes)
    axes.set(xlabel=label, ylabel="accuracy, integer, cross-validated")
    axes.yaxis.set_major_formatter(lambda share, _: f"{share:.1%}" if abs(share - 0.5) < 0.501 else "")
    axes.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
