"""Verbs that study a model or many of them."""

from eskin.cli.common import app, messages, progress_bars, recordings_for, say, show, show_text
from eskin.golden.core import Record, Result
from eskin.golden.model import load_config, load_training
from eskin.requests import ReportRequest, RunRequest, StabilityRequest


@app.command(epilog="Example: eskin stability model --data recordings.npz --out build/stability")
def stability(request: StabilityRequest) -> Result:
    """Show where a model fails: every failure mode with a figure, a bound and a curve."""
    from eskin.pages.stability_page import PAGE, figure_in_words
    from eskin.verbs import stability_job

    recordings = recordings_for(request.data, load_config(request.model))
    with progress_bars() as report:
        result = stability_job.run(request, recordings, progress=report)
    training = load_training(request.model)
    known = (training.get("data"), training.get("recordings")) == (result.data, result.recordings)
    show("stability", **dict(result), known=known, figure=figure_in_words, page=request.out / PAGE)
    return result


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
