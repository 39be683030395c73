"""`eskin baselines`: other methods on the same recordings, and what they cost."""

from eskin.cli.common import app, fitting_config, load_data, progress_bars, say, show
from eskin.requests import BaselinesRequest


@app.command(epilog="Example: eskin baselines --data recordings.npz --group person")
def baselines(asked: BaselinesRequest) -> None:
    """Compare scikit-learn's classifiers and a float GRU on the same folds: accuracy and cost."""
    from eskin.verbs import baselines_job

    recordings, user_config = load_data(asked.data, asked.config)
    front_end = fitting_config(recordings, user_config, asked.groups)
    with progress_bars() as report:
        result = baselines_job.run(asked, recordings, front_end.config, progress=report)
    show("baselines", **result)
    say(f"files: {asked.out}")
