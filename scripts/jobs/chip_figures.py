"""What chips of one model take, side by side: area, clock, energy, glitches; and what of it hangs on delays and on wires.

``python -m eskin.scripts.jobs.chip_figures MODEL --process ihp-sg13g2 cells_typ.lib cells_slow.lib sram.lib`` prints a table of ROM and
loadable chips and keeps its rows in ``--out``. ``--more`` adds glitches of equal delays, and energies and clock without wires.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from eskin.golden.core.files import write_json
from eskin.golden.data.load import load_recordings
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.model import IntegerModel
from eskin.scripts.jobs import asic_job
from eskin.scripts.jobs.main_job import code_version, fingerprint, model_key


def row_of(
    model: IntegerModel, recordings: Recordings, pdk: str, liberty: Sequence[Path], lanes: int, rom: bool, work: Path, *, more: bool
) -> dict[str, Any]:
    """`asic.json` of one chip; with ``more`` also ``unit_glitches`` and ``without_wires`` (step_j, interval_j, fmax_hz of the typical
    corner)."""
    model = dataclasses.replace(model, config=asic_job.chip_config(model.config, lanes, rom))
    result, _ = asic_job.asic(model, pdk, liberty, recordings=recordings, work=work)
    if more:
        unit, _ = asic_job.asic(model, pdk, liberty, recordings=recordings, work=work, delays="unit")
        bare, _ = asic_job.asic(model, pdk, liberty, recordings=recordings, work=work, wire_load="")
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
    parser = argparse.ArgumentParser(prog="python -m eskin.scripts.jobs.chip_figures", description=__doc__.splitlines()[0])
    parser.add_argument("model", type=Path)
    parser.add_argument("--process", nargs="+", action="append", required=True, metavar="NAME FILE ...", help="its Liberty files behind it")
    parser.add_argument("--data", default="synthetic")
    parser.add_argument("--lanes", type=int, nargs="+", default=[1, 4])
    parser.add_argument("--constants", nargs="+", choices=["rom", "loaded"], default=["rom", "loaded"])
    parser.add_argument("--more", action="store_true", help="also glitches of equal delays, and all without wires")
    parser.add_argument("--out", type=Path, default=Path("build/chip_figures.json"))
    asked = parser.parse_args(arguments)
    model, recordings = IntegerModel.load(asked.model), load_recordings(asked.data)
    kept = json.loads(asked.out.read_text()) if asked.out.exists() else {}
    made = "\n".join([code_version("golden", "rtl", "cosim"), model_key(model), fingerprint(recordings)])
    rows = []
    for pdk, *liberty in asked.process:
        for lanes in asked.lanes:
            for constants in asked.constants:
                key = json.dumps([made, pdk, lanes, constants, asked.more])
                if key not in kept:
                    paths, work = [Path(path) for path in liberty], asked.out.with_suffix("")
                    kept[key] = row_of(model, recordings, pdk, paths, lanes, constants == "rom", work, more=asked.more)
                    asked.out.parent.mkdir(parents=True, exist_ok=True)
                    write_json(asked.out, kept)
                rows.append(kept[key])
                print(f"{pdk}, {lanes} lanes, {constants}: step {rows[-1]['energy']['step_j'] * 1e9:.1f} nJ", flush=True)
    Console(width=160).print(shown(rows))
    return int(any(row["energy"]["mismatches"] for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
