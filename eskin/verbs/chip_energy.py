"""Energy of a chip's netlist from its activity on recordings: steps, frames, waiting, whole touches.

A recording is played at a slow pace, so that the clock stops between frames where it can, and everything is
counted frame by frame. A step costs what the frames around its decision cost beyond those of the same touch
without one. What a cycle without an edge costs is known from the clock's first net, so that any clock can be
asked about.
"""

import dataclasses
from operator import ne

import numpy as np

from eskin.cosim.device import Device
from eskin.cosim.gates import Chip
from eskin.cosim.latency import limits
from eskin.golden.core import AcceleratorConfig, Arrays, InputError, Record
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, run
from eskin.golden.model.pipeline import find_touches
from eskin.rtl.asic.liberty import WireLoad
from eskin.rtl.asic.nets import BAND, Nets, costs
from eskin.rtl.asic.synthesis import expression
from eskin.rtl.fpga.generate import boot_writes, pack_decision
from eskin.rtl.program.memory_map import Control, Register
from eskin.rtl.program.schedule import lowest_clock_hz, schedule
from eskin.study.energy import BATTERY_J, TOUCHES_PER_S

SEED = 1
"""Seed of the random contents that registers and memories begin with."""
NEAR = 3
"""Frames on either side of a step whose energy may belong to its decision; fewer where windows follow
closely."""
DRAIN_CYCLES = 48
"""Cycles of a slow frame beyond two a taxel: enough for the clock to stop within it."""
METHOD = (
    "changes of nets from cycle to cycle at gate level, Liberty energy and capacitance, wire load; glitches "
    "apart; no clock tree, no layout"
)
GLITCHES_BY = (
    "cells take their Liberty delay at a short edge and a small load, shorter pulses are swallowed, a glitch "
    "costs a full swing"
)


def with_touches(model: IntegerModel, recordings: Recordings, count: int) -> tuple[np.ndarray, Recordings]:
    """``count`` recordings with a whole touch, spread over the classes: their numbers, and they themselves, cut
    a hop after it; where none goes on so long, each to its end.

    Raises
    ------
    InputError
        None has a whole touch.
    """
    config = model.config
    recordings = recordings.scanned(config.sensor.scan_every)
    touches = find_touches(config, recordings)
    first = touches.first_touch()
    having = np.flatnonzero(first >= 0)
    having = having[touches.completed[first[having]] == config.windows.steps]
    if not len(having):
        raise InputError(
            f"recordings '{recordings.source}': none has a whole touch; energy needs one: look at their onsets with "
            "'eskin inspect'"
        )
    ends = touches.start_frame[first] + config.last_frame + config.windows.hop - 1
    longer = having[ends[having] <= recordings.lengths[having]]
    having = longer if len(longer) else having
    numbers = having[recordings.subset(having).evenly(min(count, len(having)))]
    return numbers, recordings.subset(numbers).until(np.minimum(ends, recordings.lengths)[numbers])


def _resting(recordings: Recordings, frames: int) -> Recordings:
    """The first of ``recordings``, with its last frame repeated ``frames`` times, because the frames after a
    decision belong to the energy of its step."""
    one = recordings.subset([0])
    samples = np.concatenate([one.samples, np.repeat(one.samples[-1:], frames, axis=0)])
    return dataclasses.replace(one, samples=samples, offsets=np.array([0, len(samples)]))


def measured(
    model: IntegerModel, nets: Nets, voltage: float, wire: WireLoad, leakage_w: float, recordings: Recordings
) -> Record:
    """The energies of `asic.json`, in joule, of one recording with a whole touch; the part of the glitches is
    listed as ``glitches``.

    Parameters
    ----------
    model:
        With the chip's configuration.
    leakage_w:
        Of the whole chip.

    Raises
    ------
    InputError
        No recording has a whole touch.
    """
    config = model.config
    chosen = _resting(with_touches(model, recordings, 1)[1], config.windows.hop)
    trace, cost = run(model, chosen), costs(nets, voltage, wire)
    library = {cell.name: cell for cell in nets.cells.values()}
    chip = Chip(nets.module, library, expression, SEED, delays=True)
    place = {kind: number for number, kind in enumerate(sorted({*cost.kind.values(), ACCESSES, "clock"}))}
    change, of = np.zeros(chip.nets), np.zeros(chip.nets, np.uint8)
    for net, kind in cost.kind.items():
        of[net], change[net] = place[kind], cost.joule[net] * (kind != "clock")
    edges = np.array([cost.joule[net] for net in chip.gates] or [0.0])
    joule = np.zeros(2 * len(place))  # what changes from cycle to cycle, and glitches
    accesses = [nets.cells[name].access_j[kind] for name in chip.macros for kind in ("read", "write")]
    of_macros = np.full(len(chip.macros), place[ACCESSES], np.uint8)
    chip.count_into(joule, (change, of, edges, of[[*chip.gates, 0]], np.array(accesses), of_macros))
    device = Device(chip, config.sensor.sample_bits)
    device.reset([*boot_writes(config, model.arrays), (int(Register.CONTROL), int(Control.ARM))])
    device.settle()
    device.forget()  # what a chain not yet reset may have offered
    marks = []
    for frame in chosen.recording(0):
        marks.append([device.state.cycle, device.state.edges, device.state.decisions, *joule])
        device.frames(frame[None], 2 * config.sensor.taxels + DRAIN_CYCLES)
    # a row a frame, to the next one's first taxel: cycles, edges that passed, decisions, joule by kind
    rows = np.diff(marks, axis=0)
    device.write(int(Register.CONTROL), int(Control.FINISH))
    device.settle()
    decisions = device.streams()["decision"][0].view(np.uint32).tolist()
    expected = [pack_decision(config, row) for row in trace.streams["decision"][0]]
    differing = sum(map(ne, decisions, expected)) + abs(len(decisions) - len(expected))
    onset = int(trace.touches.onset_frame[trace.first[0]]) - 1
    clock = max(lowest_clock_hz(config), schedule(config).decision_cycles / limits(config)["decision"])
    of_kind, extra = (
        {kind: rows[:, low + number] for kind, number in place.items()} for low in (3, 3 + len(place))
    )
    of_kind["clock"] = of_kind["clock"] + cost.root_j * rows[:, 1]
    energies = summary(config, rows, of_kind, onset, cost.root_j, leakage_w, clock)
    beyond = summary(config, rows, extra, onset, 0.0, 0.0, clock)
    glitches = {key: beyond[key] for key in GLITCHES} | {"method": GLITCHES_BY}
    hours = BATTERY_J / (energies["average_w"] + glitches["average_w"]) / 3600
    energies["glitches"] = glitches | {"battery_hours_with": hours}
    return energies | {
        "bit_exact": not differing and bool(decisions),
        "mismatches": differing,
        "compared_values": len(expected),
    }


ACCESSES = "reads and writes"
"""Kinds of access that macros charge for."""
GLITCHES = ("step_j", "interval_j", "touch_j", "frame_j", "average_w")
"""Energies that are told of glitches alone, too."""


def summary(
    config: AcceleratorConfig,
    rows: np.ndarray,
    of_kind: Arrays,
    onset: int,
    root_j: float,
    leakage_w: float,
    clock_hz: float,
) -> Record:
    """Energies from what each frame costs.

    Parameters
    ----------
    rows:
        A frame each, as `measured` makes them.
    of_kind:
        Joule of each frame by what changes, edges of the clock included.
    onset:
        Number of the frame at which the touch begins.
    """
    frame = np.sum(list(of_kind.values()), axis=0)
    decided = np.flatnonzero(rows[:, 2])
    near = np.zeros(len(rows), bool)
    around = NEAR + schedule(config).step_cycles // (2 * config.sensor.taxels + DRAIN_CYCLES)
    around = min(around, max(1, (config.windows.hop - 1) // 2 - 1))
    for row in decided:
        near[max(0, row - around) : row + around + 1] = True
    plain = ~near
    plain[: decided[0]] = plain[decided[-1] + 1 :] = False
    quiet = slice(NEAR, max(NEAR + 1, onset - around))
    hop, rate = config.windows.hop, config.sensor.scan_rate_hz
    period, steps, frames = clock_hz / rate, config.windows.steps, config.last_frame

    def whole(
        which: np.ndarray | slice,
    ) -> float:  # of a frame at that clock: its edges, and the first net in cycles without one
        return float(frame[which].mean() + root_j * (period - rows[which, 1].mean()))

    def step_energy(values: np.ndarray) -> float:
        return float((values[near].sum() - near.sum() * values[plain].mean()) / steps)

    step = step_energy(frame)
    parts = {kind: float(hop * values[plain].mean()) for kind, values in of_kind.items()}
    parts["clock"] += hop * root_j * (period - float(rows[plain, 1].mean()))
    parts |= {"step": step, "leakage": leakage_w * hop / rate}
    idle_w = leakage_w + rate * whole(quiet)
    average_w = idle_w + TOUCHES_PER_S * steps * step
    energies = {
        "step_j": step,
        "interval_j": sum(parts.values()),
        "waiting_cycle_j": root_j,
        "leakage_w": leakage_w,
        "touch_j": frames * whole(plain) + steps * step + leakage_w * frames / rate,
        "frame_j": whole(plain),
        "quiet_frame_j": whole(quiet),
        "idle_w": idle_w,
        "average_w": average_w,
    }
    return energies | {
        "band": BAND,
        "interval_parts_j": parts,
        "interval_frames": hop,
        "clock_hz": clock_hz,
        "clocked_share": float(rows[plain, 1].mean()) / period,
        "battery_hours": BATTERY_J / average_w / 3600,
        "method": METHOD,
    }
