"""The report of a run: one self-contained HTML page, and the same in brief for the terminal.

Both are made from the files of a result folder alone, so they can be made again at any time. Every figure on
the page stands in one of
these files:

run.json               the data, the configuration and why, the checks, the clocks, the wall times
evaluate.json          float against integer, the network that was exported, on all recordings
cosim.json             co-simulation at full pace: every stage compared
cosim_declared.json    at the sensor's pace: latency and budgets at the configured clock
cosim_lowest.json      the same at the lowest clock that meets every budget; absent when none was found (run.json says so)
model/config.json, model/training.json    configuration with every format; cross-validation, profiled ranges
trace.npz              one recording with every stage (``write_trace``)
"""

from __future__ import annotations

import base64
import dataclasses
import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2
import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, PercentFormatter

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.core.files import ArchiveError, read_arrays, replacing
from eskin.golden.core.formats import QFormat
from eskin.golden.model.model import describe_formats
from eskin.golden.training.choice_table import front_end_table, front_end_words, network_name, unseen
from eskin.pages.charts import share_bars
from eskin.pages.tables import mean_and_largest, rows_of, terminal_table

if TYPE_CHECKING:
    from rich.console import Group

    from eskin.golden.data.recordings import Recordings
    from eskin.golden.model.pipeline import Trace

PAGE = "report.html"
TEMPLATES = Path(__file__).with_name("templates")
TRACE_ARRAYS = [
    "number",
    "label",
    "samples",
    "onset_frame",
    "start_frame",
    "completed",
    "partial",
    "sums",
    "features",
    "hidden",
    "logits",
    "local",
    "margin",
    "global_decision",
    "global_margin",
]

CLASS_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's palette: told apart by colour-blind readers too. More classes repeat it with other line
styles."""
CONFUSED_WITH = 3
"""Wrong decisions that are named for a class."""
MANY_CLASSES = 12
"""From one more on, a confusion matrix has no figures in it: the table below it has those that matter."""
LABEL_LETTERS = 8
"""Letters of a class name above a bar."""
LINE_STYLES = ("-", "--", ":", "-.")
FLOAT_COLOUR, INTEGER_COLOUR = "#E69F00", "#0072B2"
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
}


# ---------------------------------------------------------------------- the files
class _Fields(dict):
    """A JSON object that answers a missing field with the file's name and the fix."""

    file: Path

    def __missing__(self, field: str) -> Any:
        raise InputError(f"{self.file}: has no field '{field}'; make the result again with 'eskin run'")


def read_json(path: Path) -> _Fields:
    """A file of a result folder; what is missing or damaged is refused by its name, missing fields when they
    are read."""

    def fields(pairs: dict[str, Any]) -> _Fields:
        record = _Fields(pairs)
        record.file = path
        return record

    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is no regular file; make the result again with 'eskin run'")
    try:
        value = json.loads(path.read_text(), object_hook=fields)
    except FileNotFoundError:
        raise InputError(
            f"result '{path.parent}': has no {path.name}; name a folder that 'eskin run' wrote"
        ) from None
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: is damaged ({error}); make the result again with 'eskin run'") from None
    if not isinstance(value, _Fields):
        raise InputError(f"{path}: holds no JSON object; make the result again with 'eskin run'")
    return value


@contextmanager
def well_formed(folder: Path) -> Iterator[None]:
    """What goes wrong over fields of another type or size than a run writes becomes one sentence."""
    try:
        yield
    except InputError:
        raise
    except (
        TypeError,
        ValueError,
        KeyError,
        IndexError,
        AttributeError,
        ArithmeticError,
        jinja2.TemplateError,
    ) as error:
        raise InputError(
            f"result '{folder}': a field of its files has another type or size than 'eskin run' writes "
            f"({error}); make the result again"
        ) from error


@dataclass(frozen=True)
class Result:
    """The files of a result folder, read."""

    folder: Path
    run: dict[str, Any]
    evaluate: dict[str, Any]
    cosim: dict[str, Any]
    training: dict[str, Any]
    config: AcceleratorConfig
    declared: dict[str, Any] = dataclasses.field(default_factory=dict)
    lowest: dict[str, Any] | None = None
    trace: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)

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
            raise InputError(f"result '{folder}': is no folder; name the one that 'eskin run' wrote")
        run, evaluate, cosim = (read_json(folder / f"{name}.json") for name in ("run", "evaluate", "cosim"))
        training = read_json(folder / "model/training.json")
        config = AcceleratorConfig.from_dict(
            dict(read_json(folder / "model/config.json")), str(folder / "model/config.json")
        )
        if run.get("images"):
            return cls(folder, run, evaluate, cosim, training, config)
        lowest = None if run["lowest_clock_hz"] is None else read_json(folder / "cosim_lowest.json")
        declared, trace = read_json(folder / "cosim_declared.json"), _read_trace(folder / "trace.npz")
        return cls(folder, run, evaluate, cosim, training, config, declared, lowest, trace)

    @property
    def things(self) -> str:
        """What the network decides on: recordings or images."""
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
        What it is called (its index in the whole data set).

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
    for name in TRACE_ARRAYS[3:]:
        arrays[name] = getattr(trace.touches if hasattr(trace.touches, name) else trace, name)[touch]
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)
    return Path(path)


def _read_trace(path: Path) -> dict[str, np.ndarray]:
    try:
        trace = read_arrays(path)
    except FileNotFoundError:
        raise InputError(
            f"result '{path.parent}': has no {path.name}; name a folder that 'eskin run' wrote"
        ) from None
    except (OSError, ArchiveError) as error:
        raise InputError(f"{path}: is damaged ({error}); make the result again with 'eskin run'") from None
    for name in TRACE_ARRAYS:
        if name not in trace:
            raise InputError(f"{path}: has no array '{name}'; make the result again with 'eskin run'")
    return trace


# ---------------------------------------------------------------------- figures in words
GAP = "\u00a0"
"""Between a number and its unit: no line ends there."""


def percent(share: float, digits: int = 1) -> str:
    """``share`` as a percentage; rounding never makes 100 of anything less, nor 0 of anything more."""
    shown = f"{100 * share:.{digits}f}"
    if share > 0 and float(shown) == 0:
        return f"below {10.0**-digits:.{digits}f}{GAP}%"
    if share < 1 and float(shown) >= 100:
        shown = f"{math.floor(100 * share * 10**digits) / 10**digits:.{digits}f}"
    return f"{shown}{GAP}%"


def seconds(value: float) -> str:
    """A duration with a fitting unit, three digits."""
    return unit(value, "s")


def hertz(value: float) -> str:
    """A frequency with a fitting unit, no digit lost down to 1 Hz of kHz figures."""
    for unit, scale in (("MHz", 1e6), ("kHz", 1e3)):
        if value >= scale:
            return f"{value / scale:.6g}{GAP}{unit}"
    return f"{value:.6g}{GAP}Hz"


def unit(value: float, symbol: str) -> str:
    """A quantity with the fitting multiple of its unit, three digits: ``unit(1.5e-6, "J")`` is 1.50 µJ."""
    for prefix, scale in (("", 1.0), ("m", 1e-3), ("µ", 1e-6), ("n", 1e-9)):
        if abs(value) >= scale:
            return f"{_three(value / scale)}{GAP}{prefix}{symbol}"
    return f"{_three(value / 1e-12)}{GAP}p{symbol}" if value else f"0{GAP}{symbol}"


def count(value: float) -> str:
    """A whole number in groups of three."""
    return f"{round(value):,}".replace(",", "\u202f")


def _three(value: float) -> str:
    """Three significant digits, never an exponent."""
    return f"{value:.{max(0, 2 - math.floor(math.log10(abs(value)))) if value else 0}f}"


def _split_name(split: Mapping[str, Any], things: str = "recordings") -> str:
    """What the recordings that a figure stands for have that the network never saw; no more than left out,
    where it was chosen on them."""
    groups = " + ".join(split["groups"])
    if "nested" in split:
        return f"{groups or things} left out"
    return f"unseen {groups or things.removesuffix('s')}"


def _range_row(entry: dict[str, Any]) -> dict[str, Any]:
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


def _short_name(source: str) -> str:
    """A name for a title: the file's without its ending, or the folder's where the file has the usual
    name."""
    path = Path(source)
    return (
        path.parent.name
        if path.name == "recordings.npz" and path.parent.name
        else path.stem
        if path.suffix == ".npz"
        else source
    )


def _network(config: AcceleratorConfig) -> str:
    if config.is_image:
        return config.name
    if not config.recurrent:
        return "linear, weights of every window" if config.sets > 1 else "linear"
    return f"{config.network.cell.upper()} {config.network.hidden}" + (
        f", reset {config.network.reset} the product" if config.network.cell == "gru" else ""
    )


def _headline(result: Result) -> list[dict[str, str]]:
    """The figures to read first: title, value, what it means."""
    if result.config.is_image:
        return _image_headline(result)
    cosim, declared, lowest = result.cosim, result.declared, result.lowest
    first, *further_splits = result.training["cross_validation"]
    figure = unseen(first)
    more = "".join(
        f"; {_split_name(unseen(split))} {percent(unseen(split)['integer_accuracy'])}"
        for split in further_splits
    )
    how = "front end and network chosen anew without each fold" if figure is not first else "cross-validated"
    taken = (
        f"; the network taken, on the folds it was chosen on, {percent(first['integer_accuracy'])}"
        if figure is not first
        else ""
    )
    rivals = [row for row in result.run.get("baselines", []) if row["groups"] == first["groups"]]
    beside = f"chance {percent(result.evaluate['chance'])}"
    if rivals:
        best = max(rivals, key=lambda row: row["accuracy"])
        beside += f"; best baseline {percent(best['accuracy'])} ({best['name']})"
    held = result.run.get("test")
    apart = [
        {
            "title": "accuracy, recordings held back",
            "value": percent(held["integer_accuracy"]),
            "note": f"integer network, judged once on {count(held['recordings'])}; float "
            f"{percent(held['float_accuracy'])}",
        }
        for held in ([held] if held else [])
    ]
    of = f"{count(cosim['recordings'])} of {count(result.run['data']['recordings'])} recordings"
    latency = declared["cycles"]["decision_latency_max"]
    cycles = (
        "no decision"
        if latency is None
        else f"worst case, {count(latency)} cycles at {hertz(declared['clock_hz'])}"
    )
    return [
        {
            "title": f"accuracy, {_split_name(figure)}",
            "value": percent(figure["integer_accuracy"]),
            "note": f"{beside}; integer network, {how}; float "
            f"{percent(figure['float_accuracy'])}{more}{taken}",
        },
        *apart,
        {
            "title": "hardware equals model",
            "value": "bit-exact" if cosim["bit_exact"] else "NOT EXACT",
            "note": f"{count(cosim['compared_values'])} values of {of} compared, "
            f"{count(cosim['mismatches'])} mismatches",
        },
        {
            "title": "last sample to decision",
            "value": "none" if latency is None else seconds(latency / declared["clock_hz"]),
            "note": f"{cycles}, {declared['lanes']} lanes",
        },
        {
            "title": "lowest clock",
            "value": "not found" if lowest is None else hertz(lowest["clock_hz"]),
            "note": f"{'no clock was found that' if lowest is None else 'simulated at the pace of the sensor;'} meets every latency budget",
        },
    ]


def _image_headline(result: Result) -> list[dict[str, str]]:
    split, cosim, hardware = result.training["cross_validation"][0], result.cosim, result.config.hardware
    latency = cosim["cycles"]["decision_latency_max"]
    cards = (
        (
            "integer network, images left out",
            percent(split["integer_accuracy"]),
            f"{split['folds']} folds; by chance {percent(result.evaluate['chance'])}",
        ),
        ("agreement with float", percent(split["agreement"]), f"float {percent(split['float_accuracy'])}"),
        (
            "hardware equals model",
            "bit-exact" if cosim["bit_exact"] else "NOT bit-exact",
            f"{count(cosim['compared_values'])} values of {cosim['recordings']} images compared",
        ),
        (
            "last pixel to decision",
            seconds(latency / hardware.clock_hz),
            f"{count(latency)} cycles at {hardware.clock_hz / 1e6:g} MHz, {hardware.lanes} lanes",
        ),
    )
    return [dict(zip(("title", "value", "note"), card, strict=True)) for card in cards]


def _layers(result: Result) -> list[dict[str, Any]]:
    """A row for each layer of a network for images; what only those with weights have is empty for pools."""
    errors, cycles = (
        {row["stage"]: row for row in result.evaluate["stages"]},
        result.run.get("layer_cycles", {}),
    )
    formats = describe_formats(result.config)
    rows = []
    for stage in result.config.stages:
        name, number = f"{stage.number} {stage.layer}", str(stage.number)
        row: dict[str, Any] = {
            "layer": str(stage.layer),
            "result": " x ".join(map(str, stage.result)),
            "formats": formats.get(name, ""),
        }
        row |= {
            "weights": stage.weights,
            "multiplies": stage.multiplies,
            "cycles": count(cycles[number]) if number in cycles else "",
        }
        if error := errors.get(name):
            row |= {
                "mean": f"{error['mean']:.4f}",
                "saturated": percent(error["saturated"], 2),
                "logit_max": f"{error['logit_max']:.3f}",
            }
        rows.append({"mean": "", "saturated": "", "logit_max": ""} | row)
    return rows


def confusions(split: dict[str, Any], class_names: Sequence[str]) -> list[dict[str, Any]]:
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
def svg(figure: Figure) -> str:
    """The figure as a data address for an ``img``: an image of its own, so that ids of two figures never
    meet."""
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    # the layout's last digits vary from call to call and would change the names inside the image
    for axes in figure.axes:
        axes.set_position(np.round(axes.get_position().bounds, 6))
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode()


def _class_style(index: int) -> dict[str, str]:
    return {
        "color": CLASS_COLOURS[index % len(CLASS_COLOURS)],
        "linestyle": LINE_STYLES[index // len(CLASS_COLOURS) % len(LINE_STYLES)],
    }


def draw_confusion(
    splits: Sequence[dict[str, Any]], class_names: Sequence[str], things: str = "recordings"
) -> Figure:
    """A confusion matrix for each split: share of each true class, decided by the integer network on
    recordings it has not seen."""
    classes = len(class_names)
    many = classes > MANY_CLASSES
    size = min(5.0, 0.22 * classes + 1.2) if many else max(2.5, 0.42 * classes + 0.9)
    figure = Figure(figsize=(min(10.4, 0.9 + size * len(splits)), size + 0.55), layout="constrained")
    for column, (axes, split) in enumerate(
        zip(figure.subplots(1, len(splits), squeeze=False)[0], splits, strict=True)
    ):
        table = np.array(split["confusion"], dtype=float)
        names = [*class_names, "none"]
        if not table[:, -1].any():
            table, names = table[:, :-1], names[:-1]
        shares = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
        axes.imshow(shares, cmap="Blues", vmin=0, vmax=1, aspect="auto")
        for (row, decided), share in np.ndenumerate(shares):
            if table[row, decided] and not many:
                text = percent(share, 1 if share < 1 else 0).removesuffix(f"{GAP}%")
                axes.text(
                    decided,
                    row,
                    text,
                    ha="center",
                    va="center",
                    fontsize=8,
                    color="white" if share > 0.5 else "black",
                )
        axes.set_title(
            _split_name(split) if things == "recordings" else f"{things} left out", parse_math=False
        )
        slanted = (
            {"rotation": 45, "ha": "right", "rotation_mode": "anchor"} if max(map(len, names)) > 5 else {}
        )
        size_of = {"fontsize": 7} if many else {}
        axes.set_xticks(range(len(names)), names, parse_math=False, **slanted, **size_of)
        axes.set_yticks(
            range(classes), class_names if column == 0 else [""] * classes, parse_math=False, **size_of
        )
        axes.set_xlabel("decided")
        if column == 0:
            axes.set_ylabel(f"true class (% of its {things})")
        axes.spines[:].set_visible(False)
        axes.tick_params(length=0)
    return figure


def draw_step_accuracy(splits: Sequence[dict[str, Any]], opens_at_once: bool) -> Figure:
    """Accuracy of the local decision against time since the onset, float and integer, a panel for each
    split."""
    figure = Figure(figsize=(10.4, 2.9), layout="constrained")
    axes_row = figure.subplots(1, len(splits), squeeze=False, sharey=True)[0]
    lowest = 1.0
    for column, (axes, split) in enumerate(zip(axes_row, splits, strict=True)):
        time_s = [step["time_s"] for step in split["per_step"]]
        for key, style in (
            ("float_accuracy", {"color": FLOAT_COLOUR, "linewidth": 4.0, "label": "float"}),
            (
                "integer_accuracy",
                {
                    "color": INTEGER_COLOUR,
                    "linewidth": 1.4,
                    "marker": "o",
                    "markersize": 3.5,
                    "label": "integer",
                },
            ),
        ):
            values = [step[key] for step in split["per_step"]]
            lowest = min(lowest, *values)
            axes.plot(time_s, values, **style)
        axes.set_title(_split_name(split), parse_math=False)
        axes.set_xlabel("time since the first frame (s)" if opens_at_once else "time since the onset (s)")
        axes.grid(axis="y", color="#DDDDDD", linewidth=0.7)
        axes.set_axisbelow(True)
        axes.set_xlim(left=min(0.0, *time_s))
        if column == 0:
            axes.set_ylabel("accuracy of the local decision")
            axes.legend(loc="lower right")
    axes_row[0].set_ylim(max(0.0, math.floor(10 * lowest - 0.5) / 10), 1.01)
    axes_row[0].yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    return figure


def draw_training(splits: Sequence[dict[str, Any]]) -> Figure | None:
    """Loss of the float networks while they are trained, on what they train on and on recordings left out, a
    panel for each split; None where no network was trained step by step."""
    trained = [split for split in splits if split.get("training_curve")]
    if not trained:
        return None
    figure = Figure(figsize=(10.4, 2.7), layout="constrained")
    axes_row = figure.subplots(1, len(trained), squeeze=False, sharey=True)[0]
    for column, (axes, split) in enumerate(zip(axes_row, trained, strict=True)):
        curve = split["training_curve"]
        axes.plot(
            curve["updates"],
            curve["training_loss"],
            color=FLOAT_COLOUR,
            linewidth=1.6,
            label="trained on, augmented",
        )
        if curve["held_out_loss"]:
            label = "left out, as recorded"
            axes.plot(
                curve["updates"],
                curve["held_out_loss"],
                color=INTEGER_COLOUR,
                linewidth=1.6,
                marker="o",
                markersize=3,
                label=label,
            )
        axes.set_title(_split_name(split), parse_math=False)
        axes.set_xlabel("updates of the weights")
        axes.set_xlim(left=0)
        axes.set_ylim(bottom=0)
        axes.grid(axis="y", color="#DDDDDD", linewidth=0.7)
        axes.set_axisbelow(True)
        if column == 0:
            axes.set_ylabel("cross-entropy of a step (nat)")
            axes.legend(loc="upper right")
    return figure


def draw_trace(trace: dict[str, np.ndarray], config: AcceleratorConfig) -> Figure:
    """One recording from raw taxels through features, hidden state and logits to local decisions and the
    global one."""
    figure = Figure(figsize=(10.4, 10.2), layout="constrained")
    raw, feature_axes, hidden_axes, logit_axes, decision_axes = figure.subplots(
        5, 1, height_ratios=(2.2, 1.7, 1.5, 1.6, 1.7)
    )
    steps = np.arange(int(trace["completed"]))
    _draw_raw(raw, trace, config, steps)
    for axes, name, fmt, title, unit in (
        (
            feature_axes,
            "features",
            config.formats.feature_format,
            "features: scaled window means, one column a step",
            "taxel",
        ),
        (hidden_axes, "hidden", config.formats.state_format, "hidden state after each step", "unit"),
    ):
        values = fmt.to_real(trace[name])[steps]
        if not values.shape[1]:
            axes.set_axis_off()
            axes.set_title("a linear cell has no hidden state", loc="left")
            continue
        limit = max(float(np.abs(values).max(initial=0.0)), 1e-9)
        extent = (0.5, len(steps) + 0.5, values.shape[1] - 0.5, -0.5)
        image = axes.imshow(values.T, cmap="RdBu_r", vmin=-limit, vmax=limit, aspect="auto", extent=extent)
        figure.colorbar(image, ax=axes, pad=0.01, fraction=0.03, label="value")
        axes.set_title(title, loc="left")
        axes.set_ylabel(unit)
        axes.yaxis.set_major_locator(MaxNLocator(integer=True, nbins=5))
    logits = config.formats.logit_format.to_real(trace["logits"])[steps]
    decided, margins = trace["local"][steps], config.formats.logit_format.to_real(trace["margin"])[steps]
    for index, name in enumerate(config.network.class_names):
        style = _class_style(index)
        logit_axes.plot(
            steps + 1, logits[:, index], marker="o", markersize=3, linewidth=1.4, label=name, **style
        )
        mine = decided == index
        hatch = "//" if index >= len(CLASS_COLOURS) else ""
        decision_axes.bar(steps[mine] + 1, margins[mine], width=0.8, color=style["color"], hatch=hatch)
        for step in steps[mine]:
            label = {
                "rotation": 90 if len(steps) > 12 else 0,
                "fontsize": 7.5,
                "ha": "center",
                "va": "bottom",
                "parse_math": False,
            }
            decision_axes.annotate(
                name[:LABEL_LETTERS], (step + 1, margins[step]), (0, 2), textcoords="offset points", **label
            )
    logit_axes.set_title("logits", loc="left")
    logit_axes.set_ylabel("value")
    place = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.1}
    logit_axes.legend(ncols=min(config.classes, 7), handlelength=1.6, columnspacing=1.2, **place)
    decision = int(trace["global_decision"])
    outcome = "no decision" if decision < 0 else config.network.class_names[decision]
    lead = int(trace["global_margin"])
    how = (
        f"{lead} votes ahead"
        if config.network.decision == "vote"
        else f"margin {config.formats.logit_format.to_real(lead):.2f}"
    )
    ended = ", recording ended early" if trace["partial"] else ""
    truth = config.network.class_names[int(trace["label"])]
    title = f"local decision of each step and its margin; global decision: {outcome} ({how}{ended}), true class: {truth}"
    decision_axes.set_title(title, loc="left", parse_math=False)
    decision_axes.set_ylabel("margin (logit value)")
    decision_axes.set_xlabel("step")
    letters = min(LABEL_LETTERS, max(map(len, config.network.class_names)))
    # room for the names above the bars
    decision_axes.set_ylim(0, max(float(margins.max(initial=0.0)), 1e-9) / (0.93 - 0.055 * letters))
    for axes in (feature_axes, hidden_axes, logit_axes, decision_axes):
        axes.set_xlim(0.5, len(steps) + 0.5)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=20))
    return figure


def _draw_raw(axes, trace: dict[str, np.ndarray], config: AcceleratorConfig, steps: np.ndarray) -> None:
    samples, rate = trace["samples"].astype(float), config.sensor.sample_rate_hz
    level = np.median(samples[: max(1, config.rest_level.rest_frames or min(64, len(samples) // 8))], axis=0)
    volts = 1000 * config.sensor.volt_per_code
    axes.set_prop_cycle(color=colormaps["cividis"](np.linspace(0.0, 0.9, samples.shape[1])))
    signal = (samples - level) * (volts or 1)
    axes.plot(np.arange(1, len(samples) + 1) / rate, signal, linewidth=0.6)
    start = int(trace["start_frame"]) - 1
    ends = [(start + config.window_spans[k][1]) / rate for k in steps]
    touch = ends[-1] - start / rate
    shown = max(1 / rate, start / rate - touch / 2), min(len(samples) / rate, ends[-1] + touch / 3)
    axes.set_xlim(*shown)
    visible = signal[round(shown[0] * rate) - 1 : round(shown[1] * rate)]
    low, high = visible.min(), visible.max()
    # room for the numbers of the steps
    axes.set_ylim(low - 0.2 * (high - low + 1e-9), high + 0.05 * (high - low + 1e-9))
    axes.axvspan(start / rate, ends[-1], color="#EEEEEE", zorder=0)
    for step, end in zip(steps, ends, strict=True):
        axes.axvline(end, ymax=0.04, color="black", linewidth=0.8)
        if step == 0 or (step + 1) % 5 == 0:
            text = "step 1" if step == 0 else str(step + 1)
            axes.text(
                end, 0.05, text, transform=axes.get_xaxis_transform(), fontsize=7.5, ha="center", va="bottom"
            )
    if trace["onset_frame"] > 0:
        axes.axvline(
            int(trace["onset_frame"]) / rate, color="black", linestyle="--", linewidth=1, label="onset found"
        )
        axes.legend(loc="upper right")
    axes.set_xlabel("time since arm (s)")
    axes.set_ylabel("mV from rest" if volts else "codes from rest")
    axes.set_title(
        f"recording {int(trace['number'])}: raw taxels, a line each; grey: the windows, a tick at the end "
        "of each",
        loc="left",
    )


def draw_candidates(rows: Sequence[dict[str, Any]], clock_hz: float) -> Figure:
    """Accuracy of each network tried against its multiplies a touch and its latency, with the band of one
    standard error of the best."""
    figure = Figure(figsize=(10.4, 3.3), layout="constrained")
    best = max(rows, key=lambda row: row["accuracy"])
    # of fits of one size, which lie on each other, the one taken or else the best; the table has all
    of_size: dict[tuple[str, int], dict[str, Any]] = {}
    for row in sorted(rows, key=lambda row: (row["chosen"], row["accuracy"])):
        of_size[row["cell"], row["hidden"]] = row
    rows = list(of_size.values())
    panels = [("multiplies a touch", [row["multiplies_touch"] for row in rows])]
    if all("decision_cycles" in row for row in rows):
        microseconds = [1e6 * row["decision_cycles"] / clock_hz for row in rows]
        panels.append(
            (f"features to decision (µs at {hertz(clock_hz)}, {rows[0]['lanes']} lanes)", microseconds)
        )
    row_of_axes = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
    for column, (axes, (label, positions)) in enumerate(zip(row_of_axes, panels, strict=True)):
        axes.axhspan(best["accuracy"] - best["standard_error"], best["accuracy"], color="#E8E8E8", zorder=0)
        for row, position in zip(rows, positions, strict=True):
            colour = INTEGER_COLOUR if row["chosen"] else FLOAT_COLOUR
            axes.errorbar(
                position,
                row["accuracy"],
                yerr=share_bars([row["accuracy"]], [row["standard_error"]]),
                fmt="o",
                markersize=8 if row["chosen"] else 5,
                color=colour,
                capsize=3,
            )
            name = (f"{row['cell'].upper()} {row['hidden']}" if row["hidden"] else row["cell"]) + (
                ", taken" if row["chosen"] else ""
            )
            axes.annotate(
                name, (position, row["accuracy"]), (7, -3), textcoords="offset points", fontsize=8, va="top"
            )
        axes.set_xscale("log")
        axes.margins(x=0.25, y=0.15)
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter(
            FuncFormatter(lambda value, _: count(value) if value >= 10 else f"{value:g}")
        )
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel(label)
        axes.grid(axis="y", color="#DDDDDD", linewidth=0.7)
        axes.set_axisbelow(True)
        if column == 0:
            axes.set_ylabel("accuracy, integer, cross-validated")
            axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=1))
            axes.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
            axes.set_title("grey: within one standard error of the best", loc="left")
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
        page = _render(Result.load(folder))
    path = folder / PAGE
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return path


def page_template(name: str) -> jinja2.Template:
    """A page's template with the filters and the style that pages share."""
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {
        "percent": percent,
        "seconds": seconds,
        "hertz": hertz,
        "count": count,
        "unit": unit,
        "mean_and_largest": mean_and_largest,
    }
    environment.globals["style"] = (TEMPLATES / "style.css").read_text(encoding="utf-8")
    return environment.from_string((TEMPLATES / name).read_text(encoding="utf-8"))


def _render(result: Result) -> str:
    splits, config, run = result.training["cross_validation"], result.config, result.run
    candidates = run.get("candidates") or []
    names = config.network.class_names
    drawn: dict[str, Figure | None] = {}
    with rc_context(STYLE):
        drawn["confusion"] = draw_confusion(splits, names, result.things)
        if not config.is_image:
            drawn["trace"] = draw_trace(result.trace, config)
            drawn["steps"] = draw_step_accuracy(splits, config.opens_at_once)
            drawn["training"] = draw_training(splits)
            drawn["candidates"] = (
                draw_candidates(candidates, config.hardware.clock_hz) if candidates else None
            )
        charts = {name: svg(figure) for name, figure in drawn.items() if figure}
    common = vars(result) | {
        "data": run["data"],
        "splits": splits,
        "cards": _headline(result),
        "candidates": candidates,
        "charts": charts,
        "network": _network(config),
        "confusions": lambda split: confusions(split, names),
    }
    if config.is_image:
        source = Path(run["data"]["source"]).name
        return page_template("images.html.j2").render(**common, name=source, layers=_layers(result))
    front_end = run.get("front_end")
    return page_template("report.html.j2").render(
        **common,
        name=_short_name(run["data"]["source"]),
        runs=[played for played in (result.cosim, result.declared, result.lowest) if played],
        split_name=_split_name,
        nested=[split["nested"] for split in splits if split.get("nested")],
        network_name=network_name,
        front_end=front_end,
        front_ends=[(row, front_end_words(row)) for row in front_end_table(front_end)] if front_end else [],
        baselines=run.get("baselines", []),
        test=run.get("test"),
        warnings=run.get("warnings", []),
        ranges=[_range_row(entry) for entry in result.training["ranges"]],
        short_network=f"{config.network.cell.upper()} {config.network.hidden}"
        if config.recurrent
        else "linear",
        failed=[check for check in run["checks"] if not check["held"]],
    )


def summary(folder: str | Path) -> Group:
    """The result in brief for the terminal, as a rich renderable.

    Raises
    ------
    InputError
        As ``write_report``.
    """
    with well_formed(Path(folder)):
        return _summary(Result.load(folder))


def _summary(result: Result) -> Group:
    from rich.console import Group
    from rich.text import Text

    data, run, played = result.run["data"], result.run, result.declared or result.cosim
    cards = {"what": "{title}", "value": "{value}", "": "{note}"}
    chosen = [split["nested"] for split in result.training["cross_validation"] if split.get("nested")]
    anew = {
        "": _split_name,
        "integer": lambda split: percent(split["integer_accuracy"]),
        "standard error": lambda split: percent(split["standard_error"]),
        "float": lambda split: percent(split["float_accuracy"]),
        "agreement": lambda split: percent(split["agreement"]),
    }
    splits = {
        "": lambda split: _split_name(split, result.things),
        "integer": lambda split: percent(split["integer_accuracy"]),
        "spread +-": lambda split: percent(split["integer_spread"]),
        "float": lambda split: percent(split["float_accuracy"]),
        "agreement": lambda split: percent(split["agreement"]),
        "logit error": lambda split: mean_and_largest(split["logit_error"]),
    }
    budgets = {
        "budget": "{name}",
        "limit": lambda row: seconds(row["limit_s"]),
        "measured": lambda row: seconds(row["measured_s"]),
        "": lambda row: "for comparison" if row["reference"] else "met" if row["met"] else "MISSED",
    }
    tables: tuple[tuple[str, Any, Mapping[str, Any]], ...] = (
        (
            f"{data['source']}: {data['recordings']} {result.things}, {_network(result.config)}",
            _headline(result),
            cards,
        ),
        ("accuracy on unseen recordings: front end and network chosen anew without each fold", chosen, anew),
        (
            "the network taken, on the folds it was chosen on"
            if chosen
            else f"accuracy on {result.things} the network has not seen",
            result.training["cross_validation"],
            splits,
        ),
        (f"latency at {hertz(played['clock_hz'])}", played["budgets"], budgets),
    )
    return Group(
        *(
            terminal_table(title, columns, rows_of(records, columns))
            for title, records, columns in tables
            if records
        ),
        *(
            Text(f"{'held  ' if check['held'] else 'FAILED'} {check['name']}: {check['detail']}")
            for check in run["checks"]
        ),
        *(Text(f"doubt  {sentence}", style="bold dark_orange") for sentence in run.get("warnings", [])),
    )
