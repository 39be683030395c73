"""The report of a run: one self-contained HTML page, and the same in brief for the terminal.

Both are made from the files of a result folder alone, so they can be made again at any time. Every figure on
the page stands in one of
these files:

run.json               the data, the configuration and why, the checks, the clocks, the wall times
evaluate.json          float against integer, the network that was exported, on all recordings
cosim.json             co-simulation at full pace: every stage compared
cosim_declared.json    at the sensor's pace: latency and budgets at the configured clock
cosim_lowest.json      the same at the lowest clock that meets every budget; absent when none was found
model/config.json, model/training.json    configuration with every format; cross-validation, profiled ranges
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import jinja2
import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from pydantic import Field

from eskin.choose.choice_table import (
    decides_early,
    front_end_table,
    network_name,
    where_it_fails,
    windows_brief,
)
from eskin.cosim.results import Played
from eskin.golden.core import AcceleratorConfig, InputError, Record
from eskin.golden.model import load_config
from eskin.pages.charts import CHOSEN, SCANS, STYLE, draw_costs, log_axis, svg
from eskin.pages.result import OnLanes, Run
from eskin.pages.views import page, short_name, tables, words, write_text
from eskin.training.evaluate import Evaluation
from eskin.training.formats import describe_formats
from eskin.training.record import CandidateRow, FrontEndRow, FrontEndRows, Judged, Network, Split, Training

PAGE = "report.html"
AGAIN = "name a folder that 'eskin run' wrote, or run it again"
CONFUSED_WITH = 3
"""Number of wrong decisions that are listed for a class."""


# ---------------------------------------------------------------------- the files
class Validated(Training):
    """Of a network that was cross-validated."""

    cross_validation: Annotated[Sequence[Split], Field(min_length=1)]


@contextmanager
def well_formed(folder: Path) -> Iterator[None]:
    """Turn errors about fields of another size than a run writes into one sentence."""
    try:
        yield
    except InputError:
        raise
    except (
        TypeError,
        ValueError,
        LookupError,
        AttributeError,
        ArithmeticError,
        jinja2.TemplateError,
    ) as error:
        raise InputError(
            f"result '{folder}': a field of its files has another size than 'eskin run' writes ({error}); {AGAIN}"
        ) from error


# ---------------------------------------------------------------------- figures in words
def _split_name(split: Judged, things: str = "recordings") -> str:
    """Words for the recordings of a figure: "unseen", or only "left out" if the network was chosen on
    them."""
    groups = " + ".join(split.groups)
    if isinstance(split, Split) and split.searched:
        return f"{groups or things} left out"
    return f"unseen {groups or things.removesuffix('s')}"


def _network(config: AcceleratorConfig) -> str:
    if config.is_image:
        return config.name
    gru = f", reset {config.network.reset} the product" if config.network.cell == "gru" else ""
    return network_name(Network.of(config)) + (", weights of every window" if config.sets > 1 else gru)


def confusions(split: Split, class_names: Sequence[str]) -> list[Record]:
    """Class by class, the least often found first: {name, share found, others: the most frequent wrong
    decisions, {name, share}}."""
    table = np.array(split.confusion, dtype=float)
    shares = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
    names = [*class_names, "none"]
    rows = []
    for index, name in enumerate(class_names):
        confused = [
            {"name": names[decided], "share": float(shares[index, decided])}
            for decided in np.argsort(-shares[index], kind="stable")
            if decided != index and shares[index, decided] > 0
        ]
        rows.append({"name": name, "share": float(shares[index, index]), "others": confused[:CONFUSED_WITH]})
    return sorted(rows, key=lambda row: row["share"])


# ---------------------------------------------------------------------- charts
def fewer_scans(front_end: FrontEndRows) -> list[FrontEndRow]:
    """For each ``scan_every`` that was judged the cheapest front end that ties with the best; where none does, the
    most accurate."""
    rows = [front_end.chosen, *front_end.rivals]
    found = []
    for every in sorted({row.scan_every for row in rows}):
        alike = sorted((row for row in rows if row.scan_every == every), key=lambda row: row.energy_touch_j)
        found.append(next((row for row in alike if row.level), max(alike, key=lambda row: row.accuracy)))
    return found


AXES = {
    "energy_touch_j": ("energy of a touch", " (µJ)", 1e6),
    "average_w": ("average power", " (µW)", 1e6),
    "latency_s": ("last sample to decision", " (µs)", 1e6),
    "cells": ("logic cells", "", 1),
}
"""Costs that accuracy is drawn against: name, unit, and what a row's figure is multiplied with for it."""


def draw_candidates(
    rows: Sequence[CandidateRow],
    front_end: FrontEndRows | None = None,
    down: Sequence[float] = (),
    cost: str = "energy_touch_j",
) -> Figure:
    """Accuracy of every candidate against a cost of AXES (`eskin.pages.charts.draw_costs`). Crosses, of energy alone, show what
    `fewer_scans` buy: front ends alone, by the linear classifier that chose among them. down: accuracies to which a
    line leads from the chosen one, mean and worst under disturbance."""
    board = next((row.fits for row in rows if row.fits), None)
    figure = Figure(figsize=(10.4, 3.6), layout="constrained")
    axes = figure.subplots()
    name, symbol, factor = AXES[cost]
    draw_costs(axes, rows, [factor * getattr(row, cost) for row in rows], name + symbol, down)
    scans = fewer_scans(front_end) if front_end and cost == "energy_touch_j" else []
    if len(scans) > 1:
        places = [(1e6 * row.energy_touch_j, row.accuracy) for row in scans]
        axes.plot(*zip(*places, strict=True), ":x", color=SCANS, linewidth=0.8, zorder=1)
        for row, place in zip(scans, places, strict=True):
            under: Record = {"textcoords": "offset points", "fontsize": 7, "color": SCANS}
            axes.annotate(f"1/{row.scan_every}", place, (3, -9), **under)
    filled = f"filled: fits the {board}" if board else "hollow: fits no board"
    lines = "; line down: under disturbance, mean and worst, on folds that chose nothing" * bool(down)
    crosses = "\ncrosses: front ends alone, one frame in k scanned" * (len(scans) > 1)
    axes.set_title(f"grey: the best at each cost; {filled}{lines}{crosses}")
    return figure


def draw_lanes(rows: Sequence[OnLanes], lanes: int) -> Figure:
    """Logic cells against the time to a decision of one network, a point for each number of lanes; the point of
    ``lanes`` is filled."""
    figure = Figure(figsize=(10.4, 3.6), layout="constrained")
    axes = figure.subplots()
    places = [(1e6 * row.latency_s, row.cells) for row in rows]
    axes.plot(*zip(*places, strict=True), "o-", color=CHOSEN, linewidth=0.8, markerfacecolor="white")
    for row, place in zip(rows, places, strict=True):
        axes.annotate(str(row.lanes), place, (4, 5), textcoords="offset points", fontsize=8)
        if row.lanes == lanes:
            axes.plot(*place, "o", color=CHOSEN)
    log_axis(axes)
    axes.set(xlabel="last sample or pixel to decision (µs)", ylabel="logic cells")
    axes.set_title(f"number: lanes; filled: the {lanes} of this result")
    return figure


# ---------------------------------------------------------------------- the page
def write_report(folder: str | Path) -> Path:
    """Make ``report.html`` in a result folder from the other files in it.

    Returns
    -------
    Path of the page: one file, nothing outside it is needed to show it.

    Raises
    ------
    InputError
        When a file is missing, damaged, or lacks a field or array; an existing page stays as it was.
    """
    folder = Path(folder)
    with well_formed(folder):
        text = _render(_values(folder))
    write_text(path := folder / PAGE, text)
    return path


def _values(folder: Path) -> Record:
    """Values of page and summary: what the files hold, and figures and functions of them."""
    if not folder.is_dir():
        raise InputError(f"result '{folder}': is not a folder; name the one that 'eskin run' wrote")
    run = Run.read(folder / "run.json", AGAIN)
    training = Validated.read(folder / "model/training.json", AGAIN)
    config = load_config(folder / "model")
    played = lambda name: Played.read(folder / f"{name}.json", AGAIN)
    declared = None if config.is_image else played("cosim_declared")
    lowest = None if config.is_image or run.lowest_clock_hz is None else played("cosim_lowest")
    return {
        "run": run,
        "evaluate": Evaluation.read(folder / "evaluate.json", AGAIN),
        "cosim": played("cosim"),
        "declared": declared,
        "lowest": lowest,
        "training": training,
        "config": config,
        "things": "images" if config.is_image else "recordings",
        "network": _network(config),
        "splits": training.cross_validation,
        "nested": [split.nested for split in training.cross_validation if split.nested],
        "split_name": _split_name,
        "candidates": run.priced,
        "fails": where_it_fails(run.priced, run),
        "early": decides_early(run.priced),
        "network_name": network_name,
        "windows_brief": windows_brief,
    }


def _render(values: Record) -> str:
    config: AcceleratorConfig = values["config"]
    run: Run = values["run"]
    front_end = run.front_end
    (cards,) = tables(words("cards", **values))
    values |= {
        "parts": [*tables(words("parts", **values)), None][0],
        "name": run.name or short_name(run.data.source),
        "data": run.data,
        "cards": [dict(zip(("title", "value", "note"), cells, strict=True)) for cells in cards.cells],
        "confusions": lambda split: confusions(split, config.network.class_names),
    }
    down = (
        [run.stressed_accuracy, min(row.figure for row in run.stress)]
        if values["fails"] and run.stress and run.stressed_accuracy is not None
        else []
    )
    with rc_context(STYLE):
        charts = {
            AXES[cost][0]: svg(draw_candidates(run.priced, front_end, down, cost))
            for cost in AXES
            if run.priced
        }
        if run.lanes:
            charts["lanes"] = svg(draw_lanes(run.lanes, config.hardware.lanes))
    values["charts"] = charts
    if config.is_image:
        errors = {row.stage: row for row in values["evaluate"].stages}
        values["candidates"] = run.candidates
        return page("images.html.j2", **values, errors=errors, formats=describe_formats(config))
    return page(
        "report.html.j2",
        **values,
        runs=[played for played in (values["cosim"], values["declared"], values["lowest"]) if played],
        front_end=front_end,
        front_ends=front_end_table(front_end) if front_end else [],
        baselines=run.baselines,
        test=run.test,
        warnings=run.warnings,
        ranges=values["training"].ranges,
        short_network=network_name(Network.of(config)),
        failed=[check for check in run.checks if not check.held],
    )


def summary(folder: str | Path) -> str:
    """The result in brief for the terminal, as Markdown (`eskin.pages.views`).

    Raises
    ------
    InputError
        As ``write_report``.
    """
    with well_formed(Path(folder)):
        return words("summary", **_values(Path(folder)))
