"""The verb that makes a chip's netlist."""

import dataclasses

from eskin.cli.common import app, recordings_for, say, show, stop
from eskin.requests import AsicRequest


@app.command(
    epilog="Example: eskin asic model --pdk ihp-sg13g2 --liberty cells_typ.lib --liberty cells_slow.lib "
    "--liberty sram.lib --rom"
)
def asic(request: AsicRequest) -> None:
    """Make a chip's netlist and report area, memories, clock and leakage, before layout. Takes minutes."""
    from eskin.golden.core import check_folder
    from eskin.golden.model import IntegerModel
    from eskin.rtl.fpga.tools import ToolError
    from eskin.verbs import asic_job

    check_folder(request.out, asic_job.MARK)
    integer = IntegerModel.load(request.model)
    played = None if request.data is None else recordings_for(request.data, integer.config)
    integer = dataclasses.replace(
        integer, config=asic_job.chip_config(integer.config, request.lanes, request.rom)
    )
    try:
        result, netlist = asic_job.asic(integer, request.pdk, request.liberty, recordings=played)
    except ToolError as error:
        stop(str(error), 1)
        return
    asic_job.write(result, netlist, request.out, integer.config.hardware.clock_hz)
    show("asic", **result)
    say(f"{request.out}: {asic_job.MARK}, {asic_job.PAGE}, netlist.v, accelerator.sdc")
