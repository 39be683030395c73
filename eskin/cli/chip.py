"""The verb that makes a chip's netlist."""

import dataclasses
from pathlib import Path
from typing import Annotated

from eskin.cli.common import ModelArgument, app, option, recordings_for, say, show, stop


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
    out: Annotated[Path, option("Folder of asic.json, asic.md, netlist.v and accelerator.sdc.")] = Path(
        "build/asic"
    ),
) -> None:
    """Make the netlist for a chip's process; tell area, memories, clock, leakage. Before layout; minutes."""
    from eskin.golden.core import check_folder
    from eskin.golden.model import IntegerModel
    from eskin.rtl.fpga.tools import ToolError
    from eskin.verbs import asic_job

    check_folder(out, asic_job.MARK)
    integer = IntegerModel.load(model)
    played = None if data is None else recordings_for(data, integer.config)
    integer = dataclasses.replace(integer, config=asic_job.chip_config(integer.config, lanes, rom))
    try:
        result, netlist = asic_job.asic(integer, pdk, liberty, recordings=played)
    except ToolError as error:
        stop(str(error), 1)
        return
    asic_job.write(result, netlist, out, integer.config.hardware.clock_hz)
    show("asic", **result)
    say(f"{out}: {asic_job.MARK}, {asic_job.PAGE}, netlist.v, accelerator.sdc")
