"""The page of `eskin stability`: every failure mode with its figure, its bound and where it starts to fail,
from stability.json alone."""

from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from eskin.golden.core import Record
from eskin.pages.charts import STYLE, svg
from eskin.pages.views import page, percent, write_text
from eskin.study.stability.core import GROUPS, Curve, ModeResult, Stability, weakest

PAGE = "stability.html"
COLOURS = ("#0072B2", "#E69F00", "#009E73")
BOUND = "#b13a00"

GROUP_TITLES = {
    "numeric": "Numbers: rounding, saturation, widths, tables, bits",
    "stream": "The stream: touches in time, disturbances, clocks",
    "sensor": "The sensor: taxels that fail",
    "memory": "The memories: single bit flips",
}


def figure_in_words(value: float, unit: str) -> str:
    """A mode's figure: shares in percent, counts whole, the rest with four digits."""
    if unit.startswith(("accuracy", "share of")):
        return percent(value, 2)
    return f"{value:.0f}" if float(value).is_integer() and abs(value) < 1e9 else f"{value:.4g}"


FIRST = 12
"""Modes in the table before the details: those beyond their bounds and then those with the least room."""


def flat(curve: Curve) -> bool:
    """True if no line of a curve moves."""
    return all(max(line) - min(line) <= 1e-9 * max(1.0, abs(max(line))) for line in curve.lines.values())


def draw_mode(record: ModeResult, curve: Curve) -> Figure:
    """The curve of a mode with its bound; beyond the bound is shaded."""
    figure = Figure(figsize=(4.6, 2.5), layout="constrained")
    axes = figure.subplots()
    x = curve.x
    falling = len(x) > 1 and x[0] > x[-1]  # severity grows to the right
    for k, (name, y) in enumerate(curve.lines.items()):
        style = {"linewidth": 1.6, "zorder": 3} if k == 0 else {"linewidth": 1.0, "linestyle": "--"}
        axes.plot(
            x,
            y,
            marker="o" if len(x) < 30 else "",
            markersize=3,
            color=COLOURS[k % len(COLOURS)],
            label=name,
            **style,
        )
    if len(curve.lines) > 1:
        axes.legend()
    if curve.log and min(x) > 0:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")  # text is no mathematics on a page: not 10^2
    if falling:
        axes.invert_xaxis()
    low, high = axes.get_ylim()
    bound = record.bound
    low, high = min(low, bound - 0.06 * (high - low)), max(high, bound + 0.06 * (high - low))
    beyond = (low, bound) if record.sense == "at least" else (bound, high)
    axes.axhspan(*beyond, color=BOUND, alpha=0.07, linewidth=0, zorder=0)
    axes.axhline(bound, color=BOUND, linewidth=1.0)
    axes.set_ylim(low, high)
    if record.fails_at is not None:
        axes.axvline(record.fails_at, color=BOUND, linewidth=0.8, linestyle=":")
    if all(float(value).is_integer() for value in x) and not curve.log:
        axes.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=8))
    if len(x) == 1:
        axes.set_xticks(x)
    axes.set(xlabel=curve.xlabel, ylabel=curve.ylabel)
    return figure


def write_page(folder: str | Path, result: Stability) -> Path:
    """Make ``stability.html`` in ``folder`` of the content of stability.json; one file, nothing outside it is
    needed to show it."""
    groups: list[Record] = []
    with rc_context(STYLE | {"font.size": 7.5, "axes.labelsize": 8}):
        for group in GROUPS:
            records = [record for record in result.modes if record.group == group]
            charts = [
                None if (curve := record.curve) is None or flat(curve) else svg(draw_mode(record, curve))
                for record in records
            ]
            groups.append({"title": GROUP_TITLES[group], "modes": list(zip(records, charts, strict=True))})
    text = page(
        "stability.html.j2",
        result=result,
        groups=groups,
        weakest=weakest(result.modes),
        first=weakest(result.modes, FIRST),
        words=figure_in_words,
        failed=[record for record in result.modes if not record.passed],
        wrong=[record for record in result.modes if record.rtl and not record.rtl.bit_exact],
        confirmed=[record for record in result.modes if record.rtl],
    )
    write_text(path := Path(folder) / PAGE, text)
    return path
