"""The main job and its page."""

from eskin.cli.common import app, messages, say, show_text
from eskin.golden.core import Record
from eskin.requests import ReportRequest, RunRequest


@app.command(epilog="Example: eskin run --data recordings.npz --recordings 40 --out result")
def run(request: RunRequest) -> Record:
    """Do the whole job once, in one folder: choose, train, quantise, evaluate, generate, co-simulate,
    report."""
    from eskin.pages.report import PAGE, summary
    from eskin.verbs.main_job import run as main_job

    record = main_job(request, messages)
    show_text(summary(request.out))
    say(f"report: {request.out / PAGE}")
    return record


@app.command(epilog="Example: eskin report build/run")
def report(request: ReportRequest) -> None:
    """Make the HTML page of a result folder again and print its summary."""
    from eskin.pages.report import summary, write_report

    page = write_report(request.folder)
    show_text(summary(request.folder))
    say(f"report: {page}")
