"""Choose front end and network, cross-validate, then train a model on all recordings.

Example: eskin train --data recordings.npz --out model --group person,trial
"""

import time
from pathlib import Path
from typing import Literal

from eskin.choose.choice_table import front_end_table, network_name, windows_brief
from eskin.cli.common import ChoiceOptions, load_data, option, progress_bars, remaining, required, show, warn
from eskin.golden.core.groups import Reset
from eskin.golden.model import check_model_target
from eskin.memo import Memo
from eskin.training.splits import check_split
from eskin.verbs.cost import cost_model


class TrainRequest(ChoiceOptions):
    out: Path = required("Model folder: new, or an earlier model to replace.")
    reset: Reset | None = option("GRU: reset gate before or after the recurrent product.")
    folds: int = option("Folds of the cross-validation; 0: none.", 5)
    seed: int = option("First seed; the written model uses it.", 0, min=0, max=2**31 - 1)
    protocol: Literal["default", "robust"] = option(
        "Training recipe; robust trains with failing taxels and offsets.", "default"
    )


def command(request: TrainRequest) -> None:
    from eskin.choose.choice import configure, train_chosen
    from eskin.choose.networks import check_units
    from eskin.study.stability.panel import panel_of
    from eskin.training.image_models import KEPT

    check_units(request.cell, request.hidden)
    prices = cost_model(request.prefer, request.fits)
    check_model_target(request.out)
    recordings, config = load_data(request.data, request.config)
    groups, folds, plan = request.groups, request.folds, None
    if groups is not None and folds:
        check_split(recordings, groups, folds)  # an unknown group is refused at once
    if not recordings.image_shape:
        begin = time.monotonic()
        with progress_bars() as report:
            plan = configure(recordings, config, prices, groups=groups, folds=folds, progress=report)
        for reason in plan.reasons:
            warn(f"configuration: {reason}")
        if words := remaining(time.monotonic() - begin, folds > 0):
            warn(words)
        if front_ends := plan.record():
            show("front_ends", front_ends=front_ends, rows=front_end_table(front_ends))
    with progress_bars() as report:
        record = train_chosen(
            recordings,
            config,
            prices,
            request,
            plan=plan,
            stress=panel_of(recordings, request.stress),
            keep=Memo(KEPT),
            progress=report,
        )
    show(
        "train",
        training=record,
        candidates=record.priced,
        network_name=network_name,
        windows_brief=windows_brief,
        out=request.out,
    )
