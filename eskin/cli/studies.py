"""Verbs that study a model or many of them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from eskin.cli.common import (
    CONFIG,
    DATA,
    SEED_MAX,
    DaskOption,
    JobsOption,
    app,
    console,
    fitting_config,
    group_names,
    load_data,
    messages,
    percent,
    print_table,
    progress_bars,
    recordings_for,
)
from eskin.golden.core.errors import InputError

if TYPE_CHECKING:
    from eskin.golden.data.recordings import Recordings


@app.command(epilog="Example: eskin sweep --data recordings.npz --accuracy-floor 0.95 --latency-budget 100e-6")
def sweep(
    data: Annotated[str, typer.Option(help=DATA)],
    out: Annotated[Path, typer.Option(help="Folder of sweep.json, sweep.csv and the charts.")] = Path("build/sweep"),
    config: Annotated[str | None, typer.Option(help=CONFIG)] = None,
    grid: Annotated[
        str, typer.Option(help="A JSON file: {field: list of values} or a list of such; or default (84 points) or bits (8, 6, 4 bits).")
    ] = "default",
    accuracy_floor: Annotated[float | None, typer.Option(help="Share of unseen recordings to be decided rightly, 0 to 1.")] = None,
    latency_budget: Annotated[float | None, typer.Option(help="Seconds from a window's features to its decision.")] = None,
    energy_budget: Annotated[
        float | None, typer.Option(help="Joule of a touch, waiting for its frames included (estimate: iCE40UP5K, clock stops when idle).")
    ] = None,
    group: Annotated[str | None, typer.Option(help="Group arrays A[,B..] of one split; default: the configuration's splits.")] = None,
    folds: Annotated[int, typer.Option(min=2, help="Folds of each split.")] = 5,
    parts: Annotated[int | None, typer.Option(min=1, metavar="N", help="Of images: judge the first N folds alone; default: all.")] = None,
    seed: Annotated[int, typer.Option(min=0, max=SEED_MAX, help="First seed.")] = 0,
    seeds: Annotated[
        int | None, typer.Option(min=1, max=100, help="Seeds that every point is trained with; default: 3, of images 1.")
    ] = None,
    jobs: JobsOption = None,
    dask: DaskOption = None,
    baselines: Annotated[bool, typer.Option(help="Logistic regression, SVM and CNN on the same splits.")] = True,
    all_points: Annotated[bool, typer.Option("--all-points", help="List every point, and its accuracy for each group left out.")] = False,
) -> None:
    """Train and quantise a grid of networks, chart accuracy against cost, and name the smallest that is enough."""
    given = (("--accuracy-floor", accuracy_floor), ("--latency-budget", latency_budget), ("--energy-budget", energy_budget))
    for (name, value), most in zip(given, (1.0, math.inf, math.inf), strict=True):
        if value is not None and not (0 < value <= most and math.isfinite(value)):
            raise InputError(f"{name} {value}: is out of range; give a number above 0" + (f" and at most {most:g}" if most == 1.0 else ""))
    from eskin.golden.studies.sweep import Bounds
    from eskin.verbs import sweep_job

    recordings, asked = load_data(data, config)
    groups = None if group is None else group_names(group)
    bounds = Bounds(accuracy_floor=accuracy_floor, latency_budget=latency_budget, energy_budget=energy_budget)
    if recordings.image_shape:
        if config is not None:
            raise InputError("--config: a sweep over images takes its networks from --grid; put sizes, layers, bits and lanes there")
        wanted = {"grid": grid, "group": groups, "folds": folds, "parts": parts, "seed": seed, "seeds": seeds, "bounds": bounds}
        _sweep_images(recordings, data, out, wanted, jobs, dask, all_points)
        return
    if parts is not None:
        raise InputError(f"--parts {parts}: is for images, and {data} holds recordings; leave it out")
    chosen = fitting_config(recordings, asked, groups).config
    request = sweep_job.request_of(
        recordings, chosen, grid=grid, group=groups, folds=folds, seed=seed, seeds=seeds or 3, bounds=bounds, baselines=baselines
    )
    with progress_bars() as report:
        result = sweep_job.run(recordings, request, out=out, workers=jobs, dask=dask, progress=report)
    _show_sweep(result, all_points)
    widths = result["points"][result["recommended"]]["widths"].items()
    options = "".join(f" --{name.replace('_', '-')} {bits}" for name, bits in widths)
    console.print(f"recommended: {escape(result['recommendation']['sentence'])}", soft_wrap=True)
    first = f"eskin train --data {data} --config {out / sweep_job.CONFIG} --out MODEL"
    aware = result["points"][result["recommended"]]["config"]["quantisation_aware"]
    commands = f"{first} --quantisation-aware{options}" if aware else f"{first}, then eskin quantise MODEL{options}"
    console.print(f"to have it: {escape(commands)}", soft_wrap=True)
    console.print(f"files: {escape(str(out))}")


def _sweep_images(
    recordings: Recordings, data: str, out: Path, options: dict[str, Any], jobs: int | None, dask: str | None, all_points: bool
) -> None:
    from eskin.verbs import image_sweep_job

    request = image_sweep_job.request_of(recordings, **options)
    with progress_bars() as report:
        result = image_sweep_job.run(recordings, request, out=out, workers=jobs, dask=dask, progress=report)
    points = result["points"]
    shown = points if all_points else sorted((point for point in points if point["on_front"]), key=lambda point: point["latency_s"])
    rows = [
        (
            point["name"],
            _mean_and_spread(point["accuracy"], point["splits"][0]["by_seed"]),
            f"{100 * point['standard_error']:.1f}",
            percent(point["agreement"]),
            point["multiplies_decision"],
            point["parameters"],
            point["cycles_decision"],
            f"{1e3 * point['latency_s']:.2f}",
            f"{1e6 * point['energy_j']:.1f}",
            f"{point['memory_bytes'] / 1e3:.1f}",
        )
        for point in shown
    ]
    judged = f"{result['judged_images']} images left out of {len(recordings)}, {result['parts']} of {result['folds']} folds"
    figures = ("right (%)", "standard error", "same as float", "multiplies", "parameters", "cycles", "latency (ms)")
    title = f"{'all' if all_points else 'front of'} {len(points)} points, {judged}"
    print_table(title, "network", *figures, "energy (uJ)", "memory (kB)", rows=rows)
    least = [
        (percent(one["floor"]), "none" if one["point"] is None else points[one["point"]]["name"], *_smallest(points, one["point"]))
        for one in result["smallest"]
    ]
    print_table("the smallest network that is right on so many", "images", "network", "right", "multiplies", rows=least)
    console.print(f"recommended: {escape(result['recommendation']['sentence'])}", soft_wrap=True)
    chosen, height_width = points[result["recommended"]]["config"], "{}x{}".format(*(recordings.image_shape or ()))
    first, source = "", data
    if chosen["size"] != height_width:
        first, source = f"eskin convert {data} --size {chosen['size']} --out SMALL.npz, then ", "SMALL.npz"
    train = f"eskin train --data {source} --config {out / image_sweep_job.CONFIG} --out MODEL"
    how = " --quantisation-aware --weight-bits 4" if chosen["quantisation_aware"] else ", then eskin quantise MODEL"
    console.print(f"to have it: {escape(first + train + how)}", soft_wrap=True)
    console.print(f"files: {escape(str(out))}")


def _smallest(points: list[dict[str, Any]], number: int | None) -> tuple[str, str]:
    return ("-", "-") if number is None else (percent(points[number]["accuracy"]), str(points[number]["multiplies_decision"]))


def _mean_and_spread(accuracy: float, by_seed: list[float]) -> str:
    import numpy as np

    return f"{100 * accuracy:.1f}" + (f" ± {100 * np.std(by_seed, ddof=1):.1f}" if len(by_seed) > 1 else "")


def _show_sweep(result: dict[str, Any], all_points: bool) -> None:
    from eskin.golden.studies.sweep import split_name

    def accuracies(record: dict[str, Any]) -> tuple[str, ...]:
        return tuple(_mean_and_spread(split["accuracy"], split["by_seed"]) for split in record["splits"])

    splits = result["points"][0]["splits"]
    names = [f"unseen {split_name(split['groups'])} (%)" for split in splits]
    shown = result["points"] if all_points else sorted((p for p in result["points"] if p["on_front"]), key=lambda p: p["latency_s"])
    rows = [
        (
            point["name"],
            *accuracies(point),
            percent(point["agreement"]),
            point["cycles_step"],
            f"{1e6 * point['latency_s']:.4g}",
            point["multiplies_decision"],
            point["weight_memory_bits"],
            f"{1e6 * point['compute_j']:.3g}",
            f"{1e6 * point['energy_j']:.4g}",
        )
        for point in shown
    ]
    costs = ("agreement", "cycles a step", "latency (us)", "multiplies a decision", "weight bits", "compute (uJ)", "with waiting (uJ)")
    print_table(f"{'all' if all_points else 'front of'} {len(result['points'])} points", "point", *names, *costs, rows=rows)
    if all_points:
        for number, name in enumerate(names):
            _show_one_split(result["points"], number, name)
    rows = [(b["label"], *accuracies(b), b["parameters"], b["multiplies_decision"]) for b in result["baselines"]]
    if rows:
        print_table("without a recurrent cell", "baseline", *names, "parameters", "multiplies a decision", rows=rows)
    for refused in result["refused"]:
        messages.print(f"left out: {escape(refused['name'])}: {escape(refused['reason'])}", soft_wrap=True)


def _show_one_split(points: list[dict[str, Any]], number: int, name: str) -> None:
    """Float, integer and agreement of every point, and the groups left out one by one where they are few."""
    left_out = [fold["held_out"] for fold in points[0]["splits"][number]["per_fold"]]
    rows = []
    for point in points:
        split = point["splits"][number]
        folds = (_mean_and_spread(fold["accuracy"], fold["by_seed"]) for fold in split["per_fold"])
        rows.append(
            (
                point["name"],
                _mean_and_spread(split["float_accuracy"], split["float_by_seed"]),
                _mean_and_spread(split["accuracy"], split["by_seed"]),
                percent(split["agreement"]),
                *folds,
            )
        )
    print_table(name, "point", "float", "integer", "agreement", *left_out, rows=rows)


@app.command(epilog="Example: eskin stability model --data recordings.npz --out build/stability")
def stability(
    model: Annotated[Path, typer.Argument(help="A quantised model folder.")],
    data: Annotated[str, typer.Option(help=DATA)],
    out: Annotated[Path, typer.Option(help="Folder of stability.html, stability.json, recommended.json.")] = Path("build/stability"),
    mode: Annotated[list[str] | None, typer.Option(help="Only this mode; may be given again.")] = None,
    cosim: Annotated[bool, typer.Option(help="Confirm the weakest cases in co-simulation.")] = True,
    defences: Annotated[bool, typer.Option(help="Train with and without defences, cross-validated.")] = True,
    few: Annotated[int, typer.Option(min=1, help="Recordings of each point of a curve; the figures take all.")] = 100,
    seeds: Annotated[int, typer.Option(min=1, max=100, help="Seeds of the comparison of defences.")] = 3,
    jobs: JobsOption = None,
    dask: DaskOption = None,
) -> None:
    """Show where the method fails: every failure mode with a figure, a bound and a curve, and what defences save and cost."""
    from eskin.golden.model.model import load_config
    from eskin.verbs.stability_job import run as stability_job

    config = load_config(model)
    recordings = recordings_for(data, config)
    if config.is_image:
        from eskin.verbs.image_stability_job import run as image_job

        with progress_bars() as report:
            result = image_job(model, recordings, out=out, names=mode, cosim=cosim, few=few, workers=jobs, dask=dask, progress=report)
        _show_stability(result)
        console.print(f"page: {escape(str(out / 'stability.html'))}")
        if not result["passed"]:
            raise typer.Exit(1)
        return
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
    if not result["passed"]:
        raise typer.Exit(1)


def _show_stability(result: dict[str, Any]) -> None:
    from eskin.pages.stability_page import COSTS, costs_in_words
    from eskin.pages.stability_page import figure_in_words as words

    rows = [
        (
            record["name"],
            record["group"],
            words(record["value"], record["unit"]),
            record["sense"],
            words(record["bound"], record["unit"]),
            "held" if record["passed"] else "FAILED",
            record["unit"],
            "" if not record["rtl"] else "bit-exact" if record["rtl"]["bit_exact"] else "DIFFERS",
        )
        for record in result["modes"]
    ]
    columns = ("mode", "group", "figure", "", "bound", "verdict", "unit", "RTL")
    title = f"{len(rows)} failure modes, {result['recordings']} recordings, undisturbed {percent(result['clean_accuracy'])}"
    print_table(title, *columns, rows=rows)
    for entry in result["not_run"]:
        console.print(f"not run: {escape(entry['name'])}: {escape(entry['why'])}", soft_wrap=True)
    if result["defences"]:
        names = [" and ".join(split["groups"]) or "recordings" for split in result["defences"][0]["clean"]]
        rows = [
            (
                record["name"],
                *(percent(split["accuracy"]) for split in record["clean"]),
                *(f"{percent(record[kind]['mean'])} / {percent(record[kind]['worst'])}" for kind in ("dead", "stuck", "stuck, masked")),
                *costs_in_words(record["hardware"]),
            )
            for record in result["defences"]
        ]
        faults = ("one dead: mean / worst", "one sticks", "the same, masked")
        headings = (*(f"clean, unseen {name}" for name in names), *faults, *COSTS.values())
        print_table("defences on unseen recordings, and in hardware", "defences", *headings, rows=rows)
        for split in result["defences"][-1]["margin"]:
            group = " and ".join(split["groups"]) or "recordings"
            console.print(
                f"margin of at least {split['threshold']}: {percent(split['coverage'])} of unseen {group} confident, "
                f"{percent(split['accuracy'])} of them right (all: {percent(split['without'])})"
            )
    console.print(f"weakest: {', '.join(result['weakest'])}", soft_wrap=True)


@app.command("leak-check", epilog="Example: eskin leak-check --data recordings.npz --group person")
def leak_check(
    data: Annotated[str, typer.Option(help=DATA)],
    config: Annotated[str | None, typer.Option(help=CONFIG)] = None,
    group: Annotated[str | None, typer.Option(help="Group arrays A[,B..] of one split; default: the configuration's splits.")] = None,
    folds: Annotated[int, typer.Option(min=2, help="Folds of each split.")] = 5,
    seed: Annotated[int, typer.Option(min=0, max=SEED_MAX, help="First seed.")] = 0,
    seeds: Annotated[int, typer.Option(min=1, max=100, help="Number of seeds.")] = 3,
    left_in: Annotated[int, typer.Option(min=0, help="Frames of the touch that stay in: above 0 it shows what a leak looks like.")] = 0,
    json: Annotated[Path | None, typer.Option(help="Also write the figures as JSON.")] = None,
) -> None:
    """Take the touch out of every unseen recording: networks that still know its class know it from elsewhere."""
    from eskin.golden.core.files import check_target, write_json
    from eskin.golden.studies.leak_check import leak_check as check
    from eskin.golden.studies.sweep import split_name
    from eskin.golden.training.splits import default_splits

    check_target(json)
    recordings, asked = load_data(data, config)
    chosen = fitting_config(recordings, asked, None if group is None else group_names(group)).config
    splits = default_splits(recordings, chosen) if group is None else [group_names(group)]
    with progress_bars() as report:
        result = check(recordings, chosen, splits, range(seed, seed + seeds), folds=folds, left_in=left_in, progress=report)
    if json:
        write_json(json, result)
    rows = [
        (
            split_name(row["groups"]),
            row["recordings"],
            percent(row["accuracy"]),
            percent(row["without_touch"]),
            percent(row["chance"]),
            percent(row["limit"]),
            "no leak" if row["passed"] else "LEAK",
        )
        for row in result
    ]
    columns = ("unseen", "recordings", "as recorded", "without the touch", "chance", "limit", "verdict")
    print_table("accuracy with the touch replaced by the recording's own quiet lead-in", *columns, rows=rows)
    if result[0]["no_lead_in"]:
        messages.print(f"left out: {result[0]['no_lead_in']} recordings without an onset or a quiet lead-in before it")
    if not all(row["passed"] for row in result):
        raise typer.Exit(1)
