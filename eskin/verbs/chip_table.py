"""Every kind of chip of one model, played from random contents: lanes, ROM and loadable, processes; and each with one wrong cell.

``python -m eskin.verbs.chip_table MODEL --process ihp-sg13g2 cells.lib sram.lib --process sky130hd cells.lib.gz`` prints the table
and keeps its rows in ``--out``; a row whose design and recordings are those of an earlier call is not played again.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from eskin.cosim.gate_flow import SIMULATOR
from eskin.golden.core.errors import InputError
from eskin.golden.data.load import load_recordings
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.model import IntegerModel
from eskin.golden.model.pipeline import find_touches
from eskin.verbs.chip_energy import cut_short
from eskin.verbs.chip_grid import chip_parser, rows_of
from eskin.verbs.flow import cosimulate

FLIPPED = 5
"""Seed of the cell that is made wrong."""


def begun_touches(model: IntegerModel, recordings: Recordings, count: int, windows: int) -> tuple[np.ndarray, Recordings]:
    """``count`` recordings with a touch, spread over the classes, each cut where ``windows`` of its windows are complete.

    Raises
    ------
    InputError
        None has so many.
    """
    config = model.config
    touches = find_touches(config, recordings)
    windows = min(windows, config.windows.steps)
    last = config.window_spans[windows - 1][1]
    ends = {}
    for number, touch in enumerate(touches.first_touch()):
        if touch >= 0 and touches.completed[touch] >= windows:
            ends[number] = min(int(touches.start_frame[touch]) + last + config.windows.pretrigger_frames, int(recordings.lengths[number]))
    if not ends:
        raise InputError(f"recordings '{recordings.source}': none has a touch with {windows} windows; ask for fewer")
    return cut_short(recordings, ends, count)


def row_of(
    model: IntegerModel,
    recordings: Recordings,
    numbers: np.ndarray,
    pdk: str,
    liberty: Sequence[Path],
    lanes: int,
    rom: bool,
    *,
    placed: bool,
) -> dict[str, Any]:
    """One chip: values compared and mismatches, with probes and, where asked, as ``placed``; mismatches with one wrong cell."""
    begun, row = time.monotonic(), {"pdk": pdk, "lanes": lanes, "rom": rom}
    chip: dict[str, Any] = {"pdk": pdk, "liberty": [str(path) for path in liberty], "rom": rom, "placed": placed}
    for wrong in (False, True):
        with tempfile.TemporaryDirectory() as work:
            options: dict[str, Any] = {"level": "netlist", "target": "asic", "simulator": SIMULATOR, "lanes": lanes, "numbers": numbers}
            if wrong:
                one = recordings.subset([0])
                found = cosimulate(
                    model, one, **options | {"numbers": numbers[:1]}, work=Path(work), chip=chip | {"flipped": FLIPPED, "placed": False}
                )
                row |= {"flipped_mismatches": found["mismatches"]}
                continue
            found = cosimulate(model, recordings, **options, work=Path(work), chip=chip)
        row |= {"recordings": found["recordings"], "steps": found["steps"], "decisions": found["decisions"]}
        row |= {"compared_values": found["compared_values"], "mismatches": found["mismatches"], "stages": found["stages"]}
        if placed:
            row |= {f"placed_{name}": found["without_probes"][name] for name in ("compared_values", "mismatches")}
    return row | {"seconds": round(time.monotonic() - begun)}


def shown(rows: Sequence[dict[str, Any]]) -> Table:
    """The table."""
    table = Table("process", "lanes", "constants", "recordings, steps", "values, mismatches", "as placed", "one cell wrong", "s")
    for row in rows:
        table.add_row(
            row["pdk"],
            str(row["lanes"]),
            "ROM" if row["rom"] else "loaded",
            f"{row['recordings']}, {row['steps']}",
            f"{row['compared_values']}, {row['mismatches']}",
            f"{row['placed_compared_values']}, {row['placed_mismatches']}" if "placed_mismatches" in row else "not asked",
            f"{row['flipped_mismatches']} mismatches",
            str(row["seconds"]),
        )
    return table


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit status 1 where a value differs, or a wrong cell is not seen."""
    parser = chip_parser("chip_table", __doc__)
    parser.add_argument("--recordings", type=int, default=3)
    parser.add_argument("--windows", type=int, default=10**6, help="of each touch, then the recording is cut; default: all of a touch")
    parser.add_argument("--placed", action="store_true", help="also the netlists without probes, as they would be placed")
    asked = parser.parse_args(arguments)
    model = IntegerModel.load(asked.model)
    numbers, recordings = begun_touches(model, load_recordings(asked.data), asked.recordings, asked.windows)

    def chip(pdk: str, liberty: Sequence[Path], lanes: int, rom: bool) -> dict[str, Any]:
        return row_of(model, recordings, numbers, pdk, liberty, lanes, rom, placed=asked.placed)

    rows = rows_of(
        asked, model, recordings, chip, also=asked.placed, told=lambda row: f"{row['mismatches']} mismatches, {row['seconds']} s"
    )
    Console(width=130).print(shown(rows))
    exact = all(row["compared_values"] and not row["mismatches"] and not row.get("placed_mismatches") for row in rows)
    return int(not exact or not all(row["flipped_mismatches"] for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
