"""Verbs that study a model or many of them."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from eskin.cli.common import (
    ConfigOption,
    DaskOption,
    DataOption,
    FoldsOption,
    JobsOption,
    JsonOption,
    ModelArgument,
    SeedOption,
    SplitOption,
    app,
    fitting_config,
    group_names,
    groups_of,
    load_data,
    option,
    progress_bars,
    recordings_for,
    show,
)
from eskin.golden.core import InputError, Record


@app.command(
    epilog="Example: eskin sweep --data recordings.npz --accuracy-floor 0.95 --latency-budget 100e-6"
)
def sweep(
    data: DataOption,
    out: Annotated[Path, option("Folder of sweep.json, sweep.csv and the charts.")] = Path("build/sweep"),
    config: ConfigOption = None,
    grid: Annotated[
        str,
        option(
            "A JSON file: {field: list of values} or a list of such; or default (84 points) or bits (8, 6, "
            "4 bits)."
        ),
    ] = "default",
    accuracy_floor: Annotated[
        float | None, option("Share of unseen recordings to be decided rightly, 0 to 1.")
    ] = None,
    latency_budget: Annotated[
        float | None, option("Seconds from a window's features to its decision.")
    ] = None,
    energy_budget: Annotated[
        float | None,
        option(
            "Joule of a touch, waiting for its frames included (estimate: iCE40UP5K, clock stops when idle)."
        ),
    ] = None,
    group: SplitOption = None,
    folds: FoldsOption = 5,
    parts: Annotated[
        int | None, option("Of images: judge the first N folds alone; default: all.", min=1, metavar="N")
    ] = None,
    seed: SeedOption = 0,
    seeds: Annotated[
        int | None, option("Seeds that every point is trained with; default: 3, of images 1.", min=1, max=100)
    ] = None,
    jobs: JobsOption = None,
    dask: DaskOption = None,
    baselines: Annotated[bool, option("Logistic regression, SVM and CNN on the same splits.")] = True,
    all_points: Annotated[
        bool, option("List every point, and its accuracy for each group left out.", "--all-points")
    ] = False,
) -> None:
    """Train and quantise a grid of networks, chart accuracy against cost, and name the smallest that is
    enough."""
    bounds = (
        ("--accuracy-floor", accuracy_floor),
        ("--latency-budget", latency_budget),
        ("--energy-budget", energy_budget),
    )
    for (name, value), most in zip(bounds, (1.0, math.inf, math.inf), strict=True):
        if value is not None and not (0 < value <= most and math.isfinite(value)):
            raise InputError(
                f"{name} {value}: is out of range; give a number above 0"
                + (f" and at most {most:g}" if most == 1.0 else "")
            )
    from eskin.study.sweep import Bounds, split_name, spread_of
    from eskin.verbs import sweep_job

    recordings, user_config = load_data(data, config)
    groups = groups_of(group)
    if recordings.image_shape and config is not None:
        raise InputError(
            "--config: a sweep over images takes its networks from --grid; put sizes, layers, bits and "
            "lanes there"
        )
    if parts is not None and not recordings.image_shape:
        raise InputError(f"--parts {parts}: is for images, and {data} holds recordings; leave it out")
    request = sweep_job.request_of(
        recordings,
        None if recordings.image_shape else fitting_config(recordings, user_config, groups).config,
        grid=grid,
        group=groups,
        folds=folds,
        parts=parts,
        seed=seed,
        seeds=seeds,
        bounds=Bounds(
            accuracy_floor=accuracy_floor, latency_budget=latency_budget, energy_budget=energy_budget
        ),
        baselines=baselines,
    )
    with progress_bars() as report:
        result = sweep_job.run(recordings, request, out=out, workers=jobs, dask=dask, progress=report)
    point = result["points"][result["recommended"]]
    size, source, first = point["config"].get("size"), data, ""
    if size and size != "{}x{}".format(*(recordings.image_shape or ())):
        source, first = "SMALL.npz", f"eskin convert {data} --size {size} --out SMALL.npz, then "
    options = "".join(f" --{name.replace('_', '-')} {bits}" for name, bits in point["widths"].items())
    where = (
        f" --quantisation-aware{options}"
        if point["config"]["quantisation_aware"]
        else f", then eskin quantise MODEL{options}"
    )
    command = f"{first}eskin train --data {source} --config {out / sweep_job.CONFIG} --out MODEL{where}"
    things = "images" if recordings.image_shape else "recordings"
    names = [
        f"unseen {split_name(split['groups']) if split['groups'] else things} (%)"
        for split in point["splits"]
    ]
    shown = {"all_points": all_points, "names": names, "command": command, "out": out}

    def spread(accuracy: float, by_seed: Sequence[float]) -> Record:
        return spread_of(by_seed, 1) | {"accuracy": accuracy}

    show("sweep", **result, **shown, spread=spread)


@app.command(epilog="Example: eskin stability model --data recordings.npz --out build/stability")
def stability(
    model: ModelArgument,
    data: DataOption,
    out: Annotated[Path, option("Folder of stability.html, stability.json, recommended.json.")] = Path(
        "build/stability"
    ),
    mode: Annotated[list[str] | None, option("Only this mode; may be given again.")] = None,
    cosim: Annotated[bool, option("Confirm the weakest cases in co-simulation.")] = True,
    defences: Annotated[bool, option("Train with and without defences, cross-validated.")] = True,
    few: Annotated[int, option("Recordings of each point of a curve; the figures take all.", min=1)] = 100,
    seeds: Annotated[int, option("Seeds of the comparison of defences.", min=1, max=100)] = 3,
    jobs: JobsOption = None,
    dask: DaskOption = None,
) -> Record:
    """Show where the method fails: every failure mode with a figure, a bound and a curve, and what defences
    save and cost."""
    from eskin.golden.model import load_config
    from eskin.pages.stability_page import PAGE, figure_in_words
    from eskin.verbs.stability_job import run as stability_job

    recordings = recordings_for(data, load_config(model))
    with progress_bars() as report:
        result = stability_job(
            model,
            recordings,
            out=out,
            names=mode or None,
            cosim=cosim,
            compare=defences and not mode,
            few=few,
            seeds=seeds,
            workers=jobs,
            dask=dask,
            progress=report,
        )
    show("stability", **result, figure=figure_in_words, page=out / PAGE)
    return result


@app.command("leak-check", epilog="Example: eskin leak-check --data recordings.npz --group person")
def leak_check(
    data: DataOption,
    config: ConfigOption = None,
    group: SplitOption = None,
    folds: FoldsOption = 5,
    seed: SeedOption = 0,
    seeds: Annotated[int, option("Number of seeds.", min=1, max=100)] = 3,
    left_in: Annotated[
        int, option("Frames of the touch that stay in: above 0 it shows what a leak looks like.", min=0)
    ] = 0,
    json: JsonOption = None,
) -> list[Record]:
    """Take the touch out of every unseen recording: networks that still know its class know it from
    elsewhere."""
    from eskin.study.leak_check import leak_check as check
    from eskin.study.sweep import split_name
    from eskin.training.splits import default_splits

    recordings, user_config = load_data(data, config)
    chosen = fitting_config(recordings, user_config, groups_of(group)).config
    splits = default_splits(recordings, chosen) if group is None else [group_names(group)]
    with progress_bars() as report:
        result = check(
            recordings,
            chosen,
            splits,
            range(seed, seed + seeds),
            folds=folds,
            left_in=left_in,
            progress=report,
        )
    show("leak_check", rows=result, split_name=split_name)
    return result
