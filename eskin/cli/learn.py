"""Verbs that make models and judge them."""

from functools import partial

import numpy as np

from eskin.choose.choice_table import network_name, windows_brief
from eskin.cli.common import app, fitting_config, load_data, progress_bars, recordings_for, show, warn
from eskin.golden.core import AcceleratorConfig, InputError, Record, Result
from eskin.golden.data import Recordings
from eskin.golden.model import check_model_target, load_config
from eskin.memo import Memo
from eskin.requests import (
    CompareRequest,
    EnrolRequest,
    EvaluateRequest,
    ImportRequest,
    QuantiseRequest,
    TrainRequest,
)
from eskin.training.derive import derive_config
from eskin.training.formats import describe_formats
from eskin.training.made_up import image_recordings, random_images, random_recordings
from eskin.training.splits import check_split


@app.command(epilog="Example: eskin train --data recordings.npz --out model --group person,trial")
def train(request: TrainRequest) -> None:
    """Choose front end and network, cross-validate, then train a model on all recordings."""
    from eskin.choose.choice import train_chosen
    from eskin.choose.networks import check_units
    from eskin.study.stability.panel import panel_of
    from eskin.training.image_models import KEPT
    from eskin.verbs.cost import cost_model

    check_units(request.cell, request.hidden)
    prices = cost_model(request.prefer, request.fits)
    check_model_target(request.out)
    recordings, user_config = load_data(request.data, request.config)
    groups = request.groups
    if groups is not None and request.folds:
        check_split(recordings, groups, request.folds)  # an unknown group is refused at once
    plan = (
        None
        if recordings.image_shape
        else fitting_config(recordings, user_config, groups, request.folds, prices=prices)
    )
    with progress_bars() as report:
        record = train_chosen(
            recordings,
            user_config,
            prices,
            request,
            plan=plan,
            stress=panel_of(recordings, request.stress),
            keep=Memo(KEPT),
            progress=report,
        )
    show("train", **record, network_name=network_name, windows_brief=windows_brief, out=request.out)


@app.command(
    epilog="Example: eskin enrol model --data few.npz --out model2 --with recordings.npz, or "
    "eskin enrol model --teach few.npz --out model2, or eskin enrol --evaluate --data recordings.npz --group seq -k 1,2"
)
def enrol(request: EnrolRequest) -> Record:
    """Adapt a model to a new mounting, person or position with a few touches; the bitstream stays."""
    mode = "evaluate" if request.evaluate else "teach" if request.teach is not None else "train"
    request.check(mode)
    progressing = progress_bars()
    if request.evaluate:
        from eskin.verbs import enrol_job

        recordings, user_config = load_data(request.data or "", request.config)
        with progressing as report:
            result = enrol_job.evaluate(request, recordings, user_config, progress=report)
        show("enrolments", **result)
        return result
    from eskin.teach.enrol import enrol as train_on
    from eskin.teach.enrol import teach_folder

    assert request.model and request.out
    check_model_target(request.out)
    config = load_config(request.model)
    few = recordings_for(request.data or request.teach or "", config)
    old = recordings_for(request.with_, config) if request.with_ else None
    if request.teach is not None:
        result = teach_folder(request.model, few, request.out)
    else:
        with progressing as report:
            result = train_on(request.model, few, request.out, old=old, progress=partial(report, "enrolment"))
    show("enrol" if request.teach is None else "teach", **result, out=request.out)
    return result


@app.command(
    "import",
    epilog="Example: eskin import weights.pt --out model --config c.json --cell gru --reset after --mean 0 "
    "--std 40",
)
def import_(request: ImportRequest) -> Record:
    """Convert a network of another tool to a model folder. Quantise it with --data afterwards."""
    from eskin.exchange.import_network import ONNX_SUFFIX, import_network

    check_model_target(request.out)
    recordings: Recordings | None = None
    chosen = None if request.config is None else AcceleratorConfig.load(request.config)
    if chosen is None and request.file.suffix == ONNX_SUFFIX:
        from eskin.exchange.import_onnx import Graph

        chosen = Graph(request.file).configuration
    if chosen is None:
        if request.data is None:
            raise InputError(
                f"--config: is missing, and '{request.file}' does not define the array; give it, or --data to derive one"
            )
        recordings, _ = load_data(request.data)
        chosen, reasons = derive_config(recordings)
        for reason in reasons:
            warn(f"configuration: {reason}")
    elif request.data is not None and request.mean is None:
        recordings = recordings_for(request.data, chosen)
    record = import_network(
        request.file,
        chosen,
        out=request.out,
        cell=request.cell,
        reset=request.reset,
        mean=request.mean,
        std=request.std,
        recordings=recordings,
        check=request.check,
    )
    scale = {
        name: ", ".join(f"{value:.6g}" for value in np.atleast_1d(record["normalisation"].get(name, ())))
        for name in ("mean", "std")
    }
    show("import", **{"check": None, "passed": True} | record, **scale, out=request.out)
    return record


@app.command(
    epilog="Example: eskin quantise model --weight-bits 6, or eskin quantise model --data recordings.npz "
    "--readout prototypes"
)
def quantise(request: QuantiseRequest) -> None:
    """Choose a fixed-point format for each signal and write the integer model."""
    from eskin.training.integers import quantise as to_integers

    readout_options = request.readout_options
    if request.readout != "prototypes":
        for name in readout_options:
            raise InputError(
                f"--{name.removesuffix('s').replace('_', '-')}: needs --readout prototypes; give both"
            )
    elif request.data is None:
        raise InputError("--readout prototypes: needs the recordings of the training; give --data")
    widths = request.widths
    recordings = None if request.data is None else recordings_for(request.data, load_config(request.model))
    if request.quantisation_aware:
        if recordings is None or "lean" in widths or request.readout:
            raise InputError(
                "--quantisation-aware: needs the recordings of the training; give --data, and neither "
                "--formats lean nor --readout"
            )
        with progress_bars() as report:
            aware = partial(report, "training in integers")
            integer = to_integers(request.model, recordings, aware=aware, **widths)
    else:
        if request.readout and recordings is not None and recordings.image_shape:
            raise InputError("--readout: models for images have none; leave it out")
        decided_by = readout_options if request.readout == "prototypes" else request.readout
        integer = to_integers(request.model, recordings, readout=decided_by, **widths)
    show("quantise", formats=describe_formats(integer.config))


@app.command(epilog="Example: eskin evaluate model --data recordings.npz --json evaluate.json")
def evaluate(request: EvaluateRequest) -> Result:
    """Compare the float model with the integer model: accuracy, agreement, per class, per step."""
    from eskin.training.evaluate import evaluate as compare

    result = compare(request.model, recordings_for(request.data, load_config(request.model)))
    show("evaluate", **dict(result))
    return result


@app.command(epilog="Example: eskin compare model --data recordings.npz --json compare.json")
def compare(request: CompareRequest) -> Record:
    """Compare float with integer stage by stage: errors, saturations, share of the range in use."""
    from eskin.training.evaluate import OF_LABELS
    from eskin.training.evaluate import evaluate as judge

    config = load_config(request.model)
    if request.data is None:
        things = "images" if config.is_image else "touches"
        warn(f"no --data: uses random {things}, whose ranges may differ from those of real ones")
    if request.data is None and config.is_image:
        recordings = image_recordings(config, random_images(config, 64, 1))
    elif request.data is None:
        length = config.rest_level.rest_frames + 2 * config.last_frame + config.onset_rule.rearm_frames
        recordings = random_recordings(config, [length] * 12, 1)
    else:
        recordings = recordings_for(request.data, config)
    result = judge(request.model, recordings)
    show("compare", **dict(result))
    return result.model_dump(exclude={"passed"} | (OF_LABELS if request.data is None else set()))
