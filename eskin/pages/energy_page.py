"""The energy page: every configuration's estimate with its band, beside published figures; one self-contained
HTML file."""

from matplotlib import rc_context
from matplotlib.figure import Figure

from eskin.golden.core import Record
from eskin.pages.charts import CLASS_COLOURS, STYLE, cost_axis, svg
from eskin.pages.views import article, page, unit

PAGE = "energy.html"
PART_COLOURS = {"clock": CLASS_COLOURS[0], "toggles": CLASS_COLOURS[4], "multiplies": CLASS_COLOURS[2]}
PART_WORDS = {"clock": "clock", "toggles": "registers and logic", "multiplies": "multipliers"}


def draw_touch(rows: list[Record], least: str | None, thing: str = "touch") -> Figure:
    """Compute energy of a ``thing`` by what it is spent on, a bar a configuration, with the band; the least
    one is marked."""
    figure = Figure(figsize=(10.4, 1.3 + 0.42 * len(rows)), layout="constrained")
    axes = figure.subplots()
    names = [row["name"] + ("  (least)" if row["name"] == least else "") for row in rows]
    starts = [0.0] * len(rows)
    for part, colour in PART_COLOURS.items():
        widths = [1e6 * row["per_touch_parts_j"][part] for row in rows]
        axes.barh(names, widths, left=starts, color=colour, label=PART_WORDS[part], height=0.6)
        starts = [start + width for start, width in zip(starts, widths, strict=True)]
    for place, (row, total) in enumerate(zip(rows, starts, strict=True)):
        axes.plot(
            [total / row["band"], total * row["band"]],
            [place, place],
            color="#222222",
            linewidth=1.2,
            marker="|",
            markersize=8,
        )
        axes.annotate(
            unit(row["per_touch_j"], "J"),
            (total * row["band"], place),
            xytext=(6, -3),
            textcoords="offset points",
        )
    axes.invert_yaxis()
    axes.margins(x=0.12)
    axes.set_xlabel(f"compute energy of {article(thing)} (µJ), estimate; the line is its band")
    # (a band may go anywhere within the axes)
    figure.legend(loc="outside upper right", ncols=len(PART_COLOURS))
    return figure


def draw_power(rows: list[Record], thing: str = "touch") -> Figure:
    """Average power at one ``thing`` a second for every choice of clock, and the part's static power,
    logarithmic."""
    labels, values, static, colours = [], [], [], []
    for index, row in enumerate(rows):
        for choice in row["choices"]:
            labels.append(f"{row['name']}: {choice['name']}")
            values.append(1e6 * choice["average_w"])
            static.append(1e6 * row["static_w"])
            colours.append(CLASS_COLOURS[index % len(CLASS_COLOURS)])
    figure = Figure(figsize=(10.4, 0.9 + 0.27 * len(labels)), layout="constrained")
    axes = figure.subplots()
    places = range(len(labels))
    axes.scatter(values, places, color=colours, s=42, zorder=3)
    axes.grid(axis="x", color="#DDDDDD", linewidth=0.7)
    mark: Record = {
        "linestyle": "none",
        "marker": "|",
        "markersize": 11,
        "markeredgewidth": 2,
        "color": "#222222",
    }
    axes.plot(static, places, **mark, label="static power of the part")
    for place, value in zip(places, values, strict=True):
        axes.annotate(
            unit(1e-6 * value, "W"), (value, place), xytext=(8, -3), textcoords="offset points", fontsize=8
        )
    axes.set_yticks(places, labels, fontsize=8)
    cost_axis(axes)
    axes.set_xlim(0.5 * min(static), 3 * max(values))
    axes.invert_yaxis()
    axes.set_xlabel(f"average power at one {thing} a second (µW), estimate")
    axes.legend(loc="upper right")
    return figure


def render(result: Record) -> str:
    """The page of a result of eskin.study.energy.compare."""
    rows, thing = result["configurations"], result["what"]
    with rc_context(STYLE):
        charts = {
            "touch": svg(draw_touch(rows, result["least_touch"], thing)),
            "power": svg(draw_power(rows, thing)),
        }
    parts = {row["part"]: (row["rests_on"], row["band"]) for row in rows}
    return page(
        "energy.html.j2", result=result, rows=rows, charts=charts, parts=parts, thing=thing, a=article(thing)
    )
