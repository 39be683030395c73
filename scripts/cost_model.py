"""Counted netlists of many shapes, and the constants of the cost model that they give.

``python -m scripts.cost_model`` prints a row for each of DESIGNS, then the constants and the error of the
model, for each design also with constants fitted without it. One recording with a whole touch is played into
the netlist of the board; what was counted before is kept. ``--fit FILE`` reads the rows out of a document
instead, which takes a second.

Weights and signals are random: the model is of shapes, not of what was learnt.
"""

import re
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import typer
from scipy.optimize import nnls

from eskin.golden.core import AcceleratorConfig, Record, content_key
from eskin.golden.data import Recordings
from eskin.memo import Memo, code_version
from eskin.rtl.fpga.targets import target
from eskin.rtl.program.schedule import step_cycles
from eskin.study.energy import PARTS
from eskin.study.touch_ends import with_touches
from eskin.training.formats import with_network
from eskin.verbs.build import suited
from eskin.verbs.cosim import BUILD
from eskin.verbs.cost import BOARD, CELLS, parts_of
from eskin.verbs.energy import measure
from scripts.tables import printed
from tests.support.random_models import random_integer_model

TRACKED: Record = dict(rest="tracked", rest_frames=64, onset="baseline", onset_threshold=60)
AT_ONCE: Record = dict(rest="none", rest_frames=0, onset="immediate")
TOGGLES = "STEP_TOGGLES", "FRAME_TOGGLES", "ONSET_TOGGLES", "FOLLOWING_TOGGLES"
NAME = re.compile(r"(\d+) taxels, (.+), (linear|GRU|LSTM) ?(\d*)(, at once)?(?:, whole by (\d+))?, P = (\d+)")


def _design(name: str, classes: int, hop: int, steps: int, block: int = 1) -> AcceleratorConfig:
    """What the name says, with so many classes, windows of two hops, and frames in a block of activity. Windows of a
    whole touch have at most so many hops; the longest touch doubles the hop twice."""
    taxels, kinds, cell, hidden, at_once, whole, lanes = NAME.fullmatch(name).groups()  # type: ignore[union-attr]
    config = AcceleratorConfig.of(
        name="counted",
        taxels=int(taxels),
        sample_rate_hz=1000.0,
        sample_bits=16,
        window_mode="whole" if whole else "free",
        store_per_window=int(whole or 2),
        touch_frames=3 * hop * steps * int(whole or 2),
        hop=hop,
        window=2 * hop,
        steps=steps,
        class_names=tuple(f"class{number}" for number in range(classes)),
        feature_kinds=tuple(kinds.replace("all kinds", "mean + activity + integral").split(" + ")),
        activity_block=block,
        lanes=int(lanes),
        **(AT_ONCE if at_once else TRACKED),
    )
    return with_network(config, cell=cell.lower(), hidden=int(hidden or 0) or None)


SHAPES = {
    "16 taxels, mean, linear, P = 4": (3, 48, 10),
    "16 taxels, mean, GRU 8, P = 4": (3, 24, 20),
    "8 taxels, mean + activity, linear, P = 2": (5, 64, 20, 16),
    "8 taxels, all kinds, GRU 4, P = 1": (5, 32, 10),
    "19 taxels, mean, linear, at once, P = 4": (20, 28, 19),
    "32 taxels, mean, GRU 12, P = 6": (4, 32, 10),
    "4 taxels, all kinds, linear, P = 1": (2, 64, 20),
    "64 taxels, mean, linear, P = 4": (7, 16, 10),
    "12 taxels, mean + integral, LSTM 6, at once, P = 2": (3, 40, 8),
    "16 taxels, all kinds, GRU 16, P = 6": (6, 32, 20),
    "8 taxels, mean, linear, whole by 8, P = 4": (5, 4, 20),
    "19 taxels, mean, linear, at once, whole by 8, P = 4": (20, 2, 20),
    "16 taxels, mean, linear, at once, whole by 8, P = 4": (7, 4, 20),
    "12 taxels, mean + activity, GRU 8, whole by 4, P = 4": (4, 4, 8, 4),
    "8 taxels, all kinds, linear, whole by 4, P = 2": (5, 4, 12, 2),
    "4 taxels, mean, linear, whole by 8, P = 1": (3, 8, 2),
    "32 taxels, mean, GRU 12, whole by 2, P = 6": (4, 4, 16),
    "8 taxels, mean + highest + lowest, linear, P = 2": (5, 64, 12),
    "12 taxels, mean + activity + highest + lowest, linear, at once, P = 2": (5, 32, 10, 8),
    "8 taxels, mean + highest + lowest, linear, whole by 4, P = 2": (5, 4, 12),
    "12 taxels, mean + highest + lowest, linear, at once, whole by 8, P = 4": (5, 4, 8),
}
DESIGNS = {name: _design(name, *shape) for name, shape in SHAPES.items()}
"""Shapes that no data set of the project has given."""

COLUMNS = "frames | cycles a frame | steps | cycles a step | counted uJ | LUT | block memories".split(" | ")


def played(config: AcceleratorConfig) -> Recordings:
    """One recording with a whole touch: rest and noise, then a slow swing of every taxel."""
    rng, sensor = np.random.default_rng(1), config.sensor
    quiet = config.rest_level.rest_frames + 3 * config.windows.hop + config.windows.pretrigger_frames
    frames = quiet + config.last_frame + max(3 * config.windows.hop, 64)
    since = np.maximum(np.arange(frames) - quiet, 0)[:, None] / config.last_frame
    phase, depth = rng.uniform(0, 2 * np.pi, sensor.taxels), rng.uniform(0.5, 1.5, sensor.taxels)
    swing = np.minimum(40 * since, 1) * (2 + np.sin(12 * since + phase)) * depth
    strength = 4.0 * config.onset_rule.onset_threshold
    codes = (1 << (sensor.sample_bits - 1)) + strength * swing + rng.normal(0, 4, (frames, sensor.taxels))
    return Recordings.of(
        [np.rint(codes).astype(np.int32)],
        [0],
        sample_rate_hz=sensor.sample_rate_hz,
        class_names=config.network.class_names,
    )


def counted(name: str, config: AcceleratorConfig) -> list[float]:
    """The row of a design: `COLUMNS`.

    Raises
    ------
    RuntimeError
        The netlist differs from the model.
    """
    model = random_integer_model(suited(config, target(BOARD)), 1)
    config, hardware = model.config, model.config.hardware
    numbers, recordings = with_touches(model, played(config), 1)
    lanes = (hardware.lanes, hardware.lane_type)
    with tempfile.TemporaryDirectory() as folder:
        found = measure(model, numbers, recordings, BOARD, *lanes, work=Path(folder))
    if not found.bit_exact:
        raise RuntimeError(f"{name}: the netlist differs from the model")
    cells = found.cells
    return [
        config.last_frame,
        found.activity.frame_cycles,
        config.windows.steps,
        step_cycles(config),
        1e6 * (found.per_touch_j + found.preprocessing_per_touch_j),
        cells["SB_LUT4"],
        sum(number for kind, number in cells.items() if kind.startswith("SB_RAM40_4K")),
    ]


def rows() -> pd.DataFrame:
    """The rows of `DESIGNS`, printed; from the memo where they are in it."""
    keep, made = Memo(BUILD / "cost_rows"), {}
    for name, config in DESIGNS.items():
        key = content_key(config, code_version("golden", "rtl", "cosim", "study", "verbs"))
        made[name] = keep.remembered(key, partial(counted, name, config))
        print(f"counted: {name}", file=sys.stderr)
    shown = ((name, *map("{:.4g}".format, row)) for name, row in made.items())
    print(*printed(" | ".join(["design", *COLUMNS]), shown), sep="\n")
    return pd.DataFrame(made, COLUMNS).T


def read_rows(document: str) -> pd.DataFrame:
    """The rows of `rows` that a document holds."""
    lines = (re.split(r"\s*\|\s*", line)[1:-1] for line in document.splitlines())
    found = {line[0]: line[1:] for line in lines if len(line) > len(COLUMNS) and line[0] in DESIGNS}
    return pd.DataFrame(found, COLUMNS).T.astype(float)


def shares(counted_rows: pd.DataFrame) -> tuple[pd.Series, np.ndarray, np.ndarray]:
    """A row for each counted design, as shares of the energy counted: energy of clock and products; energy of each
    toggle constant's unit. As shares of the cells counted: its `parts_of`."""
    part = PARTS[target(BOARD).device]
    configs = [suited(DESIGNS[name], target(BOARD)) for name in counted_rows.index]
    steps, frames = (
        counted_rows[f"{unit}s"] * counted_rows[f"cycles a {unit}"] for unit in ("step", "frame")
    )
    products = counted_rows["steps"] * [config.multiplies + config.inputs for config in configs]
    later = frames * [not config.opens_at_once for config in configs]
    following = frames * [config.follows_touch for config in configs]
    fixed = (steps + frames) * part.clock_j + products * part.multiply_j
    toggling = part.toggle_j * np.stack([steps, frames - following, later, following], axis=1)
    has = np.array([list(parts_of(config).values()) for config in configs])
    joule, cells = (counted_rows[[name]].to_numpy() for name in ("counted uJ", "LUT"))
    return fixed / (1e-6 * joule[:, 0]), toggling / (1e-6 * joule), has / cells


def fit(counted_rows: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """The constants of TOGGLES, and CELLS in their order: least squares of the errors as shares, none of CELLS
    below 0. The last two, of extremes, are fitted to what the others leave of designs that have some; these give
    nothing else."""
    fixed, toggling, has = shares(counted_rows)
    with_extremes = has[:, -2:].any(axis=1)
    toggling, due, plain = toggling[~with_extremes], 1 - fixed[~with_extremes], has[~with_extremes]
    cells = nnls(plain, np.ones(len(plain)))[0]
    cells[-2:] = nnls(has[with_extremes, -2:], 1 - has[with_extremes] @ cells)[0]
    return np.linalg.lstsq(toggling, due, rcond=None)[0], cells


def errors(counted_rows: pd.DataFrame, constants: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Errors of energy and cells of each design with these constants, as shares of the counted ones."""
    fixed, toggling, has = shares(counted_rows)
    return np.stack([fixed + toggling @ constants[0], has @ constants[1]]) - 1


def without_it(counted_rows: pd.DataFrame) -> np.ndarray:
    """`errors` of each design with constants fitted to the others."""
    each = [counted_rows.loc[[name]] for name in counted_rows.index]
    return np.hstack([errors(row, fit(counted_rows.drop(row.index))) for row in each])


def show(counted_rows: pd.DataFrame) -> None:
    """Print the constants and how far they are off."""
    constants = fit(counted_rows)
    print("\n" + ", ".join(map("{} {:.0f}".format, TOGGLES, constants[0])))
    print("CELLS " + ", ".join(map("{} {:.1f}".format, CELLS, constants[1])))
    each = np.stack([errors(counted_rows, constants), without_it(counted_rows)], axis=1).reshape(4, -1)
    shown = (map("{:+.1f} %".format, 100 * shares) for shares in each)
    columns = "design | energy | by the others | LUT | by the others"
    print("", *printed(columns, zip(counted_rows.index, *shown, strict=True)), sep="\n")


def main(fit: Path | None = None) -> None:
    """Print rows, constants and errors; with --fit FILE of the rows of a document."""
    show(read_rows(fit.read_text()) if fit else rows())


if __name__ == "__main__":
    typer.run(main)
