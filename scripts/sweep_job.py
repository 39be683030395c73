"""The sweep, `eskin sweep`: golden trains and judges, rtl counts cycles; here the two meet, and the files are written."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from golden import sweep as sweeping
from golden import sweep_charts
from golden.baselines import BASELINES
from golden.config import AcceleratorConfig
from golden.energy import estimate, scheduled_activity
from golden.files import check_target, replacing, write_json
from golden.recordings import Recordings
from golden.sparsity import SHARES
from golden.train import default_splits, split_folds
from rtl.complexity import register_bits
from rtl.schedule import frame_cycles, lowest_clock_hz, schedule
from rtl.schedule_view import save_figure, write_csv
from scripts.main_job import code_version, fingerprint

CACHE = Path("build/sweep_points")
"""Finished trainings by content; shared by all sweeps, safe to delete."""

PART = "iCE40UP5K"
"""Whose energy is estimated: the only part with published measurements. Its clock may stop between samples."""
_registers = lru_cache(maxsize=64)(register_bits)

RESULT, TABLE, SKIPPING, CONFIG = "sweep.json", "sweep.csv", "skipping.csv", "recommended.json"


def cycles_of(config: AcceleratorConfig) -> tuple[int, int]:
    """(cycles of a step, cycles from the features to the decision), read off the program of the hardware."""
    plan = schedule(config)
    return plan.step_cycles, plan.decision_cycles


def touch_estimate(config: AcceleratorConfig, base: AcceleratorConfig, clock_hz: float, skipped: float = 0.0) -> dict[str, Any]:
    """``golden.energy.estimate`` of a configuration on ``PART``, from the cycles of its schedule, that skips this share of its multiplies.

    The registers are those of ``base`` on the same lanes: cell, units and bits change their number by a few, and elaborating every point
    would take minutes.
    """
    registers = _registers(base.with_lanes(config.lanes, config.lane_type))
    multipliers = 0 if config.lane_type == "serial" else config.lanes
    frame = frame_cycles(config, ends_window=False)  # one frame in a hop takes longer
    activity = scheduled_activity(config, cycles_of(config)[0], frame, registers, multipliers, skipped=skipped)
    return estimate(config, PART, activity, clock_hz)


def energy_of(config: AcceleratorConfig, base: AcceleratorConfig) -> dict[str, float]:
    """energy_j: of a touch from its first frame to its last, waiting included, with an outside clock that runs, at any rate, only while
    there is work; compute_j: of its steps alone. Joule."""
    found = touch_estimate(config, base, config.clock_hz)
    return {"energy_j": found["choices"][1]["touch_j"], "compute_j": found["per_touch_j"]}


def energies(config: AcceleratorConfig, skipped: float) -> dict[str, float]:
    """Estimated energy of a touch, J, waiting included, that skips this share of its multiplies (``touch_estimate``): with the declared
    clock and with the lowest that keeps up, neither of which ever stops; with one that runs only when there is work; of it, what is
    spent at rest and on multiplies.

    A step that may skip takes an unknown time, and the worst case is that of the dense model: a clock that never stops has to be as fast
    as before and runs as long, so only multiplies and toggles go. A clock that stops saves the cycles too.
    """
    declared, lowest = (touch_estimate(config, config, clock, skipped) for clock in (config.clock_hz, lowest_clock_hz(config)))
    return {"declared_clock_j": declared["choices"][0]["touch_j"], "lowest_clock_j": lowest["choices"][0]["touch_j"],
            "stopped_clock_j": declared["choices"][1]["touch_j"], "static_j": declared["static_w"] * declared["touch_s"],
            "multiplies_j": declared["per_touch_parts_j"]["multiplies"]}  # fmt: skip


def run(
    recordings: Recordings,
    config: AcceleratorConfig,
    *,
    out: Path,
    grid: str | Path = "default",
    group: Sequence[str] | None = None,
    seed: int = 0,
    seeds: int = 3,
    folds: int = 5,
    accuracy_floor: float | None = None,
    latency_budget: float | None = None,
    energy_budget: float | None = None,
    baselines: bool = True,
    skipping: bool = True,
    workers: int | None = None,
    cache: Path = CACHE,
    progress: Callable[[str, int, int], None] | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Sweep; write sweep.json, sweep.csv, skipping.csv, recommended.json (configuration of the recommended point) and charts into ``out``.

    Parameters
    ----------
    config:
        Sensor, windows, clock, and what the grid leaves open.
    grid:
        A name (``golden.sweep.GRIDS``) or a JSON file (``golden.sweep.read_grid``).
    group:
        Group names of the one split; None: every split the configuration names, judged by the first.
    seed, seeds, folds:
        First seed, number of seeds, folds of each split.
    baselines, skipping:
        Judge the baselines too; judge the configuration's network as it skips work too (else there is no skipping.csv).
    workers:
        Processes; None: one a core.
    options:
        As for ``golden.sweep.sweep``.

    Returns
    -------
    The result, as in sweep.json.

    Raises
    ------
    InputError
        A grid, group or folder that cannot be used; before anything is trained.
    """
    splits = [list(group)] if group is not None else default_splits(recordings, config)
    for groups in splits:
        split_folds(recordings, groups, folds, None)
    points = sweeping.make_points(config, sweeping.GRIDS.get(str(grid)) or sweeping.read_grid(grid), f"grid '{grid}'")
    for name in (RESULT, TABLE, SKIPPING, CONFIG):
        check_target(out / name)
    version = json.dumps([fingerprint(recordings), code_version("golden")])
    result = sweeping.sweep(
        recordings, points, base=config, splits=splits, seeds=range(seed, seed + seeds), folds=folds, cycles_of=cycles_of,
        energy_of=lambda point: energy_of(point, config), cache=cache, version=version, workers=workers or os.cpu_count() or 1,
        baselines=list(BASELINES) if baselines else [], pruned=SHARES if skipping else (),
        accuracy_floor=accuracy_floor, latency_budget=latency_budget, energy_budget=energy_budget, progress=progress, **options,
    )  # fmt: skip
    result["data"] = str(recordings.source)
    result["skipping"] = [row | energies(config, row["skipped"]) for row in result["skipping"]]
    for name, figure in sweep_charts.charts(result).items():
        for kind in ("png", "svg"):
            with replacing(out / f"{name}.{kind}") as temporary:
                save_figure(figure, kind)(temporary)
    with replacing(out / TABLE) as temporary:
        write_csv(sweeping.flat_rows(result), temporary)
    if skipping:
        with replacing(out / SKIPPING) as temporary:
            write_csv(sweeping.skipping_rows(result), temporary)
    else:  # those of an earlier sweep would not belong to this one
        for name in (SKIPPING, "skipping.png", "skipping.svg"):
            (out / name).unlink(missing_ok=True)
    recommended = result["points"][result["recommended"]]["config"]
    write_json(out / CONFIG, next(point.config for point in points if point.to_dict() == recommended).to_dict())
    write_json(out / RESULT, result)
    return result
