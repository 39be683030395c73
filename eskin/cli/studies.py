"""Verbs that study a model or many of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape

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
    console,
    end,
    fitting_config,
    group_names,
    groups_of,
    load_data,
    messages,
    option,
    print_records,
    print_table,
    progress_bars,
    recordings_for,
    say,
    warn,
)
from eskin.golden.core.errors import InputError
from eskin.golden.core.files import check_target, write_json
from eskin.pages.tables import percent


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
    from eskin.golden.studies.sweep import Bounds
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
    _show_sweep(result, all_points)
    point = result["points"][result["recommended"]]
    size, source, first = point["config"].get("size"), data, ""
    if size and size != "{}x{}".format(*(recordings.image_shape or ())):
        source, first = "SMALL.npz", f"eskin convert {data} --size {size} --out SMALL.npz, then "
    options = "".join(f" --{name.replace('_', '-')} {bits}" for name, bits in point["widths"].items())
    how = (
        f" --quantisation-aware{options}"
        if point["config"]["quantisation_aware"]
        else f", then eskin quantise MODEL{options}"
    )
    command = f"{first}eskin train --data {source} --config {out / sweep_job.CONFIG} --out MODEL{how}"
    say(f"recommended: {result['recommendation']['sentence']}")
    say(f"to have it: {command}")
    console.print(f"files: {escape(str(out))}")


def _mean_and_spread(figures: Mapping[str, Any]) -> str:
    spread = f" ± {100 * figures['spread']:.1f}" if figures["spread"] is not None else ""
    return f"{100 * figures['accuracy']:.1f}{spread}"


_COSTS = {
    "agreement": "{agreement:percent}",
    "cycles a step": "{cycles_step}",
    "latency (us)": "{latency_s:1e6*.4g}",
    "multiplies a decision": "{multiplies_decision}",
    "weight bits": "{weight_memory_bits}",
    "compute (uJ)": "{compute_j:1e6*.3g}",
    "with waiting (uJ)": "{energy_j:1e6*.4g}",
}
_IMAGE_COSTS = {
    "standard error": "{standard_error:100*.1f}",
    "same as float": "{agreement:percent}",
    "multiplies": "{multiplies_decision}",
    "parameters": "{parameters}",
    "cycles": "{cycles_decision}",
    "latency (ms)": "{latency_s:1e3*.2f}",
    "energy (uJ)": "{energy_j:1e6*.1f}",
    "memory (kB)": "{memory_bytes:1e-3*.1f}",
}


def _show_sweep(result: dict[str, Any], all_points: bool) -> None:
    from eskin.golden.studies.sweep import split_name

    points, images = result["points"], "images" in result
    things = "images" if images else "recordings"
    names = [
        f"unseen {split_name(split['groups']) if split['groups'] else things} (%)"
        for split in points[0]["splits"]
    ]
    accuracies = {
        name: lambda record, number=number: _mean_and_spread(record["splits"][number])
        for number, name in enumerate(names)
    }
    shown = (
        points
        if all_points
        else sorted((point for point in points if point["on_front"]), key=lambda point: point["latency_s"])
    )
    judged = (
        f", {result['judged_images']} images left out, {result['parts']} of {result['folds']} folds"
        if images
        else ""
    )
    title = f"{'all' if all_points else 'front of'} {len(points)} points{judged}"
    print_records(title, shown, {"point": "{name}", **accuracies, **(_IMAGE_COSTS if images else _COSTS)})
    if images:
        nothing = {"name": "none", "accuracy": None, "multiplies_decision": None}
        least = [
            row | (nothing if row["point"] is None else points[row["point"]]) for row in result["smallest"]
        ]
        columns = {
            "images": "{floor:percent}",
            "network": "{name}",
            "right": "{accuracy:percent}",
            "multiplies": "{multiplies_decision}",
        }
        print_records("the smallest network that is right on so many", least, columns)
    for number, name in enumerate(names if all_points and not images else ()):
        _show_one_split([{"name": point["name"]} | point["splits"][number] for point in points], name)
    sizes = {"parameters": "{parameters}", "multiplies a decision": "{multiplies_decision}"}
    print_records(
        "without a recurrent cell", result["baselines"], {"baseline": "{label}", **accuracies, **sizes}
    )
    for refused in result["refused"]:
        warn(f"left out: {refused['name']}: {refused['reason']}")


def _show_one_split(splits: list[dict[str, Any]], name: str) -> None:
    """Float, integer and agreement of every point, and the groups left out one by one where they are few."""
    from eskin.golden.studies.sweep import spread_of

    def seeds(accuracy: float, by_seed: Sequence[float]) -> str:
        return _mean_and_spread(spread_of(by_seed, 1) | {"accuracy": accuracy})

    folds = {
        fold["held_out"]: lambda split, number=number: seeds(
            *(split["per_fold"][number][key] for key in ("accuracy", "by_seed"))
        )
        for number, fold in enumerate(splits[0]["per_fold"])
    }
    columns: dict[str, Any] = {
        "point": "{name}",
        "float": lambda split: seeds(split["float_accuracy"], split["float_by_seed"]),
        "integer": _mean_and_spread,
        "agreement": "{agreement:percent}",
    }
    print_records(name, splits, columns | folds)


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
) -> None:
    """Show where the method fails: every failure mode with a figure, a bound and a curve, and what defences
    save and cost."""
    from eskin.golden.model.model import load_config
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
    _show_stability(result)
    console.print(f"page: {escape(str(out / 'stability.html'))}")
    end(result)


def _show_stability(result: dict[str, Any]) -> None:
    from eskin.pages.stability_page import defence_table
    from eskin.pages.stability_page import figure_in_words as words

    columns: dict[str, Any] = {
        "mode": "{name}",
        "group": "{group}",
        "figure": lambda record: words(record["value"], record["unit"]),
        "": "{sense}",
        "bound": lambda record: words(record["bound"], record["unit"]),
        "verdict": "{passed:held|FAILED}",
        "unit": "{unit}",
        "RTL": lambda record: (
            "" if not record["rtl"] else "bit-exact" if record["rtl"]["bit_exact"] else "DIFFERS"
        ),
    }
    modes = result["modes"]
    title = f"{len(modes)} failure modes, {result['recordings']} recordings, undisturbed {percent(result['clean_accuracy'])}"
    print_records(title, modes, columns)
    for entry in result["not_run"]:
        say(f"not run: {entry['name']}: {entry['why']}")
    if result["defences"]:
        headings, rows = defence_table(result["defences"])
        print_table("defences on unseen recordings, and in hardware", *headings, rows=rows)
        for split in result["defences"][-1]["margin"]:
            group = " and ".join(split["groups"]) or "recordings"
            console.print(
                f"margin of at least {split['threshold']}: {percent(split['coverage'])} of unseen {group} "
                "confident, "
                f"{percent(split['accuracy'])} of them right (all: {percent(split['without'])})"
            )
    say(f"weakest: {', '.join(result['weakest'])}")


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
) -> None:
    """Take the touch out of every unseen recording: networks that still know its class know it from
    elsewhere."""
    from eskin.golden.studies.leak_check import leak_check as check
    from eskin.golden.studies.sweep import split_name
    from eskin.golden.training.splits import default_splits

    check_target(json)
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
    if json:
        write_json(json, result)
    columns: dict[str, Any] = {
        "unseen": lambda row: split_name(row["groups"]),
        "recordings": "{recordings}",
        "as recorded": "{accuracy:percent}",
        "without the touch": "{without_touch:percent}",
        "chance": "{chance:percent}",
        "limit": "{limit:percent}",
        "verdict": "{passed:no leak|LEAK}",
    }
    print_records("accuracy with the touch replaced by the recording's own quiet lead-in", result, columns)
    if result[0]["no_lead_in"]:
        messages.print(
            f"left out: {result[0]['no_lead_in']} recordings without an onset or a quiet lead-in before it"
        )
    if not all(row["passed"] for row in result):
        raise typer.Exit(1)
