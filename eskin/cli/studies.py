"""Verbs that study a model or many of them."""

import math

from eskin.cli.common import app, fitting_config, load_data, progress_bars, recordings_for, say, show
from eskin.golden.core import InputError, Record
from eskin.requests import FORMATS, BaselinesRequest, StabilityRequest, SweepRequest


@app.command(
    epilog="Example: eskin sweep --data recordings.npz --accuracy-floor 0.95 --latency-budget 100e-6"
)
def sweep(request: SweepRequest) -> None:
    """Train and quantise a grid of networks, plot accuracy against cost, and name the smallest that meets
    the bounds."""
    bounds = (("--accuracy-floor", request.accuracy_floor), ("--latency-budget", request.latency_budget))
    for (name, value), most in zip(bounds, (1.0, math.inf), strict=True):
        if value is not None and not (0 < value <= most and math.isfinite(value)):
            raise InputError(
                f"{name} {value}: is out of range; give a number above 0"
                + (f" and at most {most:g}" if most == 1.0 else "")
            )
    from eskin.study.sweep import split_name
    from eskin.verbs import sweep_job

    recordings, user_config = load_data(request.data, request.config)
    if recordings.image_shape and request.config is not None:
        raise InputError(
            "--config: a sweep over images takes its networks from --grid; put layers, bits and lanes there"
        )
    config = (
        None if recordings.image_shape else fitting_config(recordings, user_config, request.groups).config
    )
    with progress_bars() as report:
        result = sweep_job.run(request, recordings, config, progress=report)
    point = result["points"][result["recommended"]]
    named = [f"{name}={bits}" for name, bits in point["widths"].items() if name in FORMATS]
    options = "".join(
        f" --{name.replace('_', '-')} {bits}" for name, bits in point["widths"].items() if name not in FORMATS
    ) + (f" --formats {','.join(named)}" if named else "")
    if point["config"]["quantisation_aware"]:
        options += f" --data {request.data} --quantisation-aware"
    train = f"eskin train --data {request.data} --config {request.out / sweep_job.CONFIG} --out MODEL"
    command = f"{train}, then eskin quantise MODEL{options}"
    things = "images" if recordings.image_shape else "recordings"
    names = [
        f"unseen {split_name(split['groups']) if split['groups'] else things} (%)"
        for split in point["splits"]
    ]
    shown = {"names": names, "command": command, "out": request.out}

    show("sweep", **result, **shown)


@app.command(epilog="Example: eskin stability model --data recordings.npz --out build/stability")
def stability(request: StabilityRequest) -> Record:
    """Show where a model fails: every failure mode with a figure, a bound and a curve; benefit and cost of
    defences."""
    from eskin.golden.model import load_config
    from eskin.pages.stability_page import PAGE, figure_in_words
    from eskin.verbs import stability_job

    recordings = recordings_for(request.data, load_config(request.model))
    with progress_bars() as report:
        result = stability_job.run(request, recordings, progress=report)
    show("stability", **result, figure=figure_in_words, page=request.out / PAGE)
    return result


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
