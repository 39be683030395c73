"""What chips of one model take, side by side: area, clock, energy, glitches; and what of it hangs on delays and on wires.

``python -m eskin.verbs.chip_figures MODEL --process ihp-sg13g2 cells_typ.lib cells_slow.lib sram.lib`` prints a table of ROM and
loadable chips and keeps its rows in ``--out``. ``--more`` adds glitches of equal delays, and energies and clock without wires.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from eskin.golden.data.load import load_recordings
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.model import IntegerModel
from eskin.verbs import asic_job
from eskin.verbs.chip_grid import chip_parser, rows_of


def row_of(
    model: IntegerModel, recordings: Recordings, pdk: str, liberty: Sequence[Path], lanes: int, rom: bool, *, more: bool
) -> dict[str, Any]:
    """`asic.json` of one chip; with ``more`` also ``unit_glitches`` and ``without_wires`` (step_j, interval_j, fmax_hz of the typical
    corner)."""
    model = dataclasses.replace(model, config=asic_job.chip_config(model.config, lanes, rom))
    result, _ = asic_job.asic(model, pdk, liberty, recordings=recordings)
    if more:
        unit, _ = asic_job.asic(model, pdk, liberty, recordings=recordings, delays="unit")
        bare, _ = asic_job.asic(model, pdk, liberty, recordings=recordings, wire_load="")
        result["unit_glitches"] = unit["energy"]["glitches"]
        result["without_wires"] = {name: bare["energy"][name] for name in ("step_j", "interval_j")} | {"fmax_hz": bare["fmax_hz"]["typ"]}
    return result


def words_of(row: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Figures of a chip."""
    energy, fmax = row["energy"], row["fmax_hz"]
    glitches = energy["glitches"]
    parts = sorted(energy["interval_parts_j"].items(), key=lambda part: -part[1])[:4]
    kinds = sorted(row["area_by_kind_um2"].items(), key=lambda part: -part[1])
    clocks = [f"{fmax[corner] / 1e6:.1f} {corner}" if fmax[corner] else f"no file of {corner} cells" for corner in ("typ", "slow")]
    words = [
        ("area, mm2; kGE", f"{row['area_um2'] / 1e6:.3f}; {row['kge']:.1f}"),
        ("of it, mm2", ", ".join(f"{kind} {um2 / 1e6:.3f}" for kind, um2 in kinds)),
        ("flip-flops, latches, clock gates", f"{row['flip_flops']}, {row['latches']}, {row['clock_gates']}"),
        ("highest clock, MHz", ", ".join(clocks)),
        ("energies at, MHz", f"{energy['clock_hz'] / 1e6:.3g}"),
        ("leakage, uW", f"{energy['leakage_w'] * 1e6:.3g}"),
        ("a step, nJ", f"{energy['step_j'] * 1e9:.1f}"),
        ("glitches of a step, nJ", f"{glitches['step_j'] * 1e9:.1f}"),
        ("an interval, nJ", f"{energy['interval_j'] * 1e9:.0f}: " + ", ".join(f"{kind} {joule * 1e9:.0f}" for kind, joule in parts)),
        ("glitches of an interval, nJ", f"{glitches['interval_j'] * 1e9:.0f}"),
        ("a waiting cycle, pJ", f"{energy['waiting_cycle_j'] * 1e12:.2f}"),
        ("a touch, uJ", f"{energy['touch_j'] * 1e6:.1f}, glitches {glitches['touch_j'] * 1e6:.2f}"),
        ("average at a touch a second, uW", f"{energy['average_w'] * 1e6:.2f}, glitches {glitches['average_w'] * 1e6:.2f}"),
        ("1000 mAh at 5 V, years", f"{energy['battery_hours'] / 8766:.0f}, with glitches {glitches['battery_hours_with'] / 8766:.0f}"),
        ("8 x 2 tiles", f"{100 * row['area_um2'] / asic_job.room_um2(8, 2):.0f} % of the cells' room"),
        ("values, mismatches", f"{energy['compared_values']}, {energy['mismatches']}"),
    ]
    if "unit_glitches" in row:
        unit, bare = row["unit_glitches"], row["without_wires"]
        words += [
            ("glitches of equal delays", f"step {unit['step_j'] * 1e9:.1f} nJ, interval {unit['interval_j'] * 1e9:.0f} nJ"),
            (
                "without wires",
                f"step {bare['step_j'] * 1e9:.1f} nJ, interval {bare['interval_j'] * 1e9:.0f} nJ, {bare['fmax_hz'] / 1e6:.1f} MHz typ",
            ),
        ]
    return words


def shown(rows: Sequence[Mapping[str, Any]]) -> Table:
    """The table: a column a chip."""
    table = Table("figure", *(f"{row['pdk']}, {row['lanes']} lanes, {'ROM' if row['rom'] else 'loaded'}" for row in rows))
    columns = [dict(words_of(row)) for row in rows]
    for name in max(columns, key=len):
        table.add_row(name, *(column.get(name, "not asked") for column in columns))
    return table


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit status 1 where a decision differs."""
    parser = chip_parser("chip_figures", __doc__)
    parser.add_argument("--more", action="store_true", help="also glitches of equal delays, and all without wires")
    asked = parser.parse_args(arguments)
    model, recordings = IntegerModel.load(asked.model), load_recordings(asked.data)

    def chip(pdk: str, liberty: Sequence[Path], lanes: int, rom: bool) -> dict[str, Any]:
        return row_of(model, recordings, pdk, liberty, lanes, rom, more=asked.more)

    rows = rows_of(asked, model, recordings, chip, also=asked.more, told=lambda row: f"step {row['energy']['step_j'] * 1e9:.1f} nJ")
    Console(width=160).print(shown(rows))
    return int(any(row["energy"]["mismatches"] for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
