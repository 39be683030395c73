"""Simulate the hardware on recordings and compare every stage with the golden model, bit for bit.

Many recordings are split into parts that run side by side; an interrupted command continues where
it stopped.

Example: eskin cosim model --data recordings.npz --recordings 40 --lanes 4 --json cosim.json

Golden trace, generated files and co-simulation live in their own packages; here they are called in order.
"""

import contextlib
import dataclasses
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from eskin.cli.common import (
    ClusterOptions,
    JsonOptions,
    LaneOptions,
    ModelDataOptions,
    integer_model,
    option,
    parse_count,
    parse_lanes,
    progress_bars,
    recordings_for,
    show,
)
from eskin.cosim import flow, runner, standalone
from eskin.cosim.netlist import Hardware, netlist_hardware
from eskin.cosim.results import Placed, Played, joined
from eskin.cosim.simulation import Simulation
from eskin.golden.core import AcceleratorConfig, Arrays, InputError, Progress, Result, content_key
from eskin.golden.core.files import locked
from eskin.golden.data import Recordings
from eskin.golden.model import (
    IntegerModel,
    completing_frames,
    images_of,
    run,
    through_converter,
    write_image_vectors,
    write_vectors,
)
from eskin.golden.model.prototypes import taught_in_use
from eskin.jobs import Jobs
from eskin.memo import Memo, code_version
from eskin.rtl.asic.liberty import text_of
from eskin.rtl.fpga.generate import generate
from eskin.rtl.fpga.targets import target as find_target
from eskin.rtl.program.memory_map import memory_images
from eskin.rtl.top import standby
from eskin.rtl.top.accelerator import Accelerator
from eskin.verbs import asic
from eskin.verbs.build import BuildRequest, cached_netlist, suited, with_converter


class CosimRequest(Simulation, ModelDataOptions, LaneOptions, JsonOptions, ClusterOptions):
    recordings: str = option("Number of recordings, spread over the classes.", "all", metavar="N|all")
    simulator: Literal["verilator", "icarus"] = option("Simulator.", "verilator")
    threads: int | None = option(
        "Recordings played side by side. Default: one per core.", None, "--jobs", min=1
    )
    level: Literal["rtl", "netlist"] = option("Generated Verilog, or its netlist.", "rtl")
    target: str | None = option("Part of the netlist: a board such as icebreaker, or asic.")
    pdk: str | None = option("Chip: ihp-sg13g2 or sky130hd.", metavar="NAME")
    liberty: list[Path] | None = option(
        "Chip: a Liberty file of the process; may be repeated.", metavar="FILE"
    )
    rom: bool = option("Chip: weights and constants are in ROM.", False, "--rom")
    converter: str | None = option(
        "Play frames to the pins of this converter; none: to the core.", metavar="NAME"
    )
    standalone: bool = option(
        "The netlist of build --standalone, on its own oscillators.", False, "--standalone"
    )
    pace: Literal["full", "declared"] = option(
        "full: as fast as possible; declared: at the recordings' rate.", "full"
    )
    clock_hz: float | None = option("Clock for --pace declared.", None, "--clock", metavar="HZ")
    stalls: bool = option("Insert random stalls at input and output.", False, "--stalls")
    seed: int = option("Of stalls and a chip's start values.", 1, min=0, envvar="COCOTB_RANDOM_SEED")
    bench: Literal["sample", "cocotb"] = option(
        "Recordings under cocotb: one per class (others in bulk), or all.", "sample"
    )


def command(request: CosimRequest) -> Result:
    if request.clock_hz is not None and request.clock_hz < 1:
        raise InputError(f"`clock_hz` {request.clock_hz:g}: is not a clock; give 1 Hz or more")
    count = parse_count(request.recordings)
    integer = integer_model(request.model).with_lanes(*parse_lanes(request.lanes))
    loaded = recordings_for(request.data, integer.config)
    numbers = loaded.evenly(count)
    with work_folder() as work, progress_bars() as report:
        jobs = Jobs(workers=request.threads, dask=request.dask, progress=report, version=CODE)
        try:
            result = cosimulate_parts(integer, loaded.subset(numbers), numbers, request, work=work, jobs=jobs)
        finally:
            runner.join_results(work)
        if result.waves:  # out of the temporary folder
            result.waves = str(Path(result.waves).rename(work.with_name(f"waves_{work.name}")))
    show("cosim", played=result, **dict(result))
    return result


BUILD = Path("build")
"""Everything generated on the way."""


def cosimulate(
    model: IntegerModel,
    recordings: Recordings,
    how: Simulation,
    *,
    work: Path,
    numbers: Sequence[int] | None = None,
    design: Path | None = None,
    play: Callable[..., Played] | None = None,
    progress: Progress = lambda what, done, total: None,
) -> Played:
    """The integer model's trace of ``recordings`` against the generated hardware.

    At level ``netlist`` the netlist for ``target`` is what runs: once with the probes as outputs, every stage
    compared, and once as it is placed, without them, at full pace (cosim/netlist.py); that run is the
    result's ``without_probes`` and must be exact too.

    Parameters
    ----------
    numbers:
        What each recording is called in messages (its index in the whole data set).
    work:
        Folder for design, vectors and captures.
    design:
        Folder for the design where several runs of the same one share it: the first of them writes it.
        Default: one in ``work``.
    play:
        In place of eskin.cosim.flow.cosim.

    Raises
    ------
    InputError
        A converter together with a netlist or with stalls; a netlist without a target, a target without a
        netlist, an unknown one.
    """
    if how.standalone:
        return _cosimulate_standalone(model, recordings, how, work=work, numbers=numbers, progress=progress)
    chip, config = how.chip, with_converter(model.config, how.converter, how.clock_hz)
    hardware = placed = codes = None
    recordings = recordings.scanned(config.sensor.scan_every)
    if config.interface.converter.name != "none":
        if how.level != "rtl" or how.stalls:
            raise InputError(
                f"`converter`: is {config.interface.converter}, which goes with the design's own Verilog "
                "and clock; "
                "leave out `level` and `stalls`, or give `converter` none"
            )
        model = dataclasses.replace(model, config=config)
        recordings, codes = through_converter(recordings, config)
        how = dataclasses.replace(how, pace="declared")
    if chip:
        config = asic.chip_config(config, None, how.rom)
        hardware, placed = _chip_parts(config, model.arrays, how)
    elif how.target is not None:
        hardware, _ = netlist_of(config, model.arrays, how.target)
        placed = netlist_of(config, model.arrays, how.target, probes=False)
    how = dataclasses.replace(how, hardware=hardware) if placed else how
    design = design or work / "design"
    with locked(design.with_suffix(".lock")):
        if design.parent == work or not design.exists():
            generate(config, model.arrays, design)
    progress(f"computing what is expected of {len(recordings)} in torch", 0, 0)
    vectors = expected_of(model, recordings, work / "vectors.npz", numbers, codes)
    result = (play or flow.cosim)(design, vectors, how, work=work / "run", progress=progress)
    if placed:
        hardware, cells = placed
        how = dataclasses.replace(how, hardware=hardware, pace="full", stalls=False, probe=False)
        second = flow.cosim(design, vectors, how, work=work / "placed", progress=progress)
        result.without_probes = Placed(**second.model_dump(include={*Placed.model_fields}), cells=cells)
        result.passed &= second.bit_exact
    if result:
        result.model_hash = model.model_hash
    return result


def _cosimulate_standalone(
    model: IntegerModel,
    recordings: Recordings,
    how: Simulation,
    *,
    work: Path,
    numbers: Sequence[int] | None,
    progress: Progress,
) -> Played:
    """The netlist that ``build --standalone`` places against what the pins are to show."""
    from eskin.golden.model import torch_model

    if how.simulator != "verilator" or how.stalls or how.pdk or how.target == "asic":
        raise InputError(
            "`standalone`: plays a board's netlist in verilator; leave out `simulator`, `stalls` and a chip's options"
        )
    target = find_target(how.target or "icebreaker")
    config = suited(with_converter(model.config, how.converter), target)
    request = BuildRequest(
        config=config, arrays=model.arrays, target=target, standalone=True, clock_hz=how.clock_hz
    )
    wiring = request.wiring()
    if not wiring.standby or config.interface.converter.name == "mpr121":
        why = request.awake or "the model of the mpr121 has no open-drain pins"
        raise InputError(f"`standalone`: {why}; leave it out, or use another board, converter or clock")
    config = wiring.config
    images = memory_images(config, model.arrays)
    netlist, _ = cached_netlist(
        lambda: wiring.design(images, request.wanted_hz, None), target.family, BUILD / "netlists", keep=[]
    )
    board = standalone.Board(
        config=config,
        hardware=netlist_hardware(
            netlist.verilog, target.family.name, target.name, probes=False, oscillators=False
        ),
        clock_hz=request.wanted_hz,
        slow_hz=standby.SLOW_HZ,
        tolerance=standby.TOLERANCE,
        start_s=standby.START_S,
        turn_cycles=standby.work_cycles(config, request.wanted_hz),
    )
    recordings, codes = through_converter(recordings.scanned(config.sensor.scan_every), config)
    progress(f"computing what is expected of {len(recordings)} in torch", 0, 0)
    trace = run(torch_model.on_torch(dataclasses.replace(model, config=config)), recordings)
    rows, offsets = trace.streams["decision"]
    frames = completing_frames(trace)
    shown = [
        standalone.shown_on_pins(config, rows[low:high], frames[low:high], count)
        for (low, high), count in zip(pairwise(offsets), np.diff(recordings.offsets), strict=True)
    ]
    expected = {
        "codes": codes,
        "shown": np.array([pins for each, _ in shown for pins in each]),
        "decided": np.array([count for _, each in shown for count in each]),
        "offsets": recordings.offsets,
        "numbers": np.asarray(range(len(recordings)) if numbers is None else numbers),
    }
    return standalone.play(board, expected, how, work=work / "run", progress=progress)


@contextlib.contextmanager
def work_folder() -> Iterator[Path]:
    """A folder for this call alone, gone afterwards; two calls at a time do not meet."""
    parent = BUILD / "cosim"
    parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=parent) as work:
        yield Path(work)


def _chip_parts(
    config: AcceleratorConfig, arrays: Arrays, how: Simulation
) -> tuple[Hardware, tuple[Hardware, dict[str, int]]]:
    """A chip's netlist with probes; the netlist that is placed, and its cells."""
    process = asic.process_of(how.pdk or "", asic.libraries_of(how.liberty or ())["typ"])

    def part(probes: bool) -> tuple[Hardware, dict[str, int]]:
        netlist = asic.netlist_of(config, arrays, process, probes=probes)
        return asic.hardware_of(netlist, process, probes=probes), dict(netlist.cells)

    return part(True)[0], part(False)


def expected_of(
    model: IntegerModel,
    recordings: Recordings,
    path: Path,
    numbers: Sequence[int] | np.ndarray | None = None,
    codes: np.ndarray | None = None,
) -> Path:
    """The file of vectors of recordings or images: what goes in, and every stage of the integer model, whose
    states, maps and logits torch computes; the rest as in `cosimulate`."""
    from eskin.golden.model import torch_model  # only here: what writes files for others needs no torch

    if model.config.is_image:
        images = images_of(recordings)
        streams = torch_model.run_images_on_torch(model, images).streams
        return write_image_vectors(path, streams, images, numbers)
    trace = run(torch_model.on_torch(model), recordings)
    return write_vectors(path, trace, recordings, numbers, codes, int(taught_in_use(model).sum()))


def netlist_of(
    config: AcceleratorConfig, arrays: Arrays, target: str, *, probes: bool = True
) -> tuple[Hardware, dict[str, int]]:
    """The post-synthesis netlist of one design and the number of its cells by type; an unchanged one is taken
    from the build folder.

    Parameters
    ----------
    arrays:
        Of the integer model, for a ROM design.
    target:
        A board of eskin.rtl.fpga.targets.
    probes:
        Keep the probe ports as outputs. Without them it is the netlist that placement gets, onset to decision
        without the host link.

    Raises
    ------
    InputError
        An unknown target.
    """
    family = find_target(target).family
    images = None if config.hardware.loadable else memory_images(config, arrays)
    netlist, _ = cached_netlist(
        lambda: Accelerator(config, images), family, BUILD / "netlists", hidden=() if probes else ("probe",)
    )
    return netlist_hardware(netlist.verilog, family.name, target, probes=probes), netlist.cells


# ---------------------------------------------------------------------- parts, beside each other

CACHE = BUILD / "cosim_parts"
"""Finished parts of a run that was interrupted; gone when all are done."""
PART = {"verilator": 40, "icarus": 8}
"""Recordings of a part. It does not depend on the number of workers, so that the result does not either: a
part loads the design anew. Small enough that no worker waits long for the last part, and far more work than
starting a simulator."""
IN_BULK = 400
"""The same where recordings are played in bulk: one process does that on all cores (`eskin.cosim.bulk`)."""
CODE = partial(code_version, "golden", "rtl", "cosim", "study", "training/record.py", "verbs")
"""Code on which a co-simulation depends beside data and model."""

Piece = tuple[int, int]
"""First recording of a part, and the next after its last."""
Shared = tuple[IntegerModel, Recordings, list[int], int, Simulation, Path]
"""Model, all recordings, what they are called, how many of them (the first) are played under cocotb, how, the work
folder."""


def one_of_each(labels: np.ndarray) -> list[int]:
    """The first recording of each class: what a run shows under cocotb."""
    return sorted(np.unique(labels, return_index=True)[1].tolist())


def cosimulate_parts(
    model: IntegerModel,
    recordings: Recordings,
    numbers: Sequence[int],
    how: Simulation,
    *,
    work: Path,
    jobs: Jobs,
) -> Played:
    """The result of ``cosimulate`` over all recordings, from parts of ``PART`` recordings.

    Parameters
    ----------
    numbers:
        What each recording is called in messages.
    work:
        Folder for the parts' files where workers see it; for the waves of a mismatch always.
    jobs:
        Where the parts are played.
    """
    chip = how.target == "asic"  # compiled in minutes under cocotb
    sample = [] if chip else one_of_each(recordings.labels)
    shown = sample if how.bench == "sample" else [*range(len(numbers))]
    order = [*shown, *sorted({*range(len(numbers))} - {*shown})]
    recordings, numbers = recordings.subset(order), [int(numbers[place]) for place in order]
    config = with_converter(model.config, how.converter, how.clock_hz)
    apart = how.bench == "cocotb" or config.interface.converter.name != "none"  # in the simulator's process
    apart = apart or bool(how.stalls or how.standalone or (how.target and not chip))
    size = PART[how.simulator] if apart or how.simulator != "verilator" else IN_BULK
    content = content_key(CODE(), model, recordings, numbers, len(shown), *contents(how))
    parts = [(low, min(low + size, len(numbers))) for low in range(0, len(numbers), size)]
    pieces = {content_key(content, part): part for part in parts}
    keep, folder = Memo(CACHE), work.resolve() / content[:16]
    if work.is_dir():
        folder.mkdir(exist_ok=True)
    shared = (model, recordings, numbers, len(shown), how, folder)
    results = jobs.results(play, pieces, shared, keep=keep, what=f"parts of up to {size} compiled and played")
    played = {key: Played.model_validate(part) for key, part in results.items()}
    result = joined(model.config, [*played.values()])
    result.model_hash = model.model_hash
    differing = next((pieces[key] for key, part in played.items() if part.mismatches), None)
    if differing:  # once more, for its waves: waves of a worker are not on this machine
        if jobs.progress:
            jobs.progress("playing what differs once more, with waves", 0, 0)
        result.waves = play(shared, differing, waves=True).waves
    keep.forget(pieces)
    return result


def contents(how: Simulation) -> list[Any]:
    """What a result depends on: the settings, and the text of the Liberty files that they name."""
    values = [getattr(how, each.name) for each in dataclasses.fields(Simulation)]
    return [repr(values), *map(text_of, how.liberty or ())]


def play(shared: Shared, piece: Piece, *, waves: bool = False) -> Played:
    """The result of one part; in a worker without waves."""
    model, recordings, numbers, shown, how, folder = shared
    places = range(*piece)
    with contextlib.ExitStack() as stack:
        if not folder.is_dir():  # on another machine
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        return cosimulate(
            model,
            recordings.subset(places),
            dataclasses.replace(how, cocotb=range(shown - piece[0]), waves=waves),
            numbers=[numbers[i] for i in places],
            work=folder / f"from{piece[0]}",
            design=folder / "design",
        )
