"""`eskin baselines`: other methods on the same recordings, and what they cost."""

from pathlib import Path
from typing import Annotated

from eskin.cli.common import (
    ConfigOption,
    DaskOption,
    DataOption,
    FoldsOption,
    JobsOption,
    SeedOption,
    SplitOption,
    app,
    group_names,
    groups_of,
    load_data,
    option,
    progress_bars,
    say,
    show,
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
    show("baselines", **result)
    say(f"files: {out}")
