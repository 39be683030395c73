"""The charts of a sweep, from what sweep.json holds: accuracy against cost, the local decision in time,
accuracy against bits."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

from eskin.golden.studies.sweep import cell_name, network_name, pareto, split_name
from eskin.pages.charts import share_bars

COLOURS = (
    "#4477aa",
    "#ee6677",
    "#228833",
    "#aa3377",
    "#66ccee",
    "#ccbb44",
    "#ee8866",
    "#77aadd",
    "#999933",
    "#882255",
    "#44bb99",
    "#332288",
)
MARKERS = "ovs^DPX*"
GREY = "#777777"
RECOMMENDED = "#cc3311"

THESIS: tuple[dict[str, Any], ...] = (
    {
        "name": "GRU20, 12 neurons",
        "accuracy": 0.7307,
        "spread": 0.0653,
        "cell": "gru",
        "hidden": 12,
        "latency_s": None,
    },
    {
        "name": "LSTM20, 10 neurons",
        "accuracy": 0.7402,
        "spread": 0.0656,
        "cell": "lstm",
        "hidden": 10,
        "latency_s": 5e-3,
    },
)
"""Means and deviations of table 3.1 of the thesis this project starts from (3 classes, 16 taxels, 20 steps);
latency: its GPU's bound."""

THESIS_IMAGES = {"28x50": 0.9070, "26x47": 0.9198, "28x40": 0.9088}
THESIS_PLATFORMS: tuple[dict[str, Any], ...] = (
    {
        "name": "Jetson TX2",
        "latency_s": (5.5597e-3, 5.2905e-3, 5.919e-3),
        "energy_j": (850.6341e-6, 809.4465e-6, 905.607e-6),
    },
    {"name": "NCS2", "latency_s": (1.9e-3, 1.9e-3, 1.86e-3), "energy_j": (1520e-6, 1520e-6, 1488e-6)},
    {
        "name": "Raspberry Pi 4",
        "latency_s": (1.615e-3, 1.473e-3, 1.21e-3),
        "energy_j": (1130.5e-6, 1031.1e-6, 847e-6),
    },
)
"""TactNet4 of the same thesis, models 1 to 3: accuracy by size in figure 4.6 (mean over five folds), tables
4.3 (TensorRT, OpenVINO, TFLite) and 4.5 (dynamic energy)."""

TOP = 1.004
"""Accuracy at which the stretched axis would reach infinity."""
STRETCH_FROM = 0.95
"""The axis is stretched where something is above this."""
TICKS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95, 0.98, 0.99, 1.0)

NOTE = (
    "Thesis marks: a DIFFERENT data set (3 classes, 16 taxels), not comparable. Accuracy is stretched "
    "towards 100 %. "
    "Baselines compute in float; their latency is not known."
)
NOTE_IMAGES = (
    "Thesis marks: the same 22 objects on other folds, float, measured on its platforms (tables 4.3 and "
    "4.5). Ours: cycles by formula; "
    "energy of the computation by estimate, good to a factor of 2 either way, waiting for the image left out."
)
CROWDED = (0.65, 0.75, 0.85)
"""Ticks that a stretched axis leaves out."""

SPLIT_LABELS = {"label": "class"}


def charts(result: Mapping[str, Any]) -> dict[str, Any]:
    """File name without ending -> matplotlib Figure: ``accuracy``, and of recordings ``time`` and
    ``bits``."""
    return {"accuracy": accuracy_chart(result)} | (
        {} if of_images(result) else {"time": time_chart(result), "bits": bits_chart(result)}
    )


def of_images(result: Mapping[str, Any]) -> bool:
    """True for a sweep over networks for images."""
    return bool(result.get("images"))


def _figure(width: float, height: float):
    from matplotlib.figure import Figure  # slow to import, and only a picture needs it

    return Figure(figsize=(width, height), layout="constrained")


def _accuracy_axis(axes, low: float, high: float, *, below: float = 0.0, above: float = 0.0) -> None:
    """An accuracy axis in percent from ``low`` to 100, on which every halving of the errors takes the same
    height; even, and up to ``high`` only, where nothing comes near 100. ``below``, ``above``: room for words,
    as shares of that height."""
    import numpy as np

    stretched = high > STRETCH_FROM

    def forward(a):
        return (
            -np.log10(np.maximum(TOP - np.asarray(a, dtype=float), 1e-9))
            if stretched
            else np.asarray(a, dtype=float)
        )

    def back(y):
        return TOP - 10.0 ** -np.asarray(y, dtype=float) if stretched else np.asarray(y, dtype=float)

    axes.set_yscale("function", functions=(forward, back))
    first, last = forward(low), forward(1.0 if stretched else high)
    span = last - first
    axes.set_ylim(float(back(first - below * span)), float(back(last + max(above, 0.03) * span)))
    shown = [
        tick
        for tick in TICKS
        if low <= tick <= (1.0 if stretched else high) and not (stretched and tick in CROWDED)
    ]
    axes.set_yticks(shown)
    axes.set_yticks([], minor=True)
    axes.yaxis.set_major_formatter(lambda tick, _: f"{100 * tick:g}")


def _cost_axis(axes) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(lambda tick, _: f"{tick:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())


def _groups_in_words(groups: Sequence[str]) -> str:
    return split_name([SPLIT_LABELS.get(name, name) for name in groups])


def _split_title(result: Mapping[str, Any], number: int) -> str:
    groups = result["points"][0]["splits"][number]["groups"]
    return f"unseen {_groups_in_words(groups)}" + (" (the split that is judged)" if number == 0 else "")


def _tidy(axes, xlabel: str, ylabel: str) -> None:
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(True, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)


# ---------------------------------------------------------------------- accuracy against cost
def accuracy_chart(result: Mapping[str, Any]):
    """A row a split: accuracy against latency, multiplies of a decision, and energy of a touch; of images
    against latency, energy and memory. A colour a cell or network, a marker the bits of a weight."""
    from matplotlib.lines import Line2D

    points, images = result["points"], of_images(result)
    splits = len(points[0]["splits"])
    figure = _figure(20, 7.6 if images else 1.6 + 4.3 * splits)
    title = f"{result['data']}: accuracy on unseen groups against cost"
    if images:
        judged = f"{result['judged_images']} images left out, {result['parts']} of {result['folds']} folds, {len(result['seeds'])} seed(s)"
        title = f"{result['data']}: networks for images, integers, {judged}"
    note = NOTE_IMAGES if images else NOTE
    figure.suptitle(f"{title}\n{result['recommendation']['sentence']}\n{note}", fontsize=10, parse_math=False)
    panels = figure.subplots(splits, 3, squeeze=False)
    kinds = list(dict.fromkeys(_kind(point) for point in points))
    widths = sorted({point["config"]["weight_bits"] for point in points}, reverse=images)
    colour = {kind: COLOURS[k % len(COLOURS)] for k, kind in enumerate(kinds)}
    marker = {bits: MARKERS[k % len(MARKERS)] for k, bits in enumerate(widths)}
    clock = f"{points[0]['clock_hz'] / 1e6:g} MHz"
    costs = (
        ("latency_s", f"latency of a decision, from its last features (µs, {clock})", 1e6),
        ("multiplies_decision", "multiplies of a decision (all steps of a touch)", 1.0),
        ("energy_j", "energy of a touch, waiting included (µJ; estimate, clock stops when idle)", 1e6),
    )
    if images:
        costs = (
            ("latency_s", f"last pixel to decision (ms, {clock})", 1e3),
            ("energy_j", "energy of the computation of an image (µJ, estimate, iCE40UP5K)", 1e6),
            ("memory_bytes", "weights, biases and maps (kB)", 1e-3),
        )
    thesis, baselines = not images or _is_thesis_data(result), result["baselines"]
    label = "accuracy on images left out (%)" if images else "accuracy (%), mean and deviation over seeds"
    for number, row in enumerate(panels):
        shares = [network["splits"][number] for network in (*points, *baselines)]
        low = min(split["accuracy"] - (split["spread"] or 0.0) for split in shares) - 0.01
        if number == 0 and thesis:
            low = min(low, *THESIS_IMAGES.values()) if images else min(low, 0.65)
        high = max(split["accuracy"] + (split["spread"] or 0.0) for split in shares)
        for axes, (cost, xlabel, unit) in zip(row, costs, strict=True):
            _accuracy_axis(axes, max(0.0, low), high, below=0.12, above=0.35)
            # of a touch nearly all of it is waiting: no two points are a factor apart
            if images or cost != "energy_j":
                _cost_axis(axes)
            _points(axes, points, number, cost, unit, colour, marker)
            _tidy(axes, xlabel, label)
            if not images:
                axes.set_title(_split_title(result, number), fontsize=10, loc="left")
            if number == 0 and thesis:
                (_thesis_images if images else _thesis)(axes, cost, unit)
        for k, baseline in enumerate(baselines):
            _baseline(row[1], baseline, number, BASELINE_MARKERS[k % len(BASELINE_MARKERS)])
        if baselines:
            _front_line(
                row[1], [*points, *baselines], number, "multiplies_decision", 1.0, color=GREY, linestyle="--"
            )
        for axes, (cost, _, unit) in zip(row, costs, strict=True):
            _recommended(axes, points[result["recommended"]], number, cost, unit)

    def handle(text: str, color: str = "black", mark: str = "o", **style: Any) -> Line2D:
        return Line2D(
            [],
            [],
            color=color,
            marker=mark,
            label=text,
            **{"linestyle": "", "markerfacecolor": "none", **style},
        )

    words = {8: "8-bit weights, rounded", 4: "4-bit weights, trained on"} if images else {}
    handles = [handle(kind, colour[kind], markerfacecolor=colour[kind]) for kind in kinds]
    handles += [handle(words.get(bits, f"{bits}-bit weights"), mark=marker[bits]) for bits in widths]
    handles.append(handle("Pareto front of the panel", mark="", linestyle="-", linewidth=1.2))
    if baselines:
        handles.append(handle("the same with the baselines", GREY, "", linestyle="--", linewidth=1.2))
    handles.append(handle("recommended", RECOMMENDED, markersize=12))
    marks = zip(itertools.cycle(BASELINE_MARKERS), baselines, strict=False)
    handles += [
        handle(baseline["label"], mark=mark, markersize=8, markerfacecolor="black")
        for mark, baseline in marks
    ]
    source = "thesis, models 1 to 3" if images else "thesis, table 3.1"
    published = (THESIS_PLATFORMS if images else THESIS) if thesis else ()
    handles += [
        handle(f"{source}: {platform['name']}", GREY, mark, markerfacecolor=GREY)
        for mark, platform in zip("<>^", published, strict=False)
    ]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=5 if images else 4, fontsize=9, frameon=False
    )
    return figure


def _kind(point: Mapping[str, Any]) -> str:
    """What points of one colour have in common: the cell, or the network for images."""
    return point["config"].get("network") or cell_name(point["config"])


def _name(point: Mapping[str, Any]) -> str:
    """``GRU 12, 8 bit`` or ``tactnet 28x50, 8 bit``."""
    config = point["config"]
    return f"{config['network']} {config['size']}" if "network" in config else network_name(config)


BASELINE_MARKERS = "DPX"


def _points(
    axes, points, number: int, cost: str, unit: float, colour: Mapping[str, str], marker: Mapping[int, str]
) -> None:
    for point in points:
        split, config = point["splits"][number], point["config"]
        _with_spread(
            axes,
            unit * point[cost],
            split,
            color=colour[_kind(point)],
            marker=marker[config["weight_bits"]],
            markersize=5,
        )
    front = _front_line(axes, points, number, cost, unit, color="black")
    named: dict[Any, Any] = {}
    for i in front:
        named.setdefault((unit * points[i][cost], points[i]["splits"][number]["accuracy"]), points[i])
    # further right is further down, so that no line crosses a name
    for k, (where, point) in enumerate(named.items()):
        text = f"{_name(point)}, {point['config']['weight_bits']} bit"
        axes.annotate(
            text,
            where,
            xytext=(where[0], 0.98 - 0.045 * k),
            textcoords=axes.get_xaxis_transform(),
            fontsize=7,
            va="top",
            arrowprops={"arrowstyle": "-", "color": GREY, "linewidth": 0.5, "shrinkA": 0, "relpos": (0, 0)},
        )


def _front_line(axes, records, number: int, cost: str, unit: float, **style: Any) -> list[int]:
    def gain(record: Mapping[str, Any]) -> float:
        return record["splits"][number]["accuracy"]

    front = pareto(records, cost, gain)
    axes.step(
        [unit * records[i][cost] for i in front],
        [gain(records[i]) for i in front],
        where="post",
        linewidth=1.2,
        zorder=1,
        **style,
    )
    return front


def _with_spread(axes, x: float, split: Mapping[str, Any], **style: Any) -> None:
    bars = share_bars([split["accuracy"]], [split["spread"]])
    axes.errorbar(
        [x], [split["accuracy"]], yerr=bars, elinewidth=0.7, linestyle="", markerfacecolor="none", **style
    )


def _baseline(axes, baseline: Mapping[str, Any], number: int, mark: str) -> None:
    split = baseline["splits"][number]
    bars = share_bars([split["accuracy"]], [split["spread"]])
    axes.errorbar(
        [baseline["multiplies_decision"]],
        [split["accuracy"]],
        yerr=bars,
        color="black",
        marker=mark,
        markersize=8,
        linestyle="",
    )


def _is_thesis_data(result: Mapping[str, Any]) -> bool:
    """The thesis's figures belong beside images of 22 classes of its sizes alone."""
    return result["classes"] == 22 and any(
        point["config"]["size"] in THESIS_IMAGES for point in result["points"]
    )


def _thesis_images(axes, cost: str, unit: float) -> None:
    for mark, platform in zip("<>^", THESIS_PLATFORMS, strict=True):
        if cost in platform:
            positions = [unit * value for value in platform[cost]]
            axes.plot(
                positions, list(THESIS_IMAGES.values()), color=GREY, marker=mark, linestyle="", markersize=6
            )


def _thesis(axes, cost: str, unit: float) -> None:
    if cost == "energy_j":
        return
    for mark, network in zip("<>", THESIS, strict=True):
        gates, h, d = (3, network["hidden"], 16) if network["cell"] == "gru" else (4, network["hidden"], 16)
        multiplies = 20 * (gates * h * (d + h) + (gates - 1) * h + 3 * h)
        x = multiplies if cost == "multiplies_decision" else network["latency_s"]
        if x is None:
            continue
        axes.errorbar(
            [unit * x],
            [network["accuracy"]],
            yerr=network["spread"],
            color=GREY,
            marker=mark,
            linestyle="",
            elinewidth=0.7,
        )
        text = "LSTM20 on a GPU, less than this" if cost == "latency_s" else network["name"]
        where = (-8, -9) if mark == "<" else (-8, 7)
        axes.annotate(
            f"thesis, other data set: {text}",
            (unit * x, network["accuracy"]),
            xytext=where,
            color=GREY,
            textcoords="offset points",
            fontsize=7,
            ha="right",
            va="center",
        )


def _recommended(axes, point: Mapping[str, Any], number: int, cost: str, unit: float) -> None:
    x, y = unit * point[cost], point["splits"][number]["accuracy"]
    axes.plot(
        [x],
        [y],
        marker="o",
        markersize=13,
        markerfacecolor="none",
        markeredgecolor=RECOMMENDED,
        markeredgewidth=1.8,
        zorder=5,
    )
    axes.annotate(
        f"recommended: {point['name']}",
        (x, y),
        xytext=(0.5, 0.025),
        textcoords="axes fraction",
        fontsize=8.5,
        color=RECOMMENDED,
        ha="center",
        arrowprops={"arrowstyle": "-", "color": RECOMMENDED, "shrinkB": 8},
        zorder=6,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1},
    )


# ---------------------------------------------------------------------- the local decision in time
def time_chart(result: Mapping[str, Any]):
    """A panel a split: accuracy of the local decision against the time since the onset, a line for each
    network of the front."""
    front: dict[str, Mapping[str, Any]] = {}
    for point in sorted(
        (p for p in result["points"] if p["on_front"]), key=lambda p: p["multiplies_decision"]
    ):
        front.setdefault(
            f"{network_name(point['config'])}, {point['config']['weight_bits']} bit, "
            f"{point['config']['steps']} steps",
            point,
        )
    splits = len(result["points"][0]["splits"])
    figure = _figure(2 + 5 * splits, 5.6)
    figure.suptitle(
        f"{result['data']}\nhow early the local decision can speak, points of the front",
        fontsize=11,
        parse_math=False,
    )
    for number, axes in enumerate(figure.subplots(1, splits, squeeze=False)[0]):
        for k, (name, point) in enumerate(front.items()):
            rows = point["splits"][number]["per_step"]
            style = {
                "linestyle": ("-", "--", ":")[k // len(COLOURS) % 3],
                "color": COLOURS[k % len(COLOURS)],
                "marker": ".",
            }
            _line(
                axes,
                [1e3 * row["time_s"] for row in rows],
                [row["accuracy"] for row in rows],
                None,
                name,
                linewidth=1.2,
                **style,
            )
        _finish(
            axes,
            "time from the onset to the end of the step's window (ms)",
            "accuracy of the local decision (%)",
        )
        axes.set_title(_split_title(result, number), fontsize=10, loc="left")
    figure.legend(
        *figure.axes[0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=4,
        fontsize=9,
        frameon=False,
    )
    return figure


def _line(
    axes, x: Sequence[float], y: Sequence[float], bars: Sequence[float] | None, name: str, **style: Any
) -> None:
    axes.errorbar(
        x, y, yerr=None if bars is None else share_bars(y, bars), elinewidth=0.6, label=name, **style
    )


def _finish(axes, xlabel: str, ylabel: str) -> None:
    """An accuracy axis that holds all that was drawn."""
    limits = axes.dataLim
    _accuracy_axis(axes, max(0.0, limits.y0 - 0.03), min(1.0, limits.y1 + 0.03))
    _tidy(axes, xlabel, ylabel)


# ---------------------------------------------------------------------- bits
def bits_chart(result: Mapping[str, Any]):
    """Columns: splits. Above accuracy with its deviation over seeds, below agreement with float, against the
    bits of a weight; a line a network, broken where it was trained in integers."""
    lines: dict[str, dict[int, Mapping[str, Any]]] = {}
    possible = ("steps", "hop", "decision")
    varied = [key for key in possible if len({point["config"][key] for point in result["points"]}) > 1]
    aware = {point["config"]["quantisation_aware"] for point in result["points"]}
    words = {False: "quantised after training", True: "quantisation-aware training"}
    how = "" if len(aware) > 1 else f", {words[aware.pop()]}"
    for point in result["points"]:
        config = point["config"]
        details = [f"{key} {config[key]}" for key in varied] + (
            [] if how else [words[config["quantisation_aware"]]]
        )
        lines.setdefault(", ".join((network_name(config), *details)), {})[config["weight_bits"]] = point
    splits = len(result["points"][0]["splits"])
    figure = _figure(2 + 5 * splits, 9)
    figure.suptitle(f"{result['data']}\nbits of a weight{how}", fontsize=11, parse_math=False)
    widths = sorted({bits for line in lines.values() for bits in line})
    rows = (
        ("accuracy", "accuracy of the integer network (%)"),
        ("agreement", "agreement with the float network (%)"),
    )
    for (key, label), panels in zip(rows, figure.subplots(2, splits, squeeze=False), strict=True):
        for number, axes in enumerate(panels):
            for k, (name, line) in enumerate(lines.items()):
                bits = sorted(line)
                beside = [b + 0.5 * (k - (len(lines) - 1) / 2) / len(lines) for b in bits]
                judged = [line[b]["splits"][number] for b in bits]
                bars = [(split["spread"] or 0.0) if key == "accuracy" else 0.0 for split in judged]
                trained = next(iter(line.values()))["config"]["quantisation_aware"]
                style = {
                    "marker": MARKERS[k % len(MARKERS)],
                    "color": COLOURS[k % len(COLOURS)],
                    "linestyle": "--" if trained else "-",
                }
                _line(
                    axes,
                    beside,
                    [split[key] for split in judged],
                    bars,
                    name,
                    markersize=4,
                    linewidth=1.1,
                    **style,
                )
            _finish(axes, "weight bits", label)
            axes.set_xticks(widths)
            axes.set_title(_split_title(result, number), fontsize=10, loc="left")
    figure.legend(
        *figure.axes[0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=5,
        fontsize=9,
        frameon=False,
    )
    return figure
