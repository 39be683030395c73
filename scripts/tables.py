"""Tables of the cost of designs for docs/figures.md: ``python -m scripts.tables TABLE [ROW ...]`` prints one
table, row by row. The networks have random weights; no figure depends on them.

figures [TABLE ...]
    Replace these tables of docs/figures.md (default: all that this program makes) and the commit beside each.

designs [PRESET ...]
    Of each preset a GRU of 12 with 1 and 4 DSP lanes and a linear cell with 4, placed with seeds 1 to 3.
    Energy and power are the estimate of ``eskin build``: a touch with all its frames; waiting with a clock
    that stops between samples.
parts [PART ...]
    What one part adds to the PVDF preset, a GRU of 12 with 4 DSP lanes; the most cycles of a frame.
runs RESULT ...
    Every figure of a result that README.md, docs/results.md and docs/figures.md quote, a table for each page:
    result folders of ``eskin run`` of recordings and of images, which this checkout's code made, baselines.json
    of examples/thesis/run.py and the JSON of ``eskin enrol --evaluate``, in the order of the rows.
stress FOLDER ...
    Of each result folder, or model folder of ``eskin train``, the network that clean accuracy alone would choose and
    the chosen network, under the panel of ``--stress``.
steps [CELL ...]
    Cycles of a step against the ideal, formats of preset ``thesis``.

Cells are Yosys' counts on an iCE40 UP5K before placement where nothing else is said, onset to decision
without the serial link.
"""

import json
import re
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import typer

from eskin.choose.choice_table import front_end_words, network_name
from eskin.choose.networks import network
from eskin.cosim.results import Played
from eskin.golden.core import PRESETS, AcceleratorConfig, Record
from eskin.pages.result import Run
from eskin.pages.views import GAP, count, percent, verdict
from eskin.rtl.fpga.synthesis import ICE40, synthesise
from eskin.rtl.fpga.targets import target
from eskin.rtl.program.schedule import frame_cycles, schedule, step_cycles
from eskin.rtl.top.accelerator import Accelerator
from eskin.study.energy import CR2032_J, DAY_S
from eskin.training.record import CandidateRow, training_of
from eskin.verbs.build import BuildRequest, build
from eskin.verbs.run_job import CODE
from scripts import ROOT
from tests.support.random_models import random_integer_model

PAGE = ROOT / "docs" / "figures.md"
BOARD, LANES = target("icebreaker"), 4
PARTS: dict[str, Record] = {
    "none": {},
    "activity": {"feature_kinds": ("mean", "activity"), "activity_block": 24},
    "integral": {"feature_kinds": ("mean", "integral")},
    "fault detector": {"fault_frames": 256, "fault_activity": 64},
    "onset in 3 of 4 checks": {"onset_hits": 3, "onset_span": 4},
    "checksum": {"checksum": True},
    "watchdog": {"watchdog": True},
    "3 prototypes, 3 taught": {"readout": "prototypes", "prototypes": 3, "taught": 3},
}
"""Changes to the preset by the name of the row."""
STEPS = {
    "GRU reset before": {"cell": "gru", "reset": "before"},
    "GRU reset after": {"cell": "gru", "reset": "after"},
    "LSTM": {"cell": "lstm"},
}
CELLS = dict(
    lut="SB_LUT4", carry="SB_CARRY", ff="SB_DFF", bram="SB_RAM40_4K", spram="SB_SPRAM", dsp="SB_MAC16"
)
"""Beginnings of the names of the cells that a column counts."""
Row = tuple[Any, ...]


def cells_of(design: Any, **options: Any) -> dict[str, int]:
    """Cells by kind; options of `synthesise`."""
    with tempfile.TemporaryDirectory() as folder:
        counts = synthesise(design, ICE40, Path(folder), **options).cells.items()
    return {kind: sum(n for cell, n in counts if cell.startswith(name)) for kind, name in CELLS.items()}


# ---------------------------------------------------------------------- the rows of one name of a table
def placed(config: AcceleratorConfig) -> Row:
    """Columns behind the first, of a design with random weights on the board."""
    model = random_integer_model(config, 1)
    of_model: Record = {"config": model.config, "arrays": model.arrays, "lanes_asked": True}
    request = BuildRequest(target=BOARD, link=False, seeds=3, **of_model)
    result = build(request)[0]
    energy = result.energy
    assert energy
    touch_j = energy.per_touch_j + energy.preprocessing_per_touch_j
    return (
        result.logic_cells,
        f"{result.bram} + {result.spram}",
        ", ".join(f"{1e-6 * hertz:.1f}" for hertz in result.seeds.values()),
        round(energy.activity.step_cycles),
        f"{1e6 * touch_j:.2f} uJ",
        f"{1e6 * energy.choices[1].idle_w:.1f} uW",
    )


def designs(preset: str) -> Iterator[Row]:
    """Every design of a preset."""
    front = PRESETS[preset].replace(feature_shift=())
    gru, linear = network(front, "gru", 12), network(front, "linear", None)
    for config, lanes in ((gru, 1), (gru, LANES), (linear, LANES)):
        yield f"{preset}, {config.network.cell}, P = {lanes}", *placed(config.with_lanes(lanes, "dsp"))
    forest = network(front, "trees", None).replace(trees=16, depth=8, nodes=1024)
    yield f"{preset}, 16 trees of depth 8, 1024 nodes", *placed(forest.with_lanes(1, "dsp"))


def parts(name: str) -> Iterator[Row]:
    """The preset with one part."""
    base = PRESETS["pvdf"].with_lanes(LANES, "dsp")
    config = random_integer_model(base.replace(**PARTS[name]), 1).config
    cells = cells_of(Accelerator(config), hidden=("probe",)).values()
    yield name, *cells, frame_cycles(config), step_cycles(config)


def run_figures(folder: Path, run: Run) -> Record:
    """Figures of a result folder of ``eskin run`` by column."""
    pace = "cosim.json" if run.images else "cosim_declared.json"
    training = training_of(folder / "model")
    played, paced = (Played.read(folder / file, "run it again") for file in ("cosim.json", pace))
    split, source = training.cross_validation[0], Path(run.data.source)
    chosen = next(row for row in run.candidates or [] if row.chosen)
    late = paced.cycles.decision_latency_max
    figures = {
        "recordings": f"{source.parent.name or source}, {run.data.recordings}",
        "left out in turn": ", ".join(split.groups) or "recordings",
        "network": network_name(chosen),
        "own folds": percent(split.integer_accuracy),
        "standard error": percent((split.nested or chosen).standard_error),
        "agreement": percent(split.agreement),
        "hardware equals model": f"{verdict(played)}, {count(played.compared_values)} values",
        "last sample to decision": "no decision" if late is None else f"{1e6 * late / paced.clock_hz:.3g} us",
    }
    if not isinstance(chosen, CandidateRow):
        return figures
    return figures | {
        "accuracy on new ones": percent(split.unseen.integer_accuracy),
        "new, float": percent(split.unseen.float_accuracy),
        "front end": chosen.front_end_words.replace("|", "\\|"),
        "energy of a touch": f"{1e6 * chosen.energy_touch_j:.2f} uJ",
        "average power": f"{1e6 * chosen.average_w:.0f} uW",
        "CR2032": f"{CR2032_J / chosen.average_w / DAY_S:.0f} days",
        "cells": chosen.cells,
        "block memories": chosen.block_memories,
        "onset to decision": f"{chosen.decision_time_s:.2f} s",
        "lowest clock": f"{1e-3 * (run.lowest_clock_hz or 0):.0f} kHz",
    }


def quoted(names: Iterable[str]) -> Iterator[str]:
    """The lines of ``runs``.

    Raises
    ------
    typer.BadParameter
        Other code than this checkout's made a result.
    """
    tables: dict[str, list[Record]] = {}
    for path in map(Path, names):
        result = json.loads((path / "run.json" if path.is_dir() else path).read_text())
        if path.is_dir() and result.get("code") != CODE():
            raise typer.BadParameter(f"{path}: other code than this checkout's made it; run it again")
        if path.is_dir():
            figures = run_figures(path, Run.model_validate(result))
            for page, columns in PAGES.items() if "cells" in figures else [("docs/images.md", figures)]:
                row = {column: figures[column] for column in columns or figures}
                tables.setdefault(page, []).append(row)
        for touches, row in result.get("mean", {}).items():
            head = {"recordings": result["data"], "readout": result["readout"], "touches": touches}
            shares = {name: percent(share) for name, share in row.items()}
            tables.setdefault("docs/enrolment.md", []).append(head | shares)
        for row in result.get("rows", []) if "left_out" in result else []:
            columns = ("split", "label", "hardware", "multiplies")
            row = {"accuracy": percent(row["accuracy"])} | {column: row[column] for column in columns}
            tables.setdefault("docs/results.md, methods", []).append({"recordings": result["data"]} | row)
    for page, rows in tables.items():
        yield f"\n{page}, commit {commit()}\n"
        for line in printed(" | ".join(rows[0]), (tuple(row.values()) for row in rows)):
            yield line.replace(GAP, " ")


def stress(name: str) -> Iterator[Row]:
    """Two rows of a folder: without and with the panel."""
    training = training_of(next(Path(name).glob("**/training.json")).parent)
    for panel, kind in (("off", "calm"), ("on", "chosen")):
        row = next(row for row in training.priced if getattr(row, kind))
        assert row.worst
        yield (
            f"{Path(name).name}, {', '.join(training.cross_validation[0].groups)}",
            panel,
            f"{network_name(row)}, {front_end_words(row.front_end)}",
            *(f"{100 * (share or 0):.1f} %" for share in (row.accuracy, row.stressed_accuracy)),
            f"{row.worst.mode}, {100 * row.worst.figure:.0f} %",
            f"{sum(mode.held for mode in row.stress)} of {len(row.stress)}",
            f"{1e6 * row.energy_touch_j:.2f} uJ",
            row.cells,
        )


def steps(name: str) -> Iterator[Row]:
    """A cell in two sizes and with 1 to 12 lanes."""
    for (taxels, hidden, classes), lanes in product(((16, 12, 3), (64, 32, 32)), (1, 4, 6, 12)):
        names = tuple(f"class{k}" for k in range(classes))
        sized = STEPS[name] | {"taxels": taxels, "hidden": hidden, "class_names": names, "lanes": lanes}
        plan = schedule(PRESETS["thesis"].replace(**sized))
        ideal = plan.config.step_ideal
        counts = (plan.step_cycles, ideal, f"{plan.step_cycles / ideal:.3f}", plan.decision_cycles)
        yield (name, taxels, hidden, classes, lanes, *counts)


TABLES: dict[str, Any] = {
    "designs": (
        designs,
        ("thesis", "pvdf"),
        "design | cells | memories | MHz | cycles a step | a touch | waiting",
    ),
    "parts": (parts, PARTS, "part | lut | carry | ff | bram | spram | dsp | cycles a frame | a step"),
    "steps": (
        steps,
        STEPS,
        "cell | taxels | hidden | classes | lanes | cycles | ideal | ratio | features to decision",
    ),
    "stress": (
        stress,
        (),
        "recordings, left out | `--stress` | network | clean | stressed | worst | held | energy of a touch | cells",
    ),
}
"""Of each table the rows of a name, its names, its columns."""
NETWORK = ("recordings", "left out in turn", "network", "accuracy on new ones")
COST = ("energy of a touch", "average power", "CR2032", "last sample to decision")
PAGES: dict[str, tuple[str, ...]] = {
    "README.md": (*NETWORK, *COST, "hardware equals model"),
    "docs/results.md": (*NETWORK, "new, float", "own folds", "standard error", *COST),
    "docs/figures.md": (),
}
"""Columns of each page's table of `quoted`; none: all."""
MADE = re.compile(
    r"^Made by `python -m scripts\.tables ((\w+).*?)` at commit `[\w-]+`\.\n\n(?:\|.*\n)+", re.MULTILINE
)
"""A table of docs/figures.md, from the line that says how it was made."""


def printed(columns: str, rows: Iterable[Row]) -> Iterator[str]:
    """The lines of a table, as they are known."""
    yield f"| {columns} |"
    yield "| --- |" + " --: |" * columns.count("|")
    for row in rows:
        yield "| " + " | ".join(map(str, row)) + " |"


def lines(table: str, *chosen: str) -> Iterator[str]:
    """`printed` of a table of TABLES."""
    rows_of, names, columns = TABLES[table]
    return printed(columns, (row for name in chosen or names for row in rows_of(name)))


def rewritten(page: str, chosen: Iterable[str], commit: str) -> str:
    """``page`` with new tables in place of those whose names are ``chosen`` (none: all)."""

    def made(found: re.Match[str]) -> str:
        if chosen and found[2] not in chosen:
            return found[0]
        table = "".join(line + "\n" for line in lines(*found[1].split()))
        return f"Made by `python -m scripts.tables {found[1]}` at commit `{commit}`.\n\n{table}"

    return MADE.sub(made, page)


def commit() -> str:
    """The checkout's; with -dirty behind it where files differ from it."""
    words = "git describe --always --dirty --abbrev=8 --exclude *"
    return subprocess.check_output(words.split(), text=True, cwd=ROOT).strip()


def main(table: str, rows: Annotated[list[str] | None, typer.Argument()] = None) -> None:
    """Print the table row by row, or write the page of figures."""
    if table not in (*TABLES, "runs", "figures"):
        raise typer.BadParameter(f"give one of {', '.join(TABLES)}, runs, figures")
    if table != "figures":
        for line in quoted(rows or ()) if table == "runs" else lines(table, *(rows or ())):
            print(line, flush=True)
        return
    PAGE.write_text(rewritten(PAGE.read_text(), rows or [], commit()))


if __name__ == "__main__":
    main.__doc__ = __doc__
    typer.run(main)
