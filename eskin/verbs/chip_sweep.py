"""Chips of one model side by side: processes, lanes, constants in ROMs and loadable; what is kept is not made
again.

``python -m eskin.verbs.chip_sweep MODEL --process ihp-sg13g2 cells.lib sram.lib --process sky130hd
cells.lib.gz`` prints area, clock, energy and glitches; ``--more`` adds glitches of equal delays, and energies
and clock without wires. ``--play 3`` plays so many recordings into each chip from random contents instead,
and one into each with one wrong cell. Rows are kept in ``--out``.
"""

import argparse
import dataclasses
import tempfile
import time
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from eskin.cosim.gate_flow import SIMULATOR
from eskin.data import load_recordings
from eskin.golden.core import Memo, Record, code_version, content_key
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel
from eskin.pages.views import Rows, tables, words
from eskin.verbs import asic_job
from eskin.verbs.chip_energy import with_touches
from eskin.verbs.flow import cosimulate

FLIPPED = 5
"""Seed of the cell that is made wrong."""


@dataclasses.dataclass(frozen=True)
class ChipRequest:
    """A chip: its process and Liberty files, lanes, constants in ROMs."""

    pdk: str
    liberty: tuple[Path, ...]
    lanes: int
    rom: bool


def figures_of(asked: ChipRequest, model: IntegerModel, recordings: Recordings, *, more: bool) -> Record:
    """`asic.json`; with ``more`` also ``unit_glitches`` and ``without_wires`` (step_j, interval_j, fmax_hz of
    the typical corner)."""
    model = dataclasses.replace(model, config=asic_job.chip_config(model.config, asked.lanes, asked.rom))

    def made(**options: Any) -> Record:
        return asic_job.asic(model, asked.pdk, asked.liberty, recordings=recordings, **options)[0]

    result = made()
    if more:
        bare = made(wire_load="")
        result["unit_glitches"] = made(delays="unit")["energy"]["glitches"]
        result["without_wires"] = {name: bare["energy"][name] for name in ("step_j", "interval_j")}
        result["without_wires"] |= {"fmax_hz": bare["fmax_hz"]["typ"]}
    return result


def played(
    asked: ChipRequest, model: IntegerModel, recordings: Recordings, numbers: np.ndarray, *, placed: bool
) -> Record:
    """Values compared and mismatches, with probes and, where asked, as ``placed``; mismatches with one wrong
    cell."""
    begun = time.monotonic()
    liberty = [str(path) for path in asked.liberty]

    def play(count: int, **more: Any) -> Record:
        chip = {"pdk": asked.pdk, "liberty": liberty, "rom": asked.rom} | more
        options: Record = {"level": "netlist", "target": "asic", "simulator": SIMULATOR, "lanes": asked.lanes}
        with tempfile.TemporaryDirectory() as work:
            some, at = recordings.subset(list(range(count))), numbers[:count].tolist()
            return cosimulate(model, some, **options, numbers=at, chip=chip, work=Path(work))

    whole, wrong = play(len(recordings), placed=placed), play(1, placed=False, flipped=FLIPPED)
    row = {
        "pdk": asked.pdk,
        "lanes": asked.lanes,
        "rom": asked.rom,
        "flipped_mismatches": wrong["mismatches"],
    }
    for name in ("recordings", "steps", "decisions", "compared_values", "mismatches", "stages"):
        row[name] = whole[name]
    for name in ("compared_values", "mismatches") if placed else ():
        row[f"placed_{name}"] = whole["without_probes"][name]
    return row | {"seconds": round(time.monotonic() - begun)}


def held(row: Record) -> bool:
    """No decision differs; of a chip that was played no value does, and its wrong cell was seen."""
    if "energy" in row:
        return not row["energy"]["mismatches"]
    exact = row["compared_values"] and not row["mismatches"] and not row.get("placed_mismatches")
    return bool(exact and row["flipped_mismatches"])


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit status 1 where a chip has not `held`."""
    parser = argparse.ArgumentParser(
        prog="python -m eskin.verbs.chip_sweep", description=__doc__.splitlines()[0]
    )
    parser.add_argument("model", type=Path)
    parser.add_argument("--process", nargs="+", action="append", required=True, metavar="NAME FILE ...")
    parser.add_argument("--data", default="synthetic-easy")
    parser.add_argument("--lanes", type=int, nargs="+", default=[1, 4])
    parser.add_argument("--constants", nargs="+", choices=["rom", "loaded"], default=["rom", "loaded"])
    parser.add_argument("--out", type=Path, default=Path("build/chip_sweep"))
    parser.add_argument(
        "--more", action="store_true", help="also glitches of equal delays, and all without wires"
    )
    parser.add_argument(
        "--play", type=int, metavar="N", help="recordings to play into each chip; its figures are not made"
    )
    parser.add_argument(
        "--windows", type=int, default=10**6, help="with --play: of each touch, then it is cut"
    )
    parser.add_argument(
        "--placed", action="store_true", help="with --play: also netlists without probes, as placed"
    )
    options = parser.parse_args(arguments)
    model, recordings = IntegerModel.load(options.model), load_recordings(options.data)
    if options.play:
        numbers, recordings = with_touches(model, recordings, options.play, options.windows)
    memo, version, rows = Memo(options.out), code_version("golden", "rtl", "cosim"), []
    for (pdk, *files), lanes, constants in product(options.process, options.lanes, options.constants):
        chip = ChipRequest(pdk, tuple(map(Path, files)), lanes, constants == "rom")

        def made(chip: ChipRequest = chip) -> Record:
            if options.play:
                return played(chip, model, recordings, numbers, placed=options.placed)
            return figures_of(chip, model, recordings, more=options.more)

        also = (options.play, options.placed, options.more)
        rows.append(
            memo.remembered(
                content_key(version, model, recordings, *chip.liberty, pdk, lanes, constants, also), made
            )
        )
        print(
            f"{pdk}, {lanes} lanes, {constants}: {'held' if held(rows[-1]) else 'has mismatches'}", flush=True
        )
    if options.play:
        (table,) = tables(words("chips_played", rows=rows))
    else:
        chips = [next(tables(words("asic", **row, more=options.more))).cells for row in rows]
        lines = [(cells[0][0], *(text for _, text in cells)) for cells in zip(*chips, strict=True)]
        table = Rows("chips, before layout", ("", *map(str, range(1, 1 + len(rows)))), lines)
    Console(width=160).print(table.drawn())
    return int(not all(map(held, rows)))


if __name__ == "__main__":
    raise SystemExit(main())
