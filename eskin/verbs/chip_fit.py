"""`eskin asic --fit WxH`: how many lanes of a model, or with `--sweep FILE` which network of a sweep, fit so
many tiles.

Accuracies are those of the sweep, on recordings left out. Areas are of netlists with random numbers in the
places of weights: constants in ROMs that are trained take a little less. Netlists are kept
(`eskin.verbs.asic_job.CACHE`), so that an interrupted search goes on.
"""

import dataclasses
import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path

from eskin.golden.core import AcceleratorConfig, InputError, Progress, Record, replacing_folder, write_json
from eskin.golden.model import IntegerModel, random_integer_model
from eskin.pages.views import words
from eskin.rtl.asic.synthesis import process_of
from eskin.study.sweep import AWARE, HARDWARE, NETWORK, Point, make_points
from eskin.verbs import asic_job

MARK, PAGE = "fit.json", "fit.md"
SEED = 1
"""Of the numbers that stand for weights."""
AreaOf = Callable[[IntegerModel], float]
"""um2 of a model with a chip's configuration."""


def tiles_of(text: str) -> tuple[int, int]:
    """(wide, high) of ``8x2``.

    Raises
    ------
    InputError
    """
    sides = re.fullmatch(r"([1-9]\d?)x([1-9]\d?)", text)
    if sides is None:
        raise InputError(f"--fit {text}: is not of the form WxH; give tiles of Tiny Tapeout, such as 8x2")
    return int(sides[1]), int(sides[2])


def areas(pdk: str, paths: Sequence[Path], *, latches: bool = True) -> AreaOf:
    """Areas in a process, by synthesis."""
    process = process_of(pdk, asic_job.libraries_of(paths)["typ"])
    return lambda model: asic_job.netlist_of(model.config, model.arrays, process, latches=latches).area_um2(
        process
    )


def fitted(model: IntegerModel, tiles: str, area_of: AreaOf) -> tuple[IntegerModel, list[dict[str, float]]]:
    """The model with the most lanes of its own, half of them and so on, that fit; what was tried: lanes,
    area_um2, tiles_filled."""
    room, lanes = asic_job.room_um2(*tiles_of(tiles)), model.config.hardware.lanes
    tried: list[dict[str, float]] = []
    while not tried or (tried[-1]["tiles_filled"] > 1 and lanes > 1):
        lanes = lanes // 2 if tried else lanes
        model = dataclasses.replace(model, config=model.config.with_lanes(lanes))
        area = area_of(model)
        tried.append({"lanes": lanes, "area_um2": area, "tiles_filled": area / room})
    return model, tried


def points_of(path: Path) -> list[tuple[Point, Record]]:
    """Points of a sweep, each with its row of sweep.json.

    Raises
    ------
    InputError
        The file is no result of `eskin sweep` over recurrent or linear networks.
    """
    try:
        sweep = json.loads(path.read_text())
        base, rows = AcceleratorConfig.from_dict(sweep["base"]), sweep["points"]
        for row in rows:
            row["config"]["cell"], row["widths"], float(row["accuracy"]), float(row["standard_error"])
    except OSError as error:
        raise InputError(
            f"--sweep {path}: {error.strerror}; give the sweep.json that eskin sweep wrote"
        ) from None
    except (ValueError, KeyError, TypeError):
        raise InputError(
            f"--sweep {path}: is no result of eskin sweep; give the sweep.json that it wrote"
        ) from None
    if base.network.cell == "image":
        raise InputError(
            f"--sweep {path}: is of images, and chips are for linear, GRU and LSTM; give another sweep"
        )
    if not rows:
        raise InputError(f"--sweep {path}: has no point; sweep at least one network")
    return [(_point(base, row, path), row) for row in rows]


def _point(base: AcceleratorConfig, row: Record, path: Path) -> Point:
    config = row["config"]
    linear = config["cell"] == "linear"  # has no units and no reset gate
    names = [name for name in (*NETWORK, AWARE, *HARDWARE) if not (linear and name in ("hidden", "reset"))]
    return make_points(base, [{name: config[name] for name in names} | row["widths"]], f"--sweep {path}")[0]


def searched(
    points: Sequence[tuple[Point, Record]],
    tiles: str,
    area_of: AreaOf,
    *,
    rom: bool,
    lanes: int | None = None,
    progress: Progress | None = None,
) -> Record:
    """Each network's area against the tiles' room, the most accurate that fits, and the smallest that is not
    worse by more than a standard error. A network is not synthesised where the same with fewer hidden units
    does not fit.

    Parameters
    ----------
    lanes:
        Instead of the points' own; each network once.

    Returns
    -------
    rows (name, accuracy, standard_error, area_um2 or None, filled or None, fits), the largest area last; best
    and chosen: places in rows, or None where nothing fits; room_um2.
    """
    room = asic_job.room_um2(*tiles_of(tiles))
    if lanes is not None:
        changed = (
            (dataclasses.replace(point, config=point.config.with_lanes(lanes, "plain")), row)
            for point, row in points
        )
        points = list({point.name: (point, row) for point, row in changed}.values())
    report = progress or (lambda what, done, total: None)
    rows: list[Record] = []
    misfits: set[str] = set()  # networks but for their hidden units, of which a smaller one did not fit
    for number, (point, judged) in enumerate(
        sorted(points, key=lambda point: point[0].config.network.hidden)
    ):
        report("netlists", number, len(points))
        alike = json.dumps({name: value for name, value in point.to_dict().items() if name != "hidden"})
        row: Record = {"name": point.name, "config": point.to_dict()} | {
            name: judged[name] for name in ("accuracy", "standard_error", "cycles_step")
        }
        area = None
        if alike not in misfits:
            config = asic_job.chip_config(point.config, point.config.hardware.lanes, rom)
            area = area_of(random_integer_model(config, SEED))
        fits = area is not None and area <= room
        if not fits:
            misfits.add(alike)
        rows.append(row | {"area_um2": area, "filled": area and area / room, "fits": fits})
    report("netlists", len(points), len(points))
    rows.sort(key=lambda row: (row["area_um2"] is None, row["area_um2"] or 0.0, row["name"]))
    fitting = [number for number, row in enumerate(rows) if row["fits"]]
    best = max(fitting, key=lambda number: rows[number]["accuracy"], default=None)
    chosen = None
    if best is not None:
        enough = rows[best]["accuracy"] - rows[best]["standard_error"]
        chosen = next(number for number in fitting if rows[number]["accuracy"] >= enough)
    return {"rows": rows, "best": best, "chosen": chosen, "room_um2": room}


def write(result: Record, out: Path) -> None:
    """fit.json and its table, in one exchange."""
    with replacing_folder(out) as folder:
        (folder / PAGE).write_text(words("fit", **result))
        write_json(folder / MARK, result)
