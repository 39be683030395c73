"""The main job and its page."""

import sys

from eskin.cli.common import app, how_many, messages, say, show_text
from eskin.golden.core import Record
from eskin.requests import ReportRequest, RunRequest


@app.command(epilog="Example: eskin run --data recordings.npz --recordings 40 --out result")
def run(asked: RunRequest) -> Record:
    """Do the main job: choose what was not asked for, train, quantise, evaluate, generate, co-simulate, and
    report, all in one folder."""
    count = None if asked.recordings is None else how_many(asked.recordings) or sys.maxsize
    from eskin.pages.report import PAGE, summary
    from eskin.verbs.main_job import run as main_job

    record = main_job(
        asked.data,
        asked.config,
        count,
        asked.out,
        group=asked.groups,
        cell=asked.cell,
        hidden=asked.hidden,
        seeds=asked.seeds,
        prefer=asked.prefer,
        fits=asked.fits,
        stress=asked.stress,
        test=asked.test,
        name=asked.name,
        console=messages,
    )
    show_text(summary(asked.out))
    say(f"report: {asked.out / PAGE}")
    return record


@app.command(epilog="Example: eskin report build/run")
def report(asked: ReportRequest) -> None:
    """Make the HTML page of a result folder again and print its summary."""
    from eskin.pages.report import summary, write_report

    page = write_report(asked.folder)
    show_text(summary(asked.folder))
    say(f"report: {page}")
