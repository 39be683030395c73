"""Energy of a chip's netlist from its activity on recordings: steps, frames, waiting, whole touches.

A recording is played at a slow pace, so that the clock stops between frames where it can, and everything is counted frame by frame. A
step costs what the frames around its decision cost beyond those of the same touch without one. What a cycle without an edge costs is
known from the clock's first net, so that any clock can be asked about.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim import chip_activity, flow
from eskin.cosim.netlist import Hardware
from eskin.golden.core.errors import InputError
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.model import IntegerModel
from eskin.golden.model.pipeline import find_touches, run
from eskin.golden.model.vectors import write_vectors
from eskin.golden.studies.energy import BATTERY_J, TOUCHES_PER_S
from eskin.rtl.asic.energy import BAND, costs, simulated
from eskin.rtl.asic.liberty import Cell, WireLoad
from eskin.rtl.asic.models import models
from eskin.rtl.asic.synthesis import Netlist, Process
from eskin.rtl.fpga.generate import generate
from eskin.rtl.program.schedule import lowest_clock_hz, schedule

NEAR = 6
"""Frames around a decision in which its step may run."""
DRAIN_CYCLES = 48
"""Cycles of a slow frame beyond two a taxel: more than the clock runs on."""
METHOD = "changes of nets at gate level, Liberty energy and capacitance, wire load; no delays, so no glitches; no clock tree, no layout"


def with_touches(model: IntegerModel, recordings: Recordings, count: int) -> tuple[np.ndarray, Recordings]:
    """``count`` recordings with a whole touch, spread over the classes, each cut a hop after it: numbers and recordings."""
    touches = find_touches(model.config, recordings)
    ends = {}
    for number, touch in enumerate(touches.first_touch()):
        if touch >= 0 and touches.completed[touch] == model.config.windows.steps:
            end = int(touches.start_frame[touch]) - 1 + model.config.last_frame + model.config.windows.hop
            if end <= recordings.lengths[number]:
                ends[number] = end
    if not ends:
        raise InputError(f"recordings '{recordings.source}': none has a whole touch and a hop after it; energy needs one")
    whole = np.array(sorted(ends))
    numbers = whole[recordings.subset(whole).evenly(min(count, len(whole)))]
    chosen = recordings.subset(numbers)
    lengths = [ends[int(number)] for number in numbers]
    samples = np.concatenate([chosen.recording(index)[:length] for index, length in enumerate(lengths)])
    return numbers, dataclasses.replace(chosen, samples=samples, offsets=np.concatenate([[0], np.cumsum(lengths)]))


def measured(
    model: IntegerModel,
    netlist: Netlist,
    process: Process,
    known: Mapping[str, Cell],
    wire: WireLoad,
    leakage_w: float,
    recordings: Recordings,
    *,
    work: Path,
    builds: Path,
    top: str = "accelerator",
) -> dict[str, Any]:
    """The energies of `asic.json`, in joule, of one recording with a whole touch.

    Parameters
    ----------
    model:
        With the chip's configuration.
    known:
        The netlist's cells by name.
    leakage_w:
        Of the whole chip.

    Raises
    ------
    InputError
        No recording has a whole touch.
    """
    config = model.config
    numbers, chosen = with_touches(model, recordings, 1)
    trace = run(model, chosen)
    design = generate(config, model.arrays, work / "design")
    vectors = write_vectors(work / "vectors.npz", trace, chosen, numbers)
    flat = netlist.folder / "flat.json"
    cost = costs(flat, top, known, process.library.voltage, wire)
    text = simulated(flat, top)
    first = f"i__payload[{config.sensor.sample_bits}]"
    counted = work / "counted.v"
    groups = cost.counted
    counted.write_text(chip_activity.instrument(text, [g.kind for g in groups], [g.nets for g in groups], cost.enable, first))
    cells = work / "cells.v"
    cells.write_text(models(known[name.lstrip("\\")] for name in netlist.cells))
    hardware = Hardware((counted, cells), (), "netlist", "asic", probes=False)
    pace = (2 * config.sensor.taxels + DRAIN_CYCLES) * config.sensor.sample_rate_hz
    played = flow.cosim(design, vectors, hardware=hardware, pace="declared", clock_hz=pace, waves=False, work=work / "run", builds=builds)
    rows = chip_activity.frames(work / "run")
    onset = int(trace.touches.start_frame[trace.first[0]]) - 1 + config.windows.pretrigger_frames
    joule = np.array([group.joule for group in groups])
    clock = max(lowest_clock_hz(config), schedule(config).decision_cycles * config.sensor.sample_rate_hz)
    kinds = sorted({group.kind for group in groups})
    of_kind = {kind: rows[:, 3:] @ (joule * [group.kind == kind for group in groups]) for kind in kinds}
    of_kind["clock"] = of_kind.get("clock", 0.0) + cost.root_j * rows[:, 1]
    found = summary(config, rows, of_kind, onset, cost.root_j, leakage_w, clock)
    return found | {"bit_exact": played["bit_exact"], "mismatches": played["mismatches"], "compared_values": played["compared_values"]}


def summary(config, rows: np.ndarray, of_kind: Mapping[str, np.ndarray], onset: int, root_j: float, leakage_w: float, clock_hz: float):
    """Energies from what each frame costs.

    Parameters
    ----------
    rows:
        Of eskin.cosim.chip_activity.frames.
    of_kind:
        Joule of each frame by what changes, edges of the clock included.
    onset:
        Number of the frame at which the touch begins.
    """
    frame = np.sum(list(of_kind.values()), axis=0)
    decided = np.flatnonzero(rows[:, 2])
    near = np.zeros(len(rows), bool)
    for row in decided:
        near[max(0, row - NEAR) : row + NEAR + 1] = True
    inside = np.zeros(len(rows), bool)
    inside[decided[0] : decided[-1] + 1] = True
    plain, quiet = inside & ~near, np.zeros(len(rows), bool)
    quiet[NEAR : max(NEAR + 1, onset - NEAR)] = True
    hop, rate = config.windows.hop, config.sensor.sample_rate_hz
    period, steps = clock_hz / rate, config.windows.steps

    def whole(which: np.ndarray) -> float:  # of a frame at that clock: its edges, and the first net in cycles without one
        return float(frame[which].mean() + root_j * (period - rows[which, 1].mean()))

    step = float((frame[near].sum() - near.sum() * frame[plain].mean()) / steps)
    parts = {kind: float(hop * values[plain].mean()) for kind, values in of_kind.items()}
    parts["clock"] += hop * root_j * (period - float(rows[plain, 1].mean()))
    parts |= {"step": step, "leakage": leakage_w * hop / rate}
    interval = sum(parts.values())
    touch_frames = config.last_frame
    touch = touch_frames * whole(plain) + steps * step + leakage_w * touch_frames / rate
    idle_w = leakage_w + rate * whole(quiet)
    average_w = idle_w + TOUCHES_PER_S * steps * step
    energies = {
        "step_j": step,
        "interval_j": interval,
        "waiting_cycle_j": root_j,
        "leakage_w": leakage_w,
        "touch_j": touch,
        "frame_j": whole(plain),
        "quiet_frame_j": whole(quiet),
        "idle_w": idle_w,
        "average_w": average_w,
    }
    return energies | {
        "bands": {name: [value / BAND, value * BAND] for name, value in energies.items()},
        "band": BAND,
        "interval_parts_j": parts,
        "interval_frames": hop,
        "clock_hz": clock_hz,
        "clocked_share": float(rows[plain, 1].mean()) / period,
        "battery_hours": BATTERY_J / average_w / 3600,
        "method": METHOD,
    }
