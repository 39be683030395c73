"""The charts of a sweep, from what sweep.json holds: accuracy against cost, the local decision in time,
accuracy against bits."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from eskin.choose.cost import pareto
from eskin.golden.core import Record
from eskin.pages.charts import STYLE, cost_axis, share_bars
from eskin.study.sweep import cell_name, network_name, split_name

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
MARKERS, BASELINE_MARKERS, THESIS_MARKERS = "ovs^DPX*", "DPX", "<>^"
GREY = "#777777"
RECOMMENDED = "#cc3311"

THESIS: tuple[Record, ...] = (
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
THESIS_PLATFORMS: tuple[Record, ...] = (
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


def charts(result: Record) -> dict[str, Figure]:
    """File name without ending -> figure: ``accuracy``, and of recordings ``time`` and ``bits``."""
    with rc_context(STYLE | {"axes.grid": True}):
        figures = {"accuracy": accuracy_chart(result)}
        return (
            figures
            if of_images(result)
            else figures | {"time": time_chart(result), "bits": bits_chart(result)}
        )


def of_images(result: Record) -> bool:
    """True for a sweep over networks for images."""
    return bool(result.get("images"))


def _accuracy_axis(axes, low: float, high: float, *, below: float = 0.0, above: float = 0.0) -> None:
    """An accuracy axis in percent from ``low`` to 100, on which every halving of the errors takes the same
    height; even, and up to ``high`` only, where nothing comes near 100. ``below``, ``above``: room for words,
    as shares of that height."""
    stretched = high > STRETCH_FROM
    forward, back = (lambda a: np.asarray(a, dtype=float),) * 2
    if stretched:
        forward = lambda a: -np.log10(np.maximum(TOP - np.asarray(a, dtype=float), 1e-9))
        back = lambda y: TOP - 10.0 ** -np.asarray(y, dtype=float)
        high = 1.0
    axes.set_yscale("function", functions=(forward, back))
    first, last = forward([low, high])
    span = last - first
    axes.set_ylim(*back([first - below * span, last + max(above, 0.03) * span]))
    ticks = [tick for tick in TICKS if low <= tick <= high and not (stretched and tick in CROWDED)]
    axes.set_yticks(ticks, [f"{100 * tick:g}" for tick in ticks])
    axes.set_yticks([], minor=True)


def _split_title(result: Record, number: int) -> str:
    groups = (SPLIT_LABELS.get(name, name) for name in result["points"][0]["splits"][number]["groups"])
    return f"unseen {split_name(list(groups))}" + (" (the split that is judged)" if number == 0 else "")


def _legend(figure: Figure, columns: int, handles: Sequence[Any]) -> None:
    figure.legend(handles=handles, loc="outside lower center", ncols=columns)


# ---------------------------------------------------------------------- accuracy against cost
def accuracy_chart(result: Record) -> Figure:
    """A row a split: accuracy against latency, multiplies of a decision, and energy of a touch; of images
    against latency, energy and memory. A colour a cell or network, a marker the bits of a weight."""
    points, images, baselines = result["points"], of_images(result), result["baselines"]
    splits = len(points[0]["splits"])
    clock = f"{points[0]['clock_hz'] / 1e6:g} MHz"
    title = "accuracy on unseen groups against cost"
    note = NOTE
    label = "accuracy (%), mean and deviation over seeds"
    costs = {
        "latency_s": (f"latency of a decision, from its last features (µs, {clock})", 1e6),
        "multiplies_decision": ("multiplies of a decision (all steps of a touch)", 1.0),
        "energy_j": ("energy of a touch, waiting included (µJ; estimate, clock stops when idle)", 1e6),
    }
    if images:
        judged = f"{result['judged_images']} images left out, {result['folds']} folds"
        title = f"networks for images, integers, {judged}, {len(result['seeds'])} seed(s)"
        note, label = NOTE_IMAGES, "accuracy on images left out (%)"
        costs = {
            "latency_s": (f"last pixel to decision (ms, {clock})", 1e3),
            "energy_j": ("energy of the computation of an image (µJ, estimate, iCE40UP5K)", 1e6),
            "memory_bytes": ("weights, biases and maps (kB)", 1e-3),
        }
    figure = Figure(figsize=(20, 7.6 if images else 1.6 + 4.3 * splits), layout="constrained")
    figure.suptitle(f"{result['data']}: {title}\n{result['recommendation']['sentence']}\n{note}", fontsize=10)
    panels = figure.subplots(splits, 3, squeeze=False)
    kinds = list(dict.fromkeys(_kind(point) for point in points))
    widths = sorted({point["config"]["weight_bits"] for point in points}, reverse=images)
    colour = dict(zip(kinds, itertools.cycle(COLOURS), strict=False))
    marker = dict(zip(widths, itertools.cycle(MARKERS), strict=False))
    thesis = not images or _is_thesis_data(result)
    for number, row in enumerate(panels):
        shares = [network["splits"][number] for network in (*points, *baselines)]
        low, high = (
            [split["accuracy"] + sign * (split["spread"] or 0.0) for split in shares] for sign in (-1, 1)
        )
        low = [min(low) - 0.01]
        if number == 0 and thesis:
            low += THESIS_IMAGES.values() if images else [0.65]
        for axes, (cost, (xlabel, unit)) in zip(row, costs.items(), strict=True):
            _accuracy_axis(axes, max(0.0, min(low)), max(high), below=0.12, above=0.35)
            # of a touch nearly all of it is waiting: no two points are a factor apart
            if images or cost != "energy_j":
                cost_axis(axes)
            _points(axes, points, number, cost, unit, colour, marker)
            axes.set(xlabel=xlabel, ylabel=label, title="" if images else _split_title(result, number))
            if number == 0 and thesis:
                (_thesis_images if images else _thesis)(axes, cost, unit)
        style = {"color": "black", "markersize": 8}
        for mark, baseline in zip(itertools.cycle(BASELINE_MARKERS), baselines, strict=False):
            _mark(row[1], baseline["multiplies_decision"], baseline["splits"][number], marker=mark, **style)
        if baselines:
            everything = [*points, *baselines]
            _front_line(row[1], everything, number, "multiplies_decision", 1.0, color=GREY, linestyle="--")
        for axes, (cost, (_, unit)) in zip(row, costs.items(), strict=True):
            _recommended(axes, points[result["recommended"]], number, cost, unit)

    def handle(text: str, color: str = "black", marker: str = "o", **style: Any) -> Line2D:
        style = {"linestyle": "", "markerfacecolor": "none", **style}
        return Line2D([], [], color=color, marker=marker, label=text, **style)

    words = {8: "8-bit weights, rounded", 4: "4-bit weights, trained on"} if images else {}
    handles = [handle(kind, colour[kind], markerfacecolor=colour[kind]) for kind in kinds]
    handles += [handle(words.get(bits, f"{bits}-bit weights"), marker=marker[bits]) for bits in widths]
    handles.append(handle("Pareto front of the panel", marker="", linestyle="-", linewidth=1.2))
    if baselines:
        handles.append(handle("the same with the baselines", GREY, "", linestyle="--", linewidth=1.2))
    handles.append(handle("recommended", RECOMMENDED, markersize=12))
    handles += [
        handle(baseline["label"], marker=mark, markersize=8, markerfacecolor="black")
        for mark, baseline in zip(itertools.cycle(BASELINE_MARKERS), baselines, strict=False)
    ]
    source = "thesis, models 1 to 3" if images else "thesis, table 3.1"
    published = (THESIS_PLATFORMS if images else THESIS) if thesis else ()
    handles += [
        handle(f"{source}: {platform['name']}", GREY, mark, markerfacecolor=GREY)
        for mark, platform in zip(THESIS_MARKERS, published, strict=False)
    ]
    _legend(figure, 5 if images else 4, handles)
    return figure


def _kind(point: Record) -> str:
    """Common property of points of one colour: the cell, or the network for images."""
    return point["config"].get("network") or cell_name(point["config"])


def _name(point: Record) -> str:
    """``GRU 12, 8 bit`` or ``tactnet 28x50, 8 bit``."""
    config = point["config"]
    name = f"{config['network']} {config['size']}" if "network" in config else network_name(config)
    return f"{name}, {config['weight_bits']} bit"


def _points(
    axes, points, number: int, cost: str, unit: float, colour: Mapping[str, str], marker: Mapping[int, str]
) -> None:
    for point in points:
        look = {"color": colour[_kind(point)], "marker": marker[point["config"]["weight_bits"]]}
        look |= {"markerfacecolor": "none"}
        _mark(axes, unit * point[cost], point["splits"][number], markersize=5, **look)
    front = _front_line(axes, points, number, cost, unit, color="black")
    named: dict[Any, str] = {}
    for point in (points[i] for i in front):
        named.setdefault((unit * point[cost], point["splits"][number]["accuracy"]), _name(point))
    # further right is further down, so that no line crosses a name
    line = {"arrowstyle": "-", "color": GREY, "linewidth": 0.5, "shrinkA": 0, "relpos": (0, 0)}
    style: Record = {"textcoords": axes.get_xaxis_transform(), "fontsize": 7, "va": "top", "arrowprops": line}
    for k, (where, text) in enumerate(named.items()):
        axes.annotate(text, where, (where[0], 0.98 - 0.045 * k), **style)


def _front_line(axes, records, number: int, cost: str, unit: float, **style: Any) -> list[int]:
    def gain(record: Mapping[str, Any]) -> float:
        return record["splits"][number]["accuracy"]

    front = pareto(records, cost, gain)
    corners = [unit * records[i][cost] for i in front], [gain(records[i]) for i in front]
    axes.step(*corners, where="post", linewidth=1.2, zorder=1, **style)
    return front


def _mark(axes, x: float, split: Record, **style: Any) -> None:
    bars = share_bars([split["accuracy"]], [split["spread"]])
    axes.errorbar([x], [split["accuracy"]], yerr=bars, elinewidth=0.7, linestyle="", **style)


def _is_thesis_data(result: Record) -> bool:
    """The thesis's figures belong beside images of 22 classes of its sizes alone."""
    sizes = {point["config"]["size"] for point in result["points"]}
    return result["classes"] == 22 and bool(sizes & set(THESIS_IMAGES))


def _thesis_images(axes, cost: str, unit: float) -> None:
    for mark, platform in zip(THESIS_MARKERS, THESIS_PLATFORMS, strict=True):
        if cost in platform:
            positions = [unit * value for value in platform[cost]]
            axes.plot(positions, list(THESIS_IMAGES.values()), mark, color=GREY)


def _thesis(axes, cost: str, unit: float) -> None:
    for mark, network in zip(THESIS_MARKERS, THESIS, strict=False):
        gates, h, d = 3 if network["cell"] == "gru" else 4, network["hidden"], 16
        multiplies = 20 * (gates * h * (d + h) + (gates - 1) * h + 3 * h)
        x = {"multiplies_decision": multiplies, "latency_s": network["latency_s"]}.get(cost)
        if x is None:
            continue
        _mark(axes, unit * x, network, color=GREY, marker=mark)
        text = "LSTM20 on a GPU, less than this" if cost == "latency_s" else network["name"]
        style = {"color": GREY, "textcoords": "offset points", "fontsize": 7, "ha": "right", "va": "center"}
        place = (-8, -9 if mark == "<" else 7)
        axes.annotate(f"thesis, other data set: {text}", (unit * x, network["accuracy"]), place, **style)


def _recommended(axes, point: Record, number: int, cost: str, unit: float) -> None:
    place = unit * point[cost], point["splits"][number]["accuracy"]
    ring = {"markersize": 13, "markerfacecolor": "none", "markeredgewidth": 1.8}
    axes.plot(*place, "o", color=RECOMMENDED, zorder=5, **ring)
    style = {
        "textcoords": "axes fraction",
        "fontsize": 8.5,
        "color": RECOMMENDED,
        "ha": "center",
        "arrowprops": {"arrowstyle": "-", "color": RECOMMENDED, "shrinkB": 8},
        "bbox": {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1},
    }
    axes.annotate(f"recommended: {point['name']}", place, (0.5, 0.025), zorder=6, **style)


# ---------------------------------------------------------------------- lines
def _line_panels(result: Record, rows: int, height: float, title: str) -> tuple[Figure, np.ndarray]:
    """A figure with a column of panels a split."""
    splits = len(result["points"][0]["splits"])
    figure = Figure(figsize=(2 + 5 * splits, height), layout="constrained")
    figure.suptitle(f"{result['data']}\n{title}", fontsize=11)
    panels = figure.subplots(rows, splits, squeeze=False)
    for row in panels:
        for number, axes in enumerate(row):
            axes.set_title(_split_title(result, number), fontsize=10)
    return figure, panels


def _finish(axes, xlabel: str, ylabel: str) -> None:
    """An accuracy axis that holds all that was drawn."""
    limits = axes.dataLim
    _accuracy_axis(axes, max(0.0, limits.y0 - 0.03), min(1.0, limits.y1 + 0.03))
    axes.set(xlabel=xlabel, ylabel=ylabel)


def time_chart(result: Record) -> Figure:
    """A panel a split: accuracy of the local decision against the time since the onset, a line for each
    network of the front."""
    front: dict[str, Record] = {}
    for point in sorted(result["points"], key=lambda point: point["multiplies_decision"]):
        if point["on_front"]:
            front.setdefault(f"{_name(point)}, {point['config']['steps']} steps", point)
    title = "how early the local decision can speak, points of the front"
    figure, (panels,) = _line_panels(result, 1, 5.6, title)
    for number, axes in enumerate(panels):
        styles = itertools.product(("-", "--", ":"), COLOURS)
        for (name, point), (dash, colour) in zip(front.items(), itertools.cycle(styles), strict=False):
            rows = point["splits"][number]["per_step"]
            line = [1e3 * row["time_s"] for row in rows], [row["accuracy"] for row in rows]
            axes.plot(*line, marker=".", linestyle=dash, color=colour, linewidth=1.2, label=name)
        _finish(
            axes,
            "time from the onset to the end of the step's window (ms)",
            "accuracy of the local decision (%)",
        )
    _legend(figure, 4, panels[0].get_legend_handles_labels()[0])
    return figure


def bits_chart(result: Record) -> Figure:
    """Columns: splits. Above accuracy with its deviation over seeds, below agreement with float, against the
    bits of a weight; a line a network, broken where it was trained in integers."""
    lines: dict[str, dict[int, Record]] = {}
    configs = [point["config"] for point in result["points"]]
    varied = [key for key in ("steps", "hop", "decision") if len({config[key] for config in configs}) > 1]
    aware = {config["quantisation_aware"] for config in configs}
    words = {False: "quantised after training", True: "quantisation-aware training"}
    for point, config in zip(result["points"], configs, strict=True):
        details = [f"{key} {config[key]}" for key in varied]
        details += [words[config["quantisation_aware"]]] * (len(aware) > 1)
        lines.setdefault(", ".join((network_name(config), *details)), {})[config["weight_bits"]] = point
    title = "bits of a weight" + ("" if len(aware) > 1 else f", {words[aware.pop()]}")
    figure, panels = _line_panels(result, 2, 9, title)
    ylabels = {
        "accuracy": "accuracy of the integer network (%)",
        "agreement": "agreement with the float network (%)",
    }
    for (key, ylabel), row in zip(ylabels.items(), panels, strict=True):
        for number, axes in enumerate(row):
            for k, (name, line) in enumerate(lines.items()):
                bits = sorted(line)
                beside = [b + 0.5 * (k - (len(lines) - 1) / 2) / len(lines) for b in bits]
                judged = [line[b]["splits"][number] for b in bits]
                shares = [split[key] for split in judged]
                spreads = [split["spread"] if key == "accuracy" else None for split in judged]
                trained = next(iter(line.values()))["config"]["quantisation_aware"]
                style: Record = {"marker": MARKERS[k % len(MARKERS)], "color": COLOURS[k % len(COLOURS)]}
                style |= {"linestyle": "--" if trained else "-", "linewidth": 1.1, "markersize": 4}
                bars = share_bars(shares, spreads)
                axes.errorbar(beside, shares, yerr=bars, elinewidth=0.6, label=name, **style)
            _finish(axes, "weight bits", ylabel)
            axes.set_xticks(sorted({bits for line in lines.values() for bits in line}))
    _legend(figure, 5, panels[0][0].get_legend_handles_labels()[0])
    return figure
