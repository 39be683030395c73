"""Show where a model fails: every failure mode with a figure, a bound and a curve.

Example: eskin stability model --data recordings.npz --out build/stability
"""

from pathlib import Path

from eskin.cli.common import ClusterOptions, ModelDataOptions, option, progress_bars, recordings_for, show
from eskin.golden.core import Result
from eskin.golden.model import load_config


class StabilityRequest(ModelDataOptions, ClusterOptions):
    out: Path = option("Folder for stability.html and stability.json.", Path("build/stability"))
    mode: list[str] | None = option("Only this mode; may be repeated.")
    cosim: bool = option("Confirm the weakest cases in co-simulation.", True)
    no_defences: bool = option("Without effect: defences are not compared any more.", False, "--no-defences")
    few: int = option("Recordings per point of a curve.", 100, min=1)


def command(request: StabilityRequest) -> Result:
    from eskin.pages.stability_page import PAGE, figure_in_words
    from eskin.training.record import is_training_data
    from eskin.verbs import stability_job

    recordings = recordings_for(request.data, load_config(request.model))
    with progress_bars() as report:
        result = stability_job.run(request, recordings, progress=report)
    known = is_training_data(request.model, result.data, result.recordings)
    show("stability", **dict(result), known=known, figure=figure_in_words, page=request.out / PAGE)
    return result
