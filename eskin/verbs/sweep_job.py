"""The sweep, `eskin sweep`: golden trains and judges, rtl counts cycles; here the two meet, and the files are
written."""

import csv
import json
from functools import partial
from pathlib import Path
from typing import Any

from eskin.golden.core import AcceleratorConfig, Progress, Record, check_target, replacing, write_json
from eskin.golden.data import Recordings
from eskin.jobs import Jobs
from eskin.memo import Memo, code_version
from eskin.pages.sweep_charts import accuracy_chart
from eskin.requests import SweepRequest
from eskin.rtl.program.schedule import decision_cycles, step_cycles
from eskin.rtl.top.image_accelerator import refuse_hardware
from eskin.rtl.views.schedule_view import save_figure
from eskin.study import sweep as sweeping
from eskin.study.image_sweep import COSTS, DEFAULT_GRID, judge_image_points, make_image_points
from eskin.training import LEARNING
from eskin.training.image_models import KEPT
from eskin.training.splits import check_split, default_splits
from eskin.training.train_images import CODE as IMAGE_CODE
from eskin.verbs.cost import estimated

CACHE = Path("build/sweep_points")
"""Finished trainings by content; shared by all sweeps, safe to delete."""

CODE = partial(code_version, *LEARNING)
"""Code on which a training depends beside its data."""

PART = "iCE40UP5K"
"""Whose energy is estimated: the only part with published measurements. Its clock may stop between
samples."""

FOLDS = 5
"""Folds of every split."""
SEEDS = 3
"""Trainings of each fold; of images one."""
RESULT, TABLE, CONFIG = "sweep.json", "sweep.csv", "recommended.json"


def cost_of(config: AcceleratorConfig) -> dict[str, float]:
    """Cycles and energies (joule) of a point, as ``eskin.study.sweep.sweep`` takes them.

    compute_j: of the steps of a touch, or of an image. energy_j: of an image the same, waiting for it left
    out; of a touch from its first frame to its last, waiting included, with an outside clock that runs, at
    any rate, only while there is work.
    """
    energy = estimated(config, PART)
    compute_j = energy["per_touch_j"]
    return {
        "cycles_step": step_cycles(config),
        "cycles_decision": decision_cycles(config),
        "energy_j": compute_j if config.is_image else energy["choices"][1]["touch_j"],
        "compute_j": compute_j,
    }


def run(
    request: SweepRequest,
    recordings: Recordings,
    config: AcceleratorConfig | None,
    *,
    progress: Progress | None = None,
) -> Record:
    """Sweep; write sweep.json, sweep.csv, recommended.json (configuration of the recommended point) and
    the chart. ``config``: sensor, windows, clock, and what the grid leaves open; of images None.

    Without groups every split that the configuration names is judged, by the first of them, and images by
    random folds. Returns the result, as in sweep.json.

    Raises
    ------
    InputError
        A folder, grid or group that cannot be used, or lanes that the hardware does not have; before anything
        is trained.
    """
    out, source, images = request.out, f"grid '{request.grid}'", config is None
    splits = [request.groups or []]
    if request.groups is None and config:
        splits = default_splits(recordings, config)
    for groups in splits:
        check_split(recordings, groups, FOLDS)
    grids = DEFAULT_GRID if images else sweeping.DEFAULT_GRID
    if request.grid != "default":
        grids = sweeping.read_grid(request.grid)
    points: Any
    if config is None:
        points = make_image_points(recordings, grids, source)
        for point in points:
            refuse_hardware(point.config)
    else:
        points = sweeping.make_points(config, grids, source)
    for name in (RESULT, TABLE, CONFIG):
        check_target(out / name)
    code, seeds = (IMAGE_CODE, [0]) if images else (CODE, list(range(SEEDS)))
    jobs, keep = Jobs(dask=request.dask, progress=progress, version=code), Memo(KEPT if images else CACHE)
    options: Record = {"seeds": seeds, "folds": FOLDS, "jobs": jobs, "keep": keep}
    if config is None:
        outcomes, own = judge_image_points(recordings, points, splits[0], **options)
    else:
        version = json.dumps([recordings.content, code()])
        outcomes = sweeping.judge_points(recordings, points, splits, version=version, **options)
        own = {"base": config.to_dict()}
    bounds = {"accuracy floor": request.accuracy_floor, "latency budget": request.latency_budget}
    given = {name: bound for name, bound in bounds.items() if bound is not None}
    result = sweeping.sweep(points, outcomes, cost_of, given, COSTS if images else sweeping.COSTS)
    result |= {"seeds": seeds, "folds": FOLDS, "judged_split": splits[0], **own}
    result["data"] = str(recordings.source)
    figure = accuracy_chart(result)
    for kind in ("png", "svg"):
        with replacing(out / f"accuracy.{kind}") as temporary:
            save_figure(figure, temporary, kind)
    with replacing(out / TABLE) as temporary, temporary.open("w", newline="") as file:
        rows = sweeping.flat_rows(result)
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    recommended = result["points"][result["recommended"]]["config"]
    point = next(point for point in points if point.to_dict() == recommended)
    write_json(out / CONFIG, point.recommended.to_dict())
    write_json(out / RESULT, result)
    return result
