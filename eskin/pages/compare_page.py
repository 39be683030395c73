"""The page of ``eskin compare``: float against integer, signal by signal; one self-contained HTML file."""

from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from eskin.golden.core import Record
from eskin.pages.charts import CLASS_COLOURS, STYLE, svg
from eskin.pages.views import page, parts, words

PAGE = "compare.html"
KINDS = {"weights": CLASS_COLOURS[0], "activations": CLASS_COLOURS[2]}
RANGE, LOST = "#D9D9D9", "#b13a00"


def draw_profiles(signals: Sequence[Record]) -> Figure:
    """A box a signal over its format's range, on a scale of powers of two.

    The grey bar runs from half the format's step (below it a value becomes 0) to its largest value (beyond it
    a value saturates). The box holds half of the absolute float values, the whiskers 90 %, the dots are the
    smallest and the largest (an arrow: smaller still; red: it saturates).
    """
    figure = Figure(figsize=(9.6, 0.9 + 0.32 * len(signals)), layout="constrained")
    axes = figure.subplots()
    ends = np.log2([(signal["step"] / 2, signal["limit"]) for signal in signals]).reshape(-1, 2)
    axes.barh(
        range(len(signals)), ends[:, 1] - ends[:, 0], left=ends[:, 0], height=0.84, color=RANGE, zorder=1
    )
    quantiles = {
        place: np.log2(signal["quantiles"]) for place, signal in enumerate(signals) if signal["quantiles"]
    }
    leftmost = min([*ends[:, 0], *(values[1] for values in quantiles.values())], default=0.0) - 1
    for place, (least, low, first, middle, third, high, most) in quantiles.items():
        colour = KINDS[signals[place]["kind"]]
        box = {"whislo": low, "q1": first, "med": middle, "q3": third, "whishi": high}
        line: Record = {"color": colour, "linewidth": 1.4}
        lines: Record = {
            "boxprops": {"edgecolor": colour, "facecolor": "white"},
            "whiskerprops": line,
            "medianprops": line,
        }
        hidden: Record = {"showfliers": False, "showcaps": False, "manage_ticks": False}
        axes.bxp(
            [box],
            [place],
            widths=0.48,
            orientation="horizontal",
            patch_artist=True,
            zorder=3,
            **lines,
            **hidden,
        )
        dots: Record = {"markersize": 4, "zorder": 4}
        axes.plot(max(least, leftmost), place, "o" if least >= leftmost else "<", color=colour, **dots)
        axes.plot(most, place, "o", color=LOST if most > ends[place, 1] else colour, **dots)
    names = [f"{signal['signal']}  {signal['format']}" for signal in signals]
    axes.set_yticks(range(len(signals)), names, fontsize=8, family="monospace")
    axes.set_ylim(len(signals) - 0.4, -0.6)
    axes.autoscale_view(scaley=False)
    low, high = (round(end) for end in axes.get_xlim())
    powers = range(low, high + 1, max(1, round((high - low) / 14)))
    axes.set_xticks(powers, [f"$2^{{{power}}}$" for power in powers], parse_math=True)
    axes.set_xlabel(
        "absolute float value; grey: what the format holds, from half a step to the largest value"
    )
    axes.grid(axis="x", color="#EEEEEE", zorder=0)
    return figure


def render(result: Record) -> str:
    """The page of a result of ``eskin.training.evaluate.compare_stages``."""
    with rc_context(STYLE):
        chart = svg(draw_profiles(result["signals"]))
    return page("compare.html.j2", result=result, chart=chart, findings=parts(words("findings", **result)))
