"""Recordings in bulk into devices in this process (`eskin.cosim.device`): the same scoreboard, the same counts as under
cocotb.

A Verilated design is faster here than in a simulator that Python drives. A chip's netlist is
compiled in seconds, and begins every recording with anything in every flip-flop, latch and macro.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from eskin.cosim.device import FRAME_END, Device, Model, Write
from eskin.cosim.latency import standstill_cycles
from eskin.cosim.scoreboard import REGISTERS, Mismatch, Recording, Scoreboard, flat_stages
from eskin.golden.core import AcceleratorConfig, Record, SimulationError

SETTLE = 6
"""Cycles that are always waited for a command."""


class Played(NamedTuple):
    """Result of one recording. streams: stage -> codes, cycles. taken: cycle of each frame's last taxel. longest:
    cycles of a frame. status: registers at the end; None: the device stands still. armed: cycle of ARM."""

    streams: dict[str, tuple[np.ndarray, np.ndarray]]
    taken: list[int]
    counts: dict[str, int]
    longest: int
    status: dict[str, int] | None
    armed: int


def play(
    config: AcceleratorConfig,
    chip: Callable[[int], Model],
    recordings: Sequence[Recording],
    registers: Mapping[str, Any],
    boot: Iterable[Write],
    *,
    probes: bool = True,
    period: float = 0.0,
    seed: int = 1,
    threads: int = 1,
) -> Record:
    """Play recordings, up to the first value that differs, and say what `eskin.cosim.bench.Bench` says.

    Parameters
    ----------
    chip:
        Makes what is behind a device; called with the seed of what its states begin with. The recording at place k
        begins with those of ``seed + k``, a reset and all bus writes.
    registers:
        eskin.rtl.fpga.generate.register_map.
    boot:
        Bus writes after each reset.
    probes:
        There are probe ports.
    period:
        Clock cycles from frame to frame; 0: a taxel whenever one is taken.
    threads:
        Recordings that are played at once.
    """
    address, command = registers["registers"], registers["bits"]["CONTROL"]
    limit, stages = standstill_cycles(config), (*flat_stages(config), "step") if probes else ()
    boot = [*boot, (address["MEASURE"], registers["measures"]["STEP"]), (address["CONTROL"], command["ARM"])]
    threads = min(threads, len(recordings))
    idle = [chip(seed) for _ in range(threads)]

    def played(place: int) -> Played:
        model, recording = idle.pop(), recordings[place]
        model.begin(seed + place)
        device = Device(model, config.sensor.sample_bits, stages)
        armed, status = 0, None
        try:
            device.reset(boot)
            armed = device.state.cycle
            device.settle(limit, SETTLE)
            device.forget()  # what a chain not yet reset may have offered
            device.frames(recording["samples"], period, limit)
            device.write(address["CONTROL"], command["FINISH"])
            device.settle(limit, SETTLE)
            status = {name: device.read(address[name]) for name in REGISTERS}
            words = range(-(-config.sensor.taxels // 16) if config.faults.fault_frames else 0)
            status["TAXEL_FAULTS"] = sum(device.read(address["TAXEL_FAULTS"] + k) << 16 * k for k in words)
        except SimulationError:
            pass
        events, state = device.seen(), device.state
        taken = events["cycle"][events["stage"] == FRAME_END].tolist()
        counts = {
            "frames": len(taken),
            "cycle": state.cycle,
            "overruns": state.overruns,
            "waited": state.stalls,
        }
        said = Played(device.streams(), taken, counts, state.frame_cycles_max, status, armed)
        device.close()
        idle.append(model)
        return said

    scoreboard, total = Scoreboard(config, recordings[0].arrays, probes=probes), Counter[str]()
    mismatch: Mismatch | None = None
    longest = armed = 0
    status: dict[str, int] | None = {}
    pool = ThreadPoolExecutor(threads)
    try:
        for recording, came in zip(recordings, pool.map(played, range(len(recordings))), strict=True):
            status, armed, longest = came.status, came.armed, max(longest, came.longest)
            scoreboard.begin(recording)
            total.update(came.counts)
            if status is None:
                mismatch = scoreboard.mismatch(
                    "input", 0, "nothing moves for the watchdog's time", 0, "a standstill"
                )
                mismatch.frame = len(came.taken) + 1
                break
            for stage, values in came.streams.items():
                scoreboard.check(stage, *values)
            scoreboard.end(status, came.taken)
    except Mismatch as found:
        mismatch = found
    finally:
        pool.shutdown(cancel_futures=True)
    return {
        **total,
        **scoreboard.counts,
        "compared": dict(scoreboard.compared),
        "longest": longest,
        "mismatch": vars(mismatch) | {"since_arm": mismatch.cycle - armed} if mismatch else None,
        "registers": {name: (status or {}).get(name) for name in REGISTERS},
        "probe": None,
    }
