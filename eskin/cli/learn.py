"""Verbs that make models and judge them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import typer
from rich.markup import escape

from eskin.cli.common import (
    CELL_CHOICE,
    CONFIG,
    DATA,
    SEED_MAX,
    CellChoice,
    ConfigOption,
    DaskOption,
    DataOption,
    JsonOption,
    ModelArgument,
    app,
    argument,
    console,
    fitting_config,
    group_names,
    groups_of,
    load_data,
    messages,
    option,
    print_records,
    print_table,
    progress_bars,
    recordings_for,
    say,
    warn,
)
from eskin.golden.core.errors import InputError
from eskin.golden.core.files import check_target, replacing, write_json
from eskin.pages.tables import mean_and_largest, percent

if TYPE_CHECKING:
    from eskin.golden.data.recordings import Recordings


def _show_candidates(rows: list[dict[str, Any]]) -> None:
    from eskin.golden.training.choice_table import network_name

    columns: dict[str, Any] = {
        "network": network_name,
        "accuracy": "{accuracy:percent}",
        "standard error": "{standard_error:100*.2f}",
        "float": "{float_accuracy:percent}",
        "multiplies a touch": "{multiplies_touch}",
        "parameters": "{parameters}",
        "": "{chosen:chosen|}",
    }
    print_records("networks, integer, cross-validated", rows, columns)


Cell = Literal["gru", "lstm", "linear"]
"""Cells: recurrent ones, and the linear one, which adds up logits window by window."""


Reset = Literal["before", "after"]
"""Where a GRU applies its reset gate: before or after the recurrent product."""


WeightSets = Literal["one", "window"]
"""Weights of a linear cell: for every window, or one set for all of them."""


Protocol = Literal["default", "robust", "thesis"]
"""Training recipes."""


@app.command(epilog="Example: eskin train --data recordings.npz --out model --group person,trial")
def train(
    data: DataOption,
    out: Annotated[Path, option("The model folder: new, or an earlier model, which is replaced.")],
    config: ConfigOption = None,
    cell: Annotated[CellChoice | None, option(CELL_CHOICE)] = None,
    reset: Annotated[
        Reset | None, option("GRU only: the reset gate before or after the recurrent product.")
    ] = None,
    hidden: Annotated[int | None, option("Hidden units.")] = None,
    weight_sets: Annotated[
        WeightSets | None,
        option("Linear cell only: weights of its own for every window (default), or one set, far smaller."),
    ] = None,
    steps: Annotated[int | None, option("Recurrent steps of a touch.")] = None,
    folds: Annotated[int, option("Folds of the cross-validation; 0: none.")] = 5,
    group: Annotated[str | None, option("Group arrays A[,B..] that stay on one side of a split.")] = None,
    seed: Annotated[int, option("First seed, that of the model written.", min=0, max=SEED_MAX)] = 0,
    seeds: Annotated[
        int | None, option("Seeds of the cross-validation; default: 3, of images 1.", min=1, max=100)
    ] = None,
    protocol: Annotated[
        Protocol, option("The default recipe; robust: taxels may fail; or the thesis's.")
    ] = "default",
    quantisation_aware: Annotated[
        bool,
        option(
            "Train on in integer arithmetic; the folder then holds the integers too.", "--quantisation-aware"
        ),
    ] = False,
    weight_bits: Annotated[int | None, option("With --quantisation-aware: bits of a weight.")] = None,
    state_bits: Annotated[int | None, option("With --quantisation-aware: bits of the hidden state.")] = None,
    feature_bits: Annotated[int | None, option("With --quantisation-aware: bits of a feature.")] = None,
    gate_bits: Annotated[int | None, option("With --quantisation-aware: fraction bits of a gate.")] = None,
    table_entries: Annotated[
        int | None, option("With --quantisation-aware: entries of an activation table.")
    ] = None,
    jobs: Annotated[
        int | None, option("Of images: processes at a time; default: one a core.", min=1, metavar="N")
    ] = None,
) -> None:
    """Choose what was not asked for, cross-validate, then train a model on all recordings of DATA and write
    its folder."""
    from eskin.golden.core.memo import Memo
    from eskin.golden.model.model import check_model_target
    from eskin.golden.training.choose_network import check_units, train_chosen
    from eskin.golden.training.image_models import KEPT
    from eskin.golden.training.splits import split_folds

    check_units(cell, hidden, weight_sets)
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
        split_folds(recordings, groups, folds, None)  # an unknown group is refused before anything is said
    plan = (
        None
        if recordings.image_shape
        else fitting_config(recordings, user_config, groups, folds, nested=True)
    )
    with progress_bars() as report:
        record = train_chosen(
            recordings,
            user_config,
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
    if "candidates" in record:
        _show_candidates(record["candidates"])
    _show_cross_validation(record)
    _show_by_weights(record)
    for sentence in record["warnings"]:
        warn(f"warning: {sentence}")
    console.print(f"model: {escape(str(out))}, {record['parameters']} parameters, {record['wall_s']:.0f} s")


def _widths(*bits: int | None) -> dict[str, int]:
    """The widths that were asked for, by the names of ``eskin.golden.training.quantise.choose_formats``."""
    names = ("weight_bits", "state_bits", "feature_bits", "gate_bits", "table_entries")
    return {name: count for name, count in zip(names, bits, strict=True) if count is not None}


def _show_cross_validation(record: dict[str, Any]) -> None:
    """The figures of folds that chose nothing, and where front end or network were chosen on these folds,
    those of the network taken."""
    splits = record["cross_validation"]
    nested = [split["nested"] for split in splits if split.get("nested")]
    linear = {tuple(row["groups"]): row["accuracy"] for row in record.get("baselines", [])}
    figures: dict[str, Any] = {
        "groups left out": lambda split: " and ".join(split["groups"]) or "none",
        "folds": "{folds}",
        "float": "{float_accuracy:percent}",
        "integer": "{integer_accuracy:percent}",
    }
    more: dict[str, Any] = {
        "spread": "{integer_spread:100*.1f} points",
        "agreement": "{agreement:percent}",
        "logit error": lambda split: mean_and_largest(split["logit_error"]),
        "linear classifier, same features": lambda split: percent(linear.get(tuple(split["groups"]))),
    }
    if not nested:
        title = (
            "accuracy on the groups it was chosen on"
            if "nested" in (splits or [{}])[0]
            else "accuracy on unseen groups"
        )
        print_records(title, splits, figures | more)
        return
    shuffled = {"labels shuffled": _shuffled_words} if any(split["shuffled"] for split in nested) else {}
    error = {"standard error": "{standard_error:100*.2f} points"}
    title = f"accuracy on unseen groups: front end and network chosen anew without them ({sum(split['wall_s'] for split in nested):.0f} s)"
    print_records(title, nested, figures | error | {"agreement": more["agreement"]} | shuffled)
    print_records(
        "the network taken, on the folds it was chosen on (too good by that choice)", splits, figures | more
    )


def _shuffled_words(nested: dict[str, Any]) -> str:
    """What luck alone reaches."""
    shuffled = nested["shuffled"]
    return (
        f"{percent(shuffled['mean'])} on average, at most {percent(shuffled['largest'])} in "
        f"{shuffled['count']}"
        if shuffled
        else "-"
    )


def _show_by_weights(record: dict[str, Any]) -> None:
    """Networks for images: float and each kind of integers, seed by seed."""
    columns: dict[str, Any] = {
        "weights": "{weights}",
        "accuracy": "{accuracy:percent}",
        "spread over seeds": lambda row: (
            f"{100 * row['spread']:.2f} points" if len(row["by_seed"]) > 1 else "-"
        ),
        "same as float": "{agreement:percent}",
        "seed by seed, %": lambda row: ", ".join(f"{100 * share:.2f}" for share in row["by_seed"]),
    }
    for split in record["cross_validation"]:
        print_records("images left out, by weights", split.get("by_weights", []), columns)


Layers = Literal["dense", "all"]
"""What enrolment trains."""


Draw = Literal["random", "first"]
"""Which touches are enrolled."""


@app.command(
    epilog="Example: eskin enrol model --data few.npz --out model2 --with recordings.npz, or "
    "eskin enrol --evaluate --data recordings.npz --group seq -k 1,2"
)
def enrol(
    data: Annotated[
        str, option(f"The touches to enrol, 1 to 5 of each class; with --evaluate all recordings. {DATA}")
    ],
    model: Annotated[Path | None, argument("A quantised model folder; it stays as it is.")] = None,
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
    config: Annotated[str | None, option(f"With --evaluate. {CONFIG}")] = None,
    cell: Annotated[Cell | None, option("With --evaluate: the cell.")] = None,
    hidden: Annotated[int | None, option("With --evaluate: hidden units.")] = None,
    seed: Annotated[int, option("The seed; with --evaluate the first one.", min=0, max=SEED_MAX)] = 0,
    seeds: Annotated[int, option("With --evaluate: how many seeds.", min=1, max=1000)] = 3,
    jobs: Annotated[int | None, option("With --evaluate: processes; default: one a core.", min=1)] = None,
    dask: DaskOption = None,
    json: JsonOption = None,
) -> None:
    """Teach a model a new mounting, person or position from a few touches; the bitstream stays, the host
    loads the new weights."""

    check_target(json)
    if evaluate:
        for name, value in (("MODEL", model), ("--out", out), ("--with", with_)):
            if value is not None:
                raise InputError(
                    f"eskin enrol, {name}: belongs to no --evaluate, which trains networks of its own; "
                    "leave it out"
                )
        from eskin.golden.core.jobs import Jobs
        from eskin.verbs import enrol_job

        if group is None:
            raise InputError(
                "eskin enrol --evaluate, option --group: is missing; name the group array whose values are "
                "mountings"
            )
        recordings, user_config = load_data(data, config)
        options: dict[str, Any] = {
            "layers": layers,
            "old": not alone,
            "draw": draw,
            "seed": seed,
            "seeds": seeds,
        }
        options |= {"cell": cell, "hidden": hidden}
        with progress_bars() as report:
            where = Jobs(workers=jobs, dask=dask, progress=report, version=enrol_job.CODE)
            result = enrol_job.evaluate(
                recordings, user_config, group=group_names(group), ks=_touch_counts(k), **options, jobs=where
            )
        if json:
            write_json(json, result)
        _show_enrolments(result)
        return
    evaluating: dict[str, Any] = {
        "--group": group,
        "--config": config,
        "--cell": cell,
        "--hidden": hidden,
        "--alone": alone or None,
    }
    for name, value in (evaluating | {"--jobs": jobs, "--dask": dask}).items():
        if value is not None:
            raise InputError(f"eskin enrol, option {name}: needs --evaluate")
    if model is None or out is None:
        raise InputError(
            f"eskin enrol, {'MODEL' if model is None else 'option --out'}: is missing; or judge enrolment "
            "with --evaluate"
        )
    from eskin.golden.data.load import load_recordings
    from eskin.golden.model.model import check_model_target, load_config
    from eskin.golden.training.enrol import enrol as teach

    check_model_target(out)
    config_of_model = load_config(model)
    few, old = (
        load_recordings(data, config=config_of_model),
        None if with_ is None else recordings_for(with_, config_of_model),
    )
    with progress_bars() as report:
        result = teach(
            model,
            few,
            out,
            layers=layers,
            old=old,
            seed=seed,
            progress=lambda done, total: report("enrolment", done, total),
        )
    if json:
        write_json(json, result)
    _show_enrolment(result, out)
    if not result["passed"]:
        messages.print(
            "check not held: enrolment may cost no new recording and 1 point of the old ones; MODEL is as "
            "it was"
        )
        raise typer.Exit(1)


def _touch_counts(text: str) -> list[int]:
    """The numbers of ``-k``."""
    counts = [word.strip() for word in text.split(",")]
    if not all(word.isdecimal() and len(word) < 4 and 1 <= int(word) <= 100 for word in counts):
        raise InputError(
            f"-k {text[:40]}: is no list of touches a class; give numbers from 1 to 100, such as 1,2,5"
        )
    return [int(word) for word in counts]


def _show_enrolment(result: dict[str, Any], out: Path) -> None:
    touches = ", ".join(f"{name} {count}" for name, count in result["touches"].items())
    rows = [
        ("touches enrolled", touches),
        ("trained", {"dense": "the dense layer", "all": "the whole network"}[result["layers"]]),
        (
            "right of the new recordings",
            f"{percent(result['before'])} before, {percent(result['after'])} after (trained on them)",
        ),
    ]
    if result["old_before"] is not None:
        rows.append(
            (
                "right of the old recordings",
                f"{percent(result['old_before'])} before, {percent(result['old_after'])} after",
            )
        )
    rows.append(("largest change of a weight", f"{result['largest_change']:.3g}"))
    rows.append(
        (
            "at a limit",
            ", ".join(f"{percent(share)} of the {name}s" for name, share in result["saturated"].items()),
        )
    )
    print_table("enrolment", "what", "value", rows=rows)
    console.print(f"model: {escape(str(out))}, for the same bitstream, {result['wall_s']:.1f} s")


def _show_enrolments(result: dict[str, Any]) -> None:
    def shown(entry: dict[str, Any], name: str) -> str:
        spread = entry["spread"].get(name)
        return percent(entry[name]) + ("" if spread is None else f" +- {100 * spread:.1f}")

    figures = ("before", "after", "others_before", "others_after")
    rows = [
        (
            row["value"],
            row["k"],
            *(shown(row, name) for name in figures),
            f"{row['recordings']} and {row['others']}",
        )
        for row in result["rows"]
    ]
    rows += [("all", k, *(shown(entry, name) for name in figures), "") for k, entry in result["mean"].items()]
    layers = {"dense": "dense layer", "all": "whole network"}[result["layers"]]
    how = "with the old recordings" if result["old"] else "without the old recordings"
    columns = ("k", "before", "after", "others before", "others after", "recordings that judge")
    seeds = len(result["seeds"])
    print_table(
        f"enrolment, {layers}, {how}, {seeds} seed{'s' * (seeds > 1)}",
        result["rows"][0]["group"],
        *columns,
        rows=rows,
    )


@app.command(
    "import",
    epilog="Example: eskin import weights.pt --out model --config c.json --cell gru --reset after --mean 0 "
    "--std 40",
)
def import_(
    file: Annotated[
        Path,
        argument(
            "A torch state_dict (.pt, .pth), an .npz of Keras weights in get_weights() order; linear "
            "cell: an .npz with coef_ and intercept_, columns window by window."
        ),
    ],
    out: Annotated[Path, option("The model folder: new, or an earlier model, which is replaced.")],
    config: Annotated[
        str, option("A preset or a JSON file: the array, windows and classes of the network's training.")
    ],
    cell: Annotated[Cell | None, option("Its cell; default: the configuration's.")] = None,
    reset: Annotated[
        Reset | None, option("GRU only: the reset gate before or after the recurrent product.")
    ] = None,
    mean: Annotated[float | None, option("Codes taken off every window mean in its training.")] = None,
    std: Annotated[float | None, option("Codes that became 1 in its training.")] = None,
    data: Annotated[str | None, option("Without --mean and --std: measure them on these recordings.")] = None,
) -> None:
    """Make a model folder of a network trained elsewhere; then quantise it with --data."""
    from eskin.golden.core.config import AcceleratorConfig
    from eskin.golden.model.model import check_model_target
    from eskin.golden.training.import_network import import_network

    check_model_target(out)
    chosen = AcceleratorConfig.load(config)
    for name, value in (("--cell", cell), ("--reset", reset), ("--data", data)) if chosen.is_image else ():
        if value is not None:
            raise InputError(
                f"{name}: is for networks that read recordings, and configuration '{chosen.name}' is for "
                "images; leave it out"
            )
    recordings = None if data is None or mean is not None or std is not None else recordings_for(data, chosen)
    record = import_network(
        file, chosen, out=out, cell=cell, reset=reset, mean=mean, std=std, recordings=recordings
    )
    scale, following = record["normalisation"], ""
    if chosen.is_image:
        say(
            f"layers: {', '.join(f'{layer} of {module}' for layer, module in record['imported']['arrays'].items())}"
        )
        following = f"; next: eskin quantise {out} --data IMAGES"
    else:
        means, stds = (
            ", ".join(f"{value:.6g}" for value in np.atleast_1d(scale[name])) for name in ("mean", "std")
        )
        say(f"normalisation: mean {means}, deviation {stds} codes ({scale['source']})")
    say(f"model: {out}, {record['parameters']} parameters{following}")


@app.command(
    epilog="Example: eskin quantise model --weight-bits 6, or eskin quantise model --data recordings.npz "
    "--logit-error 0.5"
)
def quantise(
    model: Annotated[Path, argument("A model folder.")],
    data: Annotated[
        str | None, option("Profile ranges on these recordings; default: the ranges noted at training.")
    ] = None,
    weight_bits: Annotated[int | None, option("Bits of a weight.")] = None,
    state_bits: Annotated[int | None, option("Bits of the hidden state.")] = None,
    feature_bits: Annotated[int | None, option("Bits of a feature.")] = None,
    gate_bits: Annotated[int | None, option("Fraction bits of a gate.")] = None,
    table_entries: Annotated[int | None, option("Entries of an activation table.")] = None,
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
        option("With --logit-error: group arrays that are left out, A,B..; default: those of the training."),
    ] = None,
) -> None:
    """Write the integer model into a model folder, a format for each signal."""
    from eskin.golden.model.model import describe_formats, load_config
    from eskin.golden.training.quantise import quantise as to_integers

    widths = _widths(weight_bits, state_bits, feature_bits, gate_bits, table_entries)
    if logit_error is not None and (data is None or lean or widths):
        raise InputError(
            "--logit-error chooses the widths on recordings that are left out in turn; give --data with it, "
            "and no width"
        )
    if group is not None and logit_error is None:
        raise InputError("--group says what --logit-error leaves out; give both")
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
    integer = to_integers(model, recordings, lean=lean, **widths)
    print_table("formats", "signal", "format", rows=list(describe_formats(integer.config).items()))


def _quantise_by_error(model: Path, recordings: Recordings, limit: float, group: str | None) -> None:
    from eskin.golden.model.model import describe_formats
    from eskin.golden.training.splits import split_folds
    from eskin.golden.training.widths import FOLDS, quantise_by_error

    groups = groups_of(group)
    if groups is not None:
        split_folds(recordings, groups, FOLDS, None)  # refuses before the work begins
    with progress_bars() as report:
        integer, record = quantise_by_error(model, recordings, limit, group=groups, progress=report)
    columns = {
        "weight bits": "{weight_bits}",
        "table": "{table_entries}",
        "mean": "{mean:.4f}",
        "largest": "{max:.3f}",
        "most of all by": "{stage}",
    }
    print_records("logit error on recordings left out", record["tried"], columns)
    print_table("formats", "signal", "format", rows=list(describe_formats(integer.config).items()))


@app.command(epilog="Example: eskin evaluate model --data recordings.npz --json evaluate.json")
def evaluate(model: ModelArgument, data: DataOption, json: JsonOption = None) -> None:
    """Set float against integer: accuracy, agreement, per class, per step; on training data this is no
    accuracy on unseen recordings."""
    from eskin.golden.model.model import load_config
    from eskin.golden.training.evaluate import evaluate as compare

    check_target(json)
    result = compare(model, recordings_for(data, load_config(model)))
    if json:
        write_json(json, result)
    _show_evaluation(result)
    if not result["passed"]:
        messages.print(
            "check not held: the integer model may lose 1 point at most and must agree in 98 % at least"
        )
        raise typer.Exit(1)


def _logit_error(error: dict[str, Any]) -> str:
    if error["max"] is None:
        return "no step to judge"
    return f"{error['mean']:.3f} on average, {error['max']:.2f} at most, most of all by {error['stage']}"


def _show_stages(stages: list[dict[str, Any]]) -> None:
    columns = {
        "stage": "{stage}",
        "error, mean": "{mean:.4f}",
        "largest": "{max:.3f}",
        "at an end": "{saturated:percent}",
        "range used": "{used:percent}",
        "logit error by it alone, mean": "{logit_mean:.4f}",
        "the largest": "{logit_max:.3f}",
    }
    print_records("how far integers are from float, stage by stage", stages, columns)


def _show_evaluation(result: dict[str, Any]) -> None:
    rows = [
        ("recordings", f"{result['recordings']}, of which {result['not_touched']} show no onset"),
        ("accuracy, float", percent(result["float_accuracy"])),
        ("accuracy, integer", percent(result["integer_accuracy"])),
        ("agreement", percent(result["agreement"])),
        ("chance", f"{percent(result['chance'])}, always naming the class that most recordings have"),
        ("logit error", _logit_error(result["logit_error"])),
        (
            "decided after",
            "never"
            if result["decision_time_s"] is None
            else f"{1e3 * result['decision_time_s']:.4g} ms, mean, integer",
        ),
    ]
    print_table("float against integer", "what", "value", rows=rows)
    _show_stages(result["stages"])
    columns = {
        "step": "{step}",
        "since the onset": "{time_s:1e3*.4g} ms",
        "float": "{float_accuracy:percent}",
        "integer": "{integer_accuracy:percent}",
    }
    print_records("local decision, step by step", result["per_step"], columns)


@app.command(epilog="Example: eskin compare model --data recordings.npz --json compare.json")
def compare(
    model: ModelArgument,
    data: Annotated[
        str | None,
        option(f"{DATA} Default: made-up touches that reach every rule of the front end, or images."),
    ] = None,
    out: Annotated[Path, option("Folder of compare.html.")] = Path("build/compare"),
    json: JsonOption = None,
) -> None:
    """Set float against integer stage by stage: errors, saturations, and every signal against the range of
    its format."""
    from eskin.golden.model.image_network import image_recordings, random_images
    from eskin.golden.model.model import load_config
    from eskin.golden.model.vectors import random_recordings
    from eskin.golden.training.evaluate import compare_stages
    from eskin.pages.compare_page import PAGE, findings, render

    page = out / PAGE
    check_target(json)
    check_target(page)
    config = load_config(model)
    if data is None and config.is_image:
        messages.print("no --data: made-up images, which may use other parts of the ranges than real ones do")
        recordings = image_recordings(config, random_images(config, 64, 1))
    elif data is None:
        messages.print(
            "no --data: made-up touches, which may use other parts of the ranges than real ones do"
        )
        length = config.rest_level.rest_frames + 2 * config.last_frame + config.onset_rule.rearm_frames
        recordings = random_recordings(config, [length] * 12, 1)
    else:
        recordings = recordings_for(data, config)
    result = compare_stages(model, recordings)
    with replacing(page) as temporary:
        temporary.write_text(render(result), encoding="utf-8")
    if json:
        write_json(json, result)
    _show_stages(result["stages"])
    columns = {
        "signal": "{signal}",
        "format": "{format}",
        "range used": "{used:percent}",
        "become 0": "{zero:percent}",
        "saturate": "{beyond:percent}",
        "largest error": "{error_max:.3g}",
    }
    print_records("signals against their formats", result["signals"], columns)
    for sentence in findings(result):
        say(sentence)
    console.print(f"page: {escape(str(page))}")
