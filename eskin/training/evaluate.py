"""Float model against integer model on recordings or images: accuracy, agreement, per step and per class."""

from pathlib import Path
from typing import Any

import numpy as np

from eskin.data.fit import check_fit
from eskin.golden.data import Recordings
from eskin.golden.model import (
    FloatModel,
    IntegerModel,
    find_touches,
    float_images,
    images_of,
    run,
    run_images,
)
from eskin.golden.model.image_network import image_seconds
from eskin.training.record import Accuracies, StepAccuracies
from eskin.training.stage_error import LogitError, StageError, layer_errors, logit_error, stage_errors
from eskin.training.times import decision_times, step_rows, step_times

MAX_LOSS = 0.01
"""Accuracy that the integer model may lose against the float one."""

MIN_AGREEMENT = 0.98
"""Share of recordings on which both must decide the same."""

LOOKED_AT = 200
"""Images, spread evenly over the classes, on which errors are taken layer by layer."""

OF_LABELS = {"float_accuracy", "integer_accuracy", "per_step", "per_class", "confusion", "chance", "passed"}
"""Figures that mean nothing where labels are random."""


class ClassAccuracies(Accuracies):
    """Of the recordings of a class."""

    recordings: int


class Evaluation(Accuracies):
    """evaluate.json.

    agreement: share of recordings with the same global decision, none included. chance: share of the most
    frequent class, which is the accuracy of always naming it. not_touched: recordings without an onset. partial:
    first touches that their recording cut short. confusion: integer model, rows are true classes, columns decided
    ones, the last column none. decision: the configuration's rule. decision_time_s: integer model, mean over the
    decided recordings, from the onset to the end of the window decided on; None: none decided. steps: completed ones;
    local_agreement: share of them with the same class, None of images. passed: a recording
    is decided, at most MAX_LOSS under float, agreement at least MIN_AGREEMENT.
    """

    recordings: int
    agreement: float
    chance: float
    per_step: list[StepAccuracies]
    per_class: dict[str, ClassAccuracies]
    not_touched: int
    partial: int
    confusion: list[list[int]]
    class_names: list[str]
    decision: str
    decision_time_s: float | None
    model: str
    source: str
    steps: int
    local_agreement: float | None
    logit_error: LogitError
    stages: list[StageError]
    passed: bool


class HeldBack(Evaluation):
    """Of recordings held back: ``test`` of run.json."""

    seen_in_training: int


def evaluate(model_dir: str | Path, recordings: Recordings) -> Evaluation:
    """Run both models of a folder over recordings and compare; a recording without a decision counts as
    wrong.

    Raises
    ------
    InputError
        When the folder is not a quantised model folder, or the recordings are of another array or task.
    """
    integer, real = IntegerModel.load(model_dir, images=True), FloatModel.load(model_dir, images=True)
    check_fit(recordings, integer.config)
    ideal: Any
    trace: Any
    if integer.config.is_image:
        images, agreement, steps = images_of(recordings), None, len(recordings)
        ideal, trace = float_images(real, images, maps=False), run_images(integer, images, maps=False)
        stages = layer_errors(real, integer, images[recordings.evenly(LOOKED_AT)])
    else:
        touches = find_touches(integer.config, recordings)
        # with the same prototypes if prototypes decide
        ideal = run(real, recordings, touches=touches, readout=integer)
        trace = run(integer, recordings, touches=touches)
        done = trace.local >= 0
        agreement = float(np.mean((trace.local == ideal.local)[done])) if done.any() else None
        stages, steps = stage_errors(real, integer, touches), int(done.sum())
    config, labels = integer.config, recordings.labels
    confusion = np.zeros((config.classes, config.classes + 1), dtype=np.int64)
    np.add.at(confusion, (labels, trace.decision), 1)  # -1, no decision, is the last column
    per_class = {}
    for index, name in enumerate(config.network.class_names):
        members = labels == index
        if members.any():
            real_share, share = (np.mean(played.decision[members] == index) for played in (ideal, trace))
            per_class[name] = ClassAccuracies(
                recordings=members.sum(), float_accuracy=real_share, integer_accuracy=share
            )
    decision_time_s: float | None = image_seconds(config) if config.is_image else None
    if config.is_image:  # an image is one step, touched, and decided when its rows are in
        per_step = [(image_seconds(config), ideal.accuracy(labels), trace.accuracy(labels))]
        not_touched, partial = 0, 0
    else:
        of_steps = (np.mean(played.first_local() == labels[:, None], axis=0) for played in (ideal, trace))
        per_step = list(zip(step_times(config, trace.touches), *of_steps, strict=True))
        not_touched = int(trace.not_touched.sum())
        partial = int(trace.partial[trace.first[trace.first >= 0]].sum())
        if (trace.decision >= 0).any():
            decision_time_s = float(np.nanmean(decision_times(trace)))
    share, real_share, alike = trace.accuracy(labels), ideal.accuracy(labels), trace.agreement(ideal)
    return Evaluation(
        recordings=len(labels),
        float_accuracy=real_share,
        integer_accuracy=share,
        agreement=alike,
        chance=np.bincount(labels).max() / len(labels),
        per_step=step_rows(per_step),
        per_class=per_class,
        not_touched=not_touched,
        partial=partial,
        confusion=confusion.tolist(),
        class_names=list(config.network.class_names),
        decision=config.network.decision,
        decision_time_s=decision_time_s,
        model=str(model_dir),
        source=str(recordings.source),
        steps=steps,
        local_agreement=agreement,
        logit_error=logit_error(stages),
        stages=stages,
        passed=decision_time_s is not None and share >= real_share - MAX_LOSS and alike >= MIN_AGREEMENT,
    )
