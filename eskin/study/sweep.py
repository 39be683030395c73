"""Speed against accuracy: trains and quantises a grid of networks, evaluates them on unseen groups, and finds
the front and the smallest network that is enough.

A *point* is a network with its bits and its lanes. Its accuracy is cross-validated, in integers; its cost is
counted from the configuration and, through ``cost_of``, from the program of the hardware. Trained networks
are cached by content: points that differ only in lanes share one training, an interrupted sweep resumes, and
a repeated sweep trains nothing.
"""

import itertools
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from eskin.choose.cost import pareto
from eskin.golden.core import AcceleratorConfig, InputError, Record, content_key
from eskin.golden.core.groups import Network
from eskin.golden.data import Recordings
from eskin.jobs import Jobs
from eskin.memo import Memo
from eskin.training.crossval import cross_validate
from eskin.training.formats import with_network
from eskin.training.quantise import COVERED_FEATURE, choose_formats

DECISION = ("decision", "early_margin", "early_steps")
NETWORK = ("cell", "reset", "hidden", "steps", "hop", *DECISION)
WIDTHS = ("weight_bits", "state_bits", "feature_bits", "gate_bits", "table_entries")
HARDWARE = ("lanes", "lane_type")
AWARE = "quantisation_aware"
FIELDS = (*NETWORK, *WIDTHS, AWARE, *HARDWARE)
"""Fields that a grid may vary. Widths are those of ``eskin.training.quantise.choose_formats``."""

_CELLS: tuple[dict[str, list[Any]], ...] = (
    {"cell": ["gru"], "reset": ["before", "after"], "hidden": [4, 6, 8, 12, 16]},
    {"cell": ["lstm"], "hidden": [4, 6, 8, 12]},
)
DEFAULT_GRID: list[dict[str, list[Any]]] = [
    {**cell, **bits, "lanes": [1, 4]}
    for cell in _CELLS
    for bits in ({"weight_bits": [6, 8]}, {"weight_bits": [4], "state_bits": [12]})
]
"""84 points. Coarse weights need a coarser state: products of features and of states share one scale on
16-bit operands."""
NOT_BUILT = ("lut", "dsp", "bram")
"""Keys of a point that only a build fills."""

COSTS = ("latency_s", "multiplies_decision", "energy_j")
"""Keys of a record that accuracy is set against."""

SPREAD = ("accuracy", "spread", "standard_error")
"""Keys of a split that a record repeats."""

_TYPICAL_RANGES = {
    "feature": (-7.9, 7.9),
    COVERED_FEATURE: (-7.9, 7.9),
    "logit": (-12.0, 12.0),
    **dict.fromkeys(("weight", "recurrent", "dense", "bias", "dense bias"), (-1.98, 1.98)),
}
"""Formats of these ranges show, before any training, whether the widths of a point can work, and give the
hardware its widths."""


# ---------------------------------------------------------------------- points
@dataclass(frozen=True)
class Point:
    """One network on one set of lanes.

    config: with formats of the right widths, so that the program of the hardware can be counted. widths: what
    was asked of ``WIDTHS``. aware: trained on in integer arithmetic, not only quantised after training.
    """

    config: AcceleratorConfig
    widths: Mapping[str, int] = field(default_factory=dict)
    aware: bool = False

    @property
    def recommended(self) -> AcceleratorConfig:
        """Options of `eskin train` that make it."""
        return self.config

    def to_dict(self) -> Record:
        """The point in the words of ``FIELDS``."""
        config = self.config
        bits = {
            "weight_bits": config.weight_bits,
            "state_bits": config.formats.state_format.width,
            "feature_bits": config.formats.feature_format.width,
            "gate_bits": config.formats.gate_frac,
            "table_entries": config.formats.table_entries,
        }
        return {
            **{name: config.value(name) for name in NETWORK},
            **bits,
            **self.widths,
            AWARE: self.aware,
            **{name: config.value(name) for name in HARDWARE},
        }

    @property
    def name(self) -> str:
        """The point in a few words: ``GRU 12, 8 bit, 4 lanes``."""
        trained = " quantisation-aware" if self.aware else ""
        kind = network_name(self.to_dict())
        kind += (
            f" early {self.config.network.early_margin} x {self.config.network.early_steps}"
            if self.config.network.decision == "early"
            else ""
        )
        return f"{kind}, {self.config.weight_bits} bit{trained}, {lanes_name(self.to_dict())}"

    def cost(self) -> dict[str, int]:
        """Parameters; multiplies a step (``AcceleratorConfig.multiplies``) and a whole decision (all steps);
        bits of all weights."""
        config = self.config
        weights = (
            len(config.gates) * config.network.hidden * (config.inputs + config.network.hidden)
            + config.classes * config.network.hidden
        )
        if not config.recurrent:
            weights = config.sets * config.classes * config.inputs
        return {
            "parameters": config.parameter_count,
            "multiplies_step": config.multiplies,
            "multiplies_decision": config.multiplies * config.windows.steps,
            "weight_memory_bits": weights * config.weight_bits,
        }


def cell_name(config: Record) -> str:
    """``GRU``, ``GRU reset after``, ``LSTM`` or ``linear``."""
    if config["cell"] == "linear":
        return "linear"
    return config["cell"].upper() + (
        " reset after" if config["cell"] == "gru" and config["reset"] == "after" else ""
    )


def network_name(config: Record) -> str:
    """``GRU 12``: cell and hidden units; ``linear`` has none."""
    return cell_name(config) if config["cell"] == "linear" else f"{cell_name(config)} {config['hidden']}"


def lanes_name(config: Record) -> str:
    """``4 lanes``."""
    return f"{config['lanes']} lane{'s' if config['lanes'] != 1 else ''}"


def read_grid(path: str | Path) -> list[Record]:
    """Grids from a JSON file: an object or a list of objects, field -> value or list of values (all
    combinations).

    Raises
    ------
    InputError
        The file cannot be read or holds something else.
    """
    try:
        grid = json.loads(Path(path).read_text())
    except OSError as error:
        raise InputError(f"grid '{path}': {error.strerror}; give a JSON file") from None
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"grid '{path}': is not JSON ({error}); give an object of fields, or a list of them"
        ) from None
    grids = grid if isinstance(grid, list) else [grid]
    if not grids or not all(isinstance(entry, dict) for entry in grids):
        raise InputError(
            f"grid '{path}': must be an object of fields, or a list of them; fields are {', '.join(FIELDS)}"
        )
    return grids


def make_points(base: AcceleratorConfig, grids: Sequence[Record], source: str = "grid") -> list[Point]:
    """Every point of the grids, each once, in order; fields that a grid leaves out are those of ``base``.

    Raises
    ------
    InputError
        An unknown field, or a combination that no accelerator has: before anything is trained.
    """
    return expand(grids, source, FIELDS, "a grid", lambda fields: _point(base, fields))


def expand(
    grids: Sequence[Record], source: str, fields: Sequence[str], what: str, point_of: Callable[[Record], Any]
) -> list[Any]:
    """Every combination of each grid's values as ``point_of`` makes it, each once.

    Raises
    ------
    InputError
        A field that is none of ``fields``, an empty list, or a combination that ``point_of`` refuses.
    """
    points: Record = {}
    for grid in grids:
        unknown = [name for name in grid if name not in fields]
        if unknown:
            raise InputError(f"{source}: unknown field {unknown[0]}; {what} varies {', '.join(fields)}")
        choices = [value if isinstance(value, list) else [value] for value in grid.values()]
        if not all(choices):
            raise InputError(f"{source}: a field has an empty list; give at least one value")
        for values in itertools.product(*choices):
            fields_of = dict(zip(grid, values, strict=True))
            try:
                point = point_of(fields_of)
            except (InputError, ValueError) as error:
                raise InputError(f"{source}, point {json.dumps(fields_of)}: {error}") from None
            points.setdefault(json.dumps(point.to_dict()), point)
    return list(points.values())


def _point(base: AcceleratorConfig, fields: Record) -> Point:
    for name in (*WIDTHS, "hidden", "steps", "hop", "lanes"):
        if name in fields and (not isinstance(fields[name], int) or isinstance(fields[name], bool)):
            raise InputError(f"field {name}: is {fields[name]!r}; give a whole number")
    if not isinstance(fields.get(AWARE, False), bool):
        raise InputError(f"field {AWARE}: is {fields[AWARE]!r}; give true or false")
    changes = {name: fields[name] for name in ("hop", *DECISION, *HARDWARE) if name in fields}
    network = {name: fields[name] for name in ("cell", "reset", "hidden", "steps") if name in fields}
    cell = network.get("cell") or base.network.cell
    if cell == "lstm":
        network["reset"] = "before"  # an LSTM has none: two spellings of it are one point
    config = with_network(base, **network)
    if cell == "linear":  # nor has a linear cell, which has no hidden units either
        config = config.replace(reset="before", hidden=Network.hidden)
    if "hop" in changes:
        changes |= {
            "window": 2 * changes["hop"] + config.windows.window - 2 * config.windows.hop,
            "feature_shift": (),
        }
    config = config.replace(**changes)
    widths = {name: fields[name] for name in WIDTHS if name in fields}
    return Point(choose_formats(config, _TYPICAL_RANGES, **widths), widths, fields.get(AWARE, False))


# ---------------------------------------------------------------------- judging
def judge(recordings: Recordings, piece: Record) -> Record:
    """The outcome of a piece of work, which holds the arguments of `cross_validate`: ``{"splits": [...]}``
    (``split_figures``), or ``{"refused": why}`` when the trained network has no formats of these widths."""
    try:
        records = cross_validate(recordings, **piece)
    except InputError as error:
        return {"refused": str(error)}
    return {"splits": [split_figures(record) for record in records]}


def judge_points(
    recordings: Recordings,
    points: Sequence[Point],
    splits: Sequence[Sequence[str]],
    *,
    seeds: Sequence[int],
    folds: int,
    jobs: Jobs,
    keep: Memo,
    version: str = "",
) -> list[Record]:
    """The outcome of each point (`judge`) on the splits, which are group names; points that differ in lanes
    alone share a training. ``version`` names data and code in the keys of finished trainings."""
    common = {"splits": [list(split) for split in splits], "seeds": list(seeds), "folds": folds}
    pieces, keys = {}, []
    for point in points:
        config, own = point.config.with_lanes(1, "plain"), {"widths": dict(point.widths)}
        piece = common | own | {AWARE: point.aware}
        keys.append(content_key(version, config.to_dict(), piece))
        pieces[keys[-1]] = piece | {"config": config}
    outcomes = jobs.results(judge, pieces, recordings, keep=keep, what="trained and judged")
    return [outcomes[key] for key in keys]


def split_figures(record: Record) -> Record:
    """Figures of a point for one split of ``cross_validate``: groups, accuracy (integer), spread and
    standard_error (over seeds, of the accuracy over all folds), by_seed, float_accuracy, float_by_seed,
    agreement, decision_time_s, per_step (step, time_s since the onset, accuracy), per_fold (held_out,
    accuracy, by_seed)."""
    return {
        "groups": list(record["groups"]),
        "accuracy": record["integer_accuracy"],
        **seed_spread(record["integer_by_seed"], sum(fold["recordings"] for fold in record["per_fold"])),
        "float_accuracy": record["float_accuracy"],
        "float_by_seed": record["float_by_seed"],
        "agreement": record["agreement"],
        "decision_time_s": record["decision_time_s"],
        "per_step": [
            {"step": row["step"], "time_s": row["time_s"], "accuracy": row["integer_accuracy"]}
            for row in record["per_step"]
        ],
        "per_fold": [
            {
                "held_out": fold["held_out"],
                "accuracy": fold["integer_accuracy"],
                "by_seed": fold["by_seed"]["integer_accuracy"],
            }
            for fold in record["per_fold"]
        ],
    }


def seed_spread(by_seed: Sequence[float], recordings: int) -> Record:
    """spread: standard deviation over seeds; standard_error: of their mean. With one seed neither is known:
    the spread is None, and the standard error is that of a share of the recordings."""
    values = np.asarray(by_seed, dtype=np.float64)
    mean, spread = float(values.mean()), float(values.std(ddof=1)) if len(values) > 1 else None
    error = math.sqrt(mean * (1 - mean) / recordings) if spread is None else spread / math.sqrt(len(values))
    return {"spread": spread, "standard_error": error, "by_seed": values.tolist()}


# ---------------------------------------------------------------------- the sweep
def sweep(
    points: Sequence[Any],
    outcomes: Sequence[Record],
    cost_of: Callable[[AcceleratorConfig], Mapping[str, float]],
    bounds: Mapping[str, float],
    costs: Sequence[str] = COSTS,
) -> Record:
    """Mark the front of judged points, and recommend one.

    Parameters
    ----------
    points, outcomes:
        `Point`, or `eskin.study.image_sweep.ImagePoint`, and what `judge` says of each. A point's
        ``accuracy`` is that of the FIRST split; all stand in its ``splits``.
    cost_of:
        Of a configuration cycles_step, cycles_decision (from the features, or the last pixel, to the
        decision), energy_j (of a touch, waiting included, or of an image's computation) and compute_j (of the
        steps alone); energies are estimates.
    bounds:
        Of `recommend`.
    costs:
        Keys of a record that accuracy is set against.

    Returns
    -------
    Of sweep.json points, recommended, recommendation, refused.

    Raises
    ------
    InputError
        No point can be quantised to the widths it asks for.
    """
    records, refused = [], []
    for point, outcome in zip(points, outcomes, strict=True):
        if "refused" in outcome:
            refused.append({"name": point.name, "config": point.to_dict(), "reason": outcome["refused"]})
        else:
            records.append(_record(point, outcome["splits"], cost_of(point.config)))
    if not records:
        raise InputError(
            f"sweep: no point could be quantised to its widths; the first one reports: {refused[0]['reason']}"
        )
    front = {number for cost in costs for number in pareto(records, cost)}
    for number, record in enumerate(records):
        record["on_front"] = number in front
    choice = recommend(records, bounds)
    return {"points": records, "recommended": choice["point"], "recommendation": choice, "refused": refused}


def _record(point: Any, splits: list[Record], cost: Mapping[str, float]) -> Record:
    clock_hz = point.config.hardware.clock_hz
    return {
        "name": point.name,
        "config": point.to_dict(),
        "widths": dict(point.widths),
        **{key: splits[0][key] for key in (*SPREAD, "float_accuracy", "agreement")},
        **cost,
        "clock_hz": clock_hz,
        "latency_s": cost["cycles_decision"] / clock_hz,
        **point.cost(),
        **dict.fromkeys(NOT_BUILT),
        "on_front": False,
        "splits": splits,
    }


def size(record: Record) -> tuple:
    """Size of a model: multiplies of a decision, then bits of its weights, then lanes, then no early
    decision, which takes hardware beside it; the rest only makes the order unique."""
    config = record["config"]
    return (
        record["multiplies_decision"],
        record["weight_memory_bits"],
        config["lanes"],
        config.get("decision") == "early",
        json.dumps(config, sort_keys=True),
    )


def recommend(records: Sequence[Record], bounds: Mapping[str, float]) -> Record:
    """The smallest (``size``) record that meets the bounds, of ``accuracy floor`` (a share) and ``latency
    budget`` (seconds) those there are; or the nearest, and by how much it misses.

    Without a floor all records within one standard error of the most accurate one count as equal, and the
    smallest of them is named. Where no record meets the bounds, the nearest has the smallest sum of misses, each
    as a share of its bound; again the smallest within one standard error is named.

    Returns
    -------
    point (index), name, met, misses (bound -> how far beyond it, share or seconds), sentence.
    """

    def misses(record: Record) -> dict[str, float]:
        over = {
            "accuracy floor": bounds.get("accuracy floor", 0.0) - record["accuracy"],
            "latency budget": record["latency_s"] - bounds.get("latency budget", math.inf),
        }
        return {name: value for name, value in over.items() if value > 0}

    def distance(index: int) -> float:
        return sum(over / bounds[name] for name, over in misses(records[index]).items())

    nearest = min(range(len(records)), key=distance)
    slack = 0.0
    if "accuracy floor" in misses(records[nearest]):
        slack = records[nearest]["standard_error"] / bounds["accuracy floor"]
    near = [index for index in range(len(records)) if distance(index) <= distance(nearest) + slack]
    met = not misses(records[nearest])
    if met and "accuracy floor" not in bounds:
        best = max((records[index] for index in near), key=lambda record: record["accuracy"])
        least = best["accuracy"] - best["standard_error"]
        near = [index for index in near if records[index]["accuracy"] >= least]
    chosen = min(near, key=lambda index: size(records[index]))
    record, words = records[chosen], " and ".join(f"{name} {_bound(name, bounds[name])}" for name in bounds)
    if not met:
        by = " and ".join(
            f"the {name} {_bound(name, bounds[name])} by {_bound(name, over)}"
            for name, over in misses(record).items()
        )
        sentence = f"none meets the bounds; nearest is {_says(record)}: it misses {by}"
    elif bounds:
        sentence = f"{_says(record)}: the smallest that meets {words}"
    else:
        sentence = f"{_says(record)}: the smallest within one standard error of the most accurate"
    return {
        "point": chosen,
        "name": record["name"],
        "met": met,
        "misses": misses(record),
        "sentence": sentence,
    }


def _bound(name: str, value: float) -> str:
    units = {"accuracy floor": f"{100 * value:.3g} %", "latency budget": f"{1e6 * value:.4g} us"}
    return units[name]


def _says(record: Record) -> str:
    error = f" +- {100 * record['standard_error']:.2f}"
    cost = f"{1e6 * record['latency_s']:.4g} us, {1e6 * record['energy_j']:.4g} uJ"
    return f"{record['name']} ({100 * record['accuracy']:.2f}{error} %, {cost})"


def flat_rows(result: Record) -> list[Record]:
    """Rows for sweep.csv: the point's configuration and figures, then accuracy, spread, float accuracy and
    agreement of every split."""
    rows = []
    for number, record in enumerate(result["points"]):
        row = {"point": number, **record["config"]}
        row |= {key: value for key, value in record.items() if key not in ("config", "widths", "splits")}
        for split in record["splits"]:
            name = split_name(split["groups"])
            keys = ("accuracy", "spread", "standard_error", "float_accuracy", "agreement", "decision_time_s")
            row |= {f"{key} {name}": split[key] for key in keys}
        row["recommended"] = number == result["recommended"]
        rows.append(row)
    return rows


def split_name(groups: Sequence[str]) -> str:
    """Name of the groups that a split leaves out."""
    return " and ".join(groups) or "recordings"
