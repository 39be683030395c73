"""Verbs that make hardware and compare it with the model."""

import contextlib
import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from eskin.cli.common import app, console, integer_model, progress_bars, recordings_for, say, show, stop
from eskin.golden.core import (
    PREFIX,
    PRESETS,
    InputError,
    Record,
    Result,
    check_folder,
    check_target,
    replacing,
)
from eskin.golden.model import FloatModel, IntegerModel, load_config
from eskin.jobs import Jobs
from eskin.pages.views import terminal_table
from eskin.requests import (
    AsicRequest,
    BoardRequest,
    CosimRequest,
    EnergyRequest,
    ExportRequest,
    GenerateRequest,
    ReplayRequest,
    ScheduleRequest,
    parse_count,
    parse_lanes,
)
from eskin.study.energy import in_words


@app.command(epilog="Example: eskin generate model --out design --lanes 4")
def generate(request: GenerateRequest) -> None:
    """Write the accelerator: Verilog, memory images, config.json, register map, C header, a cocotb bench."""
    from eskin.verbs.generate_job import generate_design

    integer = integer_model(request.model).with_lanes(*parse_lanes(request.lanes))
    recordings = None if request.data is None else recordings_for(request.data, integer.config)
    folder = generate_design(
        integer,
        request.out,
        recordings=recordings,
        bus=request.bus,
        axis=request.streams is not None,
        top=request.top,
    )
    say(f"{folder}: {', '.join(sorted(path.name for path in folder.iterdir()))}")


@app.command(
    epilog="Example: eskin export model --to c --out controller, or eskin export model --to onnx --out net"
)
def export(request: ExportRequest) -> Record:
    """Write a model for other tools, with a check."""
    from eskin.verbs.generate_job import export_c, export_onnx

    exported: Any = (
        integer_model(request.model) if request.to == "c" else FloatModel.load(request.model, images=True)
    )
    if request.to == "c":
        prefix = PREFIX if request.prefix is None else request.prefix
        result: Record = export_c(exported, request.out, prefix=prefix)
    elif request.prefix is not None:
        raise InputError("--prefix: belongs to --to c; leave it out")
    else:
        result = export_onnx(exported, request.out)
    show("export", to=request.to, **result)
    return result


@app.command(
    epilog="Example: eskin cosim model --data recordings.npz --recordings 40 --lanes 4 --json cosim.json"
)
def cosim(request: CosimRequest) -> Result:
    """Simulate the hardware on recordings and compare every stage with the golden model, bit for bit.

    Many recordings are split into parts that run side by side; an interrupted command continues where
    it stopped.
    """
    from eskin.verbs import flow

    if request.clock_hz is not None and not 1 <= request.clock_hz < math.inf:
        raise InputError(f"`clock_hz` {request.clock_hz:g}: is not a clock; give 1 Hz or more")
    count = parse_count(request.recordings)
    integer = integer_model(request.model).with_lanes(*parse_lanes(request.lanes))
    loaded = recordings_for(request.data, integer.config)
    numbers = loaded.evenly(count)
    with flow.work_folder() as work, progress_bars() as report:
        where = Jobs(workers=request.threads, dask=request.dask, progress=report, version=flow.CODE)
        played = loaded.subset(numbers)
        result = flow.cosimulate_parts(integer, played, numbers, request, work=work, jobs=where)
        if result.waves:  # out of the temporary folder
            result.waves = str(Path(result.waves).rename(work.with_name(f"waves_{work.name}")))
    show("cosim", played=result, **dict(result))
    return result


@app.command(epilog="Example: eskin build model --target icebreaker --seeds 5")
def build(request: BoardRequest) -> None:
    """Make a board's bitstream and report its area by block, its clock and the clock that each budget
    needs."""
    from eskin.rtl.fpga.targets import target as board
    from eskin.verbs import build_job as job
    from eskin.verbs.flow import with_converter

    if request.stimulator and not (request.standalone or request.converter):
        raise InputError(
            "--stimulator: is for a board with a converter; add --converter NAME or --standalone"
        )
    if request.converter and not (request.standalone or request.link):
        raise InputError("--converter: needs the link or --standalone; leave out --no-link")
    if request.standalone and not request.link:
        raise InputError("--standalone: never has a link; leave out --no-link")
    target, (lanes, lane_type) = board(request.target), parse_lanes(request.lanes)
    folder = request.out or job.BOARDS / request.target
    check_folder(folder, job.MARK)
    integer = integer_model(request.model)
    config = job.suited(integer.config, target, lanes, lane_type)
    config = with_converter(config, request.converter)
    if request.stimulator and config.interface.stimulator == "none":
        config = config.replace(stimulator="decisions")
    build_request = job.BuildRequest(
        config=config,
        arrays=integer.arrays,
        target=target,
        link=request.link,
        standalone=request.standalone,
        sensing=bool(request.converter) and not request.standalone,
        clock_hz=request.clock,
        lanes_asked=lanes is not None,
        seeds=request.seeds,
    )
    try:
        with progress_bars() as report:
            built = job.build(build_request, report)
    except job.BuildError as error:
        stop(str(error), 1)
    result = built[0]
    job.write(*built, folder)
    show("build", **result, block_rows=job.block_rows(result), in_words=in_words, folder=folder)
    if not result["clock_met"]:
        stop(job.clock_sentence(result), 1)


@app.command(epilog="Example: eskin replay model --port /dev/ttyUSB1 --data recordings.npz")
def replay(request: ReplayRequest) -> Record:
    """Play recordings to a board over its serial line and compare its decisions with the golden model's."""
    from eskin.verbs import build_job
    from eskin.verbs.board_job import replay as play

    baud, lanes, lane_type = build_job.board_of(request.model)
    integer = integer_model(request.model).with_lanes(lanes, lane_type)
    recordings = recordings_for(request.data, integer.config)
    with progress_bars() as report:
        result = play(request, integer, recordings, baud, report)
    show("replay", **result)
    return result


@app.command(epilog="Example: eskin schedule model --lanes 4 --out picture")
def schedule(request: ScheduleRequest) -> None:
    """Draw the work of each unit in each cycle, from the program of the hardware."""
    from eskin.rtl.image.image_engine import refuse_hardware
    from eskin.rtl.program.image_passes import plan_of
    from eskin.rtl.program.schedule import schedule as plan_step
    from eskin.rtl.views import image_view, schedule_view

    config = (PRESETS.get(str(request.model)) or load_config(request.model)).with_lanes(
        *parse_lanes(request.lanes)
    )
    check_target(request.out / "schedule")
    view: Any = schedule_view
    plan: Any
    columns: Sequence[str]
    rows: Sequence[tuple]
    if config.is_image:
        refuse_hardware(config)
        view, plan = image_view, plan_of(config)
        columns, rows = image_view.COLUMNS, image_view.cells(plan)
    else:
        plan = plan_step(config)
        columns, rows = ("what", "value"), schedule_view.figures(plan)
    files = view.drawing_files(plan)
    for name in files:
        check_target(request.out / name)
    with contextlib.ExitStack() as stack:  # all files or none
        for name, write in files.items():
            write(stack.enter_context(replacing(request.out / name)))
    console.print(terminal_table(view.title(plan).partition("\n")[0], columns, rows))
    say(f"files: {', '.join(str(request.out / name) for name in files)}")


@app.command(
    epilog="Example: eskin energy model --data recordings.npz --configuration icebreaker:6 --configuration "
    "ulx3s:12"
)
def energy(request: EnergyRequest) -> Result:
    """Estimate the energy of a touch and the idle power from a simulated netlist. Takes minutes."""
    from eskin.verbs import flow
    from eskin.verbs.energy_job import RESULT, job

    check_target(request.out / RESULT)
    integer = IntegerModel.load(request.model)
    loaded = recordings_for(request.data, integer.config)
    with flow.work_folder() as work, progress_bars() as report:
        result = job(request, integer, loaded, work, report)
    show("energy", **dict(result), in_words=in_words, file=request.out / RESULT)
    return result


@app.command(
    epilog="Example: eskin asic model --pdk ihp-sg13g2 --liberty cells_typ.lib --liberty cells_slow.lib "
    "--liberty sram.lib --rom"
)
def asic(request: AsicRequest) -> None:
    """Make a chip's netlist and report area, memories, clock and leakage, before layout. Takes minutes."""
    from eskin.rtl.fpga.tools import ToolError
    from eskin.verbs import asic_job

    check_folder(request.out, asic_job.MARK)
    integer = IntegerModel.load(request.model)
    played = None if request.data is None else recordings_for(request.data, integer.config)
    integer = dataclasses.replace(
        integer, config=asic_job.chip_config(integer.config, request.lanes, request.rom)
    )
    try:
        with progress_bars() as report:
            report(f"netlist in the cells of {request.pdk}, its clock and energy", 0, 0)
            result, netlist = asic_job.asic(integer, request.pdk, request.liberty, recordings=played)
    except ToolError as error:
        stop(str(error), 1)
        return
    asic_job.write(result, netlist, request.out, integer.config.hardware.clock_hz)
    show("asic", **result)
    say(f"{request.out}: {asic_job.MARK}, {asic_job.PAGE}, netlist.v, accelerator.sdc")
