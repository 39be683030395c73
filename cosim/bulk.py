"""Recordings in bulk into devices in this process (`eskin.cosim.device`): the same scoreboard, the same counts as under
cocotb.

A Verilated design is faster here than in a simulator that Python drives. A chip's netlist starts every recording with
other random contents in every flip-flop, latch and macro.
"""

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from eskin.cosim.device import FRAME_END, Design, Device
from eskin.cosim.scoreboard import REGISTERS, Mismatch, Scoreboard, flat_stages, loading, recordings_of
from eskin.golden.core import Record, SimulationError

if TYPE_CHECKING:
    from eskin.cosim.flow import Run

COUNTED = ("frames", "simulated_cycles", "overruns", "input_stalls")
SETTLE = 6
"""Cycles that are always waited for a command."""


def play(run: "Run", positions: Sequence[int], *, seed: int = 1, threads: int = 1) -> Record:
    """Play recordings, up to the first value that differs, and say what `eskin.cosim.bench.Bench` says.

    Parameters
    ----------
    positions:
        Of the recordings.
    seed:
        The recording at place k begins with the random contents of ``seed + k``, a reset and all bus writes.
    threads:
        Recordings that are played at once.
    """
    config, settings, expected = run.config, run.settings, recordings_of(run.expected)
    recordings = [expected[position] for position in positions]
    registers, boot = loading(Path(settings["design"]))
    address, command, begun = registers["registers"], registers["bits"]["CONTROL"], time.monotonic()
    limit, stages = settings["patience"], (*flat_stages(config), "step") if settings["probes"] else ()
    boot += [(address["MEASURE"], registers["measures"]["STEP"]), (address["CONTROL"], command["ARM"])]

    verilog, quick = (
        "".join(path.read_text() for path in run.hardware.sources),
        run.hardware.level == "netlist",
    )
    design = Design(verilog, run.builds, "co-simulation", quick=quick)

    def played(place: int) -> tuple[Device, int, dict[str, int]]:
        """The device, the cycle of ARM, and the registers at the end, empty if it stands still."""
        device, armed = Device(design, config.sensor.sample_bits, stages, seed + place), 0
        status = dict[str, int]()
        with suppress(SimulationError):
            device.reset(boot)
            armed = device.state.cycle
            device.settle(limit, SETTLE)
            device.forget()  # what a chain not yet reset may have offered
            device.frames(recordings[place]["samples"], settings["period"], limit)
            device.write(address["CONTROL"], command["FINISH"])
            device.settle(limit, SETTLE)
            words = range(-(-config.sensor.taxels // 16) if config.faults.fault_frames else 0)
            flags = sum(device.read(address["TAXEL_FAULTS"] + k) << 16 * k for k in words)
            status = {name: device.read(address[name]) for name in REGISTERS} | {"TAXEL_FAULTS": flags}
        return device, armed, status

    scoreboard = Scoreboard(config, recordings[0].arrays, probes=settings["probes"])
    said: Record = dict.fromkeys(COUNTED, 0) | {"mismatch": None, "probe": None}
    longest, status, pool = 0, dict[str, int](), ThreadPoolExecutor(threads)
    try:
        for recording, came in zip(recordings, pool.map(played, range(len(recordings))), strict=True):
            device, armed, status = came
            events, state = device.seen(), device.state
            taken = events["cycle"][events["stage"] == FRAME_END].tolist()
            longest = max(longest, state.frame_cycles_max)
            for name, count in zip(
                COUNTED, (len(taken), state.cycle, state.overruns, state.stalls), strict=True
            ):
                said[name] += count
            scoreboard.begin(recording, armed)
            if not status:
                place = "nothing moves for the watchdog's time"
                raise scoreboard.mismatch("input", 0, place, 0, "a standstill", frame=len(taken) + 1)
            for stage, values in device.streams().items():
                scoreboard.check(stage, *values)
            scoreboard.end(status, taken)
            device.close()
    except Mismatch as found:
        said["mismatch"] = vars(found)
    finally:
        pool.shutdown(cancel_futures=True)
    said["registers"] = {name: status.get(name) for name in REGISTERS}
    return said | scoreboard.result(longest) | {"wall_s": time.monotonic() - begun}
