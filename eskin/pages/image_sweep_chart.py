"""The chart of a sweep over networks for images: accuracy against latency, energy and memory, the thesis's platforms beside it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from eskin.pages.sweep_charts import COLOURS, GREY, MARKERS, RECOMMENDED, _cost_axis, _figure, _front_line, _tidy

THESIS = {
    "accuracy": {"28x50": 0.9070, "26x47": 0.9198, "28x40": 0.9088},
    "platforms": (
        {"name": "Jetson TX2", "latency_s": (5.5597e-3, 5.2905e-3, 5.919e-3), "energy_j": (850.6341e-6, 809.4465e-6, 905.607e-6)},
        {"name": "NCS2", "latency_s": (1.9e-3, 1.9e-3, 1.86e-3), "energy_j": (1520e-6, 1520e-6, 1488e-6)},
        {"name": "Raspberry Pi 4", "latency_s": (1.615e-3, 1.473e-3, 1.21e-3), "energy_j": (1130.5e-6, 1031.1e-6, 847e-6)},
    ),
}
"""TactNet4 of the thesis this project starts from, models 1 to 3: figure 4.6 (mean over five folds), tables 4.3 (TensorRT, OpenVINO,
TFLite) and 4.5 (dynamic energy)."""

NOTE = (
    "Thesis marks: the same 22 objects on other folds, float, measured on its platforms (tables 4.3 and 4.5). Ours: cycles by formula; "
    "energy of the computation by estimate, good to a factor of 2 either way, waiting for the image left out."
)


def image_chart(result: Mapping[str, Any]):
    """A panel each for latency, energy and memory; a colour a network, a marker the bits of a weight, the size beside the front."""
    from matplotlib.lines import Line2D

    points = result["points"]
    figure = _figure(20, 7.6)
    judged = f"{result['judged_images']} images left out, {result['parts']} of {result['folds']} folds, {len(result['seeds'])} seed(s)"
    title = f"{result['data']}: networks for images, integers, {judged}\n{result['recommendation']['sentence']}"
    figure.suptitle(f"{title}\n{NOTE}", fontsize=10, parse_math=False)
    networks = list(dict.fromkeys(point["config"]["network"] for point in points))
    widths = sorted({point["config"]["weight_bits"] for point in points}, reverse=True)
    colour = {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(networks)}
    marker = {bits: MARKERS[k % len(MARKERS)] for k, bits in enumerate(widths)}
    clock = points[0]["clock_hz"] / 1e6
    lowest = min(point["accuracy"] - (point["spread"] or 0.0) for point in points)
    highest = max(point["accuracy"] + (point["spread"] or 0.0) for point in points)
    panels = (
        ("latency_s", f"last pixel to decision (ms, {clock:g} MHz)", 1e3),
        ("energy_j", "energy of the computation of an image (µJ, estimate, iCE40UP5K)", 1e6),
        ("memory_bytes", "weights, biases and maps (kB)", 1e-3),
    )
    thesis = _is_thesis_data(result)
    for axes, (cost, label, unit) in zip(figure.subplots(1, 3), panels, strict=True):
        _cost_axis(axes)
        for point in points:
            config, spread = point["config"], point["spread"] or 0.0
            style = {"color": colour[config["network"]], "marker": marker[config["weight_bits"]], "markerfacecolor": "none"}
            axes.errorbar([unit * point[cost]], [point["accuracy"]], yerr=[[spread], [spread]], linestyle="", elinewidth=0.7, **style)
        front = _front_line(axes, [_as_split(point) for point in points], 0, cost, unit, color="black")
        for k, number in enumerate(front):
            point = points[number]
            where = (unit * point[cost], point["accuracy"])
            text = f"{point['config']['network']} {point['config']['size']}, {point['config']['weight_bits']} bit"
            place = {"xytext": (where[0], 0.985 - 0.035 * k), "textcoords": axes.get_xaxis_transform()}
            arrow = {"arrowstyle": "-", "color": GREY, "linewidth": 0.5, "shrinkA": 0, "relpos": (0, 0)}
            axes.annotate(text, where, fontsize=7, va="top", arrowprops=arrow, **place)
        if thesis and cost != "memory_bytes":
            for mark, platform in zip("<>^", THESIS["platforms"], strict=True):
                accuracy = list(THESIS["accuracy"].values())
                axes.plot([unit * value for value in platform[cost]], accuracy, color=GREY, marker=mark, linestyle="", markersize=6)
        best = points[result["recommended"]]
        axes.plot([unit * best[cost]], [best["accuracy"]], marker="o", markersize=14, markerfacecolor="none", markeredgecolor=RECOMMENDED)
        low = min([lowest, *(THESIS["accuracy"].values() if thesis else ())])
        axes.set_ylim(low - 0.01, highest + 0.42 * (highest - low) + 0.01)
        axes.yaxis.set_major_formatter(lambda tick, _: f"{100 * tick:.3g}" if tick <= 1 else "")
        _tidy(axes, label, "accuracy on images left out (%)")
    hollow = {"markerfacecolor": "none", "linestyle": ""}
    handles = [Line2D([], [], color=colour[name], marker="o", label=name, **hollow) for name in networks]
    words = {8: "8-bit weights, rounded", 4: "4-bit weights, trained on"}
    handles += [Line2D([], [], color="black", marker=marker[bits], label=words[bits], **hollow) for bits in widths]
    handles.append(Line2D([], [], color="black", linewidth=1.2, label="front of the panel"))
    handles.append(Line2D([], [], color=RECOMMENDED, marker="o", markersize=12, label="recommended", **hollow))
    if thesis:
        platforms = zip("<>^", THESIS["platforms"], strict=True)
        handles += [Line2D([], [], color=GREY, marker=m, linestyle="", label=f"thesis, models 1 to 3: {p['name']}") for m, p in platforms]
    figure.legend(handles=handles, loc="outside lower center", ncols=5, fontsize=9, frameon=False)
    return figure


def _as_split(point: Mapping[str, Any]) -> dict[str, Any]:
    return dict(point) | {"splits": [{"accuracy": point["accuracy"]}]}


def _is_thesis_data(result: Mapping[str, Any]) -> bool:
    """The thesis's figures belong beside images of 22 classes of its sizes alone."""
    return result["classes"] == 22 and any(point["config"]["size"] in THESIS["accuracy"] for point in result["points"])
