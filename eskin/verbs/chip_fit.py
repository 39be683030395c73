"""`eskin asic --fit WxH --sweep FILE`: which network of a sweep fits so many tiles of a chip, by synthesis of each, and how good it is.

Accuracies are those of the sweep, on recordings left out. Areas are of netlists with random numbers in the places of weights: constants in
ROMs that are trained take a little less. Netlists are kept (`eskin.verbs.asic_job.CACHE`), so that an interrupted search goes on.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.core.files import replacing_folder, write_json
from eskin.golden.model.model import random_integer_model
from eskin.golden.studies.sweep import AWARE, HARDWARE, NETWORK, Point, make_points
from eskin.rtl.asic.synthesis import process_of
from eskin.verbs import asic_job

MARK, PAGE = "fit.json", "fit.md"
SEED = 1
"""Of the numbers that stand for weights."""


def points_of(path: Path) -> list[tuple[Point, Mapping[str, Any]]]:
    """Points of a sweep, each with its row of sweep.json.

    Raises
    ------
    InputError
        The file is no result of `eskin sweep` over recurrent or linear networks.
    """
    try:
        found = json.loads(path.read_text())
        base = AcceleratorConfig.from_dict(found["base"])
        rows = [
            (row, row["config"]["cell"], row["widths"], float(row["accuracy"]), float(row["standard_error"])) for row in found["points"]
        ]
    except OSError as error:
        raise InputError(f"--sweep {path}: {error.strerror}; give the sweep.json that eskin sweep wrote") from None
    except (ValueError, KeyError, TypeError):
        raise InputError(f"--sweep {path}: is no result of eskin sweep; give the sweep.json that it wrote") from None
    if base.network.cell == "image":
        raise InputError(f"--sweep {path}: is of images, and chips are for linear, GRU and LSTM; give another sweep")
    if not rows:
        raise InputError(f"--sweep {path}: has no point; sweep at least one network")
    return [(_point(base, row, path), row) for row, *_ in rows]


def _point(base: AcceleratorConfig, row: Mapping[str, Any], path: Path) -> Point:
    config = row["config"]
    linear = config["cell"] == "linear"  # has no units and no reset gate
    asked = {name: config[name] for name in (*NETWORK, AWARE, *HARDWARE) if not (linear and name in ("hidden", "reset"))}
    return make_points(base, [asked | row["widths"]], f"--sweep {path}")[0]


def searched(
    points: Sequence[tuple[Point, Mapping[str, Any]]],
    room_um2: float,
    area_of: Callable[[AcceleratorConfig], float],
    *,
    rom: bool,
    progress: Callable[[str, int, int], None] | None = None,
) -> dict[str, Any]:
    """Each network's area against the room, the most accurate that fits, and the smallest that is not worse by more than a standard error.

    A network is not synthesised where the same with fewer hidden units does not fit.

    Parameters
    ----------
    area_of:
        um2 of a chip's configuration.

    Returns
    -------
    rows (name, accuracy, standard_error, area_um2 or None, filled or None, fits), the largest area last; best and chosen: places in rows,
    or None where nothing fits; room_um2.
    """
    rows: list[dict[str, Any]] = []
    too_small: dict[str, int] = {}  # hidden units of the smallest misfit among networks that differ in nothing else
    ordered = sorted(points, key=lambda point: point[0].config.network.hidden)
    for number, (point, judged) in enumerate(ordered):
        if progress is not None:
            progress("netlists", number, len(ordered))
        alike = json.dumps({name: value for name, value in point.to_dict().items() if name != "hidden"})
        row: dict[str, Any] = {"name": point.name, "config": point.to_dict()}
        row |= {name: judged[name] for name in ("accuracy", "standard_error", "cycles_step")} | {"area_um2": None, "filled": None}
        if alike not in too_small:
            row["area_um2"] = area_of(asic_job.chip_config(point.config, point.config.hardware.lanes, rom))
            row["filled"] = row["area_um2"] / room_um2
            if row["filled"] > 1:
                too_small[alike] = point.config.network.hidden
        row["fits"] = row["filled"] is not None and row["filled"] <= 1
        rows.append(row)
    if progress is not None:
        progress("netlists", len(ordered), len(ordered))
    rows.sort(key=lambda row: (row["area_um2"] is None, row["area_um2"] or 0.0, row["name"]))
    fitting = [number for number, row in enumerate(rows) if row["fits"]]
    best = max(fitting, key=lambda number: rows[number]["accuracy"], default=None)
    chosen = None
    if best is not None:
        enough = rows[best]["accuracy"] - rows[best]["standard_error"]
        chosen = next(number for number in fitting if rows[number]["accuracy"] >= enough)
    return {"rows": rows, "best": best, "chosen": chosen, "room_um2": room_um2}


def fit(
    sweep: Path,
    pdk: str,
    paths: Sequence[Path],
    tiles: str,
    *,
    lanes: int | None = None,
    rom: bool = False,
    latches: bool = True,
    progress: Callable[[str, int, int], None] | None = None,
) -> dict[str, Any]:
    """`searched` over a sweep's points in a process; ``lanes``: instead of the points' own, each network once.

    Raises
    ------
    InputError
        A sweep, Liberty file or number of tiles that cannot be used.
    """
    place, points = asic_job.tiles_of(tiles), points_of(sweep)
    process = process_of(pdk, asic_job.libraries_of(paths)["typ"])
    known = {cell.name: cell for cell in (*process.library.cells.values(), *process.macros)}
    if lanes is not None:
        changed = ((dataclasses.replace(point, config=point.config.with_lanes(lanes, "plain")), row) for point, row in points)
        points = list({point.name: (point, row) for point, row in changed}.values())

    def area_of(config: AcceleratorConfig) -> float:
        model = random_integer_model(config, SEED)
        netlist = asic_job.netlist_of(model.config, model.arrays, process, latches=latches)
        return sum(known[name.lstrip("\\")].area * number for name, number in netlist.cells.items())

    found = searched(points, asic_job.room_um2(*place), area_of, rom=rom, progress=progress)
    return {"tiles": tiles, "pdk": pdk, "rom": rom, "utilisation": asic_job.UTILISATION, "sweep": str(sweep), **found}


def table(result: Mapping[str, Any]) -> list[tuple[str, str, str, str, str]]:
    """Rows of words: network, accuracy, mm2, share of the room, what it is."""
    shown = []
    for number, row in enumerate(result["rows"]):
        area = "more" if row["area_um2"] is None else f"{row['area_um2'] / 1e6:.3f}"
        filled = "does not fit, as with fewer units" if row["filled"] is None else f"{100 * row['filled']:.0f} %"
        marks = [word for word, place in (("most accurate that fits", result["best"]), ("chosen", result["chosen"])) if place == number]
        error = f"{100 * row['accuracy']:.2f} +- {100 * row['standard_error']:.2f} %"
        shown.append((row["name"], error, area, filled, ", ".join(marks)))
    return shown


HEAD = ("network", "accuracy", "mm2", "of the cells' room", "")


def write(result: Mapping[str, Any], out: Path) -> None:
    """fit.json and its table, in one exchange."""
    rows = [HEAD, ("---",) * len(HEAD), *table(result)]
    text = "\n".join("| " + " | ".join(row) + " |" for row in rows)
    with replacing_folder(out) as folder:
        (folder / PAGE).write_text(f"# Networks in {result['tiles']} tiles\n\n{result['pdk']}\n\n{text}\n")
        write_json(folder / MARK, result)
