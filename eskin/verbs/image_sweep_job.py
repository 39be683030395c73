"""`eskin sweep` on images: golden trains and judges, rtl counts cycles; here the two meet, and the files are written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.core.files import check_target, replacing, write_json
from eskin.golden.core.jobs import Jobs
from eskin.golden.core.memo import Memo
from eskin.golden.data.recordings import Recordings
from eskin.golden.studies import image_sweep
from eskin.golden.studies.energy import estimate, scheduled_activity
from eskin.golden.studies.sweep import Bounds, flat_rows, read_grid
from eskin.golden.training.image_models import KEPT
from eskin.golden.training.splits import split_folds
from eskin.golden.training.train_images import code_version
from eskin.pages.image_sweep_chart import image_chart
from eskin.rtl.program.schedule import decision_cycles, frame_cycles, step_cycles
from eskin.rtl.top.image_accelerator import refuse_hardware
from eskin.rtl.views.complexity import register_bits
from eskin.rtl.views.schedule_view import save_figure, write_csv
from eskin.verbs.sweep_job import CONFIG, PART, RESULT, TABLE

CHART = "accuracy"


@lru_cache(maxsize=16)
def _registers(base: AcceleratorConfig) -> int:
    return register_bits(base)


def cost_of(config: AcceleratorConfig, base: AcceleratorConfig) -> dict[str, float]:
    """Cycles of a point and the energy of an image's computation on `PART`, an estimate. The registers are those of ``base`` on the same
    lanes: sizes and bits of a network change the width of a few counters, and elaborating every point would take minutes."""
    hardware = config.hardware
    registers = _registers(base.replace(clock_hz=hardware.clock_hz).with_lanes(hardware.lanes, hardware.lane_type))
    activity = scheduled_activity(config, step_cycles(config), frame_cycles(config, ends_window=False), registers, hardware.lanes)
    return {
        "cycles_step": step_cycles(config),
        "cycles_decision": decision_cycles(config),
        "energy_j": estimate(config, PART, activity, hardware.clock_hz)["per_touch_j"],
    }


def request_of(
    recordings: Recordings,
    *,
    grid: str | Path = "default",
    group: Sequence[str] | None = None,
    seed: int = 0,
    seeds: int | None = None,
    folds: int = 5,
    parts: int | None = None,
    bounds: Bounds | None = None,
) -> image_sweep.ImageSweepRequest:
    """The request of a command line; ``seeds`` None: 1.

    Raises
    ------
    InputError
        A grid, group or number of parts that cannot be used, or lanes that the hardware does not have.
    """
    split_folds(recordings, list(group or []), folds, None)
    if parts is not None and parts > folds:
        raise InputError(f"--parts {parts}: there are {folds} folds; give at most as many")
    assert recordings.image_shape is not None
    if grid == "bits":
        raise InputError("--grid bits: is for recordings; the default grid for images has weights of 8 and of 4 bits")
    grids = image_sweep.default_grid(*recordings.image_shape) if grid == "default" else read_grid(grid)
    points = image_sweep.make_image_points(recordings, grids, f"grid '{grid}'")
    for point in points:
        refuse_hardware(point.config)
    many = range(seed, seed + (seeds or 1))
    return image_sweep.ImageSweepRequest(
        points=points, group=list(group or []), folds=folds, parts=parts, seeds=many, bounds=bounds or Bounds()
    )


def run(
    recordings: Recordings,
    request: image_sweep.ImageSweepRequest,
    *,
    out: Path,
    dask: str | None = None,
    workers: int | None = None,
    keep: Path = KEPT,
    progress: Callable[[str, int, int], None] | None = None,
) -> dict[str, Any]:
    """Sweep; write sweep.json, sweep.csv, recommended.json (configuration of the recommended point) and the chart into ``out``. Returns
    the result, as in sweep.json.

    Raises
    ------
    InputError
        A folder that cannot be used; before anything is trained.
    """
    for name in (RESULT, TABLE, CONFIG):
        check_target(out / name)
    base = request.points[0].config
    result = image_sweep.sweep_images(
        recordings,
        request,
        cost_of=lambda config: cost_of(config, base),
        jobs=Jobs(workers=workers, dask=dask, progress=progress, version=code_version),
        keep=Memo(keep),
    )
    result |= {"data": str(recordings.source), "classes": len(recordings.class_names), "images": True}
    figure = image_chart(result)
    for kind in ("png", "svg"):
        with replacing(out / f"{CHART}.{kind}") as temporary:
            save_figure(figure, kind)(temporary)
    with replacing(out / TABLE) as temporary:
        write_csv(flat_rows(result), temporary)
    chosen = request.points[result["recommended"]]
    wanted = chosen.trained.replace(clock_hz=chosen.config.hardware.clock_hz)
    write_json(out / CONFIG, wanted.with_lanes(chosen.config.hardware.lanes, "plain").to_dict())
    write_json(out / RESULT, result)
    return result
