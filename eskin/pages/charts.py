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
from matplotlib.ticker import LogLocator, NullFormatter

from eskin.pages.views import count

CLASS_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's palette: told apart by colour-blind readers too. More classes repeat it with other line
styles."""
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
    """The figure as a data address for an ``img``: an image of its own, so that ids of two figures never
    meet."""
    letters = {ord(letter) for text in figure.findobj(Text) for letter in text.get_text()}
    known = get_font(findfont(STYLE["font.family"])).get_charmap().keys() | {ord("\n")}
    # what the font has no letters for is left to the reader's browser, as text
    other: dict[Any, Any] = {} if letters <= known else {"svg.fonttype": "none"}
    buffer = io.BytesIO()
    with rc_context(other), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        # the layout's last digits vary from call to call and would change the names inside the image
        for axes in figure.axes:
            axes.set_position(np.round(axes.get_position().bounds, 6))
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode()


def share_bars(shares: Sequence[float], spreads: Sequence[float | None]) -> np.ndarray:
    """Error bars (2, n), down and up, of shares between 0 and 1: no bar leaves that range. A spread of None
    has none."""
    share, spread = np.asarray(shares, dtype=float), np.array([value or 0.0 for value in spreads])
    return np.array([np.minimum(spread, share), np.minimum(spread, 1.0 - share)])


def panel_row(number: int, width: float, height: float, *, sharey: bool = True) -> tuple[Figure, list[Axes]]:
    """A figure of ``width`` x ``height`` inches with ``number`` panels in a row; panels with a common scale
    have grid lines."""
    figure = Figure(figsize=(width, height), layout="constrained")
    panels = figure.subplots(1, number, squeeze=False, sharey=sharey)[0]
    for axes in panels:
        axes.grid(sharey, axis="y")
    return figure, list(panels)


def cost_axis(axes: Axes) -> None:
    """A logarithmic axis of a cost, with plain numbers."""
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(lambda cost, _: count(cost) if cost >= 10 else f"{cost:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
