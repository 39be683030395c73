"""The sweep, `eskin sweep`: golden trains and judges, rtl counts cycles; here the two meet, and the files are written."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from eskin.golden.baselines.rows import SWEPT
from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.files import check_target, replacing, write_json
from eskin.golden.core.jobs import Jobs
from eskin.golden.core.memo import Memo, code_version
from eskin.golden.data.recordings import Recordings
from eskin.golden.studies import sweep as sweeping
from eskin.golden.studies.energy import estimate, scheduled_activity
from eskin.golden.training.splits import default_splits, split_folds
from eskin.pages import sweep_charts
from eskin.rtl.program.schedule import frame_cycles, schedule
from eskin.rtl.views.complexity import register_bits
from eskin.rtl.views.schedule_view import save_figure, write_csv

CACHE = Path("build/sweep_points")
"""Finished trainings by content; shared by all sweeps, safe to delete."""

CODE = partial(code_version, "golden")
"""What a training depends on beside its data."""

PART = "iCE40UP5K"
"""Whose energy is estimated: the only part with published measurements. Its clock may stop between samples."""
_registers = lru_cache(maxsize=64)(register_bits)

RESULT, TABLE, CONFIG = "sweep.json", "sweep.csv", "recommended.json"


def cycles_of(config: AcceleratorConfig) -> tuple[int, int]:
    """(cycles of a step, cycles from the features to the decision), read off the program of the hardware."""
    plan = schedule(config)
    return plan.step_cycles, plan.decision_cycles


def energy_of(config: AcceleratorConfig, base: AcceleratorConfig) -> dict[str, float]:
    """energy_j: of a touch from its first frame to its last, waiting included, with an outside clock that runs, at any rate, only while
    there is work; compute_j: of its steps alone. Joule, by ``eskin.golden.studies.energy.estimate`` for ``PART``.

    The registers are those of ``base`` on the same lanes: cell, units and bits change their number by a few, and elaborating every point
    would take minutes.
    """
    registers = _registers(base.with_lanes(config.hardware.lanes, config.hardware.lane_type))
    multipliers = 0 if config.hardware.lane_type == "serial" else config.hardware.lanes
    frame = frame_cycles(config, ends_window=False)  # one frame in a hop takes longer
    activity = scheduled_activity(config, cycles_of(config)[0], frame, registers, multipliers)
    found = estimate(config, PART, activity, config.hardware.clock_hz)
    return {"energy_j": found["choices"][1]["touch_j"], "compute_j": found["per_touch_j"]}


def cost_of(config: AcceleratorConfig, base: AcceleratorConfig) -> dict[str, float]:
    """Cycles and energies of a point, as ``eskin.golden.studies.sweep.sweep`` takes them."""
    step, decision = cycles_of(config)
    return {"cycles_step": step, "cycles_decision": decision, **energy_of(config, base)}


def request_of(
    recordings: Recordings,
    config: AcceleratorConfig,
    *,
    grid: str | Path = "default",
    group: Sequence[str] | None = None,
    seed: int = 0,
    seeds: int = 3,
    folds: int = 5,
    bounds: sweeping.Bounds | None = None,
    baselines: bool = True,
) -> sweeping.SweepRequest:
    """The request of a command line.

    Parameters
    ----------
    config:
        Sensor, windows, clock, and what the grid leaves open.
    grid:
        A name (``eskin.golden.studies.sweep.GRIDS``) or a JSON file (``eskin.golden.studies.sweep.read_grid``).
    group:
        Group names of the one split; None: every split the configuration names, judged by the first.
    seed, seeds, folds:
        First seed, number of seeds, folds of each split.
    baselines:
        Judge the baselines too.

    Raises
    ------
    InputError
        A grid or group that cannot be used.
    """
    splits = [list(group)] if group is not None else default_splits(recordings, config)
    for groups in splits:
        split_folds(recordings, groups, folds, None)
    return sweeping.SweepRequest(
        points=sweeping.make_points(config, sweeping.GRIDS.get(str(grid)) or sweeping.read_grid(grid), f"grid '{grid}'"),
        base=config,
        splits=splits,
        seeds=range(seed, seed + seeds),
        folds=folds,
        baselines=list(SWEPT) if baselines else [],
        bounds=bounds or sweeping.Bounds(),
    )


def run(
    recordings: Recordings,
    request: sweeping.SweepRequest,
    *,
    out: Path,
    dask: str | None = None,
    workers: int | None = None,
    cache: Path = CACHE,
    progress: Callable[[str, int, int], None] | None = None,
) -> dict[str, Any]:
    """Sweep; write sweep.json, sweep.csv, recommended.json (configuration of the recommended point) and charts into ``out``.

    ``dask``, ``workers`` and ``progress`` are those of ``eskin.golden.core.jobs.Jobs``. Returns the result, as in sweep.json.

    Raises
    ------
    InputError
        A folder that cannot be used; before anything is trained.
    """
    for name in (RESULT, TABLE, CONFIG):
        check_target(out / name)
    version = json.dumps([recordings.content, CODE()])
    result = sweeping.sweep(
        recordings,
        request,
        cost_of=lambda config: cost_of(config, request.base),
        jobs=Jobs(workers=workers, dask=dask, progress=progress, version=CODE),
        keep=Memo(cache),
        version=version,
    )
    result["data"] = str(recordings.source)
    for name, figure in sweep_charts.charts(result).items():
        for kind in ("png", "svg"):
            with replacing(out / f"{name}.{kind}") as temporary:
                save_figure(figure, kind)(temporary)
    with replacing(out / TABLE) as temporary:
        write_csv(sweeping.flat_rows(result), temporary)
    recommended = result["points"][result["recommended"]]["config"]
    write_json(out / CONFIG, next(point.config for point in request.points if point.to_dict() == recommended).to_dict())
    write_json(out / RESULT, result)
    return result
