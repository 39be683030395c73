"""`eskin baselines`: other methods on the same recordings, and what they cost."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from rich.markup import escape

from eskin.cli.common import (
    ConfigOption,
    DaskOption,
    DataOption,
    FoldsOption,
    JobsOption,
    SeedOption,
    SplitOption,
    app,
    console,
    group_names,
    groups_of,
    load_data,
    option,
    print_records,
    progress_bars,
    say,
    warn,
)


@app.command(epilog="Example: eskin baselines --data recordings.npz --methods simple,ours --group person")
def baselines(
    data: DataOption,
    methods: Annotated[
        str | None,
        option(
            "Methods, or ours, thesis, simple, tensor, tiles, transfer; default: each once.", metavar="A,B"
        ),
    ] = None,
    group: SplitOption = None,
    out: Annotated[Path, option("Folder of baselines.json and the chart.")] = Path("build/baselines"),
    config: ConfigOption = None,
    shape: Annotated[str | None, option("Rows and columns of the array, 4x4 say.", metavar="RxC")] = None,
    weights: Annotated[
        Path | None,
        option("Weights of torchvision's mobilenet_v2 for dcnn; without: random layers.", metavar="FILE"),
    ] = None,
    folds: FoldsOption = 5,
    seed: SeedOption = 0,
    seeds: Annotated[int, option("Runs of each fold; the thesis has 10.", min=1, max=100)] = 3,
    full: Annotated[
        bool, option("Every number of windows; every seed for slow methods too.", "--full")
    ] = False,
    jobs: JobsOption = None,
    dask: DaskOption = None,
) -> None:
    """Judge other methods, the thesis's own among them, on the same unseen recordings: accuracy against cost,
    table, chart, JSON."""
    from eskin.verbs import baselines_job

    recordings, user_config = load_data(data, config)
    with progress_bars() as report:
        result = baselines_job.run(
            recordings,
            user_config,
            methods=None if methods is None else group_names(methods),
            group=groups_of(group),
            folds=folds,
            seed=seed,
            seeds=seeds,
            shape=shape,
            weights=weights,
            full=full,
            out=out,
            workers=jobs,
            dask=dask,
            progress=report,
        )
    _show(result)
    console.print(f"files: {escape(str(out))}")


def _show(result: dict[str, Any]) -> None:
    for reason in result["reasons"]:
        warn(f"configuration: {reason}")
    columns: dict[str, Any] = {
        "method": "{label}",
        "accuracy (%)": "{accuracy:100*.1f} ± {spread:100*.1f}",
        "best run": "{best:100*.1f}",
        "multiplies": lambda row: row["multiplies"] or f"0 ({row['comparisons']} comparisons)",
        "parameters": "{parameters}",
        "bytes": "{bytes}",
        "train (s)": "{train_s:.3g}",
        "decision (us)": "{decision_us:.0f}",
        "99 %": "{decision_us_99:.0f}",
        "hardware": "{hardware:yes|}",
    }
    for near in result["nearest"]:
        rows = sorted(
            (row for row in result["rows"] if row["split"] == near["split"]), key=lambda row: -row["accuracy"]
        )
        print_records(f"unseen {near['split']}, {result['recordings']} recordings", rows, columns)
        say(_nearest(near))
    for order in result["orders"]:
        sides = " against ".join(
            f"{order[side]['method']} {100 * order[side]['accuracy']:.1f} ± "
            f"{100 * order[side]['spread']:.1f} %"
            for side in ("above", "below")
        )
        verdict = {True: "holds", False: "does not hold", None: "is not told apart"}[order["holds"]]
        say(f"unseen {order['split']}: {order['order']} {verdict}: {sides}")
    for left in result["left_out"]:
        warn(f"left out: {left['method']}: {left['reason']}")
    for note in result["notes"]:
        say(note)


def _nearest(near: dict[str, Any]) -> str:
    best = f"best of all: {near['best']} with {100 * near['best_accuracy']:.1f} %"
    if near["network"] is None:
        return f"{best}; no method that eskin puts into hardware was asked for"
    network = f"{near['network']} with {100 * near['accuracy']:.1f} % and {near['multiplies']} multiplies"
    if near["within"]:
        return f"{best}; smallest network in hardware within a point of it: {network}"
    return f"{best}; the nearest network in hardware is {network}: {100 * near['gap']:.1f} points below"
