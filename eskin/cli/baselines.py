"""`eskin baselines`: other methods on the same recordings, and what they cost."""

from eskin.cli.common import app, fitting_config, load_data, progress_bars, say, show
from eskin.requests import BaselinesRequest


@app.command(epilog="Example: eskin baselines --data recordings.npz --group person")
def baselines(request: BaselinesRequest) -> None:
    """Compare scikit-learn's classifiers and a float GRU on the same folds: accuracy and cost."""
    from eskin.verbs import baselines_job

    recordings, _ = load_data(request.data)
    front_end = fitting_config(recordings, None, request.groups)
    with progress_bars() as report:
        result = baselines_job.run(request, recordings, front_end.config, progress=report)
    show("baselines", **result)
    say(f"files: {request.out}")
