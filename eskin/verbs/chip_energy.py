"""Energy of a chip's netlist from its activity on recordings: steps, frames, waiting, whole touches.

A recording is played at a slow pace, so that the clock stops between frames where it can, and everything is counted frame by frame. A
step costs what the frames around its decision cost beyond those of the same touch without one. What a cycle without an edge costs is
known from the clock's first net, so that any clock can be asked about.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim.device import Device
from eskin.cosim.gates import Chip
from eskin.golden.core.errors import InputError
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.model import IntegerModel
from eskin.golden.model.pipeline import find_touches, run
from eskin.golden.studies.energy import BATTERY_J, TOUCHES_PER_S
from eskin.rtl.asic.blocks import OTHERS, blocks_of
from eskin.rtl.asic.energy import BAND, costs
from eskin.rtl.asic.liberty import Cell, WireLoad
from eskin.rtl.asic.models import expression
from eskin.rtl.asic.synthesis import Netlist, Process
from eskin.rtl.fpga.generate import boot_writes, pack_decision
from eskin.rtl.program.memory_map import Control, Register
from eskin.rtl.program.schedule import lowest_clock_hz, schedule

SEED = 1
"""Of what registers and memories begin with."""
NEAR = 3
"""Frames around a decision, beyond those that its step lasts, which may cost more for it; fewer where windows follow closely."""
DRAIN_CYCLES = 48
"""Cycles of a slow frame beyond two a taxel: more than the clock runs on."""
METHOD = (
    "changes of nets from cycle to cycle at gate level, Liberty energy and capacitance, wire load; glitches apart; no clock tree, no layout"
)
DELAYS = {
    "cells": "cells take their Liberty delay at a short edge and a small load, shorter pulses are swallowed, a glitch costs a full swing",
    "unit": "all cells take the same time, shorter pulses are swallowed, a glitch costs a full swing",
}
"""What glitches are counted with, by the word for `eskin.cosim.gates.Chip`."""


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
    return cut_short(recordings, ends, count)


def cut_short(recordings: Recordings, ends: Mapping[int, int], count: int) -> tuple[np.ndarray, Recordings]:
    """``count`` of the recordings that have an end, spread over the classes, each only up to it: their numbers, and they themselves."""
    having = np.array(sorted(ends))
    numbers = having[recordings.subset(having).evenly(min(count, len(having)))]
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
    top: str = "accelerator",
    wrong: str | None = None,
    delays: str = "cells",
) -> dict[str, Any]:
    """The energies of `asic.json`, in joule, of one recording with a whole touch; what glitches add is told apart as ``glitches``.

    Parameters
    ----------
    model:
        With the chip's configuration.
    known:
        The netlist's cells by name.
    leakage_w:
        Of the whole chip.
    wrong:
        A logic cell that says the opposite, to see that it is seen.
    delays:
        One of `DELAYS`: by which glitches come about.

    Raises
    ------
    InputError
        No recording has a whole touch.
    """
    config = model.config
    _, chosen = with_touches(model, recordings, 1)
    trace = run(model, chosen)
    flat = netlist.folder / "flat.json"
    cost = costs(flat, top, known, process.library.voltage, wire)
    module = json.loads(flat.read_text())["modules"][top]
    chip = Chip(module, known, expression, SEED, wrong, delays=delays)
    program = chip.program
    blocks = blocks_of(module, known)
    block = {net: blocks[cell] for net, cell in cost.driver.items()}
    parts = sorted({(kind, block.get(net, OTHERS)) for net, kind in cost.kind.items()})
    place = {part: number for number, part in enumerate(parts)}
    change, of = np.zeros(program.nets), np.zeros(program.nets, np.uint8)
    for net, kind in cost.kind.items():
        of[net], change[net] = place[kind, block.get(net, OTHERS)], cost.joule[net] * (kind != "clock")
    edges = np.array([cost.joule[net] for net in program.gates] or [0.0])
    joule = np.zeros(2 * len(parts))  # what changes from cycle to cycle, and glitches
    chip.count_into(joule, (change, of, edges, of[[*program.gates, 0]]))
    device = Device(chip, config.sensor.sample_bits)
    device.reset([*boot_writes(config, model.arrays), (int(Register.CONTROL), int(Control.ARM))])
    device.settle()
    device.forget()  # what a chain not yet reset may have offered
    device.mark_frames()
    device.frames(chosen.recording(0), 2 * config.sensor.taxels + DRAIN_CYCLES)
    # a row a frame, to the next one's first taxel: cycles, edges that passed, decisions, reads and writes of macros, joule by kind
    rows = np.diff(device.marks(5 + len(joule)), axis=0)
    device.write(int(Register.CONTROL), int(Control.FINISH))
    device.settle()
    decisions = [int(word, 16) for word in device.streams()["decision"].words]
    expected = [pack_decision(row) for row in trace.streams["decision"][0]]
    differing = sum(found != wanted for found, wanted in zip(decisions, expected, strict=False)) + abs(len(decisions) - len(expected))
    onset = int(trace.touches.start_frame[trace.first[0]]) - 1 + config.windows.pretrigger_frames
    clock = max(lowest_clock_hz(config), schedule(config).decision_cycles * config.sensor.sample_rate_hz)
    of_part, extra = ({part: rows[:, low + number] for part, number in place.items()} for low in (5, 5 + len(parts)))
    extra.setdefault(("clock", OTHERS), np.zeros(len(rows)))
    of_part["clock", OTHERS] = of_part.get(("clock", OTHERS), 0.0) + cost.root_j * rows[:, 1]
    ring = next((blocks[name] for name, cell in module["cells"].items() if known[cell["type"]].kind == "memory"), OTHERS)
    of_part["reads and writes", ring] = rows[:, 3:5] @ np.array(cost.access_j)
    found = summary(config, rows, of_part, onset, cost.root_j, leakage_w, clock)
    beyond = summary(config, rows, extra, onset, 0.0, 0.0, clock)
    glitches = {key: beyond[key] for key in ("step_j", "interval_j", "touch_j", "frame_j", "step_blocks_j", "interval_blocks_j")}
    glitches |= {"average_w": beyond["average_w"], "method": DELAYS[delays]}
    found["glitches"] = glitches | {"battery_hours_with": BATTERY_J / (found["average_w"] + glitches["average_w"]) / 3600}
    return found | {"bit_exact": not differing and bool(decisions), "mismatches": differing, "compared_values": len(expected)}


def summary(
    config, rows: np.ndarray, of_part: Mapping[tuple[str, str], np.ndarray], onset: int, root_j: float, leakage_w: float, clock_hz: float
):
    """Energies from what each frame costs.

    Parameters
    ----------
    rows:
        A frame each, as `measured` makes them.
    of_part:
        Joule of each frame by what changes and in which block, edges of the clock included.
    onset:
        Number of the frame at which the touch begins.
    """
    frame = np.sum(list(of_part.values()), axis=0)
    of_kind, of_block = _sums(of_part, 0), _sums(of_part, 1)
    decided = np.flatnonzero(rows[:, 2])
    near = np.zeros(len(rows), bool)
    around = NEAR + schedule(config).step_cycles // (2 * config.sensor.taxels + DRAIN_CYCLES)
    around = min(around, max(1, (config.windows.hop - 1) // 2 - 1))
    for row in decided:
        near[max(0, row - around) : row + around + 1] = True
    inside = np.zeros(len(rows), bool)
    inside[decided[0] : decided[-1] + 1] = True
    plain, quiet = inside & ~near, np.zeros(len(rows), bool)
    quiet[NEAR : max(NEAR + 1, onset - around)] = True
    hop, rate = config.windows.hop, config.sensor.sample_rate_hz
    period, steps = clock_hz / rate, config.windows.steps

    def whole(which: np.ndarray) -> float:  # of a frame at that clock: its edges, and the first net in cycles without one
        return float(frame[which].mean() + root_j * (period - rows[which, 1].mean()))

    step = float((frame[near].sum() - near.sum() * frame[plain].mean()) / steps)
    parts = {kind: float(hop * values[plain].mean()) for kind, values in of_kind.items()}
    parts["clock"] += hop * root_j * (period - float(rows[plain, 1].mean()))

    def of_step(values: np.ndarray) -> float:
        return float((values[near].sum() - near.sum() * values[plain].mean()) / steps)

    step_blocks = {block: of_step(values) for block, values in of_block.items()}
    interval_blocks = {block: float(hop * values[plain].mean()) + step_blocks[block] for block, values in of_block.items()}
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
        "step_parts_j": {kind: of_step(values) for kind, values in of_kind.items()},
        "step_blocks_j": _largest_first(step_blocks),
        "interval_blocks_j": _largest_first(interval_blocks),
        "interval_frames": hop,
        "clock_hz": clock_hz,
        "clocked_share": float(rows[plain, 1].mean()) / period,
        "battery_hours": BATTERY_J / average_w / 3600,
        "method": METHOD,
    }


def _largest_first(joule: Mapping[str, float]) -> dict[str, float]:
    return dict(sorted(joule.items(), key=lambda row: -row[1]))


def _sums(of_part: Mapping[tuple[str, str], np.ndarray], by: int) -> dict[str, np.ndarray]:
    """Joule of each frame by what changes (0) or by block (1)."""
    found: dict[str, np.ndarray] = {}
    for part, values in of_part.items():
        found[part[by]] = found.get(part[by], np.zeros(len(values))) + values
    return found


def chip_row(path: Path) -> dict[str, Any]:
    """A chip for the energy page, of what `eskin asic --data` wrote: name, per_step_j, per_touch_j (everything included), band, idle_w,
    average_w, hours, touches, clock_hz, static_w, bit_exact, and ``choices`` as a board's row has them.

    Raises
    ------
    InputError
        Not such a file, or one without recordings.
    """
    try:
        found = json.loads(path.read_text())
        energy = found["energy"]
        name = f"chip {found['pdk']}, {found['lanes']} lane{'s' if found['lanes'] > 1 else ''}, {'ROM' if found['rom'] else 'loadable'}"
    except OSError as error:
        raise InputError(f"--chip {path}: {error.strerror}; give the asic.json that eskin asic --data wrote") from None
    except (ValueError, KeyError, TypeError):
        raise InputError(f"--chip {path}: is no result of eskin asic; give the asic.json that eskin asic --data wrote") from None
    if energy["step_j"] is None:
        raise InputError(f"--chip {path}: has no energy of steps; make it anew with eskin asic --data D")
    choice = {key: energy[key] for key in ("clock_hz", "idle_w", "average_w")}
    choice |= {"name": "outside clock, stopped by the chip", "hours": energy["battery_hours"]}
    row = {"name": name, "per_step_j": energy["step_j"], "per_touch_j": energy["touch_j"], "band": energy["band"]}
    row |= {"static_w": energy["leakage_w"], "bit_exact": energy["bit_exact"], "corner": found["corner"], "method": energy["method"]}
    return row | {"choices": [choice | {"touches": BATTERY_J / energy["touch_j"]}]}
