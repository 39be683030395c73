"""The sweep, `eskin sweep`: golden trains and judges, the cost model prices; here the two meet, and the files are
written."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from eskin.golden.core import AcceleratorConfig, Progress, Record, check_target, replacing, write_json
from eskin.golden.data import Recordings
from eskin.jobs import Jobs
from eskin.memo import Memo, code_version
from eskin.pages.sweep_charts import accuracy_chart
from eskin.requests import SweepRequest
from eskin.rtl.program.schedule import decision_cycles, step_cycles
from eskin.rtl.views.schedule_view import save_figure
from eskin.study.sweep import FOLDS, image_points, judge_points, recording_points, split_name, sweep
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
"""Whose energy is estimated: the only part with published measurements."""
RESULT, TABLE, CONFIG = "sweep.json", "sweep.csv", "recommended.json"


def cost_of(config: AcceleratorConfig) -> dict[str, float]:
    """Costs of a point on its own lanes and clock, as ``eskin.study.sweep.sweep`` takes them; of an image the
    computation alone."""
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
    """Sweep; write sweep.json, sweep.csv, recommended.json (configuration of the recommended point) and
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
    for name in (RESULT, TABLE, CONFIG):
        check_target(out / name)
    code, keep = (CODE, Memo(CACHE)) if config else (IMAGE_CODE, Memo(KEPT))
    jobs = Jobs(dask=request.dask, progress=progress, version=code)
    version = json.dumps([recordings.content, code()])
    outcomes = judge_points(recordings, points, splits, jobs, keep, version)
    bounds = request.accuracy_floor, request.latency_budget
    result = sweep(points, outcomes, cost_of, len(recordings), *bounds)
    result["data"] = str(recordings.source)
    figure = accuracy_chart(result)
    for kind in ("png", "svg"):
        with replacing(out / f"accuracy.{kind}") as temporary:
            save_figure(figure, temporary, kind)
    with replacing(out / TABLE) as temporary:
        table(result["points"]).to_csv(temporary, index_label="point")
    name = result["points"][result["recommended"]]["name"]
    point = next(point for point in points if point.name == name)
    write_json(out / CONFIG, point.config.to_dict())
    write_json(out / RESULT, result)
    return result


def table(points: list[Record]) -> pd.DataFrame:
    """Rows of sweep.csv: a point's configuration and figures, then accuracy and its deviation over seeds of every
    split."""
    rows = []
    for point in points:
        row = point["config"] | {
            key: value for key, value in point.items() if key not in ("config", "splits")
        }
        for split in point["splits"]:
            name = split_name(split["groups"])
            row |= {
                f"accuracy {name}": split["integer_accuracy"],
                f"spread {name}": np.std(split["integer_by_seed"]),
            }
        rows.append(row)
    return pd.DataFrame(rows)
