"""Make a board's bitstream and report its area by block, its clock and the clock that each budget
needs.

Example: eskin build model --target icebreaker --seeds 5

The accelerator goes through Yosys and nextpnr; of several seeds the best is taken.
"""

from __future__ import annotations

import math
import shlex
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from amaranth.back import rtlil
from amaranth.lib.wiring import Component

from eskin.cli.common import (
    ModelOptions,
    integer_model,
    option,
    parse_lanes,
    progress_bars,
    required,
    show,
    stop,
    warn,
)
from eskin.cosim.latency import COUNT_OF, limits
from eskin.golden.core import (
    AcceleratorConfig,
    Arrays,
    InputError,
    Progress,
    Record,
    Result,
    check_folder,
    content_key,
    model_hash,
    replacing_folder,
    write_json,
)
from eskin.golden.core.config import WIDEST_DSP_ACCUMULATOR
from eskin.golden.core.converters import sample_clock
from eskin.memo import Memo, code_version
from eskin.rtl.common import lanes_in_large_memories, short_of_blocks
from eskin.rtl.engine.lanes import LANE_TYPES
from eskin.rtl.fpga import blocks, implementation
from eskin.rtl.fpga.generate import contents, write_contents
from eskin.rtl.fpga.implementation import FAMILIES, DoesNotFit, Implementation, NoRoute, place
from eskin.rtl.fpga.synthesis import Family, Netlist, synthesise
from eskin.rtl.fpga.targets import Target
from eskin.rtl.fpga.targets import target as find_target
from eskin.rtl.fpga.tools import need_tool
from eskin.rtl.fpga.wiring import Wiring
from eskin.rtl.host.uart import DIVISOR_MIN
from eskin.rtl.image.image_engine import refuse_hardware
from eskin.rtl.program.memory_map import memory_images
from eskin.rtl.program.schedule import (
    decision_cycles,
    frame_cycles,
    lowest_clock_hz,
    mean_frame_cycles,
    step_cycles,
)
from eskin.rtl.top import standby
from eskin.rtl.top.system import BAUD, refuse_standalone
from eskin.study.energy import (
    PARTS,
    Estimate,
    Power,
    Turn,
    bitstream_power,
    estimate,
    in_words,
    scheduled_activity,
)
from eskin.training.record import training_of


class BoardRequest(ModelOptions):
    target: str = required("icebreaker, upduino, ulx3s or tangnano9k.", metavar="NAME")
    lanes: str | None = option(
        "Parallel multipliers. Default: the model's, or as many as fit.", metavar="P[:TYPE]"
    )
    link: bool = option("Include the serial link, or build onset to decision only.", True)
    converter: str | None = option(
        "Read frames from this converter. Default with --standalone: the model's.", metavar="NAME"
    )
    frames: bool = option("With a converter: a host can ask for its frames.", False, "--frames")
    stimulator: bool = option("With a converter: decisions drive the stimulator.", False, "--stimulator")
    standalone: bool = option(
        "Build without a host: model in the bitstream, frames from a converter.", False, "--standalone"
    )
    clock: float | None = option("Target clock. Default: the board's oscillator.", min=1e3, metavar="HZ")
    seeds: int = option("Number of placements to try; the fastest is kept.", 1, min=1, max=1000)
    out: Path | None = option("Folder to write: new, or an earlier build. Default: build/board/NAME.")


def command(request: BoardRequest) -> None:
    if request.stimulator and not (request.standalone or request.converter):
        raise InputError(
            "--stimulator: is for a board with a converter; add --converter NAME or --standalone"
        )
    if request.frames and (request.standalone or not request.converter):
        raise InputError(
            "--frames: is for a host and a converter; add --converter NAME, and leave out --standalone"
        )
    if request.converter and not (request.standalone or request.link):
        raise InputError("--converter: needs the link or --standalone; leave out --no-link")
    if request.standalone and not request.link:
        raise InputError("--standalone: never has a link; leave out --no-link")
    target, (lanes, lane_type) = find_target(request.target), parse_lanes(request.lanes)
    folder = request.out or BOARDS / request.target
    check_folder(folder, MARK)
    integer = integer_model(request.model)
    config = with_converter(suited(integer.config, target, lanes, lane_type), request.converter)
    if request.frames:
        config = config.replace(send_frames=True)
    if request.stimulator and config.interface.stimulator == "none":
        config = config.replace(stimulator="decisions")
    design = BuildRequest(
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
    if design.wiring().standby:
        refuse_rate_not_held(request.model)
    try:
        with progress_bars() as report:
            result, bitstream, netlist, placed = build(design, report)
    except BuildError as error:
        stop(str(error), 1)
    with replacing_folder(folder) as new:
        shutil.copyfile(bitstream, new / result.bitstream)
        shutil.copyfile(netlist, new / "netlist.v")
        write_contents(new, contents(placed, integer.arrays))
        write_json(new / MARK, result)
    show("build", **dict(result), block_rows=block_rows(result), in_words=in_words, folder=folder)
    if not result.clock_met:
        stop(clock_sentence(result), 1)


def refuse_rate_not_held(folder: Path) -> None:
    """Refuse a model that is known not to hold another rate: the part's own oscillators are off by up to
    `standby.TOLERANCE`. A model that is below the bound by less than the standard error of its accuracy gets a warning.

    Raises
    ------
    InputError
        Training has judged it, and its figure is further below the bound.
    """
    for split in training_of(folder).cross_validation[:1]:
        if not (nested := split.nested) or not (row := nested.disturbed.oscillator) or row.held:
            return
        found = (
            f"the part's own oscillator is off by up to {100 * standby.TOLERANCE:g} %, and '{folder}' decides "
            f"{100 * row.figure:.1f} % of unseen recordings with {row.mode} where {100 * row.bound:.1f} % are asked"
        )
        if row.figure + nested.standard_error >= row.bound:
            warn(f"warning: {found}; it is below that by less than a standard error")
            return
        raise InputError(
            f"`standalone`: {found}; train with --stress FILE, in which '{row.mode}' weighs more, or use a board with a clock"
        )


CACHE = Path("build/implementations")
"""Finished netlists and placements by content; safe to delete."""

BOARDS = Path("build/board")
"""Default folder of builds, with one sub-folder per board."""

MARK = "build.json"
"""A folder with this file was built and may be replaced."""

TOP, CHAIN = "accelerator", "inner.chain"

LARGEST = "ulx3s"
"""The board with the largest part."""

SEEDS_WORTH_TRYING = 5

FAILURES_MAX = 10
"""Failed seeds after which a build gives up: without a route, or with paths that are too short. On a Gowin
part two of three seeds fail."""


class OnBoard(Result):
    """What a host has to know of a board. link: a host talks to it, at ``baud`` bits a second."""

    link: bool
    lanes: int
    lane_type: str | None
    baud: float = 0.0


class TooMany(Result):
    """Lanes that do not fit, and resources that they lack."""

    lanes: int
    needs: str


class Used(Result):
    """Of a resource of the part."""

    used: int
    available: int


class Counts(Result):
    """Cycles of the schedule."""

    step: int
    step_ideal: int
    decision: int


class PlannedBudget(Result):
    """A budget by the cycles that the schedule plans; co-simulation measures them, with the few of the front end."""

    name: str
    limit_s: float
    cycles: int
    needed_clock_hz: float
    met: bool


class Asleep(Result):
    """A part whose fast oscillator runs for each scan: seconds of its start, share by which its rate is off, jitter of
    scans, and SCLK of its converter (None: it has none)."""

    start_s: float
    rate_error: float
    scan_jitter_s: float
    sclk_hz: float | None = None


class Build(OnBoard):
    """build.json.

    lanes_chosen_by: asked or fit. not_taken: seed -> why. logic_cells: without harness_cells, which take the place of a
    link. blocks: cells of each block by column. clock_hz: asked; reached_hz: the highest that the oscillator may
    have; clock_met: that is no more than fmax_hz. seeds: highest clock of each. energy, power: where figures of the part are
    published. class_pins: how the class stands on pins. converter to wiring: of a board that has one. standby: of
    a board that sleeps.
    """

    model_hash: str = ""
    lanes_chosen_by: str = ""
    lanes_too_many: TooMany | None = None
    not_taken: Mapping[str, str] = {}
    target: str
    device: str
    images: bool
    logic_cells: int
    lut: int
    ff: int
    dsp: int
    bram: int
    spram: int
    harness_cells: int
    blocks: Mapping[str, Mapping[str, int]]
    utilisation: Mapping[str, Used]
    fmax_hz: float
    clock_hz: float
    reached_hz: float = 0.0
    clock_met: bool
    critical_path: str
    seed: int
    seeds: Mapping[str, float]
    cycles: Counts
    lowest_clock_hz: float
    budgets: Sequence[PlannedBudget]
    energy: Estimate | None
    power: Power | None = None
    bitstream: str
    class_pins: str = ""
    standalone: bool = False
    converter: str = ""
    stimulator: bool = False
    wiring: Sequence[Mapping[str, str]] = ()
    standby: Asleep | None = None


class BuildError(RuntimeError):
    """The design does not fit; the message says by how much and what would help."""


def suited_lane_type(config: AcceleratorConfig, target: Target) -> str:
    """The lane type that suits the board's part. Sums of very many inputs do not fit the accumulators of its
    DSP blocks; plain lanes take those."""
    narrow = config.is_image or config.accumulator_bits <= WIDEST_DSP_ACCUMULATOR
    return "dsp" if "dsp" in LANE_TYPES and target.family.dsp == "SB_MAC16" and narrow else "plain"


def suited(
    config: AcceleratorConfig, target: Target, lanes: int | None = None, lane_type: str | None = None
) -> AcceleratorConfig:
    """``config`` on the lanes asked for; by default on as many as it has, of the type that suits the
    part.

    Raises
    ------
    InputError
        Lanes that there are not, or not for images.
    """
    suited_config = config.with_lanes(lanes, lane_type or suited_lane_type(config, target))
    if suited_config.is_image:
        refuse_hardware(suited_config)
    return suited_config


def with_converter(
    config: AcceleratorConfig, converter: str | None, clock_hz: float | None = None
) -> AcceleratorConfig:
    """The configuration with that converter (None, or the name that it has: as it is) at the clock it is used
    with, which is checked against its pace."""
    own = config.interface.converter.name
    changes: Record = {} if converter in (None, own) else {"converter": converter}
    if clock_hz and (converter or own) != "none":
        changes["clock_hz"] = float(clock_hz)
    return config.replace(**changes) if changes else config


@dataclass(frozen=True, kw_only=True)
class BuildRequest:
    """The design to place.

    Attributes
    ----------
    config:
        With the wanted lanes.
    lanes_asked:
        They are the user's wish; otherwise fewer are taken where these do not fit.
    misfit:
        (lanes, what the part lacks for them) of the first try, where fewer were taken.
    arrays:
        Of the integer model; they matter for a ROM design only.
    link:
        The accelerator behind its serial link: what goes onto a board. False: onset to decision alone, for
        its area and speed.
    standalone:
        No host: the model in the bitstream, frames from the configuration's converter, its stimulator if it
        has one.
    sensing:
        With the link: frames from the configuration's converter, its stimulator if it has one; a host loads
        the model.
    clock_hz:
        The clock that must be reached, and that the link divides; default: the board's oscillator.
    seed, seeds:
        The first seed and how many from it on are tried.
    cache:
        Where netlists and placements are kept; which are not made again.
    """

    config: AcceleratorConfig
    arrays: Arrays
    target: Target
    link: bool = True
    standalone: bool = False
    sensing: bool = False
    clock_hz: float | None = None
    lanes_asked: bool = False
    misfit: TooMany | None = None
    seed: int = 1
    seeds: int = 1
    cache: Path = CACHE

    @property
    def wanted_hz(self) -> float:
        """The clock to reach."""
        return self.clock_hz or self.target.clock_hz

    @property
    def hosted(self) -> bool:
        """A host talks to it."""
        return self.link and not self.standalone

    @property
    def rate(self) -> float | None:
        """Bits a second of its link: the highest up to `BAUD` that its clock makes exactly.

        Raises
        ------
        InputError
            The clock does not make them.
        """
        clock = self.wanted_hz
        return clock / max(DIVISOR_MIN, math.ceil(clock / BAUD)) if self.hosted else None

    def wiring(self) -> Wiring:
        """Its design and pins.

        Raises
        ------
        InputError
            What a board without a host cannot do.
        """
        config, skin = self.config, self.standalone or self.sensing
        if skin:
            config = config.replace(clock_hz=self.wanted_hz)
        if self.standalone:
            config = config.replace(loadable=False)
            refuse_standalone(config)
        return Wiring(
            config=config,
            target=self.target,
            link=self.hosted,
            sensing=skin,
            standby=self.standalone and not self.awake,
        )

    @property
    def awake(self) -> str:
        """Why the clock of a board without a host never stops; empty where it does."""
        if self.target.family.name != "ice40":
            return f"the {self.target.device} has no oscillator that can be switched off"
        return standby.cannot_sleep(self.config.replace(loadable=False), self.wanted_hz)

    def spared(self, misfit: DoesNotFit) -> BuildRequest | None:
        """The same with weights in large memories, where block memories are what the part lacks."""
        config, family = self.wiring().config, self.target.family.name
        spared = config.replace(spare_blocks=True) if config.recurrent else config
        short = (
            "block memories" in misfit.shortage and config.recurrent and not short_of_blocks(config, family)
        )
        return replace(self, config=spared) if short and lanes_in_large_memories(spared, family, 1) else None

    def on_fewer_lanes(self, misfit: DoesNotFit) -> BuildRequest | None:
        """The same on fewer lanes: fewer by the multipliers that are missing, else by one. None where the
        user named the lanes, or where fewer would not help."""
        lanes, short = self.config.hardware.lanes, misfit.shortage
        weights_alone = set(short) == {"block memories"} and not self.config.recurrent
        if self.lanes_asked or lanes == 1 or weights_alone:
            return None
        fewer = lanes - (_over(short, "multipliers") if "multipliers" in short else 1)
        if fewer < 1:
            return None
        return replace(
            self,
            config=self.config.with_lanes(fewer),
            misfit=self.misfit or TooMany(lanes=lanes, needs=_lacks(short)),
        )


def build(
    request: BuildRequest, progress: Progress | None = None
) -> tuple[Build, Path, Path, AcceleratorConfig]:
    """The best of the placements. Where a recurrent design lacks block memories and the part has large ones,
    they hold its weights (``spare_blocks``).

    Returns
    -------
    The result (`build.json`), its bitstream, its netlist as Verilog, and the configuration that is placed.

    Raises
    ------
    BuildError
        The part is too small.
    """
    report = progress or (lambda stage, done, total: None)
    wiring, rate = request.wiring(), request.rate
    config, target, pins = wiring.config, request.target, wiring.sites()  # refuses before anything is made
    need_tool(FAMILIES[target.family.name].packer)
    images = None if config.hardware.loadable else memory_images(config, request.arrays)
    border = "" if request.link else CHAIN
    report("synthesis", 0, 1)
    netlist, key = cached_netlist(
        lambda: wiring.design(images, request.wanted_hz, rate),
        target.family,
        request.cache,
        keep=[border] if border else [],
    )
    report("synthesis", 1, 1)
    placements: list[Implementation] = []
    not_taken: dict[str, str] = {}  # seed: why
    failures = max(FAILURES_MAX, request.seeds)
    try:
        while len(placements) < request.seeds and len(not_taken) < failures:
            report("placements", len(placements), request.seeds)
            seed = request.seed + len(placements) + len(not_taken)  # a failed seed is replaced by the next
            try:
                placement = _placement(netlist, key, target, pins, border, seed, request.cache)
            except NoRoute:
                not_taken[str(seed)] = "no route was found"
                continue
            if placement.hold_errors:
                not_taken[str(seed)] = f"{placement.hold_errors} paths are too short at any clock"
            else:
                placements.append(placement)
    except DoesNotFit as misfit:
        if again := request.spared(misfit) or request.on_fewer_lanes(misfit):
            return build(again, progress)
        alone = request.standalone or request.sensing
        raise BuildError(misfit_sentence(config, target, request.hosted, misfit, alone=alone)) from None
    report("placements", request.seeds, request.seeds)
    if not placements:
        raise BuildError(
            f"no seed from {request.seed} to {request.seed + failures - 1} gives a valid placement (seed "
            f"{request.seed}: {not_taken[str(request.seed)]}); --seeds {2 * failures} tries more"
        )
    best = max(placements, key=lambda placement: placement.fmax_hz)
    awake = request.awake if request.standalone else ""
    result = _result(config, target, request.link, best, placements, request.wanted_hz, wiring.standby, awake)
    result.model_hash, result.not_taken = model_hash(config, request.arrays), not_taken
    result.lanes_chosen_by = "asked" if request.lanes_asked else "fit"
    result.lanes_too_many = request.misfit
    if request.hosted:
        assert rate is not None
        result.baud, result.class_pins = rate, wiring.shown
    if wiring.sensing:
        result.link, result.standalone = request.sensing, request.standalone
        result.converter = config.interface.converter.name
        result.stimulator, result.wiring = config.interface.stimulator != "none", wiring.table()
    if wiring.standby:
        p, _ = sample_clock(standby.SLOW_HZ, config.sensor.scan_rate_hz)
        period = standby.standby_plan(config, request.wanted_hz).sclk_cycles
        result.standby = Asleep(
            start_s=standby.start_cycles() / standby.SLOW_HZ,
            rate_error=standby.TOLERANCE,
            scan_jitter_s=0.0 if p == 1 else 1 / standby.SLOW_HZ,
            sclk_hz=request.wanted_hz / period if period else None,
        )
    return result, best.bitstream, netlist.verilog, config


def board_of(model: Path) -> tuple[int, int, Any]:
    """(bits a second, lanes, lane type) of the board that runs ``model``: of the single build in the model's
    folder, else beside it, else in `BOARDS`.

    Raises
    ------
    InputError
        There is none, or more than one; or it is one without the link.
    """
    builds: list[Path] = []
    for folder in (model, model.resolve().parent, BOARDS):
        builds = builds or sorted(folder.glob(f"*/{MARK}"))
    if len(builds) != 1:
        found = (
            f"of {', '.join(str(path.parent) for path in builds)} it may be each"
            if builds
            else "there is none"
        )
        raise InputError(
            f"--port: the build of the board holds its rate and lanes, and {found}; run "
            + shlex.join(["eskin", "build", str(model), "--target", "NAME", "--out", f"{model}/board"])
        )
    board = OnBoard.read(builds[0], "build the board again")
    if not board.link:
        raise InputError(
            f"--port: {builds[0].parent} was built with --no-link, so no host can talk to it; build it again "
            "without that option"
        )
    return round(board.baud), board.lanes, board.lane_type


def _result(
    config: AcceleratorConfig,
    target: Target,
    link: bool,
    best: Implementation,
    placements: list[Implementation],
    wanted_hz: float,
    sleeps: bool = False,
    awake: str = "",
) -> Build:
    inside = {name: counts for name, counts in best.blocks.items() if link or name != blocks.TOP}
    total: Record = {
        column: sum(counts[column] for counts in inside.values()) for column in implementation.COLUMNS
    }
    needed_hz = max([lowest_clock_hz(config), *(row.needed_clock_hz for row in _budgets(config, wanted_hz))])
    activity = scheduled_activity(config, step_cycles(config), *mean_frame_cycles(config), total["dsp"])
    modelled = target.device in PARTS
    turn = Turn(*standby.turn(config, wanted_hz)) if sleeps else None
    reached_hz = wanted_hz * (1 + standby.TOLERANCE * sleeps)  # an own oscillator may be faster
    return Build(
        target=target.name,
        device=target.device,
        lanes=config.hardware.lanes,
        lane_type=config.hardware.lane_type,
        link=link,
        images=config.is_image,
        logic_cells=total["cells"],
        **total,
        harness_cells=0 if link else best.blocks[blocks.TOP]["cells"],
        blocks=best.blocks,
        utilisation={
            resource: Used(used=count, available=available)
            for resource, (count, available) in best.utilisation.items()
        },
        fmax_hz=best.fmax_hz,
        clock_hz=wanted_hz,
        reached_hz=reached_hz,
        clock_met=best.fmax_hz >= reached_hz,
        critical_path=best.path,
        seed=best.seed,
        seeds={str(placement.seed): placement.fmax_hz for placement in placements},
        cycles=Counts(
            step=step_cycles(config), step_ideal=config.step_ideal, decision=decision_cycles(config)
        ),
        lowest_clock_hz=lowest_clock_hz(config),
        budgets=_budgets(config, wanted_hz),
        energy=estimate(config, target.device, activity, needed_hz) if modelled else None,
        power=bitstream_power(config, target.device, activity, wanted_hz, turn=turn, awake=awake)
        if modelled
        else None,
        bitstream=f"{config.name}_{target.name}{best.bitstream.suffix}",
    )


def _budgets(config: AcceleratorConfig, clock_hz: float) -> list[PlannedBudget]:
    """Budgets at the clock."""
    planned = {
        "frame_max": frame_cycles(config),
        "step_max": step_cycles(config),
        "decision_latency_max": decision_cycles(config),
    }
    budgets = []
    for name, limit in limits(config).items():
        cycles = planned[COUNT_OF[name]]
        needed_hz, met = cycles / limit, cycles / clock_hz <= limit
        budgets.append(
            PlannedBudget(name=name, limit_s=limit, cycles=cycles, needed_clock_hz=needed_hz, met=met)
        )
    return budgets


def misfit_sentence(
    config: AcceleratorConfig, target: Target, link: bool, misfit: DoesNotFit, *, alone: bool = False
) -> str:
    """The missing resources, and the remedy."""
    short = misfit.shortage
    lacks = _lacks(short)
    helps = []
    if config.is_image and "block memories" in short:
        helps.append("a network with fewer weights in its convolutions needs fewer")
    elif not config.recurrent and "block memories" in short:
        helps.append("fewer windows (steps), or one set of weights for all (weight_sets one), need fewer")
    elif config.hardware.lanes > 1:
        fewer = max(1, config.hardware.lanes - _over(short, "multipliers")) if "multipliers" in short else 1
        helps.append(f"--lanes {fewer} needs {'fewer' if 'multipliers' in short else 'least'}")
    if target.name != LARGEST:
        helps.append(f"--target {LARGEST} has a larger part")
    elif not helps:
        helps.append("fewer taxels or hidden units need less")
    if link and not alone:
        helps.append("--no-link leaves out what talks to the host")
    design = "with the link" if link else "without the link"
    return (
        f"{design}, does not fit the {target.device} of {target.name}: it needs {lacks}; {', '.join(helps)}"
    )


def _lacks(short: Mapping[str, tuple[int, int]]) -> str:
    return ", ".join(
        f"{needed} {resource} of {available} ({needed - available} too many)"
        for resource, (needed, available) in short.items()
    )


def _over(short: Mapping[str, tuple[int, int]], resource: str) -> int:
    needed, available = short[resource]
    return needed - available


def clock_sentence(result: Build) -> str:
    """By how much the clock is missed and what would help."""
    reached_hz = result.reached_hz
    short = reached_hz - result.fmax_hz
    tried = len(result.seeds)
    if tried < SEEDS_WORTH_TRYING and short < 0.15 * reached_hz:
        helps = f"--seeds {SEEDS_WORTH_TRYING} tries more placements"
    else:
        helps = f"--clock {math.floor(result.fmax_hz / 1e5) * 1e5:.0f} is a clock it reaches"
    share = 100 * short / reached_hz
    clock = f"{result.fmax_hz / 1e6:.1f} of {reached_hz / 1e6:g} MHz"
    return f"misses its clock: {clock}, {share:.1f} % too slow; {helps}"


# ---------------------------------------------------------------------- kept work
def cached_netlist(
    design: Callable[[], Component], family: Family, cache: Path, **options: Any
) -> tuple[Netlist, str]:
    """The netlist of a design and its key; an unchanged one is taken from ``cache``. options: of `synthesise`."""
    text = rtlil.convert(design(), name=TOP, platform=family.name, emit_src=False)
    key = content_key(text, str(family), options, code_version("rtl"))
    folder = Memo(cache).folder(key, lambda new: synthesise(design(), family, new, top=TOP, **options))
    return Netlist.of(folder, family, TOP), key


def _placement(
    netlist: Netlist, key: str, target: Target, pins: Mapping[str, str], border: str, seed: int, cache: Path
) -> Implementation:
    def make(new: Path) -> None:
        work = new / "work"
        placement = place(netlist, target, pins, work, seed=seed, border=border)
        placement.bitstream.rename(new / placement.bitstream.name)
        shutil.rmtree(work)  # megabytes that nothing reads again
        write_json(new / "implementation.json", placement)

    folder = Memo(cache).folder(content_key(key, str(target.place), dict(pins), seed), make)
    placement = Implementation.read(folder / "implementation.json", "remove it")
    placement.bitstream = folder / placement.bitstream.name
    return placement


# ---------------------------------------------------------------------- rows of the table
def block_rows(result: Build) -> list[tuple]:
    """Cells by block, and their sum, which is the whole device's use."""
    top = "(pins)" if result.link or result.standalone else "(harness)"
    named = {blocks.TOP: top, blocks.WIRING: "(wiring between)"}
    counts = {
        named.get(name, name): [block[column] for column in implementation.COLUMNS]
        for name, block in result.blocks.items()
    }
    largest = sorted(counts.items(), key=lambda block: -block[1][0])
    totals = map(sum, zip(*counts.values(), strict=True))
    return [*((name, *cells) for name, cells in largest), ("sum", *totals)]
