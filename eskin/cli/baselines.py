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
    load_data,
    messages,
    option,
    print_table,
    progress_bars,
)


@app.command(epilog="Example: eskin baselines --data recordings.npz --methods simple,ours --group person")
def baselines(
    data: DataOption,
    methods: Annotated[
        str | None, option("Methods, or ours, thesis, simple, tensor, tiles, transfer; default: each once.", metavar="A,B")
    ] = None,
    group: SplitOption = None,
    out: Annotated[Path, option("Folder of baselines.json and the chart.")] = Path("build/baselines"),
    config: ConfigOption = None,
    shape: Annotated[str | None, option("Rows and columns of the array, 4x4 say.", metavar="RxC")] = None,
    weights: Annotated[
        Path | None, option("Weights of torchvision's mobilenet_v2 for dcnn; without: random layers.", metavar="FILE")
    ] = None,
    folds: FoldsOption = 5,
    seed: SeedOption = 0,
    seeds: Annotated[int, option("Runs of each fold; the thesis has 10.", min=1, max=100)] = 3,
    full: Annotated[bool, option("Every number of windows; every seed for slow methods too.", "--full")] = False,
    jobs: JobsOption = None,
    dask: DaskOption = None,
) -> None:
    """Judge other methods, the thesis's own among them, on the same unseen recordings: accuracy against cost, table, chart, JSON."""
    from eskin.verbs import baselines_job

    recordings, asked = load_data(data, config)
    with progress_bars() as report:
        result = baselines_job.run(
            recordings,
            asked,
            methods=None if methods is None else group_names(methods),
            group=None if group is None else group_names(group),
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
        messages.print(f"configuration: {escape(reason)}", soft_wrap=True)
    columns = ("method", "accuracy (%)", "best run", "multiplies", "parameters", "bytes", "train (s)", "decision (us)", "99 %", "hardware")
    for near in result["nearest"]:
        rows = [
            (
                row["label"],
                f"{100 * row['accuracy']:.1f} ± {100 * row['spread']:.1f}",
                f"{100 * row['best']:.1f}",
                row["multiplies"] or f"0 ({row['comparisons']} comparisons)",
                row["parameters"],
                row["bytes"],
                f"{row['train_s']:.3g}",
                "-" if row["decision_us"] is None else f"{row['decision_us']:.0f}",
                "-" if row["decision_us_99"] is None else f"{row['decision_us_99']:.0f}",
                "yes" if row["hardware"] else "",
            )
            for row in sorted(result["rows"], key=lambda row: -row["accuracy"])
            if row["split"] == near["split"]
        ]
        print_table(f"unseen {near['split']}, {result['recordings']} recordings", *columns, rows=rows)
        console.print(escape(_nearest(near)), soft_wrap=True)
    for order in result["orders"]:
        sides = " against ".join(
            f"{order[side]['method']} {100 * order[side]['accuracy']:.1f} ± {100 * order[side]['spread']:.1f} %"
            for side in ("above", "below")
        )
        verdict = {True: "holds", False: "does not hold", None: "is not told apart"}[order["holds"]]
        console.print(f"unseen {order['split']}: {order['order']} {verdict}: {sides}", soft_wrap=True)
    for left in result["left_out"]:
        messages.print(f"left out: {escape(left['method'])}: {escape(left['reason'])}", soft_wrap=True)
    for note in result["notes"]:
        console.print(escape(note), soft_wrap=True)


def _nearest(near: dict[str, Any]) -> str:
    best = f"best of all: {near['best']} with {100 * near['best_accuracy']:.1f} %"
    if near["network"] is None:
        return f"{best}; no method that eskin puts into hardware was asked for"
    network = f"{near['network']} with {100 * near['accuracy']:.1f} % and {near['multiplies']} multiplies"
    if near["within"]:
        return f"{best}; smallest network in hardware within a point of it: {network}"
    return f"{best}; the nearest network in hardware is {network}: {100 * near['gap']:.1f} points below"
