"""The page of ``eskin compare``: float against integer, signal by signal; one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from eskin.golden.model.stage_error import QUANTILES
from eskin.pages.report import CLASS_COLOURS, STYLE, page_template, svg

PAGE = "compare.html"
KINDS = {"weights": CLASS_COLOURS[0], "activations": CLASS_COLOURS[2]}
RANGE, LOST = "#D9D9D9", "#b13a00"
SEEN = 0.001
"""Share of values outside a format's range from which the page names the signal."""


def draw_profiles(signals: Sequence[Mapping[str, Any]]) -> Figure:
    """A box a signal over its format's range, on a scale of powers of two.

    The grey bar runs from half the format's step (below it a value becomes 0) to its largest value (beyond it
    a value saturates). The box holds half of the absolute float values, the whiskers 90 %, the dots are the
    smallest and the largest (an arrow: smaller still; red: it saturates).
    """
    figure = Figure(figsize=(9.6, 0.9 + 0.32 * len(signals)), layout="constrained")
    axes = figure.subplots()
    named = dict(
        zip(("least", "low", "first", "middle", "third", "high", "most"), range(len(QUANTILES)), strict=True)
    )
    shown = [np.log2([signal["step"] / 2, *signal["quantiles"][1:2]]).min() for signal in signals]
    leftmost = min(shown, default=0.0) - 1
    for place, signal in enumerate(signals):
        ends = np.log2([signal["step"] / 2, signal["limit"]])
        axes.add_patch(
            Rectangle((ends[0], place - 0.42), ends[1] - ends[0], 0.84, color=RANGE, linewidth=0, zorder=1)
        )
        if not signal["quantiles"]:
            continue
        q = np.log2(signal["quantiles"])
        colour = KINDS[signal["kind"]]
        axes.plot([q[named["low"]], q[named["high"]]], [place, place], color=colour, linewidth=1.2, zorder=2)
        left, right = q[named["first"]], q[named["third"]]
        axes.add_patch(
            Rectangle(
                (left, place - 0.24),
                right - left,
                0.48,
                facecolor="white",
                edgecolor=colour,
                linewidth=1.4,
                zorder=3,
            )
        )
        axes.plot(
            [q[named["middle"]]] * 2, [place - 0.24, place + 0.24], color=colour, linewidth=1.8, zorder=4
        )
        least = q[named["least"]]
        axes.plot(
            max(least, leftmost),
            place,
            marker="o" if least >= leftmost else "<",
            markersize=4,
            color=colour,
            zorder=4,
        )
        axes.plot(
            q[named["most"]],
            place,
            marker="o",
            markersize=4,
            color=LOST if q[named["most"]] > ends[1] else colour,
            zorder=4,
        )
    axes.set_yticks(
        range(len(signals)),
        [f"{signal['signal']}  {signal['format']}" for signal in signals],
        fontsize=8,
        family="monospace",
    )
    axes.set_ylim(len(signals) - 0.4, -0.6)
    axes.autoscale_view(scaley=False)
    low, high = (round(end) for end in axes.get_xlim())
    every = max(1, round((high - low) / 14))
    axes.set_xticks(
        range(low, high + 1, every), [f"$2^{{{power}}}$" for power in range(low, high + 1, every)]
    )
    axes.set_xlabel(
        "absolute float value; grey: what the format holds, from half a step to the largest value"
    )
    axes.grid(axis="x", color="#EEEEEE", linewidth=0.7, zorder=0)
    return figure


def findings(result: Mapping[str, Any]) -> list[str]:
    """What to know before the tables: signals that saturate, signals that are lost below the step, the stage
    that counts most."""
    sentences = []
    for signal in result["signals"]:
        if signal["beyond"] >= SEEN:
            sentences.append(
                f"{signal['signal']}: {100 * signal['beyond']:.2g} % of its values lie beyond "
                f"{signal['format']} and saturate"
            )
        if signal["zero"] >= 0.25:
            sentences.append(
                f"{signal['signal']}: {100 * signal['zero']:.3g} % of its values are below half a step of "
                f"{signal['format']} and become 0"
            )
    error = result["logit_error"]
    if error["max"] is not None:
        sentences.append(
            f"logits differ by {error['mean']:.3g} on average and {error['max']:.3g} at most; of all stages "
            f"alone, {error['stage']} bring "
            "about the largest difference"
        )
    return sentences


def render(result: Mapping[str, Any]) -> str:
    """The page of a result of ``eskin.golden.training.evaluate.compare_stages``."""
    with rc_context(STYLE):
        chart = svg(draw_profiles(result["signals"]))
    return page_template("compare.html.j2").render(result=result, chart=chart, findings=findings(result))
