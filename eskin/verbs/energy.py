"""Estimate the energy of a touch and the idle power from a simulated netlist. Takes minutes.

Example: eskin energy model --data recordings.npz --configuration icebreaker:6 --configuration ulx3s:12

Activity is counted in co-simulated netlists of several configurations.
For each configuration: the lowest clock that meets every budget (generated Verilog at the sensor's pace),
then the netlist that placement gets, with counters beside its cells, over the same recordings at full pace
and at a slower one. Both runs must be bit-exact.
"""

import dataclasses
import math
from pathlib import Path

import numpy as np

from eskin.cli.common import ModelDataOptions, option, parse_lanes, progress_bars, recordings_for, show
from eskin.cosim import flow
from eskin.cosim.activity import instrument, read_count
from eskin.cosim.results import Played
from eskin.cosim.simulation import Simulation
from eskin.data.table import Reading
from eskin.data.text import read_text
from eskin.golden.core import AcceleratorConfig, InputError, Result, check_target, write_json
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, find_touches
from eskin.rtl.fpga.blocks import block_of
from eskin.rtl.fpga.generate import generate
from eskin.rtl.fpga.targets import target as find_target
from eskin.rtl.program.schedule import frame_cycles, mean_frame_cycles, step_cycles
from eskin.rtl.program.timing import logit_to_decision
from eskin.rtl.top import standby
from eskin.study import energy
from eskin.study.energy import Estimate, Power, Turn, in_words
from eskin.study.touch_ends import with_touches
from eskin.verbs.cosim import expected_of, netlist_of, work_folder


class EnergyRequest(ModelDataOptions):
    configuration: list[str] | None = option(
        "Board, lanes and lane type; may be repeated.", metavar="TARGET:LANES[:TYPE]"
    )
    recordings: int = option("Number of recordings to simulate.", 2, min=1)
    touches: float = option("Touches a minute, for the average power.", 60.0, min=0)
    measured: Path | None = option(
        "An instrument's CSV file: time, current, voltage; printed beside the estimate.", metavar="FILE"
    )
    out: Path = option("Folder for energy.json.", Path("build/energy"))


def command(request: EnergyRequest) -> Result:
    check_target(request.out / RESULT)
    model = IntegerModel.load(request.model)
    recordings = recordings_for(request.data, model.config)
    boards = [*map(parse_configuration, request.configuration or CONFIGURATIONS)]
    for target, lanes, kind in boards:  # one that cannot be is refused before any long work
        model.config.with_lanes(lanes, kind)
        if find_target(target).device not in energy.PARTS:
            raise InputError(
                f"--configuration {target}: there is no energy model of its part; use another board"
            )
    measured = measured_power(request.measured) if request.measured else None
    numbers, chosen = with_touches(model, recordings, request.recordings)
    rows, touches = [], request.touches
    with work_folder() as work, progress_bars() as notify:
        for number, (target, lanes, kind) in enumerate(boards):
            notify(f"configurations measured, now {target} with {lanes} lanes", number, len(boards))
            place = work / f"{target}{lanes}{kind}"
            rows.append(measure(model, numbers, chosen, target, lanes, kind, work=place, touches=touches))
    result = Energies(configurations=rows, passed=all(row.bit_exact for row in rows), measured=measured)
    write_json(request.out / RESULT, result)
    show("energy", **dict(result), in_words=in_words, file=request.out / RESULT)
    return result


CONFIGURATIONS = ("icebreaker:1", "icebreaker:4", "icebreaker:6", "ulx3s:12")
"""Default comparison: board, lanes, lane type."""
SLOW_FACTOR, SLOWER_LEAST = 4, 1.5
"""Cycles a frame of the slower run: in taxels, and over cycles of the run at full pace at least."""
RESULT = "energy.json"


class Configuration(Estimate):
    """A board with a number of lanes of a type; its cells by type. power: of its bitstream, at the board's
    clock; power_standalone: of one without a host, whose clock stops (None: it does not, or there is no converter)."""

    name: str
    target: str
    lanes: int
    lane_type: str
    cells: dict[str, int]
    bit_exact: bool
    power: Power | None = None
    power_standalone: Power | None = None


class Measured(Result):
    """Mean power that an instrument recorded; volt: mean voltage."""

    file: str
    seconds: float
    samples: int
    volt: float
    mean_w: float


class Energies(Result):
    """energy.json. passed: all are bit-exact. measured: an instrument's record."""

    configurations: list[Configuration]
    passed: bool
    measured: Measured | None = None


SUPPLY_VOLT = 3.3
"""Of an instrument's file without a voltage: the boards' rail."""
PREFIXES = {"": 1.0, "m": 1e-3, "u": 1e-6, "µ": 1e-6, "n": 1e-9}


def measured_power(path: Path) -> Measured:
    """Mean power of a record of an instrument: a CSV file with the columns time, current and, if known, voltage,
    by name or without a header in this order; in s, A and V unless the header says otherwise, as in ``Current
    (uA)``. Power is a straight line between two samples.

    Raises
    ------
    InputError
        It is no such table, or its times do not rise.
    """
    table = read_text(path, Reading())
    header = [name.lower() for name in table.header()]
    columns = []
    for place, word in enumerate(("time", "current", "volt")):
        named = [column for column, name in enumerate(header) if name.startswith(word)]
        columns += named[:1] or [place] * (not header and place < table.width)
    if len(columns) < 2:
        table.refuse("is no record of an instrument; give columns time (s), current (A) and voltage (V)")
    units = ["".join(table.units_of([column])) for column in columns]
    scales = [PREFIXES.get(unit[:-1], 1.0) for unit in units]
    seconds, ampere, *volts = (table.numbers(columns) * scales).T
    if len(seconds) < 2 or (np.diff(seconds) <= 0).any():
        table.refuse("its times do not rise; give one row per sample")
    volt = volts[0] if volts else np.full(len(seconds), SUPPLY_VOLT)
    duration = seconds[-1] - seconds[0]
    return Measured(
        file=str(path),
        seconds=float(duration),
        samples=len(seconds),
        volt=float(volt.mean()),
        mean_w=float(np.trapezoid(ampere * volt, seconds) / duration),
    )


def parse_configuration(text: str) -> tuple[str, int, str]:
    """(target, lanes, lane type) of ``TARGET:LANES[:TYPE]``, plain where no type is named."""
    target, _, rest = text.partition(":")
    find_target(target)
    lanes, kind = parse_lanes(rest, f"--configuration {target}:P[:TYPE],")
    return target, lanes, kind or "plain"


def measure(
    model: IntegerModel,
    numbers: np.ndarray,
    recordings: Recordings,
    target: str,
    lanes: int,
    lane_type: str,
    *,
    work: Path,
    touches: float = 60.0,
) -> Configuration:
    """Activity and estimate of one configuration.

    Parameters
    ----------
    numbers, recordings:
        Of `with_touches`.
    work:
        Folder for design, vectors and captures. touches: a minute.
    """
    requested = model.config.with_lanes(lanes, lane_type)
    config = requested.replace(converter="none")  # frames as recorded: the chain alone is counted
    design = generate(config, model.arrays, work / "design")
    vectors = expected_of(model, recordings, work / "vectors.npz", numbers)
    first = expected_of(model, recordings.subset([0]), work / "one.npz", numbers[:1])
    lowest = flow.lowest_clock(design, first, Simulation(), work=work / "clock")
    hardware, cells = netlist_of(config, model.arrays, target, probes=False)
    (work / "counted.v").write_text(instrument(hardware.sources[0].read_text(), block_of))
    sources = work / "counted.v", *hardware.sources[1:]
    how = Simulation(hardware=dataclasses.replace(hardware, sources=sources))
    full = flow.cosim(design, vectors, how, work=work / "full")
    clock_hz = slower_cycles(config, full) * config.sensor.scan_rate_hz
    how = dataclasses.replace(how, pace="declared", clock_hz=clock_hz)
    slow = flow.cosim(design, vectors, how, work=work / "slow")
    played = find_touches(config, recordings)
    played = played.take(played.first_touch())
    activity = energy.counted_activity(
        read_count(work / "full"),
        read_count(work / "slow"),
        frames=full.frames,
        touch_frames=int((played.ends(config)[:, -1] - played.start_frame + 1).sum()),
        steps=full.steps,
        recordings=len(recordings),
        quiet_frame_cycles=mean_frame_cycles(config)[1],
        step_cycles=(full.registers["LONGEST"] or 0) + logit_to_decision(config) - 1,
    )
    board = find_target(target)
    turn, has_converter = None, requested.interface.converter.name != "none"
    if board.family.name == "ice40" and has_converter and not standby.cannot_sleep(requested, board.clock_hz):
        turn = Turn(*standby.turn(requested, board.clock_hz))
    power, power_standalone = (
        energy.bitstream_power(requested, board.device, activity, board.clock_hz, touches, each)
        for each in (None, turn)
    )
    return Configuration(
        name=f"{target}, {lanes} {lane_type} lane{'s' if lanes > 1 else ''}",
        target=target,
        lanes=lanes,
        lane_type=lane_type,
        cells=cells,
        bit_exact=all(result.bit_exact for result in (lowest, full, slow)),
        power=power,
        power_standalone=power_standalone if turn else None,
        **dict(energy.estimate(requested, board.device, activity, lowest.clock_hz)),
    )


def slower_cycles(config: AcceleratorConfig, full: Played) -> int:
    """Cycles a frame of the slower run, given the result of the run at full pace: a frame and a step follow each
    other.

    Several kinds of feature hold frames up at full pace, and so do steps that follow each other closely.
    """
    least = math.ceil(SLOWER_LEAST * full.simulated_cycles / full.frames)
    return max(SLOW_FACTOR * config.sensor.taxels, least, frame_cycles(config) + step_cycles(config))
