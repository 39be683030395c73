"""The report of a run: one self-contained HTML page, and the same in brief for the terminal.

Both are made from the files of a result folder alone, so they can be made again at any time. Every figure on
the page stands in one of
these files:

run.json               the data, the configuration and why, the checks, the clocks, the wall times
evaluate.json          float against integer, the network that was exported, on all recordings
cosim.json             co-simulation at full pace: every stage compared
cosim_declared.json    at the sensor's pace: latency and budgets at the configured clock
cosim_lowest.json      the same at the lowest clock that meets every budget; absent when none was found
model/config.json, model/training.json    configuration with every format; cross-validation, profiled ranges
trace.npz              one recording with every stage (``write_trace``)
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path

import jinja2
import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter

from eskin.choose.choice_table import (
    front_end_brief,
    front_end_table,
    front_end_words,
    network_name,
    unseen,
    where_it_fails,
    windows_brief,
)
from eskin.choose.cost import pareto
from eskin.golden.core import (
    AcceleratorConfig,
    ArchiveError,
    Arrays,
    InputError,
    QFormat,
    Record,
    read_arrays,
    replacing,
)
from eskin.golden.data import Recordings
from eskin.golden.model import Trace
from eskin.pages.charts import CLASS_COLOURS, STYLE, cost_axis, draw_events, panel_row, share_bars, svg
from eskin.pages.views import GAP, page, percent, short_name, tables, words, write_text
from eskin.training.formats import describe_formats

PAGE = "report.html"
TEMPLATES = Path(__file__).with_name("templates")
TRACE_ARRAYS = (
    "number label samples onset_frame start_frame completed partial sums features hidden logits local margin "
    "global_decision global_margin"
).split()

CONFUSED_WITH = 3
"""Number of wrong decisions that are listed for a class."""
MANY_CLASSES = 12
"""Highest number of classes for which a confusion matrix has figures in it; with more, the table below it has
those that matter."""
LABEL_LETTERS = 8
"""Letters of a class name above a bar."""
LINE_STYLES = ("-", "--", ":", "-.")
FLOAT_COLOUR, INTEGER_COLOUR, SCAN_COLOUR = "#E69F00", "#0072B2", "#888888"
FLOAT_LINE: Record = {"color": FLOAT_COLOUR, "linewidth": 1.6}
INTEGER_LINE: Record = {"color": INTEGER_COLOUR, "linewidth": 1.4, "marker": "o", "markersize": 3.5}


# ---------------------------------------------------------------------- the files
def read_json(path: Path) -> Record:
    """Read a file of a result folder; a missing or damaged file is refused by its name."""
    try:
        if path.exists() and not path.is_file():
            raise OSError(0, "is not a regular file")  # a pipe without a writer would wait for ever
        return json.loads(path.read_text())
    except (OSError, ValueError, RecursionError) as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: Exception) -> InputError:
    why = error.strerror if isinstance(error, OSError) else f"is damaged: {error}"
    return InputError(
        f"{path}: cannot be read ({why}); name a folder that 'eskin run' wrote, or run it again"
    )


@contextmanager
def well_formed(folder: Path) -> Iterator[None]:
    """Turn errors about fields that are missing, or have another type or size than a run writes, into one
    sentence."""
    try:
        yield
    except InputError:
        raise
    except (
        TypeError,
        ValueError,
        LookupError,
        AttributeError,
        ArithmeticError,
        jinja2.TemplateError,
    ) as error:
        raise InputError(
            f"result '{folder}': a field of its files is missing or has another type or size than 'eskin run' writes "
            f"({error}); make the result again"
        ) from error


@dataclass(frozen=True)
class Result:
    """The files of a result folder, read."""

    folder: Path
    run: Record
    evaluate: Record
    cosim: Record
    training: Record
    config: AcceleratorConfig
    declared: Record = dataclasses.field(default_factory=dict)
    lowest: Record | None = None
    trace: Arrays = dataclasses.field(default_factory=dict)

    @classmethod
    def load(cls, folder: str | Path) -> Result:
        """Read a result folder.

        Raises
        ------
        InputError
            When a file is missing or damaged; the sentence names it.
        """
        folder = Path(folder)
        if not folder.is_dir():
            raise InputError(f"result '{folder}': is not a folder; name the one that 'eskin run' wrote")
        run, evaluate, cosim = (read_json(folder / f"{name}.json") for name in ("run", "evaluate", "cosim"))
        training = read_json(folder / "model/training.json")
        config = AcceleratorConfig.from_dict(
            read_json(folder / "model/config.json"), str(folder / "model/config.json")
        )
        if run.get("images"):
            return cls(folder, run, evaluate, cosim, training, config)
        lowest = None if run["lowest_clock_hz"] is None else read_json(folder / "cosim_lowest.json")
        declared, trace = read_json(folder / "cosim_declared.json"), _read_trace(folder / "trace.npz")
        return cls(folder, run, evaluate, cosim, training, config, declared, lowest, trace)

    @property
    def things(self) -> str:
        """Kind of the network's input: recordings or images."""
        return "images" if self.config.is_image else "recordings"


def write_trace(path: str | Path, trace: Trace, recordings: Recordings, index: int, number: int) -> Path:
    """Keep one recording with every stage of its first touch, for the drawing.

    Parameters
    ----------
    trace:
        The integer run over ``recordings``.
    index:
        The recording in them; it has a touch with a completed step.
    number:
        Number that the page shows for it (its index in the whole data set).

    The arrays
    ----------
    number, label, onset_frame, start_frame (frames from 1; onset 0: open at once), completed, partial,
    global_decision, global_margin: scalars. samples (frames, taxels): A/D codes. sums, features (K, D),
    hidden (K, H), logits (K, C): codes. local, margin (K).
    """
    touch = int(trace.first[index])
    arrays = {
        "number": number,
        "label": recordings.labels[index],
        "samples": recordings.recording(index).astype(np.int32),
    }
    for name in (name for name in TRACE_ARRAYS if name not in arrays):
        arrays[name] = getattr(trace.touches if hasattr(trace.touches, name) else trace, name)[touch]
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)
    return Path(path)


def _read_trace(path: Path) -> Arrays:
    try:
        trace = read_arrays(path)
    except (OSError, ArchiveError) as error:
        raise _unreadable(path, error) from None
    for name in TRACE_ARRAYS:
        if name not in trace:
            raise InputError(f"{path}: has no array '{name}'; make the result again with 'eskin run'")
    return trace


# ---------------------------------------------------------------------- figures in words
def _split_name(split: Record, things: str = "recordings") -> str:
    """Words for the recordings of a figure: "unseen", or only "left out" if the network was chosen on
    them."""
    groups = " + ".join(split["groups"])
    if "nested" in split:
        return f"{groups or things} left out"
    return f"unseen {groups or things.removesuffix('s')}"


def _range_row(entry: Record) -> Record:
    """A profiled range with the width of its format and the share used: largest magnitude over what the
    format holds.

    Both are None for the index of an activation table, which saturates by design.
    """
    try:
        fmt = QFormat.parse(entry["format"])
    except ValueError:
        return {**entry, "bits": None, "share": None}
    low, high = float(fmt.to_real(fmt.min_code)), float(fmt.to_real(fmt.max_code))
    return {
        **entry,
        "bits": fmt.width,
        "share": max(entry["max"] / high, entry["min"] / low if low else 0.0, 0.0),
    }


def network_label(config: AcceleratorConfig) -> str:
    """``GRU 12`` or ``linear``."""
    return f"{config.network.cell.upper()} {config.network.hidden}" if config.recurrent else "linear"


def _network(config: AcceleratorConfig) -> str:
    if config.is_image:
        return config.name
    gru = f", reset {config.network.reset} the product" if config.network.cell == "gru" else ""
    return network_label(config) + (", weights of every window" if config.sets > 1 else gru)


def confusions(split: Record, class_names: Sequence[str]) -> list[Record]:
    """Class by class, the least often found first: {name, share found, others: the most frequent wrong
    decisions, {name, share}}."""
    table = np.array(split["confusion"], dtype=float)
    shares = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
    names = [*class_names, "none"]
    rows = []
    for index, name in enumerate(class_names):
        wrong = [
            int(decided)
            for decided in np.argsort(-shares[index], kind="stable")
            if decided != index and shares[index, decided] > 0
        ]
        confused = [
            {"name": names[decided], "share": float(shares[index, decided])}
            for decided in wrong[:CONFUSED_WITH]
        ]
        rows.append({"name": name, "share": float(shares[index, index]), "others": confused})
    return sorted(rows, key=lambda row: row["share"])


# ---------------------------------------------------------------------- charts
def _class_style(index: int) -> dict[str, str]:
    return {
        "color": CLASS_COLOURS[index % len(CLASS_COLOURS)],
        "linestyle": LINE_STYLES[index // len(CLASS_COLOURS) % len(LINE_STYLES)],
    }


def draw_confusion(
    splits: Sequence[Record], class_names: Sequence[str], things: str = "recordings"
) -> Figure:
    """A confusion matrix for each split: share of each true class, decided by the integer network on
    recordings it has not seen."""
    classes = len(class_names)
    many = classes > MANY_CLASSES
    size = min(5.0, 0.22 * classes + 1.2) if many else max(2.5, 0.42 * classes + 0.9)
    figure, panels = panel_row(len(splits), min(10.4, 0.9 + size * len(splits)), size + 0.55, sharey=False)
    for axes, split in zip(panels, splits, strict=True):
        table = np.array(split["confusion"], dtype=float)
        names = [*class_names, "none"]
        if not table[:, -1].any():
            table, names = table[:, :-1], names[:-1]
        shares = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
        axes.imshow(shares, cmap="Blues", vmin=0, vmax=1, aspect="auto")
        for (row, decided), share in np.ndenumerate(shares):
            if table[row, decided] and not many:
                text = percent(share, 1 if share < 1 else 0).removesuffix(f"{GAP}%")
                colour = "white" if share > 0.5 else "black"
                axes.text(decided, row, text, ha="center", va="center", fontsize=8, color=colour)
        title = _split_name(split) if things == "recordings" else f"{things} left out"
        axes.set(title=title, xlabel="decided")
        font: Record = {"fontsize": 7} if many else {}
        long = max(map(len, names)) > 5
        slanted: Record = {"rotation": 45, "ha": "right", "rotation_mode": "anchor"} if long else {}
        axes.set_xticks(range(len(names)), names, **slanted, **font)
        axes.set_yticks(range(classes), class_names if axes is panels[0] else [""] * classes, **font)
        axes.spines[:].set_visible(False)
        axes.tick_params(length=0)
    panels[0].set_ylabel(f"true class (% of its {things})")
    return figure


def draw_step_accuracy(splits: Sequence[Record], opens_at_once: bool) -> Figure:
    """Accuracy of the local decision against time since the onset, float and integer, a panel for each
    split."""
    figure, panels = panel_row(len(splits), 10.4, 2.9)
    begin = "first frame" if opens_at_once else "onset"
    lowest = 1.0
    for axes, split in zip(panels, splits, strict=True):
        steps = split["per_step"]
        time_s = [step["time_s"] for step in steps]
        for kind, style in (("float", FLOAT_LINE | {"linewidth": 4.0}), ("integer", INTEGER_LINE)):
            values = [step[f"{kind}_accuracy"] for step in steps]
            lowest = min(lowest, *values)
            axes.plot(time_s, values, label=kind, **style)
        axes.set(title=_split_name(split), xlabel=f"time since the {begin} (s)")
        axes.set_xlim(left=min(0.0, *time_s))
    panels[0].set(
        ylabel="accuracy of the local decision", ylim=(max(0.0, math.floor(10 * lowest - 0.5) / 10), 1.01)
    )
    panels[0].legend(loc="lower right")
    panels[0].yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    return figure


def draw_trace(trace: Arrays, config: AcceleratorConfig, unit: str = "V") -> Figure:
    """One recording from raw taxels through features, hidden state and logits to local decisions and the
    global one."""
    figure = Figure(figsize=(10.4, 10.2), layout="constrained")
    raw, *panels = figure.subplots(5, 1, height_ratios=(2.2, 1.7, 1.5, 1.6, 1.7))
    feature_axes, hidden_axes, logit_axes, decision_axes = panels
    steps = np.arange(int(trace["completed"]))
    formats, names = config.formats, config.network.class_names
    _draw_raw(raw, trace, config, steps, unit)
    kinds, features = config.features.feature_kinds, formats.feature_format.to_real(trace["features"])[steps]
    by_kind = np.concatenate([features[:, k :: len(kinds)] for k in range(len(kinds))], axis=1)
    title = f"features, scaled: {', '.join(kinds)} of each taxel, one column a step"
    _draw_map(feature_axes, by_kind, title, "taxel" if len(kinds) == 1 else "inputs, by kind")
    if len(kinds) > 1:
        taxels = config.sensor.taxels
        feature_axes.set_yticks([(k + 0.5) * taxels - 0.5 for k in range(len(kinds))], kinds)
        for k in range(1, len(kinds)):
            feature_axes.axhline(k * taxels - 0.5, color="black", linewidth=0.6)
    title = "hidden state after each step"
    _draw_map(hidden_axes, formats.state_format.to_real(trace["hidden"])[steps], title, "unit")
    logits = formats.logit_format.to_real(trace["logits"])[steps]
    decided, margins = trace["local"][steps], formats.logit_format.to_real(trace["margin"])[steps]
    rotation = 90 if len(steps) > 12 else 0
    for index, name in enumerate(names):
        style = _class_style(index)
        logit_axes.plot(steps + 1, logits[:, index], marker="o", markersize=3, label=name, **style)
        of_class = decided == index
        hatch = "//" if index >= len(CLASS_COLOURS) else ""
        bars = decision_axes.bar(steps[of_class] + 1, margins[of_class], color=style["color"], hatch=hatch)
        shown = [name[:LABEL_LETTERS]] * int(of_class.sum())
        decision_axes.bar_label(bars, shown, padding=2, rotation=rotation, fontsize=7.5)
    logit_axes.set(title="logits", ylabel="value")
    place = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.1}
    logit_axes.legend(ncols=min(config.classes, 7), handlelength=1.6, columnspacing=1.2, **place)
    decision, lead = int(trace["global_decision"]), int(trace["global_margin"])
    outcome = "no decision" if decision < 0 else names[decision]
    lead_text = f"margin {formats.logit_format.to_real(lead):.2f}"
    if config.network.decision == "vote":
        lead_text = f"{lead} votes ahead"
    ended = ", recording ended early" if trace["partial"] else ""
    truth = names[int(trace["label"])]
    title = "local decision of each step and its margin; "
    title += f"global decision: {outcome} ({lead_text}{ended}), true class: {truth}"
    letters = min(LABEL_LETTERS, max(map(len, names)))
    # room for the names above the bars
    top = max(float(margins.max(initial=0.0)), 1e-9) / (0.93 - 0.055 * letters)
    decision_axes.set(title=title, xlabel="step", ylabel="margin (logit value)", ylim=(0, top))
    for axes in panels:
        axes.set_xlim(0.5, len(steps) + 0.5)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=20))
    return figure


def _draw_map(axes, values: np.ndarray, title: str, unit: str) -> None:
    """Values (steps, units) as colours, 0 white."""
    if not values.shape[1]:
        axes.set_axis_off()
        axes.set_title("a linear cell has no hidden state")
        return
    limit = max(float(np.abs(values).max(initial=0.0)), 1e-9)
    extent = (0.5, len(values) + 0.5, values.shape[1] - 0.5, -0.5)
    image = axes.imshow(values.T, cmap="RdBu_r", vmin=-limit, vmax=limit, aspect="auto", extent=extent)
    axes.figure.colorbar(image, ax=axes, pad=0.01, fraction=0.03, label="value")
    axes.set(title=title, ylabel=unit)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True, nbins=5))


def _draw_raw(axes, trace: Arrays, config: AcceleratorConfig, steps: np.ndarray, unit: str) -> None:
    samples, rate = trace["samples"].astype(float), config.sensor.scan_rate_hz
    level = np.median(samples[: max(1, config.rest_level.rest_frames or min(64, len(samples) // 8))], axis=0)
    scale, worth = (1000.0, "mV") if unit == "V" else (1.0, unit or "unit of the samples")
    volts = np.any(config.sensor.volt_per_code)
    signal = (samples - level) * (scale * np.array(config.sensor.volt_per_code) if volts else 1)
    events = draw_events(axes, samples, rate, first=1)
    if events:
        signal = np.broadcast_to(np.arange(samples.shape[1]), samples.shape)
    else:
        axes.set_prop_cycle(color=colormaps["cividis"](np.linspace(0.0, 0.9, samples.shape[1])))
        axes.plot(np.arange(1, len(samples) + 1) / rate, signal, linewidth=0.6)
    start = int(trace["start_frame"]) - 1
    ends = [(start + config.window_spans[k][1]) / rate for k in steps]
    touch = ends[-1] - start / rate
    shown = max(1 / rate, start / rate - touch / 2), min(len(samples) / rate, ends[-1] + touch / 3)
    visible = signal[round(shown[0] * rate) - 1 : round(shown[1] * rate)]
    low, high = visible.min(), visible.max()
    span = high - low + 1e-9
    axes.axvspan(start / rate, ends[-1], color="#EEEEEE", zorder=0)
    for step, end in zip(steps, ends, strict=True):
        axes.axvline(end, ymax=0.04, color="black", linewidth=0.8)
        if step == 0 or (step + 1) % 5 == 0:
            place = {"transform": axes.get_xaxis_transform(), "ha": "center", "va": "bottom"}
            axes.text(end, 0.05, "step 1" if step == 0 else str(step + 1), fontsize=7.5, **place)
    if trace["onset_frame"] > 0:
        onset_s = int(trace["onset_frame"]) / rate
        axes.axvline(onset_s, color="black", linestyle="--", linewidth=1, label="onset found")
        axes.legend(loc="upper right")
    axes.set(
        title=f"recording {int(trace['number'])}: raw taxels, a {'row of events' if events else 'line'} each; grey: the windows, a tick at the "
        "end of each",
        xlabel="time (s)",
        ylabel="taxel" if events else f"{worth} from rest" if volts else "codes from rest",
        xlim=shown,
        ylim=(low - 0.2 * span, high + 0.05 * span),  # room for the numbers of the steps
    )


COSTS = {
    "energy_touch_j": ("energy of a touch (µJ)", 1e6),
    "decision_time_s": ("time to the decision (s)", 1),
}
"""Costs against which accuracy is drawn: key of a candidate, label, factor."""


def fewer_scans(front_end: Record) -> list[Record]:
    """For each ``scan_every`` that was judged the cheapest front end that ties with the best; where none does, the
    most accurate."""
    rows = [front_end["chosen"], *front_end["rivals"]]
    found = []
    for every in sorted({row["scan_every"] for row in rows}):
        alike = sorted((row for row in rows if row["scan_every"] == every), key=itemgetter("energy_touch_j"))
        found.append(next((row for row in alike if row["level"]), max(alike, key=itemgetter("accuracy"))))
    return found


def draw_candidates(rows: Sequence[Record], front_end: Record | None = None) -> Figure:
    """Accuracy of every candidate against energy of a touch and against the time to the decision, with the
    front of those that none beats in both; the taken one is named. What fits the board is filled. Crosses show
    what `fewer_scans` buy: front ends alone, by the linear classifier that chose among them."""
    board = next((row["fits"] for row in rows if row["fits"]), None)
    # a cost that all share tells nothing
    costs = {
        key: words for key, words in COSTS.items() if len({f"{row[key]:.4}" for row in rows if row[key]}) > 1
    } or COSTS
    scans = fewer_scans(front_end) if front_end and "energy_touch_j" in costs else []
    figure, panels = panel_row(len(costs), 10.4, 3.6)
    for axes, (key, (label, factor)) in zip(panels, costs.items(), strict=True):
        # rounded, so that costs that are equal but for their last bits are one
        shown = [row | {key: float(f"{factor * row[key]:.6g}")} for row in rows if row[key] is not None]
        front = pareto(shown, key)
        line = [(shown[index][key], shown[index]["accuracy"]) for index in front]
        axes.step(*zip(*line, strict=True), where="post", color="#999999", linewidth=1, zorder=1)
        for row in shown:
            place = row[key], row["accuracy"]
            colour = INTEGER_COLOUR if row["chosen"] else FLOAT_COLOUR
            if row.get("stress"):
                # a share of false onsets is drawn as what is left
                figures = [abs(one["figure"] - (one["bound"] < 0.5)) for one in row["stress"]]
                down = row["stressed_accuracy"], min(figures)
                axes.vlines(
                    row[key], min(down), row["accuracy"], color=colour, linewidth=0.8, alpha=0.6, zorder=1
                )
                axes.plot([row[key]] * 2, down, ls="", marker="_", color=colour, alpha=0.6, zorder=1)
            axes.errorbar(
                *place,
                yerr=share_bars([row["accuracy"]], [row["standard_error"]]),
                fmt="o",
                capsize=2,
                elinewidth=0.8,
                color=colour,
                markersize=9 if row["chosen"] else 6,
                markerfacecolor=colour if row["fits"] else "white",
                zorder=3 if row["chosen"] else 2,
            )
            if row["chosen"]:  # the table below has the recipe and every kind
                text = f"chosen: {network_name(row)}"
                style: Record = {
                    "textcoords": "offset points",
                    "fontsize": 8,
                    "weight": "bold",
                    "ha": "center",
                }
                axes.annotate(text, place, (0, 9), zorder=4, **style)
        if len(scans) > 1 and key == "energy_touch_j":
            places = [(factor * row[key], row["accuracy"]) for row in scans]
            axes.plot(*zip(*places, strict=True), ":x", color=SCAN_COLOUR, linewidth=0.8, zorder=1)
            for row, place in zip(scans, places, strict=True):
                axes.annotate(
                    f"1/{row['scan_every']}",
                    place,
                    (3, -9),
                    textcoords="offset points",
                    fontsize=7,
                    color=SCAN_COLOUR,
                )
        axes.margins(x=0.15, y=0.15)
        if stressed := [row["stressed_accuracy"] for row in rows if row.get("stress")]:
            # a gate that always opens lies below the drawing
            axes.set_ylim(min(stressed) - 0.05, min(axes.get_ylim()[1], 1.03))
        cost_axis(axes)
        axes.set_xlabel(label)
    axes = panels[0]
    filled = f"filled: fits the {board}" if board else "hollow: fits no board"
    crosses = "\ncrosses: front ends alone, one frame in k scanned" * (len(scans) > 1)
    axes.set(
        title=f"grey: the best at each cost; {filled}{'; lines down: under disturbance' * bool(stressed)}{crosses}",
        ylabel="accuracy, integer, cross-validated",
    )
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=1))
    axes.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    return figure


# ---------------------------------------------------------------------- the page
def write_report(folder: str | Path) -> Path:
    """Make ``report.html`` in a result folder from the other files in it.

    Returns
    -------
    Path of the page: one file, nothing outside it is needed to show it.

    Raises
    ------
    InputError
        When a file is missing, damaged, or lacks a field or array; an existing page stays as it was.
    """
    folder = Path(folder)
    with well_formed(folder):
        text = _render(Result.load(folder))
    write_text(path := folder / PAGE, text)
    return path


def _values(result: Result) -> Record:
    """Values of page and summary."""
    splits = result.training["cross_validation"]
    return vars(result) | {
        "network": _network(result.config),
        "nested": [split["nested"] for split in splits if split.get("nested")],
        "split_name": _split_name,
        "things": result.things,
        "unseen": unseen,
        "candidates": (candidates := [] if result.config.is_image else result.run.get("candidates") or []),
        "fails": where_it_fails(candidates),
        "network_name": network_name,
        "front_end_brief": front_end_brief,
        "windows_brief": windows_brief,
    }


def _render(result: Result) -> str:
    splits, config, run = result.training["cross_validation"], result.config, result.run
    candidates, front_end = run.get("candidates") or [], run.get("front_end")
    names = config.network.class_names
    with rc_context(STYLE):
        drawn: dict[str, Figure | None] = {"confusion": draw_confusion(splits, names, result.things)}
        if not config.is_image:
            drawn |= {
                "trace": draw_trace(result.trace, config, run["data"].get("unit", "V")),
                "steps": draw_step_accuracy(splits, config.opens_at_once),
                "candidates": draw_candidates(candidates, front_end) if candidates else None,
            }
        charts = {name: svg(figure) for name, figure in drawn.items() if figure}
    values = _values(result)
    (cards,) = tables(words("cards", **values))
    values |= {
        "name": run.get("name") or short_name(run["data"]["source"]),
        "data": run["data"],
        "splits": splits,
        "cards": [dict(zip(("title", "value", "note"), cells, strict=True)) for cells in cards.cells],
        "candidates": candidates,
        "charts": charts,
        "confusions": lambda split: confusions(split, names),
    }
    if config.is_image:
        errors = {row["stage"]: row for row in result.evaluate["stages"]}
        formats = describe_formats(config)
        return page("images.html.j2", **values, errors=errors, formats=formats)
    return page(
        "report.html.j2",
        **values,
        runs=[played for played in (result.cosim, result.declared, result.lowest) if played],
        front_end=front_end,
        front_ends=[(row, front_end_words(row)) for row in front_end_table(front_end)] if front_end else [],
        baselines=run.get("baselines", []),
        test=run.get("test"),
        warnings=run.get("warnings", []),
        ranges=[_range_row(entry) for entry in result.training["ranges"]],
        short_network=network_label(config),
        failed=[check for check in run["checks"] if not check["held"]],
    )


def summary(folder: str | Path) -> str:
    """The result in brief for the terminal, as Markdown (`eskin.pages.views`).

    Raises
    ------
    InputError
        As ``write_report``.
    """
    with well_formed(Path(folder)):
        return words("summary", **_values(Result.load(folder)))
