"""Verbs that make models and judge them."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eskin.cli.common import app, fitting_config, load_data, progress_bars, recordings_for, show, warn
from eskin.golden.core import InputError, Record
from eskin.requests import (
    CompareRequest,
    EnrolRequest,
    EvaluateRequest,
    ImportRequest,
    QuantiseRequest,
    TrainRequest,
)

if TYPE_CHECKING:
    from eskin.golden.core import AcceleratorConfig
    from eskin.golden.data import Recordings


@app.command(epilog="Example: eskin train --data recordings.npz --out model --group person,trial")
def train(asked: TrainRequest) -> None:
    """Choose front end and network, cross-validate, then train a model on all recordings."""
    from eskin.choose.choice import train_chosen
    from eskin.choose.choice_table import network_name, windows_brief
    from eskin.choose.networks import check_units
    from eskin.golden.model import check_model_target
    from eskin.memo import Memo
    from eskin.study.stability.panel import panel_of
    from eskin.training.image_models import KEPT
    from eskin.training.splits import check_split
    from eskin.verbs.cost import cost_model

    check_units(asked.cell, asked.hidden)
    prices = cost_model(asked.prefer, asked.fits)
    check_model_target(asked.out)
    recordings, user_config = load_data(asked.data, asked.config)
    groups = asked.groups
    if groups is not None and asked.folds:
        check_split(recordings, groups, asked.folds)  # an unknown group is refused at once
    plan = (
        None
        if recordings.image_shape
        else fitting_config(recordings, user_config, groups, asked.folds, prices=prices)
    )
    with progress_bars() as report:
        record = train_chosen(
            recordings,
            user_config,
            prices,
            plan=plan,
            out=asked.out,
            cell=asked.cell,
            reset=asked.reset,
            hidden=asked.hidden,
            folds=asked.folds,
            group=groups,
            seed=asked.seed,
            seeds=asked.seeds,
            protocol=asked.protocol,
            progress=report,
            of_images={"keep": Memo(KEPT)},
            stress=panel_of(recordings, asked.stress),
        )
    show("train", **record, network_name=network_name, windows_brief=windows_brief, out=asked.out)


@app.command(
    epilog="Example: eskin enrol model --data few.npz --out model2 --with recordings.npz, or "
    "eskin enrol model --teach few.npz --out model2, or eskin enrol --evaluate --data recordings.npz --group seq -k 1,2"
)
def enrol(asked: EnrolRequest) -> Record:
    """Adapt a model to a new mounting, person or position with a few touches; the bitstream stays."""
    mode = "evaluate" if asked.evaluate else "teach" if asked.teach is not None else "train"
    asked.check(mode)
    progressing = progress_bars()
    if asked.evaluate:
        from eskin.verbs import enrol_job

        recordings, user_config = load_data(asked.data or "", asked.config)
        with progressing as report:
            result = enrol_job.evaluate(asked, recordings, user_config, progress=report)
        show("enrolments", **result)
        return result
    from eskin.golden.model import check_model_target, load_config
    from eskin.teach.enrol import enrol as train_on
    from eskin.teach.enrol import teach_folder

    assert asked.model and asked.out
    check_model_target(asked.out)
    config = load_config(asked.model)
    few = recordings_for(asked.data or asked.teach or "", config)
    old = recordings_for(asked.with_, config) if asked.with_ else None
    if asked.teach is not None:
        result = teach_folder(asked.model, few, asked.out)
    else:
        with progressing as report:
            result = train_on(asked.model, few, asked.out, old=old, progress=partial(report, "enrolment"))
    show("enrol" if asked.teach is None else "teach", **result, out=asked.out)
    return result


@app.command(
    "import",
    epilog="Example: eskin import weights.pt --out model --config c.json --cell gru --reset after --mean 0 "
    "--std 40",
)
def import_(asked: ImportRequest) -> Record:
    """Convert a network of another tool to a model folder. Quantise it with --data afterwards."""
    from eskin.exchange.import_network import import_network
    from eskin.golden.core import AcceleratorConfig
    from eskin.golden.model import check_model_target

    check_model_target(asked.out)
    recordings: Recordings | None = None
    if asked.config is not None:
        chosen = AcceleratorConfig.load(asked.config)
    else:
        chosen, recordings = _imported_config(asked.file, asked.data)
    if asked.mean is not None or asked.std is not None:
        recordings = None
    elif asked.data is not None and recordings is None:
        recordings = recordings_for(asked.data, chosen)
    record = import_network(
        asked.file,
        chosen,
        out=asked.out,
        cell=asked.cell,
        reset=asked.reset,
        mean=asked.mean,
        std=asked.std,
        recordings=recordings,
        check=asked.check,
    )
    scale = {
        name: ", ".join(f"{value:.6g}" for value in np.atleast_1d(record["normalisation"].get(name, ())))
        for name in ("mean", "std")
    }
    show("import", **{"check": None, "passed": True} | record, **scale, out=asked.out)
    return record


def _imported_config(file: Path, data: str | None) -> tuple[AcceleratorConfig, Recordings | None]:
    """Configuration for an .onnx file without --config, and the recordings it is derived from, if it is."""
    from eskin.exchange.import_network import ONNX_SUFFIX
    from eskin.training.derive import derive_config

    if file.suffix != ONNX_SUFFIX:
        raise InputError("--config: is missing; weights alone do not define the array, so give it")
    from eskin.exchange.import_onnx import configuration_of

    configuration = configuration_of(file)
    if configuration is not None:
        return configuration, None
    if data is None:
        raise InputError(
            f"network '{file}': does not define the array; give --config, or --data to derive one"
        )
    recordings, _ = load_data(data)
    chosen, reasons = derive_config(recordings)
    for reason in reasons:
        warn(f"configuration: {reason}")
    return chosen, recordings


@app.command(
    epilog="Example: eskin quantise model --weight-bits 6, or eskin quantise model --data recordings.npz "
    "--readout prototypes"
)
def quantise(asked: QuantiseRequest) -> None:
    """Choose a fixed-point format for each signal and write the integer model."""
    from eskin.golden.model import load_config
    from eskin.training.formats import describe_formats
    from eskin.training.integers import quantise as to_integers

    of_readout = asked.of_readout
    if asked.readout != "prototypes":
        for name in of_readout:
            raise InputError(
                f"--{name.removesuffix('s').replace('_', '-')}: needs --readout prototypes; give both"
            )
    elif asked.data is None:
        raise InputError("--readout prototypes: needs the recordings of the training; give --data")
    widths = asked.widths
    recordings = None if asked.data is None else recordings_for(asked.data, load_config(asked.model))
    if asked.quantisation_aware:
        if recordings is None or "lean" in widths or asked.readout:
            raise InputError(
                "--quantisation-aware: needs the recordings of the training; give --data, and neither "
                "--formats lean nor --readout"
            )
        with progress_bars() as report:
            aware = partial(report, "training in integers")
            integer = to_integers(asked.model, recordings, aware=aware, **widths)
    else:
        if asked.readout and recordings is not None and recordings.image_shape:
            raise InputError("--readout: models for images have none; leave it out")
        decided_by = of_readout if asked.readout == "prototypes" else asked.readout
        integer = to_integers(asked.model, recordings, readout=decided_by, **widths)
    show("quantise", formats=describe_formats(integer.config))


@app.command(epilog="Example: eskin evaluate model --data recordings.npz --json evaluate.json")
def evaluate(asked: EvaluateRequest) -> Record:
    """Compare the float model with the integer model: accuracy, agreement, per class, per step."""
    from eskin.golden.model import load_config
    from eskin.training.evaluate import evaluate as compare

    result = compare(asked.model, recordings_for(asked.data, load_config(asked.model)))
    show("evaluate", **result)
    return result


@app.command(epilog="Example: eskin compare model --data recordings.npz --json compare.json")
def compare(asked: CompareRequest) -> Record:
    """Compare float with integer stage by stage: errors, saturations, share of the range in use."""
    from eskin.golden.model import load_config
    from eskin.training.evaluate import compare_stages
    from eskin.training.made_up import image_recordings, random_images, random_recordings

    config = load_config(asked.model)
    if asked.data is None:
        things = "images" if config.is_image else "touches"
        warn(f"no --data: uses random {things}, whose ranges may differ from those of real ones")
    if asked.data is None and config.is_image:
        recordings = image_recordings(config, random_images(config, 64, 1))
    elif asked.data is None:
        length = config.rest_level.rest_frames + 2 * config.last_frame + config.onset_rule.rearm_frames
        recordings = random_recordings(config, [length] * 12, 1)
    else:
        recordings = recordings_for(asked.data, config)
    result = compare_stages(asked.model, recordings)
    show("compare", **result)
    return result
