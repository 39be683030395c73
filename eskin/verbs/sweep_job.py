"""The sweep, `eskin sweep`, speed against accuracy: trains and quantises a grid of networks, evaluates them on unseen
groups or images, and finds the front and the smallest network that is enough.

A *point* is a network with its bits and its lanes. Its accuracy is cross-validated, in integers; its cost is that
of the cost model by which `eskin train` chooses. Trained networks are cached by content: points that differ only
in lanes share one training, and so do the bits of a network for images. An interrupted sweep resumes.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from eskin.choose.cost import pareto
from eskin.choose.networks import network
from eskin.golden.core import (
    NETWORKS,
    AcceleratorConfig,
    InputError,
    Progress,
    QFormat,
    Record,
    check_target,
    content_key,
    replacing,
    write_json,
)
from eskin.golden.data import Recordings
from eskin.jobs import Jobs
from eskin.memo import Memo, code_version
from eskin.pages.charts import COSTS, accuracy_chart
from eskin.requests import SweepRequest
from eskin.rtl.program.schedule import decision_cycles, step_cycles
from eskin.rtl.views.schedule_view import save_figure
from eskin.training import LEARNING
from eskin.training.crossval import cross_validate
from eskin.training.formats import with_network
from eskin.training.image_models import KEPT, image_config, judged_folds, split_of
from eskin.training.quantise import COVERED_FEATURE, choose_formats
from eskin.training.splits import check_split, default_splits
from eskin.training.train_images import CODE as IMAGE_CODE
from eskin.training.train_images import ImageRecipe
from eskin.verbs.cost import estimated

CELLS: list[tuple[str, str, int | None]] = [("linear", "before", None)]
CELLS += [("gru", reset, hidden) for reset in ("before", "after") for hidden in (4, 6, 8, 12, 16)]
CELLS += [("lstm", "before", hidden) for hidden in (4, 6, 8, 12)]
"""Cell, reset and hidden units of the networks for recordings."""

WIDTHS: tuple[Record, ...] = ({"weight_bits": 8}, {"weight_bits": 6}, {"weight_bits": 4, "state_bits": 12})
"""Coarse weights need a coarser state: products of features and of states share one scale on 16-bit operands."""

LANES = (1, 4)
IMAGE_BITS, IMAGE_LANES, IMAGE_CLOCK_HZ = (8, 4), 8, 36e6
"""Of networks for images; the clock is what `eskin build` reaches with TactNet4 on an iCE40UP5K, less a reserve."""

FOLDS, SEEDS, IMAGE_SEEDS = 5, 3, 1
"""Folds of every split, and trainings of each."""

TYPICAL_RANGES = {
    **dict.fromkeys(("feature", COVERED_FEATURE), (-7.9, 7.9)),
    "logit": (-12.0, 12.0),
    **dict.fromkeys(("weight", "recurrent", "dense", "bias", "dense bias"), (-1.98, 1.98)),
}
"""Formats of these ranges show, before any training, whether the widths of a point can work, and give the
hardware its widths."""

SPLIT = (
    "groups",
    "integer_accuracy",
    "integer_by_seed",
    "float_accuracy",
    "agreement",
    "decision_time_s",
    "per_step",
)
"""Keys of a cross-validation that sweep.json keeps."""


@dataclass(frozen=True)
class Point:
    """One network on one set of lanes. config: with formats of the right widths, so that the program of the
    hardware can be counted. widths: options of ``quantise``."""

    config: AcceleratorConfig
    widths: Mapping[str, int]

    @property
    def network(self) -> str:
        """``linear``, ``GRU 12``, ``GRU reset after 12``, ``tactnet``."""
        cell = self.config.network
        if self.config.is_image:
            return self.config.name
        after = " reset after" if cell.reset == "after" else ""
        return f"{cell.cell.upper()}{after} {cell.hidden}" if self.config.recurrent else cell.cell

    @property
    def name(self) -> str:
        """``GRU 12, 8 bit, 4 lanes``."""
        lanes = self.config.hardware.lanes
        return f"{self.network}, {self.widths['weight_bits']} bit, {lanes} lane{'s' * (lanes != 1)}"

    def to_dict(self) -> Record:
        """The point in the words of sweep.json."""
        config = self.config
        own: Record = {name: config.value(name) for name in ("cell", "reset", "hidden")}
        if config.is_image:
            own = {"layers": list(config.image.layers), "clock_hz": config.hardware.clock_hz}
        return {"network": self.network, **own, **self.widths, "lanes": config.hardware.lanes}


def recording_points(base: AcceleratorConfig) -> list[Point]:
    """The networks of CELLS, with WIDTHS and LANES, on the front end of ``base``; those that no accelerator has are
    left out.

    Raises
    ------
    InputError
        No point is left.
    """
    points, why = list[Point](), ""
    for cell, reset, hidden in CELLS:
        for widths in WIDTHS:
            try:
                config = network(base, cell, hidden)
                config = with_network(config, reset=reset) if hidden else config
                config = choose_formats(config, TYPICAL_RANGES, **widths)
                points += [Point(config.with_lanes(lanes, "plain"), widths) for lanes in LANES]
            except InputError as error:
                why = why or str(error)
    if not points:
        raise InputError(f"sweep: no network suits this configuration; the first one reports: {why}")
    return points


def image_points(recordings: Recordings) -> list[Point]:
    """NETWORKS with weights of IMAGE_BITS on IMAGE_LANES."""
    points = []
    for name in NETWORKS:
        trained = image_config(recordings, name)
        weights = len(trained.weighted_stages)
        for bits in IMAGE_BITS:  # widths count cycles; where the points stand is only known after training
            config = trained.replace(
                weight_formats=(QFormat(1, bits - 1),) * weights,
                map_formats=(QFormat(3, 5, signed=False),) * (weights - 1),
                logit_format=QFormat(8, 8),
                clock_hz=IMAGE_CLOCK_HZ,
            )
            points.append(Point(config.with_lanes(IMAGE_LANES, "plain"), {"weight_bits": bits}))
    return points


# ---------------------------------------------------------------------- judging
def judge_recordings(recordings: Recordings, piece: Record) -> Record:
    """The outcome of a piece of work, which holds the arguments of `cross_validate`: ``{"splits": [...]}``, with the
    keys SPLIT of each, or ``{"refused": why}`` when the trained network has no formats of these widths."""
    try:
        records = cross_validate(recordings, **piece)
    except InputError as error:
        return {"refused": str(error)}
    return {"splits": [{key: record[key] for key in SPLIT} for record in records]}


def judge_points(
    recordings: Recordings,
    points: Sequence[Point],
    splits: Sequence[Sequence[str]],
    jobs: Jobs,
    keep: Memo,
    version: str,
) -> list[Record]:
    """The outcome of each point on the splits, which are group names. ``version`` names data and code in the keys
    of finished trainings. Images have one split, of which no groups are random folds."""
    if points[0].config.is_image:
        return _judge_images(recordings, points, list(splits[0]), jobs, keep)
    pieces, keys = {}, []
    for point in points:
        config = point.config.with_lanes(1, "plain")
        piece: Record = {"splits": list(map(list, splits)), "seeds": list(range(SEEDS)), "folds": FOLDS}
        piece["widths"] = dict(point.widths)
        keys.append(content_key(version, config.to_dict(), piece))
        pieces[keys[-1]] = piece | {"config": config}
    outcomes = jobs.results(judge_recordings, pieces, recordings, keep=keep, what="trained and judged")
    return [outcomes[key] for key in keys]


def _judge_images(
    recordings: Recordings, points: Sequence[Point], groups: list[str], jobs: Jobs, keep: Memo
) -> list[Record]:
    configs = {name: image_config(recordings, name) for name in dict.fromkeys(p.network for p in points)}
    networks = list(configs.values())
    judged = judged_folds(recordings, networks, groups, FOLDS, range(IMAGE_SEEDS), ImageRecipe(), jobs, keep)
    outcomes = []
    for point in points:
        of_network = judged[list(configs).index(point.network)]
        split = split_of(recordings, groups, of_network, f"w{point.config.weight_bits}")
        split["decision_time_s"] = split["per_step"][0]["time_s"]
        outcomes.append({"splits": [{key: split[key] for key in SPLIT}]})
    return outcomes


# ---------------------------------------------------------------------- the sweep
def sweep(
    points: Sequence[Point],
    outcomes: Sequence[Record],
    recordings: int,
    floor: float | None = None,
    budget: float | None = None,
) -> Record:
    """Mark the front of judged points, and recommend one.

    Parameters
    ----------
    outcomes:
        Of `judge_points`. A point's ``accuracy`` is that of the FIRST split; all stand in its ``splits``.
    recordings:
        Number judged, for the standard error.
    floor, budget:
        Of `recommend`.

    Returns
    -------
    points, recommended, sentence, refused of sweep.json.

    Raises
    ------
    InputError
        No point can be quantised to the widths it asks for.
    """
    records, refused = [], []
    for point, outcome in zip(points, outcomes, strict=True):
        if "refused" in outcome:
            refused.append({"name": point.name, "config": point.to_dict(), "reason": outcome["refused"]})
            continue
        first, config = outcome["splits"][0], point.config
        accuracy = first["integer_accuracy"]
        records.append(
            {
                "name": point.name,
                "config": point.to_dict(),
                "accuracy": accuracy,
                "standard_error": math.sqrt(accuracy * (1 - accuracy) / recordings),
                "float_accuracy": first["float_accuracy"],
                "agreement": first["agreement"],
                **cost_of(config),
                "clock_hz": config.hardware.clock_hz,
                "parameters": config.parameter_count,
                "multiplies_decision": config.multiplies * (1 if config.is_image else config.windows.steps),
                **dict.fromkeys(("lut", "dsp", "bram")),  # only a build fills these
                "splits": outcome["splits"],
            }
        )
    if not records:
        raise InputError(
            f"sweep: no point could be quantised to its widths; the first one reports: {refused[0]['reason']}"
        )
    front = {number for cost in COSTS for number in pareto(records, cost)}
    for number, record in enumerate(records):
        record["on_front"] = number in front
    recommended, sentence = recommend(records, floor, budget)
    return {"points": records, "recommended": recommended, "sentence": sentence, "refused": refused}


def size(record: Record) -> tuple:
    """Size of a model: multiplies of a decision, then bits of a weight, then lanes."""
    return record["multiplies_decision"], record["config"]["weight_bits"], record["config"]["lanes"]


def recommend(records: Sequence[Record], floor: float | None, budget: float | None) -> tuple[int, str]:
    """Index of the smallest (``size``) record that is within the latency ``budget`` (seconds) and has the accuracy
    ``floor`` (a share), and a sentence about it. Without a floor it is within one standard error of the most
    accurate. Where no record meets the budget it is the fastest, and where none has the floor the most accurate."""
    fast = [record for record in records if budget is None or record["latency_s"] <= budget]
    best = max(fast or records, key=lambda record: record["accuracy"])
    least = best["accuracy"] - best["standard_error"] if floor is None else floor
    enough = [record for record in fast if record["accuracy"] >= least]
    if not fast:
        chosen, why = (
            min(records, key=lambda record: record["latency_s"]),
            "none meets the latency budget, the fastest",
        )
    elif not enough:
        chosen, why = best, "none has the accuracy asked for, the most accurate"
    else:
        chosen = min(enough, key=size)
        why = (
            "the smallest within one standard error of the most accurate"
            if floor is None
            else "the smallest that is enough"
        )
    figures = f"{100 * chosen['accuracy']:.2f} +- {100 * chosen['standard_error']:.2f} %"
    cost = f"{1e6 * chosen['latency_s']:.4g} us, {1e6 * chosen['energy_j']:.4g} uJ"
    return list(records).index(chosen), f"{chosen['name']} ({figures}, {cost}): {why}"


# ---------------------------------------------------------------------- the verb
CACHE = Path("build/sweep_points")
"""Finished trainings by content; shared by all sweeps, safe to delete."""
CODE = partial(code_version, *LEARNING, "verbs/sweep_job.py")
"""Code on which a training depends beside its data."""
PART = "iCE40UP5K"
"""Whose energy is estimated: the only part with published measurements."""
RESULT, CONFIG = "sweep.json", "recommended.json"


def cost_of(config: AcceleratorConfig) -> dict[str, float]:
    """Costs of a point on its own lanes and clock: cycles_step, latency_s (from the features, or the last pixel, to the
    decision) and energy_j (an estimate, of a touch; of an image the computation alone)."""
    energy = estimated(config, PART)
    return {
        "cycles_step": step_cycles(config),
        "latency_s": decision_cycles(config) / config.hardware.clock_hz,
        "energy_j": energy["per_touch_j"]
        + (energy["preprocessing_per_touch_j"] if not config.is_image else 0.0),
    }


def run(
    request: SweepRequest,
    recordings: Recordings,
    config: AcceleratorConfig | None,
    *,
    progress: Progress | None = None,
) -> Record:
    """Sweep; write sweep.json, recommended.json (configuration of the recommended point) and
    the chart. ``config``: the front end; of images None.

    Without groups every split that the configuration names is judged, by the first of them, and images by
    random folds. Returns the result, as in sweep.json.

    Raises
    ------
    InputError
        A folder or group that cannot be used, before anything is trained.
    """
    out = request.out
    splits = [request.groups or []]
    if request.groups is None and config:
        splits = default_splits(recordings, config)
    for groups in splits:
        check_split(recordings, groups, FOLDS)
    points = recording_points(config) if config else image_points(recordings)
    for name in (RESULT, CONFIG):
        check_target(out / name)
    code, keep = (CODE, Memo(CACHE)) if config else (IMAGE_CODE, Memo(KEPT))
    jobs = Jobs(dask=request.dask, progress=progress, version=code)
    version = json.dumps([recordings.content, code()])
    outcomes = judge_points(recordings, points, splits, jobs, keep, version)
    bounds = request.accuracy_floor, request.latency_budget
    result = sweep(points, outcomes, len(recordings), *bounds)
    result["data"] = str(recordings.source)
    figure = accuracy_chart(result)
    for kind in ("png", "svg"):
        with replacing(out / f"accuracy.{kind}") as temporary:
            save_figure(figure, temporary, kind)
    name = result["points"][result["recommended"]]["name"]
    point = next(point for point in points if point.name == name)
    write_json(out / CONFIG, point.config.to_dict())
    write_json(out / RESULT, result)
    return result
