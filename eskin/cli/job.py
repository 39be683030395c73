"""The main job and its page."""

import sys
from pathlib import Path
from typing import Annotated

from eskin.cli.common import (
    SEED_MAX,
    CellOption,
    ConfigOption,
    DataOption,
    FitsOption,
    GroupOption,
    HiddenOption,
    PreferOption,
    TrainingSeeds,
    app,
    argument,
    groups_of,
    how_many,
    messages,
    option,
    say,
    show_text,
)
from eskin.golden.core import Record


@app.command(epilog="Example: eskin run --data recordings.npz --recordings 40 --out result")
def run(
    data: DataOption = "synthetic",
    config: ConfigOption = None,
    recordings: Annotated[
        str | None, option("Co-simulated ones; default: 8 a class, or all of few.", metavar="N|all")
    ] = None,
    out: Annotated[Path, option("The result folder: new, or an earlier result, which is replaced.")] = Path(
        "build/run"
    ),
    seed: Annotated[int, option("First seed of the training.", min=0, max=SEED_MAX)] = 0,
    group: GroupOption = None,
    cell: CellOption = None,
    hidden: HiddenOption = None,
    seeds: TrainingSeeds = None,
    prefer: PreferOption = "energy",
    fits: FitsOption = None,
    test: Annotated[
        str | None, option("Recordings held back: judged once, shown apart.", metavar="HELD")
    ] = None,
    name: Annotated[str | None, option("Title of the report; default: the data's name.")] = None,
) -> Record:
    """Do the main job: choose what was not asked for, train, quantise, evaluate, generate, co-simulate, and
    report, all in one folder."""
    count = None if recordings is None else how_many(recordings) or sys.maxsize
    from eskin.pages.report import PAGE, summary
    from eskin.verbs.main_job import run as main_job

    record = main_job(
        data,
        config,
        count,
        out,
        seed=seed,
        group=groups_of(group),
        cell=cell,
        hidden=hidden,
        seeds=seeds,
        prefer=prefer,
        fits=fits,
        test=test,
        name=name,
        console=messages,
    )
    show_text(summary(out))
    say(f"report: {out / PAGE}")
    return record


@app.command(epilog="Example: eskin report build/run")
def report(folder: Annotated[Path, argument("A folder that eskin run wrote.", metavar="DIR")]) -> None:
    """Make the HTML page of a result folder again and print its summary."""
    from eskin.pages.report import summary, write_report

    page = write_report(folder)
    show_text(summary(folder))
    say(f"report: {page}")
