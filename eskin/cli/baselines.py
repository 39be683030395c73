"""`eskin baselines`: other methods on the same recordings, and what they cost."""

from pathlib import Path
from typing import Annotated

from eskin.cli.common import (
    ConfigOption,
    DaskOption,
    DataOption,
    FoldsOption,
    JobsOption,
    SplitOption,
    app,
    fitting_config,
    groups_of,
    load_data,
    option,
    progress_bars,
    say,
    show,
)


@app.command(epilog="Example: eskin baselines --data recordings.npz --group person")
def baselines(
    data: DataOption,
    group: SplitOption = None,
    out: Annotated[Path, option("Folder of baselines.json.")] = Path("build/baselines"),
    config: ConfigOption = None,
    folds: FoldsOption = 5,
    seeds: Annotated[int, option("Runs of each fold.", min=1, max=100)] = 3,
    jobs: JobsOption = None,
    dask: DaskOption = None,
) -> None:
    """Judge scikit-learn's classifiers and a GRU in float on the same unseen recordings: accuracy against
    cost."""
    from eskin.verbs import baselines_job

    recordings, user_config = load_data(data, config)
    groups = groups_of(group)
    front_end = fitting_config(recordings, user_config, groups, folds)
    with progress_bars() as report:
        result = baselines_job.run(
            recordings,
            front_end.config,
            group=groups,
            folds=folds,
            seeds=seeds,
            out=out,
            workers=jobs,
            dask=dask,
            progress=report,
        )
    show("baselines", **result)
    say(f"files: {out}")
