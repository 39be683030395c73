"""The verb that makes a chip's netlist."""

import dataclasses
from pathlib import Path
from typing import Annotated

from eskin.cli.common import ModelArgument, app, option, progress_bars, recordings_for, say, show, stop


@app.command(
    epilog="Example: eskin asic model --pdk ihp-sg13g2 --liberty cells_typ.lib --liberty cells_slow.lib "
    "--liberty sram.lib --rom"
)
def asic(
    model: ModelArgument,
    pdk: Annotated[str, option("The process: ihp-sg13g2 or sky130hd.", metavar="NAME")],
    liberty: Annotated[
        list[Path],
        option(
            "Its Liberty files, .gz too: cells and memory macros, in any order; several times.",
            metavar="FILE",
        ),
    ],
    lanes: Annotated[int | None, option("Multipliers that work at once; default: the model's.")] = None,
    rom: Annotated[
        bool, option("Weights and constants are fixed; otherwise the host loads them.", "--rom")
    ] = False,
    data: Annotated[
        str | None,
        option(
            "One of these recordings is played into the netlist and its energy counted; many minutes.",
            metavar="D",
        ),
    ] = None,
    fit: Annotated[
        str | None,
        option(
            "Tiles of Tiny Tapeout, such as 8x2: the most lanes that fit, of --lanes, half of them and so "
            "on.",
            metavar="WxH",
        ),
    ] = None,
    sweep: Annotated[
        Path | None,
        option(
            "With --fit: the sweep.json of eskin sweep, whose networks are tried in place of the model's.",
            metavar="FILE",
        ),
    ] = None,
    latches: Annotated[bool, option("What small memories are made of.", "--latches/--flip-flops")] = True,
    out: Annotated[Path, option("Folder of asic.json, asic.md, netlist.v and accelerator.sdc.")] = Path(
        "build/asic"
    ),
) -> None:
    """Make the netlist for a chip's process; tell area, memories, clock, leakage. Before layout; minutes."""
    from eskin.golden.core import InputError, check_folder
    from eskin.golden.model import IntegerModel
    from eskin.rtl.fpga.tools import ToolError
    from eskin.verbs import asic_job, chip_fit

    check_folder(out, asic_job.MARK if sweep is None else chip_fit.MARK)
    if fit is not None:
        chip_fit.tiles_of(fit)
    elif sweep is not None:
        raise InputError("--sweep: is for --fit; name the tiles too, such as --fit 8x2")
    try:
        if fit is not None and sweep is not None:
            points = chip_fit.points_of(sweep)
            area_of = chip_fit.areas(pdk, liberty, latches=latches)
            with progress_bars() as report:
                networks = chip_fit.searched(points, fit, area_of, rom=rom, lanes=lanes, progress=report)
            request = {
                "tiles": fit,
                "pdk": pdk,
                "rom": rom,
                "utilisation": asic_job.UTILISATION,
                "sweep": str(sweep),
            }
            chip_fit.write(request | networks, out)
            show("fit", **request, **networks)
            say(f"{out}: {chip_fit.MARK}, {chip_fit.PAGE}")
            if networks["chosen"] is None:
                stop(
                    f"--fit {fit}: no network of the sweep fits; sweep smaller ones (fewer hidden units, "
                    "linear)",
                    1,
                )
            return
        integer = IntegerModel.load(model)
        played = None if data is None else recordings_for(data, integer.config)
        integer = dataclasses.replace(integer, config=asic_job.chip_config(integer.config, lanes, rom))
        tried: list[dict[str, float]] = []
        if fit is not None:
            integer, tried = chip_fit.fitted(integer, fit, chip_fit.areas(pdk, liberty, latches=latches))
        result, netlist = asic_job.asic(integer, pdk, liberty, latches=latches, recordings=played)
    except ToolError as error:
        stop(str(error), 1)
        return
    fits = not tried or tried[-1]["tiles_filled"] <= 1
    if tried:
        result["fit"] = {"tiles": fit, "fits": fits, "tried": tried}
    asic_job.write(result, netlist, out, integer.config.hardware.clock_hz)
    show("asic", **result)
    say(f"{out}: {asic_job.MARK}, {asic_job.PAGE}, netlist.v, accelerator.sdc")
    if not fits:
        smaller = "train a smaller network (eskin train --hidden H or --cell linear)"
        stop(f"--fit {fit}: even one lane is too large; {smaller}", 1)
