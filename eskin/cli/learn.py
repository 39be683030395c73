"""Verbs that make models and judge them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from eskin.cli.common import (
    CONFIG,
    DATA,
    SEED_MAX,
    CellOption,
    ConfigOption,
    DaskOption,
    DataOption,
    FitsOption,
    GroupOption,
    HiddenOption,
    JsonOption,
    ModelArgument,
    PreferOption,
    TrainingSeeds,
    app,
    argument,
    fitting_config,
    group_names,
    groups_of,
    load_data,
    option,
    progress_bars,
    recordings_for,
    show,
    warn,
)
from eskin.golden.core import InputError, Record, check_target

if TYPE_CHECKING:
    from eskin.golden.core import AcceleratorConfig
    from eskin.golden.data import Recordings


Cell = Literal["gru", "lstm", "linear"]
"""Cells: recurrent ones, and the linear one, which adds up logits window by window."""


Reset = Literal["before", "after"]
"""Where a GRU applies its reset gate: before or after the recurrent product."""
ResetOption = Annotated[
    Reset | None, option("GRU only: the reset gate before or after the recurrent product.")
]


WeightSets = Literal["one", "window"]
"""Weights of a linear cell: for every window, or one set for all of them."""


Protocol = Literal["default", "robust", "thesis"]
"""Training recipes."""


ModelOut = Annotated[Path, option("The model folder: new, or an earlier model, which is replaced.")]
WeightBits = Annotated[int | None, option("Bits of a weight.")]
StateBits = Annotated[int | None, option("Bits of the hidden state.")]
FeatureBits = Annotated[int | None, option("Bits of a feature.")]
GateBits = Annotated[int | None, option("Fraction bits of a gate.")]
TableEntries = Annotated[int | None, option("Entries of an activation table.")]


@app.command(epilog="Example: eskin train --data recordings.npz --out model --group person,trial")
def train(
    data: DataOption,
    out: ModelOut,
    config: ConfigOption = None,
    cell: CellOption = None,
    reset: ResetOption = None,
    hidden: HiddenOption = None,
    weight_sets: Annotated[
        WeightSets | None,
        option("Linear cell only: weights of its own for every window (default), or one set, far smaller."),
    ] = None,
    steps: Annotated[int | None, option("Recurrent steps of a touch.")] = None,
    folds: Annotated[int, option("Folds of the cross-validation; 0: none.")] = 5,
    group: GroupOption = None,
    seed: Annotated[int, option("First seed, that of the model written.", min=0, max=SEED_MAX)] = 0,
    seeds: TrainingSeeds = None,
    prefer: PreferOption = "energy",
    fits: FitsOption = None,
    protocol: Annotated[
        Protocol, option("The default recipe; robust: taxels may fail; or the thesis's.")
    ] = "default",
    quantisation_aware: Annotated[
        bool,
        option(
            "Train on in integer arithmetic, of the widths given; the folder then holds the integers too.",
            "--quantisation-aware",
        ),
    ] = False,
    weight_bits: WeightBits = None,
    state_bits: StateBits = None,
    feature_bits: FeatureBits = None,
    gate_bits: GateBits = None,
    table_entries: TableEntries = None,
    jobs: Annotated[
        int | None, option("Of images: processes at a time; default: one a core.", min=1, metavar="N")
    ] = None,
) -> None:
    """Choose what was not asked for, cross-validate, then train a model on all recordings of DATA and write
    its folder."""
    from eskin.choose.choice_table import network_name, windows_brief
    from eskin.choose.choose_network import check_units, train_chosen
    from eskin.golden.core import Memo
    from eskin.golden.model import check_model_target
    from eskin.training.image_models import KEPT
    from eskin.training.splits import check_split
    from eskin.verbs.cost import market

    check_units(cell, hidden, weight_sets)
    prices = market(prefer, fits)
    widths = _widths(weight_bits, state_bits, feature_bits, gate_bits, table_entries)
    if widths and not quantisation_aware:
        raise InputError(
            f"eskin train, option --{next(iter(widths)).replace('_', '-')}: needs --quantisation-aware; "
            "without it, give it to 'eskin quantise'"
        )
    check_model_target(out)
    recordings, user_config = load_data(data, config)
    groups = groups_of(group)
    if groups is not None and folds:
        check_split(recordings, groups, folds)  # an unknown group is refused before anything is said
    plan = (
        None
        if recordings.image_shape
        else fitting_config(recordings, user_config, groups, folds, nested=True, prices=prices)
    )
    with progress_bars() as report:
        record = train_chosen(
            recordings,
            user_config,
            prices,
            plan=plan,
            out=out,
            cell=cell,
            reset=reset,
            hidden=hidden,
            weight_sets=weight_sets,
            steps=steps,
            folds=folds,
            group=groups,
            seed=seed,
            seeds=seeds,
            protocol=protocol,
            quantisation_aware=quantisation_aware,
            widths=widths,
            progress=report,
            of_images={"keep": Memo(KEPT), "workers": jobs},
        )
    show("train", **record, network_name=network_name, windows_brief=windows_brief, out=out)


def _widths(*bits: int | None) -> dict[str, int]:
    """The widths that were asked for, by the names of ``eskin.training.quantise.choose_formats``."""
    names = ("weight_bits", "state_bits", "feature_bits", "gate_bits", "table_entries")
    return {name: count for name, count in zip(names, bits, strict=True) if count is not None}


Layers = Literal["dense", "all"]
"""What enrolment trains."""


Draw = Literal["random", "first"]
"""Which touches are enrolled."""


Readout = Literal["dense", "prototypes"]
"""What decides: the logits of the dense layer, or the nearest stored trajectory."""


@app.command(
    epilog="Example: eskin enrol model --data few.npz --out model2 --with recordings.npz, or "
    "eskin enrol model --teach few.npz --out model2, or eskin enrol --evaluate --data recordings.npz --group seq -k 1,2"
)
def enrol(
    model: Annotated[Path | None, argument("A quantised model folder; it stays as it is.")] = None,
    data: Annotated[
        str | None,
        option(f"The touches to train on, 1 to 5 of each class; with --evaluate all recordings. {DATA}"),
    ] = None,
    out: Annotated[
        Path | None, option("The folder of the enrolled model: new, or an earlier model, which is replaced.")
    ] = None,
    layers: Annotated[
        Layers, option("What is trained: the dense layer alone, the recurrent part frozen; or all.")
    ] = "all",
    with_: Annotated[
        str | None,
        option(
            "The recordings that the model was trained on, which it then remembers best.",
            "--with",
            metavar="D",
        ),
    ] = None,
    evaluate: Annotated[
        bool,
        option(
            "Report what enrolment brings on each value of --group, left out of the training.", "--evaluate"
        ),
    ] = False,
    teach: Annotated[
        str | None,
        option(
            "In place of --data: touches to store as prototypes beside those of a model quantised with "
            "--readout prototypes; nothing is trained.",
            "--teach",
            metavar="FEW",
        ),
    ] = None,
    readout: Annotated[
        Readout, option("With --evaluate: what is judged, a dense layer trained on, or prototypes taught.")
    ] = "dense",
    group: Annotated[
        str | None, option("With --evaluate: group arrays A[,B..], a mounting, person or place a value.")
    ] = None,
    k: Annotated[
        str, option("With --evaluate: touches of each class that are enrolled.", "-k", metavar="K[,K..]")
    ] = "1,2,5",
    alone: Annotated[
        bool, option("With --evaluate: enrol without the recordings of the first training.", "--alone")
    ] = False,
    draw: Annotated[
        Draw, option("With --evaluate: which touches are enrolled, the archive's first ones or any.")
    ] = "random",
    new_class: Annotated[
        bool,
        option(
            "With --evaluate --readout prototypes --config: each class is left out of the training in turn and then "
            "taught K touches, each of another value of --group.",
            "--new-class",
        ),
    ] = False,
    config: Annotated[str | None, option(f"With --evaluate. {CONFIG}")] = None,
    cell: Annotated[Cell | None, option("With --evaluate: the cell.")] = None,
    hidden: Annotated[int | None, option("With --evaluate: hidden units.")] = None,
    seed: Annotated[int, option("The seed; with --evaluate the first one.", min=0, max=SEED_MAX)] = 0,
    seeds: Annotated[int, option("With --evaluate: how many seeds.", min=1, max=1000)] = 3,
    jobs: Annotated[int | None, option("With --evaluate: processes; default: one a core.", min=1)] = None,
    dask: DaskOption = None,
    json: JsonOption = None,
) -> Record:
    """Teach a model a new mounting, person or position from a few touches; the bitstream stays, the host
    loads the new weights."""
    if evaluate:
        for name, value in (("MODEL", model), ("--out", out), ("--with", with_), ("--teach", teach)):
            if value is not None:
                raise InputError(
                    f"eskin enrol, {name}: belongs to no --evaluate, which trains networks of its own; "
                    "leave it out"
                )
        from eskin.golden.core import Jobs
        from eskin.verbs import enrol_job

        if group is None:
            raise InputError(
                "eskin enrol --evaluate, option --group: is missing; name the group array whose values are "
                "mountings"
            )
        if data is None:
            raise InputError("eskin enrol --evaluate, option --data: is missing; name all recordings")
        recordings, user_config = load_data(data, config)
        options: Record = {"layers": layers, "old": not alone, "draw": draw, "seed": seed, "seeds": seeds}
        options |= {"cell": cell, "hidden": hidden, "readout": readout, "new_class": new_class}
        if readout == "prototypes" and (layers != "all" or alone):
            name = "--alone" if alone else "--layers"
            raise InputError(
                f"eskin enrol --evaluate, option {name}: is for what is trained, and prototypes are taught; "
                "leave it out"
            )
        if new_class and (readout != "prototypes" or config is None):
            missing = "--readout prototypes" if readout != "prototypes" else "--config"
            raise InputError(f"eskin enrol --evaluate --new-class, option {missing}: is missing; give it")
        with progress_bars() as report:
            where = Jobs(workers=jobs, dask=dask, progress=report, version=enrol_job.CODE)
            result = enrol_job.evaluate(
                recordings, user_config, group=group_names(group), ks=_touch_counts(k), **options, jobs=where
            )
        show("enrolments", **result)
        return result
    evaluating: Record = {
        "--group": group,
        "--config": config,
        "--cell": cell,
        "--hidden": hidden,
        "--alone": alone or None,
        "--readout": None if readout == "dense" else readout,
        "--new-class": new_class or None,
    }
    for name, value in (evaluating | {"--jobs": jobs, "--dask": dask}).items():
        if value is not None:
            raise InputError(f"eskin enrol, option {name}: needs --evaluate")
    if model is None or out is None:
        raise InputError(
            f"eskin enrol, {'MODEL' if model is None else 'option --out'}: is missing; or judge enrolment "
            "with --evaluate"
        )
    from eskin.data import load_recordings
    from eskin.golden.model import check_model_target, load_config
    from eskin.teach.enrol import enrol as train_on

    check_model_target(out)
    config_of_model = load_config(model)
    if teach is not None:
        from eskin.teach.enrol import teach_folder

        for name, given in (
            ("--data", data is not None),
            ("--with", with_ is not None),
            ("--layers", layers != "all"),
            ("--seed", seed != 0),
        ):
            if given:
                raise InputError(
                    f"eskin enrol --teach, option {name}: is for what is trained, and --teach trains nothing; "
                    "leave it out"
                )
        result = teach_folder(model, load_recordings(teach, config=config_of_model), out)
        show("teach", **result, out=out)
        return result
    if data is None:
        raise InputError(
            "eskin enrol, option --data: is missing; name a few touches of each class, or --teach FEW for a "
            "model that is taught"
        )
    few = load_recordings(data, config=config_of_model)
    old = None if with_ is None else recordings_for(with_, config_of_model)
    with progress_bars() as report:
        result = train_on(
            model,
            few,
            out,
            layers=layers,
            old=old,
            seed=seed,
            progress=lambda done, total: report("enrolment", done, total),
        )
    show("enrol", **result, out=out)
    return result


def _touch_counts(text: str) -> list[int]:
    """The numbers of ``-k``."""
    counts = [word.strip() for word in text.split(",")]
    if not all(word.isdecimal() and len(word) < 4 and 1 <= int(word) <= 100 for word in counts):
        raise InputError(
            f"-k {text[:40]}: is no list of touches a class; give numbers from 1 to 100, such as 1,2,5"
        )
    return [int(word) for word in counts]


@app.command(
    "import",
    epilog="Example: eskin import weights.pt --out model --config c.json --cell gru --reset after --mean 0 "
    "--std 40",
)
def import_(
    file: Annotated[
        Path,
        argument(
            "A torch state_dict (.pt, .pth), an .npz of Keras weights in get_weights() order, an .onnx file; "
            "linear cell: an .npz with coef_ and intercept_, columns window by window."
        ),
    ],
    out: ModelOut,
    config: Annotated[
        str | None,
        option(
            "A preset or a JSON file: the array, windows and classes of the network's training. Of an .onnx file "
            "by default its own, where eskin exported it, or derived from --data."
        ),
    ] = None,
    cell: Annotated[
        Cell | None, option("Its cell; default: the configuration's, of an .onnx file the file's.")
    ] = None,
    reset: ResetOption = None,
    mean: Annotated[float | None, option("Codes taken off every window mean in its training.")] = None,
    std: Annotated[float | None, option("Codes that became 1 in its training.")] = None,
    data: Annotated[str | None, option("Without --mean and --std: measure them on these recordings.")] = None,
    check: Annotated[
        Path | None,
        option(
            "An .npz of reference inputs (touches, steps, inputs), normalised, and outputs (logits, of the last step or of "
            "every step) that the model must give; else nothing is written, status 1."
        ),
    ] = None,
) -> Record:
    """Make a model folder of a network trained elsewhere; then quantise it with --data."""
    from eskin.exchange.import_network import import_network
    from eskin.golden.core import AcceleratorConfig
    from eskin.golden.model import check_model_target

    check_model_target(out)
    recordings: Recordings | None = None
    if config is not None:
        chosen = AcceleratorConfig.load(config)
    else:
        chosen, recordings = _imported_config(file, data)
    for name, value in (("--cell", cell), ("--reset", reset), ("--data", data)) if chosen.is_image else ():
        if value is not None:
            raise InputError(
                f"{name}: is for networks that read recordings, and configuration '{chosen.name}' is for "
                "images; leave it out"
            )
    if mean is not None or std is not None:
        recordings = None
    elif data is not None and recordings is None:
        recordings = recordings_for(data, chosen)
    record = import_network(
        file, chosen, out=out, cell=cell, reset=reset, mean=mean, std=std, recordings=recordings, check=check
    )
    scale = {
        name: ", ".join(f"{value:.6g}" for value in np.atleast_1d(record["normalisation"].get(name, ())))
        for name in ("mean", "std")
    }
    show("import", **{"check": None, "passed": True} | record, **scale, out=out, images=chosen.is_image)
    return record


def _imported_config(file: Path, data: str | None) -> tuple[AcceleratorConfig, Recordings | None]:
    """Configuration for an .onnx file without --config, and the recordings it is derived from, if it is."""
    from eskin.exchange.import_network import ONNX_SUFFIX
    from eskin.training.derive import derive_config

    if file.suffix != ONNX_SUFFIX:
        raise InputError("--config: is missing; a file of weights does not say which array it is for")
    from eskin.exchange.import_onnx import configuration_of

    configuration = configuration_of(file)
    if configuration is not None:
        return configuration, None
    if data is None:
        raise InputError(
            f"network '{file}': does not say which array it is for; give --config, or --data to derive one from"
        )
    recordings, _ = load_data(data)
    chosen, reasons = derive_config(recordings)
    for reason in reasons:
        warn(f"configuration: {reason}")
    return chosen, recordings


@app.command(
    epilog="Example: eskin quantise model --weight-bits 6, or eskin quantise model --data recordings.npz "
    "--logit-error 0.5"
)
def quantise(
    model: Annotated[Path, argument("A model folder.")],
    data: Annotated[
        str | None, option("Profile ranges on these recordings; default: the ranges noted at training.")
    ] = None,
    weight_bits: WeightBits = None,
    state_bits: StateBits = None,
    feature_bits: FeatureBits = None,
    gate_bits: GateBits = None,
    table_entries: TableEntries = None,
    lean: Annotated[
        bool, option("Formats of features and logits that need the fewest logic cells.", "--lean")
    ] = False,
    logit_error: Annotated[
        float | None,
        option(
            "Narrowest widths whose logits differ from float ones by no more, on recordings left out; needs "
            "--data."
        ),
    ] = None,
    group: Annotated[
        str | None,
        option(
            "Group arrays A,B..: with --logit-error what is left out, with --readout what is left out for --unknown and "
            "for how much nearer a taught touch counts; default: those of the training."
        ),
    ] = None,
    readout: Annotated[
        Readout | None,
        option(
            "What decides: the dense layer, or the nearest stored trajectory; that needs --data. Default: as the "
            "model's config.json says."
        ),
    ] = None,
    prototypes: Annotated[
        int | None, option("With --readout: prototypes a class at most; default: 8.", min=1, max=16)
    ] = None,
    taught: Annotated[
        int | None,
        option("With --readout: places a class for touches taught in use; default: 3.", min=0, max=16),
    ] = None,
    state_code_bits: Annotated[
        int | None, option("With --readout: bits of a prototype's value; default: 4.", min=3, max=8)
    ] = None,
    unknown: Annotated[
        float | None,
        option(
            "With --readout: share of known touches, of groups left out, that may be called unsure; what is "
            "further from every prototype is unsure, too.",
            min=0.0,
            max=0.5,
        ),
    ] = None,
    spare_classes: Annotated[
        int | None,
        option(
            "With --readout: so many of the classes, the last ones, of which there is no recording, are known once they "
            "are taught.",
            min=0,
            max=30,
        ),
    ] = None,
) -> None:
    """Write the integer model into a model folder, a format for each signal."""
    from eskin.golden.model import describe_formats, load_config
    from eskin.training.quantise import quantise as to_integers

    widths: Record = {**_widths(weight_bits, state_bits, feature_bits, gate_bits, table_entries)}
    if logit_error is not None and (data is None or lean or widths):
        raise InputError(
            "--logit-error chooses the widths on recordings that are left out in turn; give --data with it, "
            "and no width"
        )
    asked = {
        "prototypes": prototypes,
        "taught": taught,
        "state_code_bits": state_code_bits,
        "unknown": unknown,
        "spare_classes": spare_classes,
    }
    of_readout = {name: value for name, value in asked.items() if value is not None}
    if readout != "prototypes":
        if group is not None and logit_error is None:
            raise InputError("--group says what --logit-error leaves out; give both")
        for name in of_readout:
            raise InputError(f"--{name.replace('_', '-')}: needs --readout prototypes; give both")
    elif data is None or logit_error is not None:
        raise InputError(
            "--readout prototypes: is made of the recordings of the training; give --data with it, and no "
            "--logit-error"
        )
    recordings = None if data is None else recordings_for(data, load_config(model))
    if logit_error is not None and recordings is not None:
        if recordings.image_shape:
            raise InputError(
                "--logit-error: is for models that read recordings; leave it out for one of images"
            )
        _quantise_by_error(model, recordings, logit_error, group)
        return
    if lean and feature_bits is not None:
        raise InputError("--lean chooses the bits of a feature; give it or --feature-bits")
    if readout is not None and recordings is not None and recordings.image_shape:
        raise InputError("--readout: is for models that read recordings; leave it out for one of images")
    decided_by = {"groups": groups_of(group)} | of_readout if readout == "prototypes" else readout
    integer = to_integers(model, recordings, readout=decided_by, lean=lean, **widths)
    show("quantise", tried=[], formats=describe_formats(integer.config))


def _quantise_by_error(model: Path, recordings: Recordings, limit: float, group: str | None) -> None:
    from eskin.golden.model import describe_formats
    from eskin.training.splits import check_split
    from eskin.training.widths import FOLDS, quantise_by_error

    groups = groups_of(group)
    if groups is not None:
        check_split(recordings, groups, FOLDS)  # refuses before the work begins
    with progress_bars() as report:
        integer, record = quantise_by_error(model, recordings, limit, group=groups, progress=report)
    show("quantise", tried=record["tried"], formats=describe_formats(integer.config))


@app.command(epilog="Example: eskin evaluate model --data recordings.npz --json evaluate.json")
def evaluate(model: ModelArgument, data: DataOption, json: JsonOption = None) -> Record:
    """Set float against integer: accuracy, agreement, per class, per step; on training data this is no
    accuracy on unseen recordings."""
    from eskin.golden.model import load_config
    from eskin.training.evaluate import evaluate as compare

    result = compare(model, recordings_for(data, load_config(model)))
    show("evaluate", **result)
    return result


@app.command(epilog="Example: eskin compare model --data recordings.npz --json compare.json")
def compare(
    model: ModelArgument,
    data: Annotated[
        str | None,
        option(f"{DATA} Default: made-up touches that reach every rule of the front end, or images."),
    ] = None,
    out: Annotated[Path, option("Folder of compare.html.")] = Path("build/compare"),
    json: JsonOption = None,
) -> Record:
    """Set float against integer stage by stage: errors, saturations, and every signal against the range of
    its format."""
    from eskin.golden.model import load_config, random_images, random_recordings
    from eskin.golden.model.image_network import image_recordings
    from eskin.pages.compare_page import PAGE, render
    from eskin.pages.views import write_text
    from eskin.training.evaluate import compare_stages

    page = out / PAGE
    check_target(page)
    config = load_config(model)
    if data is None:
        things = "images" if config.is_image else "touches"
        warn(f"no --data: made-up {things}, which may use other parts of the ranges than real ones do")
    if data is None and config.is_image:
        recordings = image_recordings(config, random_images(config, 64, 1))
    elif data is None:
        length = config.rest_level.rest_frames + 2 * config.last_frame + config.onset_rule.rearm_frames
        recordings = random_recordings(config, [length] * 12, 1)
    else:
        recordings = recordings_for(data, config)
    result = compare_stages(model, recordings)
    write_text(page, render(result))
    show("compare", **result, page=page)
    return result
