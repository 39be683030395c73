"""Counted netlists of many shapes, and the constants of the cost model that they give.

``python -m scripts.cost_model`` prints a row for each of DESIGNS, then the constants and the error of the
model, for each design also with constants fitted without it. One recording with a whole touch is played into
the netlist of the board; what was counted before is kept. ``--fit FILE`` reads the rows out of a document
instead, which takes a second.

Weights and signals are random: the model is of shapes, not of what was learnt.
"""

import argparse
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import nnls

from eskin.golden.core import AcceleratorConfig, Record, content_key
from eskin.golden.data import Recordings
from eskin.memo import Memo, code_version
from eskin.rtl.fpga.generate import generate
from eskin.rtl.fpga.targets import target
from eskin.rtl.program.schedule import step_cycles
from eskin.study.energy import PARTS, estimate
from eskin.training.formats import with_network
from eskin.verbs import energy_job
from eskin.verbs.build_job import suited
from eskin.verbs.chip_energy import with_touches
from eskin.verbs.cost import BOARD, CELLS, blocks_of, parts_of
from eskin.verbs.flow import BUILD, expected_of
from tests.support.random_models import random_integer_model

TRACKED: Record = dict(rest="tracked", rest_frames=64, onset="baseline", onset_threshold=60)
AT_ONCE: Record = dict(rest="none", rest_frames=0, onset="immediate")
ALL = ("mean", "activity", "integral")


def _design(taxels: int, classes: int, hop: int, steps: int, cell: str, hidden: int | None, **of: Any) -> Any:
    names = tuple(f"class{number}" for number in range(classes))
    config = AcceleratorConfig.of(
        name="counted",
        taxels=taxels,
        sample_rate_hz=1000.0,
        sample_bits=16,
        window_mode="free",
        pretrigger_frames=0,
        hop=hop,
        window=2 * hop,
        steps=steps,
        class_names=names,
        **of,
    )
    return with_network(config, cell=cell, hidden=hidden)


DESIGNS: dict[str, AcceleratorConfig] = {
    "16 taxels, mean, linear, P = 4": _design(16, 3, 48, 10, "linear", None, lanes=4, **TRACKED),
    "16 taxels, mean, GRU 8, P = 4": _design(16, 3, 24, 20, "gru", 8, lanes=4, **TRACKED),
    "8 taxels, mean + activity, linear, P = 2": _design(
        8, 5, 64, 20, "linear", None, lanes=2, feature_kinds=ALL[:2], activity_block=16, **TRACKED
    ),
    "8 taxels, all kinds, GRU 4, P = 1": _design(
        8, 5, 32, 10, "gru", 4, lanes=1, feature_kinds=ALL, **TRACKED
    ),
    "19 taxels, mean, linear, at once, P = 4": _design(19, 20, 28, 19, "linear", None, lanes=4, **AT_ONCE),
    "32 taxels, mean, GRU 12, P = 6": _design(32, 4, 32, 10, "gru", 12, lanes=6, **TRACKED),
    "4 taxels, all kinds, linear, P = 1": _design(
        4, 2, 64, 20, "linear", None, lanes=1, feature_kinds=ALL, **TRACKED
    ),
    "64 taxels, mean, linear, P = 4": _design(64, 7, 16, 10, "linear", None, lanes=4, **TRACKED),
    "12 taxels, mean + integral, LSTM 6, P = 2": _design(
        12, 3, 40, 8, "lstm", 6, lanes=2, feature_kinds=("mean", "integral"), **AT_ONCE
    ),
    "16 taxels, all kinds, GRU 16, P = 6": _design(
        16, 6, 32, 20, "gru", 16, lanes=6, feature_kinds=ALL, **TRACKED
    ),
}
"""Shapes that no data set of the project has given."""

COLUMNS = (
    "frames",
    "cycles a frame",
    "steps",
    "cycles a step",
    "multiplies a step",
    "toggles a frame",
    "toggles a step",
    "counted uJ",
    "LUT",
    "block memories",
)


def played(config: AcceleratorConfig) -> Recordings:
    """One recording with a whole touch: rest and noise, then a slow swing of every taxel."""
    rng, sensor = np.random.default_rng(1), config.sensor
    quiet = config.rest_level.rest_frames + 3 * config.windows.hop + config.windows.pretrigger_frames
    frames = quiet + config.last_frame + 3 * config.windows.hop
    since = np.maximum(np.arange(frames) - quiet, 0)[:, None] / config.last_frame
    phase, depth = rng.uniform(0, 2 * np.pi, sensor.taxels), rng.uniform(0.5, 1.5, sensor.taxels)
    swing = np.minimum(40 * since, 1) * (2 + np.sin(12 * since + phase)) * depth
    strength = 4.0 * config.onset_rule.onset_threshold
    codes = (1 << (sensor.sample_bits - 1)) + strength * swing + rng.normal(0, 4, (frames, sensor.taxels))
    return Recordings(
        np.rint(codes).astype(np.int32),
        np.array([0, frames]),
        np.zeros(1, int),
        config.network.class_names,
        sensor.sample_rate_hz,
    )


def counted(name: str, config: AcceleratorConfig) -> Record:
    """The row of a design: `COLUMNS`, and the name.

    Raises
    ------
    RuntimeError
        The netlist differs from the model.
    """
    model = random_integer_model(suited(config, target(BOARD)), 1)
    config = model.config
    recordings = with_touches(model, played(config), 1)[1]
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        design = generate(config, model.arrays, work / "design")
        vectors = expected_of(model, recordings, work / "vectors.npz", [0])
        activity, cells, exact = energy_job.counted(config, model, design, vectors, BOARD, 1, work=work)
    if not exact:
        raise RuntimeError(f"{name}: the netlist differs from the model")
    energy = estimate(config, target(BOARD).device, activity, config.hardware.clock_hz)
    joule = energy["per_touch_j"] + energy["preprocessing_per_touch_j"]
    figures = (
        config.last_frame,
        activity.frame_cycles,
        config.windows.steps,
        step_cycles(config),
        activity.step_multiplies,
        activity.frame_toggles,
        activity.step_toggles,
        1e6 * joule,
        cells["SB_LUT4"],
        sum(number for kind, number in cells.items() if kind.startswith("SB_RAM40_4K")),
    )
    return dict(zip(COLUMNS, figures, strict=True))


def rows(names: Sequence[str]) -> dict[str, Record]:
    """The rows of those designs, printed as soon as they are known, from the memo where they are in it."""
    keep, made = Memo(BUILD / "cost_rows"), {}
    print("| design | " + " | ".join(COLUMNS) + " |\n|---|" + "--:|" * len(COLUMNS), flush=True)
    for name in names:
        key = content_key(DESIGNS[name].to_dict(), code_version("golden", "rtl", "cosim"))
        made[name] = row = keep.remembered(key, partial(counted, name, DESIGNS[name]))
        print(f"| {name} | " + " | ".join(f"{row[column]:.4g}" for column in COLUMNS) + " |", flush=True)
    return made


def read_rows(document: str) -> dict[str, Record]:
    """The rows of `rows` that a document holds."""
    found = {}
    for line in document.splitlines():
        name, *cells = (cell.strip() for cell in line.strip("|").split("|"))
        if name in DESIGNS and len(cells) == len(COLUMNS):
            found[name] = dict(zip(COLUMNS, map(float, cells), strict=True))
    return found


def terms(name: str, row: Record) -> tuple[float, np.ndarray, np.ndarray]:
    """Energies of a counted design: joule of clock and products, joule of each toggle constant's unit, its `parts_of`."""
    part, config = PARTS[target(BOARD).device], suited(DESIGNS[name], target(BOARD))
    frames, steps = (row[what] * row[f"cycles a {what[:-1]}"] for what in ("frames", "steps"))
    products = row["steps"] * (config.multiplies + config.inputs)
    toggling = part.toggle_j * np.array([steps, frames, frames * (not config.opens_at_once)])
    fixed = (steps + frames) * part.clock_j + products * part.multiply_j
    return fixed, toggling, np.array(list(parts_of(config).values()))


def fit(counted_rows: dict[str, Record]) -> tuple[np.ndarray, np.ndarray]:
    """(STEP_TOGGLES, FRAME_TOGGLES, ONSET_TOGGLES), and CELLS in their order: least squares of the errors as
    shares, none of CELLS below 0."""
    fixed, toggling, has = map(np.array, zip(*map(terms, counted_rows, counted_rows.values()), strict=True))
    energy, cells = (np.array([row[key] for row in counted_rows.values()]) for key in ("counted uJ", "LUT"))
    energy = 1e-6 * energy
    toggles = np.linalg.lstsq(toggling / energy[:, None], 1 - fixed / energy, rcond=None)[0]
    return toggles, nnls(has / cells[:, None], np.ones(len(cells)))[0]


def errors(counted_rows: dict[str, Record], constants: tuple[np.ndarray, np.ndarray], name: str) -> Any:
    """Errors of energy and cells of a design with these constants, as shares of the counted ones."""
    (fixed, toggling, has), row = terms(name, counted_rows[name]), counted_rows[name]
    toggles, of_cells = constants
    return 1e6 * (fixed + toggling @ toggles) / row["counted uJ"] - 1, has @ of_cells / row["LUT"] - 1


def show(counted_rows: dict[str, Record]) -> None:
    """Print the constants and how far they are off."""
    constants = fit(counted_rows)
    print("\nSTEP_TOGGLES {:.0f}, FRAME_TOGGLES {:.0f}, ONSET_TOGGLES {:.0f}".format(*constants[0]))
    print(
        "CELLS " + ", ".join(f"{name} {count:.1f}" for name, count in zip(CELLS, constants[1], strict=True))
    )
    print(
        "\n| design | energy | by the others | LUT | by the others | block memories |\n|---|--:|--:|--:|--:|--:|"
    )
    for name, row in counted_rows.items():
        others = {other: row for other, row in counted_rows.items() if other != name}
        pairs = (errors(counted_rows, constants, name), errors(counted_rows, fit(others), name))
        shares = [f"{100 * pair[which]:+.1f} %" for which in (0, 1) for pair in pairs]
        blocks = f"{blocks_of(DESIGNS[name], BOARD)} of {row['block memories']:.0f}"
        print(f"| {name} | " + " | ".join([*shares, blocks]) + " |", flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print rows, constants and errors."""
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0], epilog="example: --fit docs/figures.md"
    )
    parser.add_argument("--designs", nargs="*", default=list(DESIGNS), help="by name (default: all)")
    parser.add_argument("--fit", type=Path, metavar="FILE", help="take the rows of a document")
    asked = parser.parse_args(arguments)
    show(read_rows(asked.fit.read_text()) if asked.fit else rows(asked.designs))


if __name__ == "__main__":
    main()
