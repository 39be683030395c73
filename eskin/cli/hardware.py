"""Verbs that make hardware and compare it with the model."""

import dataclasses
import math
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

from eskin.cli.common import (
    SEED_MAX,
    ClassPins,
    CountOption,
    DaskOption,
    DataOption,
    JobsOption,
    JsonOption,
    LanesOption,
    LaneType,
    LaneTypeOption,
    ModelArgument,
    app,
    argument,
    console,
    how_many,
    integer_model,
    option,
    progress_bars,
    recordings_for,
    say,
    show,
    stop,
)
from eskin.golden.core import PREFIX, InputError, Record, check_folder, check_target, replacing

Simulator = Literal["verilator", "icarus", "compiled"]
"""Simulators."""


Level = Literal["rtl", "netlist"]
"""What is simulated."""


Bus = Literal["wishbone", "axi4lite"]
"""Buses of a user's system."""


Pace = Literal["full", "declared"]
"""How frames are fed: as fast as they are taken, or at the declared rate."""


@app.command(epilog="Example: eskin generate model --out design --lanes 4")
def generate(
    model: ModelArgument,
    out: Annotated[Path, option("The folder to write: new, or an earlier generated one, which is replaced.")],
    lanes: LanesOption = None,
    lane_type: LaneTypeOption = None,
    data: Annotated[
        str | None, option("The testbench plays the first of these recordings; default: a made-up one.")
    ] = None,
    bus: Annotated[
        Bus | None,
        option("For a CPU: registers, samples, decisions and an interrupt behind this bus, a driver in C."),
    ] = None,
    fifo: Annotated[int | None, option("With --bus: decisions that may wait, 0, 2 or 4; default 2.")] = None,
    streams: Annotated[
        Literal["axis"] | None, option("Frames under AXI-Stream names; without --bus decisions too.")
    ] = None,
    top: Annotated[
        str | None,
        option(
            "Name of the topmost module; all other modules and the driver begin with it, so that several designs go into "
            "one system.",
            metavar="NAME",
        ),
    ] = None,
) -> None:
    """Write the accelerator: Verilog, memory images, config.json, register map, C header, self-checking
    testbench."""
    from eskin.rtl.host.decision_queue import DEPTHS
    from eskin.verbs.generate_job import generate_design

    if fifo is not None and bus is None:
        raise InputError("--fifo: is of a bus; add --bus NAME")
    depth = 2 if fifo is None else fifo
    if depth not in DEPTHS:
        raise InputError(f"--fifo: is {fifo}; give 0, 2 or 4")

    integer = integer_model(model)
    recordings = None if data is None else recordings_for(data, integer.config)
    design = {
        "lanes": lanes,
        "lane_type": lane_type,
        "bus": bus,
        "axis": streams is not None,
        "depth": depth,
        "top": top,
    }
    folder = generate_design(integer, out, recordings=recordings, **design)  # type: ignore[arg-type]
    say(f"{folder}: {', '.join(sorted(path.name for path in folder.iterdir()))}")


@app.command(
    epilog="Example: eskin export model --to c --out controller, or eskin export model --to onnx --out net"
)
def export(
    model: ModelArgument,
    to: Annotated[
        Literal["c", "onnx"],
        option("c: the integer model as plain C99 for a microcontroller; onnx: the float network."),
    ],
    out: Annotated[Path, option("The folder to write: new, or an earlier exported one, which is replaced.")],
    data: Annotated[
        str | None, option("What eskin_check.c plays, or onnxruntime is compared on; default: made-up ones.")
    ] = None,
    prefix: Annotated[
        str | None,
        option(
            "With --to c: begins the names of files, types, functions and macros, so that several models go into one "
            "program; default eskin."
        ),
    ] = None,
    json: JsonOption = None,
) -> Record:
    """Write a model in the words of other tools, with what checks it."""
    from eskin.golden.model import FloatModel
    from eskin.verbs.export_job import export_c, export_onnx

    exported: Any = integer_model(model) if to == "c" else FloatModel.load(model, images=True)
    recordings = None if data is None else recordings_for(data, exported.config)
    if to == "c":
        result: Record = export_c(
            exported, out, recordings=recordings, prefix=PREFIX if prefix is None else prefix
        )
    elif prefix is not None:
        raise InputError("--prefix: is for --to c; an ONNX file declares no names")
    else:
        result = export_onnx(exported, out, recordings=recordings)
    result = {"to": to} | result
    show("export", **result)
    return result


@app.command(
    epilog="Example: eskin cosim model --data recordings.npz --recordings 40 --lanes 4 --json cosim.json"
)
def cosim(
    model: ModelArgument,
    data: DataOption,
    recordings: CountOption = "all",
    lanes: LanesOption = None,
    lane_type: LaneTypeOption = None,
    simulator: Annotated[
        Simulator | None,
        option(
            "Icarus is four-state and slow; compiled: a chip's netlist as C. Default: compiled for chips, "
            "else verilator."
        ),
    ] = None,
    level: Annotated[Level, option("Generated Verilog, or its netlist.")] = "rtl",
    target: Annotated[
        str | None, option("Not with --level rtl: the board, such as icebreaker, ulx3s; or asic.")
    ] = None,
    pdk: Annotated[str | None, option("With --target asic: ihp-sg13g2 or sky130hd.", metavar="NAME")] = None,
    liberty: Annotated[
        list[Path] | None,
        option("With --target asic: the process's Liberty files; several times.", metavar="FILE"),
    ] = None,
    rom: Annotated[bool, option("With --target asic: weights and constants are fixed.", "--rom")] = False,
    converter: Annotated[
        str | None,
        option(
            "Begin at the pins of this converter, such as ads7953 or spi (docs/interface.md has all); or none.",
            metavar="NAME",
        ),
    ] = None,
    pace: Annotated[
        Pace, option("full: as fast as frames are taken; declared: at the recordings' rate.")
    ] = "full",
    clock: Annotated[
        str | None,
        option(
            "Clock of --pace declared, the sensor's; default: the configuration's. lowest: look for it.",
            metavar="HZ|lowest",
        ),
    ] = None,
    stalls: Annotated[bool, option("Random stalls on both sides.", "--stalls")] = False,
    seed: Annotated[int, option("Of the stalls.", min=0, max=SEED_MAX)] = 1,
    jobs: JobsOption = None,
    dask: DaskOption = None,
    json: JsonOption = None,
) -> Record:
    """Simulate the hardware on recordings and compare every stage with the golden model, bit for bit.

    Many recordings are split into parts that run beside each other; interrupted, the same command goes on
    where it stopped.
    """
    from eskin.golden.core import Jobs
    from eskin.verbs import cosim_job
    from eskin.verbs.flow import cosimulate

    count = how_many(recordings)
    hertz = _clock(clock)
    lowest = clock == "lowest"
    if lowest and pace != "declared":
        raise InputError(
            "--clock lowest: budgets are met or missed at the sensor's pace; add --pace declared"
        )
    if lowest and dask:
        raise InputError(
            "--dask: the lowest clock is looked for in one run after the other, here; leave --dask out"
        )
    simulator = simulator or ("compiled" if target == "asic" and not (stalls or lowest) else "verilator")
    integer = integer_model(model)
    loaded = recordings_for(data, integer.config)
    numbers = loaded.evenly(len(loaded) if count is None else count)
    with _work_folder(Path("build/cosim")) as work, progress_bars() as report:
        options: Record = {
            "lanes": lanes,
            "lane_type": lane_type,
            "simulator": simulator,
            "stalls": stalls,
            "seed": seed,
            "level": level,
            "target": target,
            "converter": converter,
        }
        if pdk or liberty or rom or target == "asic":
            options["chip"] = {"pdk": pdk, "liberty": [str(path) for path in liberty or ()], "rom": rom}
        options |= {"lowest": True} if lowest else {"pace": pace, "clock_hz": hertz}
        played = loaded.subset(numbers)
        if dask is None and (lowest or len(numbers) <= cosim_job.PART[simulator]):
            result = cosimulate(integer, played, numbers=numbers, work=work, **options)
        else:
            where = Jobs(workers=jobs, dask=dask, progress=report, version=cosim_job.CODE)
            result = cosim_job.cosimulate(integer, played, numbers, work=work, jobs=where, **options)
        if result["waves"]:
            result["waves"] = _keep(Path(result["waves"]), work)
    show("cosim", played=result, **result)
    return result


@contextmanager
def _work_folder(parent: Path) -> Iterator[Path]:
    """A folder for this call alone, gone afterwards; two calls at a time do not meet."""
    parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=parent) as work:
        yield Path(work)


def _keep(waves: Path, work: Path) -> str:
    """The waves of a mismatch, moved out of the work folder that ends with the call."""
    target = work.with_name(f"waves_{work.name}")
    waves.rename(target)
    return str(target)


def _clock(text: str | None) -> float | None:
    """Hertz of ``--clock``; None where it names none."""
    if text in (None, "lowest"):
        return None
    try:
        hertz = float(text)
    except ValueError:
        hertz = math.nan
    if not (math.isfinite(hertz) and hertz >= 1):
        raise InputError(f"--clock {text}: is no clock; give hertz, 1 or more, or the word lowest")
    return hertz


@app.command(epilog="Example: eskin build model --target icebreaker --seeds 5")
def build(
    model: ModelArgument,
    target: Annotated[str, option("icebreaker, upduino, ulx3s or tangnano9k.", metavar="NAME")],
    lanes: Annotated[
        int | None,
        option("Multipliers that work at once; default: the model's, fewer where they do not fit."),
    ] = None,
    lane_type: Annotated[LaneType | None, option("Default: what suits the part.")] = None,
    link: Annotated[
        bool, option("With the serial link; without it: onset to decision alone, for its figures.")
    ] = True,
    class_pins: Annotated[
        ClassPins | None,
        option(
            "A pin for each class, the class as a binary number, or none; default: each, or binary where "
            "pins are too few."
        ),
    ] = None,
    converter: Annotated[
        str | None,
        option(
            "Frames from its pins: any that cosim takes; with --standalone default: the model's.",
            metavar="NAME",
        ),
    ] = None,
    stimulator: Annotated[
        bool, option("With a converter: drive the stimulator by decisions.", "--stimulator")
    ] = False,
    standalone: Annotated[
        bool,
        option(
            "No host: the model in the bitstream, frames from a converter on the board's pins.",
            "--standalone",
        ),
    ] = False,
    flash: Annotated[
        bool,
        option(
            "With --standalone: the model not in the bitstream but in the board's flash, read at start.",
            "--flash",
        ),
    ] = False,
    baud: Annotated[
        float | None, option("Of the serial link; default: up to 2000000, as the clock allows.", min=300)
    ] = None,
    clock: Annotated[
        float | None, option("The clock to reach; default: the board's oscillator.", min=1e3, metavar="HZ")
    ] = None,
    seed: Annotated[int, option("First seed of the placement.", min=1, max=SEED_MAX)] = 1,
    seeds: Annotated[
        int, option("How many seeds to try; the fastest placement is kept.", min=1, max=1000)
    ] = 1,
    out: Annotated[Path | None, option("New folder or an earlier build; default build/board/NAME.")] = None,
) -> None:
    """Make a board's bitstream; tell its area block by block, its highest clock and slowest path, and the
    clock each budget needs."""
    from eskin.rtl.fpga.targets import target as board
    from eskin.study.converter_power import in_words
    from eskin.verbs import build_job as job
    from eskin.verbs.flow import with_converter

    if class_pins and not link:
        raise InputError("--class-pins: is for a build with the link; leave it out, or leave out --no-link")
    if stimulator and not (standalone or converter):
        raise InputError(
            "--stimulator: is for a board with a converter; add --converter NAME or --standalone"
        )
    if converter and not standalone and (not link or class_pins is not None):
        raise InputError(
            "--converter: goes with the link or --standalone; leave out --no-link and --class-pins"
        )
    if flash and not standalone:
        raise InputError("--flash: is for a board without a host; add --standalone")
    if standalone and (not link or baud is not None or class_pins is not None):
        raise InputError("--standalone: has no link; leave out --no-link, --baud and --class-pins")
    folder, part = out or job.BOARDS / target, board(target)
    check_folder(folder, job.MARK)
    integer = integer_model(model)
    config = with_converter(job.suited(integer.config, part, lanes, lane_type), converter)
    if stimulator and config.interface.stimulator == "none":
        config = config.replace(stimulator="decisions")
    request = job.BuildRequest(
        config=config,
        arrays=integer.arrays,
        target=part,
        link=link,
        standalone=standalone,
        flash=flash,
        sensing=bool(converter) and not standalone,
        clock_hz=clock,
        baud=baud,
        class_pins=class_pins,
        lanes_asked=lanes is not None,
        seed=seed,
        seeds=seeds,
    )
    try:
        with progress_bars() as report:
            built = job.build(request, report)
    except job.BuildError as error:
        stop(str(error), 1)
    result = built[0]
    job.write(*built, folder)
    show("build", **result, block_rows=job.block_rows(result), in_words=in_words, folder=folder)
    if not result["clock_met"]:
        stop(job.clock_sentence(result), 1)


@app.command(
    epilog="Example: eskin replay model --port /dev/ttyUSB1 --data recordings.npz --build "
    "build/board/icebreaker --recordings 40"
)
def replay(
    model: Annotated[Path, argument("The quantised model folder that the bitstream was built from.")],
    port: Annotated[str, option("The board's serial port.")],
    data: DataOption,
    recordings: CountOption = "all",
    build: Annotated[
        Path | None,
        option(
            "Folder of 'eskin build' with the board's bitstream, which tells its rate and lanes; default: "
            "the only one in build/board.",
            metavar="DIR",
        ),
    ] = None,
    baud: Annotated[
        int | None,
        option(
            "Without a build at hand: bits a second of its link within 2 % (usually 2000000; ulx3s 1923077, tangnano9k 1928571).",
            min=1,
        ),
    ] = None,
    lanes: Annotated[
        int | None, option("With --baud: lanes that the bitstream was built with; default 4.")
    ] = None,
    lane_type: Annotated[
        LaneType | None, option("With --baud: lanes that the bitstream was built with; default plain.")
    ] = None,
    teach: Annotated[
        str | None,
        option("The last touch of each recording is taught as this class when it is over.", metavar="CLASS"),
    ] = None,
    save_taught: Annotated[
        Path | None,
        option(
            "File (.npz) of touches taught: what it holds is loaded, what the board holds in the end is written to "
            "it.",
            metavar="FILE",
        ),
    ] = None,
    json: JsonOption = None,
) -> Record:
    """Play recordings to a board over its serial line and compare its decisions with the golden model's."""
    from eskin.verbs import build_job
    from eskin.verbs.replay_job import replay as play

    if build and baud:
        raise InputError(f"--build {build}: tells the rate by itself; leave out --baud")
    if not baud:
        if lanes is not None or lane_type:
            raise InputError(
                f"--{'lanes' if lanes is not None else 'lane-type'}: is told by the build; leave it out, or "
                "give --baud too"
            )
        baud, lanes, lane_type = build_job.link_of(build or build_job.only_build())
    count = how_many(recordings)
    integer = integer_model(model).with_lanes(lanes, lane_type)
    classes = integer.config.network.class_names
    if teach is not None and teach not in classes:
        raise InputError(f"--teach {teach}: is no class of the model; there are {', '.join(classes)}")
    loaded = recordings_for(data, integer.config)
    numbers = loaded.evenly(len(loaded) if count is None else count)
    with progress_bars() as report:
        result = play(
            integer,
            loaded.subset(numbers),
            numbers=numbers,
            port=port,
            baud=baud,
            progress=lambda done, total: report("frames played", done, total),
            teach=None if teach is None else classes.index(teach),
            kept=save_taught,
        )
    show("replay", **result)
    return result


@app.command(epilog="Example: eskin schedule model --lanes 4 --out picture")
def schedule(
    model: Annotated[str, argument("A model folder, or a preset: thesis, synthetic, pvdf, fabric.")],
    lanes: LanesOption = None,
    lane_type: LaneTypeOption = None,
    out: Annotated[Path, option("Folder of the files.")] = Path("build/schedule"),
) -> None:
    """Draw which unit does what in which cycle, from the very program that goes into the hardware."""
    from eskin.golden.core import PRESETS
    from eskin.pages.views import terminal_table
    from eskin.rtl.views import schedule_view

    if model in PRESETS:
        config = PRESETS[model]
    else:
        from eskin.golden.model import load_config

        config = load_config(model)
    config = config.with_lanes(lanes, lane_type)
    check_target(out / "schedule")
    if config.is_image:
        from eskin.rtl.program.image_passes import plan_of
        from eskin.rtl.top.image_accelerator import refuse_hardware
        from eskin.rtl.views import image_view

        refuse_hardware(config)
        passes = plan_of(config)
        files = image_view.drawing_files(passes)
        shown: tuple[str, Sequence[str], Sequence[tuple]] = (
            image_view.title(passes),
            image_view.COLUMNS,
            image_view.cells(passes),
        )
    else:
        from eskin.rtl.program.schedule import schedule as plan_step

        plan = plan_step(config)
        files = schedule_view.drawing_files(plan)
        shown = (schedule_view.title(plan).partition("\n")[0], ("what", "value"), schedule_view.figures(plan))
    _write_files(out, files)
    console.print(terminal_table(*shown))
    say(f"files: {', '.join(str(out / name) for name in files)}")


def _write_files(folder: Path, files: dict[str, Callable[[Path], None]]) -> None:
    """Write each file whole into ``folder``; every name is checked before the first is written."""

    for name in files:
        check_target(folder / name)
    for name, write in files.items():
        with replacing(folder / name) as temporary:
            write(temporary)


@app.command(
    epilog="Example: eskin energy model --data recordings.npz --configuration icebreaker:6 --configuration "
    "ulx3s:12"
)
def energy(
    model: ModelArgument,
    data: DataOption,
    configuration: Annotated[
        list[str] | None,
        option(
            "A board, its lanes and their type; may be given several times.", metavar="TARGET:LANES[:TYPE]"
        ),
    ] = None,
    chip: Annotated[
        list[Path] | None,
        option("An asic.json of eskin asic --data, shown beside the boards; several times.", metavar="FILE"),
    ] = None,
    recordings: Annotated[int, option("Recordings whose activity is counted.", min=1)] = 2,
    decide_within: Annotated[
        float | None,
        option("Latency budget of a decision, seconds; default: the model's, one frame.", metavar="S"),
    ] = None,
    out: Annotated[Path, option("Folder of energy.json and energy.html.")] = Path("build/energy"),
) -> Record:
    """Estimate energy of a touch and power of waiting, from activity counted in co-simulated netlists;
    minutes a configuration."""
    from eskin.pages.energy_page import PAGE
    from eskin.study.converter_power import in_words
    from eskin.verbs.energy_job import RESULT, job

    check_target(out / RESULT)
    integer = integer_model(model)
    if decide_within is not None:
        integer = dataclasses.replace(integer, config=integer.config.replace(decide_within_s=decide_within))
    loaded = recordings_for(data, integer.config)
    with _work_folder(Path("build/cosim")) as work, progress_bars() as report:
        options: Record = {
            "count": recordings,
            "out": out,
            "work": work,
            "notify": report,
            "chips": chip or (),
        }
        result = job(integer, loaded, configuration, **options)
    show("energy", **result, in_words=in_words, page=out / PAGE)
    return result
