"""Float model against integer model on recordings or images: accuracy, agreement, per step and per class."""

from pathlib import Path
from typing import Any

import numpy as np

from eskin.data.fit import check_fit
from eskin.golden.core import Record
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
from eskin.training.stage_error import layer_errors, logit_error, stage_errors
from eskin.training.times import decision_times, step_rows, step_times

MAX_LOSS = 0.01
"""Accuracy that the integer model may lose against the float one."""

MIN_AGREEMENT = 0.98
"""Share of recordings on which both must decide the same."""

LOOKED_AT = 200
"""Images, spread evenly over the classes, on which errors are taken layer by layer."""

OF_LABELS = ("float_accuracy", "integer_accuracy", "per_step", "per_class", "confusion", "chance")
"""Figures that mean nothing where labels are random."""


def evaluate(model_dir: str | Path, recordings: Recordings) -> Record:
    """Run both models of a folder over recordings and compare; a recording without a decision counts as
    wrong.

    Returns
    -------
    recordings, float_accuracy, integer_accuracy, agreement (share of recordings with the same global
    decision, none included), per_step (list of {step, time_s, float_accuracy, integer_accuracy}; time from
    the onset to the end of the step's window, median over touches), per_class (class name -> {recordings,
    float_accuracy, integer_accuracy}), not_touched (recordings without an onset), partial (first touches that
    their recording cut short), confusion (integer model: rows = true class, columns = decided, last column =
    none), class_names, decision (the configuration's rule), decision_time_s (integer model: mean over the
    decided recordings, from the onset to the end of the window decided on; None: none decided), chance (share
    of the most frequent class, which is the accuracy of always naming it), logit_error ({mean, max, stage}:
    distance of integer logits from float ones over all completed steps, and the stage that alone causes the
    largest; None without a step), stages (a record for each stage: ``eskin.training.stage_error.FIGURES``),
    model, source, steps (completed ones), local_agreement (share of steps with the same class; None of
    images), passed (result of ``passes``).

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
    result = compare(ideal, trace, recordings.labels)
    return result | {
        "model": str(model_dir),
        "source": str(recordings.source),
        "steps": steps,
        "local_agreement": agreement,
        "logit_error": logit_error(stages),
        "stages": stages,
        "passed": passes(result),
    }


def compare(ideal: Any, trace: Any, labels: np.ndarray) -> Record:
    """The result of ``evaluate`` without ``passed`` and errors, from a float and an integer trace
    (`eskin.golden.model.pipeline.Trace`, or `eskin.golden.model.image_network.ImageTrace`) of the same
    recordings and their labels."""
    config, labels = trace.config, np.asarray(labels)
    confusion = np.zeros((config.classes, config.classes + 1), dtype=np.int64)
    np.add.at(confusion, (labels, trace.decision), 1)  # -1, no decision, is the last column
    per_class = {}
    for index, name in enumerate(config.network.class_names):
        members = labels == index
        if members.any():
            shares = {
                "float_accuracy": ideal.decision[members] == index,
                "integer_accuracy": trace.decision[members] == index,
            }
            per_class[name] = {"recordings": int(members.sum())} | {
                key: float(np.mean(right)) for key, right in shares.items()
            }
    decision_time_s: float | None = image_seconds(config) if config.is_image else None
    if config.is_image:  # an image is one step, touched, and decided when its rows are in
        steps = [(image_seconds(config), ideal.accuracy(labels), trace.accuracy(labels))]
        not_touched, partial = 0, 0
    else:
        times = step_times(config, trace.touches)
        of_steps = (np.mean(run.first_local() == labels[:, None], axis=0) for run in (ideal, trace))
        steps = list(zip(times, *of_steps, strict=True))
        not_touched = int(trace.not_touched.sum())
        partial = int(trace.partial[trace.first[trace.first >= 0]].sum())
        if (trace.decision >= 0).any():
            decision_time_s = float(np.nanmean(decision_times(trace)))
    return {
        "recordings": len(labels),
        "float_accuracy": ideal.accuracy(labels),
        "integer_accuracy": trace.accuracy(labels),
        "agreement": trace.agreement(ideal),
        "chance": float(np.bincount(labels).max() / len(labels)),
        "per_step": step_rows(steps),
        "per_class": per_class,
        "not_touched": not_touched,
        "partial": partial,
        "confusion": confusion.tolist(),
        "class_names": list(config.network.class_names),
        "decision": config.network.decision,
        "decision_time_s": decision_time_s,
    }


def passes(result: Record) -> bool:
    """True when the integer model is at most MAX_LOSS under the float one and agrees on at least
    MIN_AGREEMENT."""
    return (
        result["integer_accuracy"] >= result["float_accuracy"] - MAX_LOSS
        and result["agreement"] >= MIN_AGREEMENT
    )
