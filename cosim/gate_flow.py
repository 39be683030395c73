"""A co-simulation in this process: recordings into a device's ports, every stage and decision compared; the
CONTRACT's result.

It is made for a chip's netlist, and plays a Verilated design as well.

Beside Verilator it compiles a whole chip in seconds, and begins every recording with anything in every
flip-flop, latch and macro.
"""

import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim import flow
from eskin.cosim.device import FRAME_END, Device, Model, Write
from eskin.cosim.latency import Measured
from eskin.cosim.scoreboard import Mismatch, Scoreboard, flat_stages, local_decisions, recordings_of
from eskin.golden.core import AcceleratorConfig, InputError, Record, SimulationError

SIMULATOR = "compiled"
"""What a result calls it."""
SETTLE = 6
"""Cycles that are always waited for a command."""


def cosim(
    config: AcceleratorConfig,
    chip: Callable[[int], Model],
    vectors: Path,
    registers: Mapping[str, Any],
    boot: Iterable[Write],
    *,
    probes: bool = True,
    pace: str = "full",
    clock_hz: float | None = None,
    stalls: bool = False,
    seed: int = 1,
) -> Record:
    """Play ``vectors`` into a chip and compare.

    Parameters
    ----------
    chip:
        Compiles it; called with the seed of what its states begin with. The recording at place k begins with
        those of ``seed + k``, a reset and all bus writes.
    vectors:
        File written by eskin.golden.model.vectors.write_vectors.
    registers:
        eskin.rtl.fpga.generate.register_map.
    boot:
        Bus writes after each reset.
    probes:
        The netlist has its probe ports.
    pace, clock_hz:
        As for eskin.cosim.flow.cosim.

    Returns
    -------
    dict
        As of eskin.cosim.flow.cosim, ``simulator`` being ``compiled``.

    Raises
    ------
    InputError
        Stalls, which only a simulator's bench makes; an unknown pace, a clock that cannot carry the frames.
    """
    if stalls:
        raise InputError("--stalls: a compiled chip takes none; leave them out, or add --simulator verilator")
    with np.load(vectors) as archive:
        expected = dict(archive)
    clock_hz = float(clock_hz or config.hardware.clock_hz)
    flow.check(config, expected, vectors, pace, clock_hz)
    begun, boot = time.monotonic(), list(boot)
    address, command, measures = registers["registers"], registers["bits"]["CONTROL"], registers["measures"]
    gates, scoreboard, measured = chip(seed), Scoreboard(config, expected, probes=probes), Measured()
    stages = (*flat_stages(config), "step") if probes else ()
    device = Device(gates, config.sensor.sample_bits, stages)
    period = clock_hz / config.sensor.scan_rate_hz if pace == "declared" else 0.0
    frames, mismatch = 0, None
    last: dict[str, int] = {}

    def read(register: int) -> int:
        word = device.read(register)
        device.cycle()
        return word

    for place, recording in enumerate(recordings_of(expected)):
        gates.begin(seed + place)
        scoreboard.begin(recording)
        try:
            arm = (address["CONTROL"], command["ARM"])
            device.reset([*boot, (address["MEASURE"], measures["STEP"]), arm])
            device.settle(quiet=SETTLE)
            device.forget()  # what a chain not yet reset may have offered
            device.frames(recording["samples"], period)
            device.write(address["CONTROL"], command["FINISH"])
            device.settle(quiet=SETTLE)
            for stage, (codes, cycles) in device.streams().items():
                if stage == "step":
                    measured.steps(codes)
                    continue
                if stage == "decision":
                    measured.decisions(cycles)
                    if not probes:
                        measured.counts["steps"] += local_decisions(codes)
                scoreboard.check(stage, codes, cycles)
            ends = device.seen()["cycle"][device.seen()["stage"] == FRAME_END].tolist()
            measured.end(recording["decision_frame"].tolist(), dict(enumerate(ends, start=1)))
            device.forget()
            frames += len(ends)
            last = {name: read(address[name]) for name in ("STATUS", "FAULTS", "TOUCHES", "LONGEST")}
            words = range(-(-config.sensor.taxels // 16) if config.faults.fault_frames else 0)
            flags = sum(read(address["TAXEL_FAULTS"] + k) << 16 * k for k in words)
            scoreboard.end(last | {"TAXEL_FAULTS": flags})
        except SimulationError:
            place_ = "no beat was taken for the watchdog's time"
            mismatch = scoreboard.mismatch("input", 0, place_, None, "a standstill")
            mismatch.frame = device.state.frame + 1
        except Mismatch as found:
            mismatch = found
        if mismatch:
            break
    state = device.state
    said = {
        **measured.counts,
        "compared": dict(scoreboard.compared),
        "mismatch": vars(mismatch) if mismatch else None,
        "frames": frames,
        "cycle": state.cycle,
        "overruns": state.overruns,
        "waited": state.stalls,
        "longest": state.frame_cycles_max,
        "registers": last,
    }
    played: Record = {"simulator": SIMULATOR, "level": "netlist", "target": "asic", "pace": pace}
    played |= {"stalls": stalls, "seed": seed}
    wall_s = time.monotonic() - begun
    return flow.result_of(config, place + 1, said, played, clock_hz=clock_hz, wall_s=wall_s, bulk=True)
