"""A co-simulation in this process: recordings into a device's ports, every stage and decision compared; the
CONTRACT's result.

It is made for a chip's netlist, and plays a Verilated design as well.

Beside Verilator it compiles a whole chip in seconds, and begins every recording with anything in every
flip-flop, latch and macro.
"""

import time
from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim import flow
from eskin.cosim.device import FRAME_END, Device, Model, Write
from eskin.cosim.latency import STAMP_RANGE
from eskin.cosim.scoreboard import Capture, Stream, compare, flat_stages
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
    progress: flow.Progress | None = None,
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
    pace, clock_hz, progress:
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
    flat = flat_stages(config)
    gates = chip(seed)
    device = Device(gates, config.sensor.sample_bits, (*flat, "step") if probes else ())
    stages: dict[str, dict[int, Stream]] = {stage: {} for stage in (*flat, "decision", "step")}
    status: dict[int, tuple] = {}
    frame_ends: list[int] = []
    last: dict[str, int] = {}
    stuck: dict[str, int] = {"stuck": 0, "stuck_recording": 0, "stuck_frame": 0}
    period = clock_hz / config.sensor.sample_rate_hz if pace == "declared" else 0.0

    def read(register: int) -> int:
        word = device.read(register)
        device.cycle()
        return word

    for place, (number, (low, high)) in enumerate(
        zip(expected["numbers"].tolist(), pairwise(expected["offsets"].tolist()), strict=True)
    ):
        gates.begin(seed + place)
        try:
            device.reset(
                [*boot, (address["MEASURE"], measures["STEP"]), (address["CONTROL"], command["ARM"])]
            )
            armed_at = device.state.cycle
            device.settle(quiet=SETTLE)
            device.forget()  # what a chain not yet reset may have offered
            device.frames(expected["samples"][low:high], period)
            device.write(address["CONTROL"], command["FINISH"])
            device.settle(quiet=SETTLE)
        except SimulationError:
            stuck = {"stuck": 1, "stuck_recording": number, "stuck_frame": device.state.frame + 1}
            break
        for stage, stream in device.streams().items():
            stages[stage][number] = stream
        events = device.seen()
        frame_ends += events["cycle"][events["stage"] == FRAME_END].tolist()
        device.forget()
        last = {name: read(address[name]) for name in ("STATUS", "FAULTS", "TOUCHES", "LONGEST")}
        flags = [
            read(address["TAXEL_FAULTS"] + k)
            for k in range(-(-config.sensor.taxels // 16) if config.faults.fault_frames else 0)
        ]
        words, flagged = ([f"{word:04x}" for word in part] for part in (list(last.values())[:3], flags))
        status[number] = (*words, armed_at, *flagged)
        if progress:
            progress(high, len(expected["samples"]))
    state, steps = device.state, stages.pop("step")
    summary = {
        "frames": len(frame_ends),
        "cycles": state.cycle,
        "overruns": state.overruns,
        "input_stalls": state.stalls,
    }
    summary |= {"frame_cycles_max": state.frame_cycles_max, "protocol_errors": 0, "unknown": 0, **stuck}
    stamps = np.array(frame_ends, dtype=np.int64) % STAMP_RANGE
    capture = Capture(
        stages=stages, steps=steps, status=status, frame_cycles=stamps.astype(np.uint32), summary=summary
    )
    verdict = compare(config, expected, capture, probes=probes)
    played = {
        "simulator": SIMULATOR,
        "level": "netlist",
        "target": "asic",
        "pace": pace,
        "stalls": stalls,
        "seed": seed,
    }
    wall_s = time.monotonic() - begun
    return flow.result_of(
        config,
        expected,
        capture,
        verdict,
        played,
        probes=probes,
        clock_hz=clock_hz,
        wall_s=wall_s,
        registers=last,
    )
