"""The page and the summary of a folder that `eskin run` wrote; of images they are made here, of recordings in report.py."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib import rc_context

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.files import replacing
from eskin.golden.model.model import describe_formats
from eskin.pages import report
from eskin.pages.report import PAGE, STYLE, confusions, count, draw_confusion, page_template, percent, read_json, seconds, svg

if TYPE_CHECKING:
    from rich.console import Group


def _files(folder: Path) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any], dict[str, Any], AcceleratorConfig]:
    run, evaluated, cosim = (read_json(folder / f"{name}.json") for name in ("run", "evaluate", "cosim"))
    training = read_json(folder / "model/training.json")
    config = AcceleratorConfig.from_dict(dict(read_json(folder / "model/config.json")), str(folder / "model/config.json"))
    return run, evaluated, cosim, training, config


def _cards(evaluated: dict[str, Any], cosim: dict[str, Any], training: dict[str, Any], config: AcceleratorConfig) -> list[dict[str, str]]:
    split, latency = training["cross_validation"][0], cosim["cycles"]["decision_latency_max"]
    hardware = "bit-exact" if cosim["bit_exact"] else "NOT bit-exact"
    guess = f"{split['folds']} folds; by chance {percent(evaluated['chance'])}"
    compared = f"{count(cosim['compared_values'])} values of {cosim['recordings']} images compared"
    return [
        {"title": "integer network, images left out", "value": percent(split["integer_accuracy"]), "note": guess},
        {"title": "agreement with float", "value": percent(split["agreement"]), "note": f"float {percent(split['float_accuracy'])}"},
        {"title": "hardware equals model", "value": hardware, "note": compared},
        {
            "title": "last pixel to decision",
            "value": seconds(latency / config.hardware.clock_hz),
            "note": f"{count(latency)} cycles at {config.hardware.clock_hz / 1e6:g} MHz, {config.hardware.lanes} lanes",
        },
    ]


def write_report(folder: str | Path) -> Path:
    """Make ``report.html`` in a result folder, of images or of recordings, as `eskin.pages.report.write_report`."""
    folder = Path(folder)
    if not _of_images(folder):
        return report.write_report(folder)
    with report.well_formed(folder):
        page = _render(folder)
    with replacing(folder / PAGE) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return folder / PAGE


def summary(folder: str | Path) -> Group:
    """The result in brief for the terminal, of images or of recordings, as a rich renderable."""
    folder = Path(folder)
    if not _of_images(folder):
        return report.summary(folder)
    with report.well_formed(folder):
        return _summary(folder)


def _of_images(folder: Path) -> bool:
    """True for a result of images, whose run.json says so."""
    return (folder / "run.json").is_file() and bool(read_json(folder / "run.json").get("images"))


def _render(folder: Path) -> str:
    run, evaluated, cosim, training, config = _files(folder)
    splits, names = training["cross_validation"], config.network.class_names
    with rc_context(STYLE):
        charts = {"confusion": svg(draw_confusion(splits, names, "images"))}
    return page_template("images.html.j2").render(
        name=Path(run["data"]["source"]).name,
        network=config.name,
        run=run,
        config=config,
        cards=_cards(evaluated, cosim, training, config),
        splits=splits,
        found=confusions(splits[0], names),
        candidates=run["candidates"] or [],
        layers=_layers(config, evaluated, run.get("layer_cycles", {})),
        cosim=cosim,
        charts=charts,
    )


def _layers(config: AcceleratorConfig, evaluated: dict[str, Any], cycles: dict[str, int]) -> list[dict[str, Any]]:
    """A row for each layer; what only those with weights have is empty for pools. cycles: by the layer's number, where they were kept."""
    errors = {row["stage"]: row for row in evaluated["stages"]}
    formats = describe_formats(config)
    rows = []
    for stage in config.stages:
        name = f"{stage.number} {stage.layer}"
        row: dict[str, Any] = {"layer": str(stage.layer), "result": " x ".join(map(str, stage.result)), "formats": formats.get(name, "")}
        row |= {"weights": stage.weights, "multiplies": stage.multiplies, "mean": "", "saturated": "", "logit_max": ""}
        row["cycles"] = count(cycles[str(stage.number)]) if str(stage.number) in cycles else ""
        if name in errors:
            error = errors[name]
            row |= {"mean": f"{error['mean']:.4f}", "saturated": percent(error["saturated"], 2), "logit_max": f"{error['logit_max']:.3f}"}
        rows.append(row)
    return rows


def _summary(folder: Path) -> Group:
    from rich.console import Group
    from rich.markup import escape
    from rich.table import Table

    run, evaluated, cosim, training, config = _files(folder)
    title = f"{escape(str(run['data']['source']))}: {run['data']['recordings']} images, {escape(config.name)}"
    cards = Table("what", "value", "", title=title, title_justify="left")
    for card in _cards(evaluated, cosim, training, config):
        cards.add_row(*(escape(card[key]) for key in ("title", "value", "note")))
    checks = Table("check", "", "", title="checks", title_justify="left")
    for check in run["checks"]:
        checks.add_row(escape(check["name"]), "held" if check["held"] else "NOT HELD", escape(check["detail"]))
    return Group(cards, checks, *map(escape, run["warnings"]))
