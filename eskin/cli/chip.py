"""The verb that makes a chip's netlist."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

from rich.markup import escape

from eskin.cli.common import ModelArgument, app, console, option, print_table, progress_bars, recordings_for, stop


@app.command(epilog="Example: eskin asic model --pdk ihp-sg13g2 --liberty cells_typ.lib --liberty cells_slow.lib --liberty sram.lib --rom")
def asic(
    model: ModelArgument,
    pdk: Annotated[str, option("The process: ihp-sg13g2 or sky130hd.", metavar="NAME")],
    liberty: Annotated[
        list[Path], option("Its Liberty files, .gz too: cells and memory macros, in any order; several times.", metavar="FILE")
    ],
    lanes: Annotated[int | None, option("Multipliers that work at once; default: the model's.")] = None,
    rom: Annotated[bool, option("Weights and constants are fixed; otherwise the host loads them.", "--rom")] = False,
    data: Annotated[
        str | None, option("One of these recordings is played into the netlist and its energy counted; many minutes.", metavar="D")
    ] = None,
    fit: Annotated[
        str | None,
        option("Tiles of Tiny Tapeout, such as 8x2: the most lanes that fit, of --lanes, half of them and so on.", metavar="WxH"),
    ] = None,
    sweep: Annotated[
        Path | None, option("With --fit: the sweep.json of eskin sweep, whose networks are tried in place of the model's.", metavar="FILE")
    ] = None,
    latches: Annotated[bool, option("What small memories are made of.", "--latches/--flip-flops")] = True,
    out: Annotated[Path, option("Folder of asic.json, asic.md, netlist.v and accelerator.sdc.")] = Path("build/asic"),
) -> None:
    """Make the netlist for a chip's process; tell area, memories, clock, leakage. Before layout; minutes."""
    from eskin.golden.core.errors import InputError
    from eskin.golden.model.model import IntegerModel
    from eskin.rtl.fpga.tools import ToolError
    from eskin.verbs import asic_job, chip_fit

    mark = asic_job.MARK if sweep is None else chip_fit.MARK
    if out.is_dir() and any(out.iterdir()) and not (out / mark).exists():
        raise InputError(f"--out {out}: holds other files and no {mark}; name a new folder")
    place = None if fit is None else asic_job.tiles_of(fit)
    if sweep is not None:
        if fit is None:
            raise InputError("--sweep: is for --fit; name the tiles too, such as --fit 8x2")
        _fit_networks(sweep, pdk, liberty, fit, lanes, rom, latches, out)
        return
    integer = IntegerModel.load(model)
    config = asic_job.chip_config(integer.config, lanes, rom)
    played = None if data is None else recordings_for(data, integer.config)
    try:
        model_ = dataclasses.replace(integer, config=config)
        tried: list[dict[str, float]] = []
        if place is not None:
            model_, tried = asic_job.fitted(model_, pdk, liberty, place, latches=latches)
        result, netlist = asic_job.asic(model_, pdk, liberty, latches=latches, recordings=played)
    except ToolError as error:
        stop(str(error), 1)
        return
    fits = not tried or tried[-1]["tiles_filled"] <= 1
    if tried:
        result["fit"] = {"tiles": fit, "fits": fits, "tried": tried}
    asic_job.write(result, netlist, out, config.hardware.clock_hz)
    print_table("chip, before layout", "figure", "value", rows=asic_job.figures(result))
    rows = [(row["name"], row["words"], row["width"], row["kind"]) for row in result["memories"]]
    print_table("memories", "memory", "words", "bits of a word", "made of", rows=rows)
    if tried:
        print_table(
            f"in {fit} tiles", "lanes", "um2", "of the cells' room", rows=[tuple(f"{value:.4g}" for value in row.values()) for row in tried]
        )
    console.print(f"{escape(str(out))}: {asic_job.MARK}, {asic_job.PAGE}, netlist.v, accelerator.sdc", soft_wrap=True)
    if not fits:
        stop(f"--fit {fit}: even one lane is too large; train a smaller network (eskin train --hidden H or --cell linear)", 1)


def _fit_networks(sweep: Path, pdk: str, liberty: list[Path], tiles: str, lanes: int | None, rom: bool, latches: bool, out: Path) -> None:
    """Which network of a sweep fits."""
    from eskin.rtl.fpga.tools import ToolError
    from eskin.verbs import chip_fit

    try:
        with progress_bars() as report:
            found = chip_fit.fit(sweep, pdk, liberty, tiles, lanes=lanes, rom=rom, latches=latches, progress=report)
    except ToolError as error:
        stop(str(error), 1)
        return
    chip_fit.write(found, out)
    print_table(f"in {tiles} tiles", *chip_fit.HEAD, rows=chip_fit.table(found))
    console.print(f"{escape(str(out))}: {chip_fit.MARK}, {chip_fit.PAGE}", soft_wrap=True)
    if found["chosen"] is None:
        stop(f"--fit {tiles}: no network of the sweep fits; sweep smaller ones (fewer hidden units, linear)", 1)
