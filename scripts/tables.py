"""Tables of the cost of designs for docs/figures.md: ``python -m scripts.tables TABLE [ROW ...]`` prints one
table, row by row. The networks have random weights; no figure depends on them.

figures [TABLE ...]
    Replace these tables of docs/figures.md (default: all that this program makes) and the commit beside each.

designs [PRESET ...]
    Of each preset a GRU of 12 with 1 and 4 DSP lanes and a linear cell with 4, placed with seeds 1 to 3.
    Energy and power are the estimate of ``eskin build``: a touch with all its frames; waiting with a clock
    that stops between samples.
buses [SHELL ...]
    Bus shells: cells of the whole design (preset ``thesis``, one lane) less those of the bare one; the
    highest clock of one placement (seed 1) with registers around all ports.
features [KINDS ...]
    Kinds of feature on the PVDF preset; frame, frame_plain: most cycles of a frame that ends a window, and of
    another.
runs FOLDER ...
    Results of ``eskin run``, a row per result folder.
stress FOLDER ...
    Of each result folder, or model folder of ``eskin train``, the network that clean accuracy alone would choose and
    the one chosen, under the panel of ``--stress``.
steps
    Cycles of a step against the ideal, formats of preset ``thesis``.
checks
    Checksum and watchdog, placed once, with the link, which tells the faults.
readouts
    Prototypes in place of the dense layer's decision, preset ``pvdf`` on one lane, placed once; three places to be
    taught. Teaching: cycles of one touch's pass over the memory, and as many cycles of a step in joules.

Cells are Yosys' counts on an iCE40 UP5K before placement where nothing else is said, onset to decision
without the serial link.
"""

import json
import re
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from eskin.choose.choice_table import front_end_words, network_name
from eskin.choose.networks import network
from eskin.golden.core import PRESETS, AcceleratorConfig, Record
from eskin.rtl.fpga.implementation import place
from eskin.rtl.fpga.synthesis import ICE40, Chain, Harness, PoweredOn, synthesise
from eskin.rtl.fpga.targets import target
from eskin.rtl.program.memory_map import prototype_words
from eskin.rtl.program.schedule import decision_cycles, frame_cycles, schedule
from eskin.rtl.top.bus_top import BusTop
from eskin.verbs import build_job
from tests.support.random_models import random_integer_model

PAGE = Path(__file__).resolve().parents[1] / "docs" / "figures.md"
BOARD, LANES = "icebreaker", 4
READOUTS = {
    "dense": 0,
    "3 prototypes": 3,
    "8 prototypes": 8,
    "dense, checksum": 0,
    "3 prototypes, checksum": 3,
    "dense, last": 0,
    "3 prototypes, last": 3,
}
"""Prototypes a class; by name with a checksum, or a decision by the last step in place of the preset's votes."""
TAUGHT: Record = {"readout": "prototypes", "taught": 3, "state_code_bits": 4, "state_code_shift": 9}
SCENES = ("thesis", "synthetic", "pvdf")
ALL = ("mean", "activity", "integral")
FEATURES: dict[str, Record] = {
    "mean": {},
    "mean, a scale a taxel": {"feature_scale": "taxel"},
    "mean, activity (sum)": {"feature_kinds": ALL[:2]},
    "mean, activity (change)": {"feature_kinds": ALL[:2], "activity_rule": "change"},
    "mean, integral": {"feature_kinds": ("mean", "integral")},
    "all": {"feature_kinds": ALL},
    "all, a scale a taxel": {"feature_kinds": ALL, "feature_scale": "taxel"},
    "activity (sum)": {"feature_kinds": ("activity",)},
    "integral": {"feature_kinds": ("integral",)},
}
"""Changes to the preset by the name of the row."""
BUSES: dict[str, Record] = {
    "Wishbone": {"bus": "wishbone"},
    "AXI4-Lite": {"bus": "axi4lite"},
    "Wishbone, frames from a stream": {"bus": "wishbone", "axis": True},
}

CHECKS = {
    "neither": (),
    "checksum": ("checksum",),
    "watchdog": ("watchdog",),
    "both": ("checksum", "watchdog"),
}
"""Fields that are on, by the name of the row."""

Row = tuple[Any, ...]
Table = Literal["designs", "buses", "features", "readouts", "steps", "runs", "stress", "checks", "figures"]


CELLS = dict(
    lut="SB_LUT4", carry="SB_CARRY", ff="SB_DFF", bram="SB_RAM40_4K", spram="SB_SPRAM", dsp="SB_MAC16"
)
"""Beginnings of the names of the cells that a column counts."""


def cells_of(design: Any) -> dict[str, int]:
    """Cells by kind."""
    with tempfile.TemporaryDirectory() as folder:
        counts = synthesise(design, ICE40, Path(folder)).cells.items()
    return {kind: sum(n for cell, n in counts if cell.startswith(name)) for kind, name in CELLS.items()}


# ---------------------------------------------------------------------- designs
def built(config: AcceleratorConfig, **options: Any) -> Record:
    """Result of ``eskin build`` for a random model on the board."""
    model = random_integer_model(config, 1)
    of_model: Record = {"config": model.config, "arrays": model.arrays}
    request = build_job.BuildRequest(target=target(BOARD), lanes_asked=True, **of_model, **options)
    return build_job.build(request)[0]


def placed(config: AcceleratorConfig, seeds: int = 3) -> Row:
    """Columns behind the first, of a design on the board; and the energy of a step."""
    try:
        result = built(config, link=False, seeds=seeds)
    except build_job.BuildError as misfit:
        return (misfit,)
    energy = result["energy"]
    activity = energy["activity"]
    touch_j = energy["per_touch_j"] + energy["preprocessing_per_touch_j"]
    return (
        result["logic_cells"],
        f"{result['bram']} + {result['spram']}",
        ", ".join(f"{1e-6 * hertz:.1f}" for hertz in result["seeds"].values()),
        f"{activity['frame_cycles']:.1f}",
        f"{activity['quiet_frame_cycles']:.1f}",
        activity["step_cycles"],
        f"{1e6 * touch_j:.2f} uJ",
        f"{1e6 * energy['choices'][1]['idle_w']:.1f} uW",
        energy["per_step_j"],
    )


def design_rows(asked: Sequence[str]) -> Iterator[Row]:
    """Every design of every scene."""
    for name in asked or SCENES:
        front = PRESETS[name].replace(feature_shift=())
        gru = network(front, "gru", 12)
        for config, lanes in ((gru, 1), (gru, LANES), (network(front, "linear", None), LANES)):
            yield f"{name}, {config.network.cell}, P = {lanes}", *placed(config.with_lanes(lanes, "dsp"))[:8]


# ---------------------------------------------------------------------- buses
def clock_mhz(design: Any) -> str:
    """Highest clock of one placement."""
    board = target(BOARD)
    sites = (board.clock_pin, *board.pins)
    pins = dict(zip(("clk", "shift_in", "capture", "shift_out"), sites, strict=False))
    with tempfile.TemporaryDirectory() as folder:
        netlist = synthesise(PoweredOn(Harness(design)), ICE40, Path(folder))
        return f"{place(netlist, board, pins, Path(folder) / 'placed', seed=1).fmax_hz / 1e6:.1f}"


def bus_rows(asked: Sequence[str]) -> Iterator[Row]:
    """The bare design, then every shell."""
    config = random_integer_model(PRESETS["thesis"].replace(lanes=1), 1).config
    bare = cells_of(Chain(config))
    yield "none (the whole design)", bare["lut"], bare["ff"], clock_mhz(Chain(config))
    for name in asked or BUSES:
        cells = cells_of(BusTop(config, **BUSES[name]))
        more = (cells[kind] - bare[kind] for kind in ("lut", "ff"))
        yield name, *more, clock_mhz(BusTop(config, **BUSES[name]))


# ---------------------------------------------------------------------- features, checks
def feature_rows(asked: Sequence[str]) -> Iterator[Row]:
    """Every set of kinds."""
    base = PRESETS["pvdf"].replace(lanes=LANES, lane_type="dsp", activity_block=24)
    for name in asked or FEATURES:
        config = random_integer_model(base.replace(**FEATURES[name]), 1).config
        plan, cells = schedule(config), cells_of(Chain(config))
        frames = frame_cycles(config), frame_cycles(config, ends_window=False)
        kinds = (cells[kind] for kind in ("lut", "carry", "ff", "bram", "spram", "dsp"))
        yield name, *kinds, config.inputs, config.multiplies, plan.step_cycles, plan.decision_cycles, *frames


def check_rows(asked: Sequence[str]) -> Iterator[Row]:
    """With and without checksum and watchdog. Without the link nobody reads the faults, and what finds them
    is not there either."""
    base = PRESETS["thesis"].with_lanes(LANES, "dsp")
    for name, fields in CHECKS.items():
        cells = built(base.replace(**dict.fromkeys(fields, True)))
        yield name, *(cells[kind] for kind in ("logic_cells", "ff", "bram")), cells["cycles"]["step"]


def readout_rows(asked: Sequence[str]) -> Iterator[Row]:
    """The dense layer and prototypes."""
    for name in asked or READOUTS:
        base = PRESETS["pvdf"].with_lanes(1, "dsp").replace(checksum=name.endswith("checksum"))
        if name.endswith("last"):
            base = base.replace(decision="last")
        if count := READOUTS[name]:
            base = base.with_readout(prototypes=count, **TAUGHT)
        cells, memories, mhz, _, _, step, touch, waiting, step_j = placed(base, seeds=1)
        config, teaching = random_integer_model(base, 1).config, "-"
        if count:
            pass_cycles = prototype_words(config) + config.windows.steps
            teaching = f"{pass_cycles} cycles, {1e6 * pass_cycles * step_j / step:.2f} uJ"
        yield name, cells, memories, mhz, f"{step}, {decision_cycles(config)}", touch, teaching, waiting


def run_rows(asked: Sequence[str]) -> Iterator[Row]:
    """A row of each result folder of ``eskin run``."""
    for folder in map(Path, asked):
        names = "run.json", "cosim.json", "cosim_declared.json", "model/training.json"
        run, played, paced, training = (json.loads((folder / name).read_text()) for name in names)
        chosen = next(row for row in run["candidates"] if row["chosen"])
        split, cycles = training["cross_validation"][0], paced["cycles"]["decision_latency_max"]
        source, network = Path(run["data"]["source"]), f"{chosen['cell']} {chosen['hidden'] or ''}".strip()
        yield (
            f"{source.parent.name or source}, {run['data']['recordings']}",
            ", ".join(split["groups"]),
            f"{network}, {chosen['front_end_words']}".replace("|", "\\|"),
            *(f"{100 * split['nested'][kind]:.1f} %" for kind in ("integer_accuracy", "float_accuracy")),
            *(f"{100 * split[kind]:.1f} %" for kind in ("integer_accuracy", "agreement")),
            f"{1e6 * chosen['energy_touch_j']:.2f} uJ",
            *(chosen[kind] for kind in ("cells", "block_memories")),
            f"{chosen['decision_time_s']:.2f} s",
            f"{played['compared_values']}, {played['mismatches']} differ",
            f"{1e6 * cycles / paced['clock_hz']:.2f} us",
            f"{1e-3 * run['lowest_clock_hz']:.0f} kHz",
        )


def stress_rows(asked: Sequence[str]) -> Iterator[Row]:
    """Two rows of each folder: without and with the panel."""
    for folder in map(Path, asked):
        found = [path for path in (folder / "model/training.json", folder / "training.json") if path.exists()]
        training = json.loads(found[0].read_text())
        groups = ", ".join(training["cross_validation"][0]["groups"])
        for kind in ("calm", "chosen"):
            row = next(row for row in training["candidates"] if row[kind])
            held = sum(mode["held"] for mode in row["stress"])
            yield (
                f"{folder.name}, {groups}",
                "off" if kind == "calm" else "on",
                f"{network_name(row)}, {front_end_words(row['front_end'])}",
                *(f"{100 * row[name]:.1f} %" for name in ("accuracy", "stressed_accuracy")),
                f"{row['worst']['mode']}, {100 * row['worst']['figure']:.0f} %",
                f"{held} of {len(row['stress'])}",
                f"{1e6 * row['energy_touch_j']:.2f} uJ",
                row["cells"],
            )


def step_rows(asked: Sequence[str]) -> Iterator[Row]:
    """Cells, three sizes and 1 to 12 lanes."""
    base = PRESETS["thesis"]
    cells = (("gru", "before"), ("gru", "after"), ("lstm", "before"))
    for (cell, reset), (taxels, hidden, classes) in product(cells, ((16, 12, 3), (8, 8, 5), (64, 32, 32))):
        names = tuple(f"class{k}" for k in range(classes))
        sized = base.replace(cell=cell, reset=reset, taxels=taxels, hidden=hidden, class_names=names)
        for lanes in (1, 2, 4, 6, 12):
            plan = schedule(sized.replace(lanes=lanes))
            ideal = plan.config.step_ideal
            yield (
                f"{cell.upper()} reset {reset}" if cell == "gru" else "LSTM",
                *(taxels, hidden, classes, lanes, plan.step_cycles, ideal),
                *(f"{plan.step_cycles / ideal:.3f}", f"{100 * plan.busy_share:.1f} %", plan.decision_cycles),
            )


TABLES: dict[str, tuple[str, Callable[[Sequence[str]], Iterator[Row]]]] = {
    "designs": (
        "design | cells | memories | MHz | cycles a frame, touch | quiet | cycles a step | a touch | waiting",
        design_rows,
    ),
    "buses": ("shell | LUT | flip-flops | MHz", bus_rows),
    "features": (
        "features | lut | carry | ff | bram | spram | dsp | inputs | multiplies | step | decision | frame "
        "| frame_plain",
        feature_rows,
    ),
    "readouts": (
        "readout | cells | memories | MHz | cycles a step, to the decision | a touch | teaching | waiting",
        readout_rows,
    ),
    "steps": (
        "cell | taxels | hidden | classes | lanes | cycles | ideal | ratio | busy share | features to decision",
        step_rows,
    ),
    "runs": (
        "recordings | left out | network | new, integer | new, float | own folds | agreement | a touch | cells "
        "| block memories | onset to decision | values compared | last sample to decision | lowest clock",
        run_rows,
    ),
    "stress": (
        "recordings, left out | `--stress` | network | clean | stressed | worst | held | energy of a touch | cells",
        stress_rows,
    ),
    "checks": ("checks | cells | flip-flops | block memories | cycles a step", check_rows),
}
"""Columns and rows of each table."""


MADE = re.compile(
    r"^Made by `python -m scripts\.tables ((\w+).*?)` at commit `\w+`\.\n\n(?:\|.*\n)+", re.MULTILINE
)
"""A table of docs/figures.md, from the line that says how it was made."""


def printed(columns: str, rows: Iterable[Row]) -> Iterator[str]:
    """The lines of a table, as they are known."""
    yield f"| {columns} |"
    yield "| --- |" + " --: |" * columns.count("|")
    for row in rows:
        yield "| " + " | ".join(map(str, row)) + " |"


def lines(table: str, *asked: str) -> Iterator[str]:
    """`printed` of a table of TABLES."""
    columns, rows = TABLES[table]
    return printed(columns, rows(asked))


def rewritten(page: str, chosen: Sequence[str], commit: str) -> str:
    """``page`` with new tables in place of those whose names are ``chosen`` (none: all)."""

    def made(found: re.Match[str]) -> str:
        if chosen and found[2] not in chosen:
            return found[0]
        table = "".join(line + "\n" for line in lines(*found[1].split()))
        return f"Made by `python -m scripts.tables {found[1]}` at commit `{commit}`.\n\n{table}"

    return MADE.sub(made, page)


def main(table: Table, rows: Annotated[list[str] | None, typer.Argument()] = None) -> None:
    """Print the table row by row, or write the page of figures."""
    if table != "figures":
        for line in lines(table, *(rows or ())):
            print(line, flush=True)
        return
    asked = ["git", "rev-parse", "--short=8", "HEAD"]
    commit = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()
    PAGE.write_text(rewritten(PAGE.read_text(), rows or [], commit))


if __name__ == "__main__":
    main.__doc__ = __doc__
    typer.run(main)
