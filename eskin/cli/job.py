"""The main job and its page."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from eskin.cli.common import CELL_CHOICE, CONFIG, DATA, SEED_MAX, CellChoice, app, console, group_names, how_many, messages


@app.command(epilog="Example: eskin run --data recordings.npz --recordings 40 --out result")
def run(
    data: Annotated[str, typer.Option(help=DATA)] = "synthetic",
    config: Annotated[str | None, typer.Option(help=CONFIG)] = None,
    recordings: Annotated[str | None, typer.Option(metavar="N|all", help="Co-simulated ones; default: 8 a class, or all of few.")] = None,
    out: Annotated[Path, typer.Option(help="The result folder: new, or an earlier result, which is replaced.")] = Path("build/run"),
    seed: Annotated[int, typer.Option(min=0, max=SEED_MAX, help="First seed of the training.")] = 0,
    group: Annotated[str | None, typer.Option(help="Group arrays A[,B..] that stay on one side of a split.")] = None,
    cell: Annotated[CellChoice | None, typer.Option(help=CELL_CHOICE)] = None,
    hidden: Annotated[int | None, typer.Option(help="Hidden units.")] = None,
    seeds: Annotated[int | None, typer.Option(min=1, max=100, help="Seeds of the cross-validation; default: 3, of images 1.")] = None,
    test: Annotated[str | None, typer.Option(metavar="HELD", help="Recordings held back: judged once, shown apart.")] = None,
) -> None:
    """Do the main job: choose what was not asked for, train, quantise, evaluate, generate, co-simulate, and report, all in one folder."""
    count = None if recordings is None else how_many(recordings) or sys.maxsize
    from eskin.pages.report import PAGE, summary
    from eskin.verbs.main_job import run as main_job

    record = main_job(
        data,
        config,
        count,
        out,
        seed=seed,
        group=None if group is None else group_names(group),
        cell=cell and str(cell),
        hidden=hidden,
        seeds=seeds,
        test=test,
        console=messages,
    )
    console.print(summary(out))
    console.print(f"report: {escape(str(out / PAGE))}")
    if not record["passed"]:
        raise typer.Exit(1)


@app.command(epilog="Example: eskin report build/run")
def report(folder: Annotated[Path, typer.Argument(metavar="DIR", help="A folder that eskin run wrote.")]) -> None:
    """Make the HTML page of a result folder again and print its summary."""
    from eskin.pages.report import summary, write_report

    page = write_report(folder)
    console.print(summary(folder))
    console.print(f"report: {escape(str(page))}")
