"""Recordings in bulk into devices in this process (`eskin.cosim.device`): the same scoreboard, the same counts as under
cocotb.

A Verilated design is faster here than in a simulator that Python drives. A chip's netlist starts every recording with
other random contents in every flip-flop, latch and macro.
"""

import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from eskin.cosim.device import FRAME_END, SETTLE, Accelerator, Design
from eskin.cosim.results import Answer
from eskin.cosim.scoreboard import INPUT_STALLED, Mismatch, Recording, Scoreboard, loading, read_behind
from eskin.golden.core import Progress, SimulationError

if TYPE_CHECKING:
    from eskin.cosim.flow import Run


def play(
    run: "Run", positions: Sequence[int], progress: Progress, *, seed: int = 1, threads: int = 1
) -> Answer:
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
    begun, config, settings, hardware = time.monotonic(), run.config, run.settings, run.hardware
    recordings = [Recording(run.expected, position) for position in positions]
    registers, boot = loading(Path(settings["design"]))
    verilog = "".join(path.read_text() for path in hardware.sources)
    progress("compiling the design", 0, 0)
    design = Design(verilog, run.how.builds)
    progress("played in bulk", 0, len(recordings))

    def played(place: int) -> tuple[Accelerator, int, int, dict[str, int], dict[str, int]]:
        """The device, the cycles of ARM and FINISH, STATUS on the way, and the registers at the end, empty if it stands still."""
        device = Accelerator(design, config, registers, boot, probes=hardware.probes, seed=seed + place)
        armed, finished, looks, status = 0, 0, dict[str, int](), dict[str, int]()
        number = registers["registers"]
        with suppress(SimulationError):
            device.command("CLEAR_FAULTS")  # before ARM, which may raise none
            armed = device.state.cycle + 1
            device.command("ARM")
            device.forget()  # what a chain not yet reset may have offered
            looks["ARM"] = device.register("STATUS")
            pace, look, samples = settings["period"], recordings[place].look, recordings[place]["samples"]
            device.frames(samples[:look], pace, device.limit)
            if look:
                device.state.watch = number["STATUS"]  # which takes no extra cycle
                device.frames(samples[look : look + 1], pace, device.limit)
                device.state.watch, looks["TOUCH"] = -1, device.get("bus__r_data")
            device.frames(samples[look + bool(look) :], pace, device.limit)
            finished = device.state.cycle
            device.write(number["CONTROL"], registers["bits"]["CONTROL"]["FINISH"])
            looks["FINISH"] = device.register("STATUS")
            for _ in range(2):  # with a watchdog the engine begins anew behind the last decision
                device.settle(device.limit, SETTLE)
            status = read_behind(registers, device.register)
        return device, armed, finished, looks, status

    scoreboard, counts = Scoreboard(config, registers, probes=hardware.probes), Counter[str]()
    longest, pool = 0, ThreadPoolExecutor(threads)
    try:
        for number, result in enumerate(pool.map(played, range(len(recordings)))):
            device, armed, finished, looks, status = result
            progress("played in bulk", number + 1, len(recordings))
            events, state = device.seen(), device.state
            accepted = events["cycle"][events["stage"] == FRAME_END].tolist()
            longest = max(longest, state.frame_cycles_max)
            counts.update(frames=len(accepted), simulated_cycles=state.cycle)
            late = (state.overruns + state.refused) * bool(settings["period"])
            counts.update(overruns=late, input_stalls=state.stalls)
            scoreboard.begin(recordings[number], armed)
            scoreboard.faults = INPUT_STALLED * bool(state.refused)
            if not status:
                place = "nothing moves for the watchdog's time"
                raise scoreboard.mismatch("input", 0, 0, "a standstill", place=place, frame=len(accepted) + 1)
            for stage, values in device.streams().items():
                with suppress(Mismatch):  # a later stage may differ earlier
                    scoreboard.check(stage, *values)
            if scoreboard.differing:
                break
            for after, word in looks.items():
                scoreboard.look(after, word)
            scoreboard.end(status, accepted, finished)
            device.close()
    except Mismatch:  # the scoreboard has it
        pass
    finally:
        pool.shutdown(cancel_futures=True)
    answer = Answer.of(scoreboard, frame_max=longest, probe=False, **counts)
    answer.wall_s = time.monotonic() - begun
    return answer
