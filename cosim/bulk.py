"""Recordings in bulk into a device in this process (`eskin.cosim.device`): the same scoreboard, the same counts as under
cocotb.

A Verilated design is faster here than in a simulator that Python drives. A chip's netlist is compiled in seconds, and
begins every recording with anything in every flip-flop, latch and macro.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from eskin.cosim.device import FRAME_END, Device, Model, Write
from eskin.cosim.latency import Measured, standstill_cycles
from eskin.cosim.scoreboard import REGISTERS, Mismatch, Recording, Scoreboard, flat_stages, local_decisions
from eskin.golden.core import AcceleratorConfig, Record, SimulationError

SETTLE = 6
"""Cycles that are always waited for a command."""


def play(
    config: AcceleratorConfig,
    chip: Callable[[int], Model],
    recordings: Sequence[Recording],
    registers: Mapping[str, Any],
    boot: Iterable[Write],
    *,
    probes: bool = True,
    measure: str = "STEP",
    period: float = 0.0,
    seed: int = 1,
) -> Record:
    """Play recordings, up to the first value that differs, and say what `eskin.cosim.bench.Bench` says.

    Parameters
    ----------
    chip:
        Makes what is behind the device; called with the seed of what its states begin with. The recording at place k
        begins with those of ``seed + k``, a reset and all bus writes.
    registers:
        eskin.rtl.fpga.generate.register_map.
    boot:
        Bus writes after each reset.
    probes:
        There are probe ports.
    measure:
        What register LONGEST is of.
    period:
        Clock cycles from frame to frame; 0: a taxel whenever one is taken.
    """
    boot, limit = list(boot), standstill_cycles(config)
    address, command, measures = registers["registers"], registers["bits"]["CONTROL"], registers["measures"]
    model, measured = chip(seed), Measured()
    scoreboard = Scoreboard(config, recordings[0].arrays, probes=probes)
    device = Device(model, config.sensor.sample_bits, (*flat_stages(config), "step") if probes else ())
    mismatch: Mismatch | None = None
    last: dict[str, int] = {}
    frames = armed = 0

    def read(register: int) -> int:
        word = device.read(register)
        device.cycle()
        return word

    for place, recording in enumerate(recordings):
        model.begin(seed + place)
        scoreboard.begin(recording)
        try:
            arm = (address["CONTROL"], command["ARM"])
            device.reset([*boot, (address["MEASURE"], measures[measure]), arm])
            armed = device.state.cycle
            device.settle(limit, SETTLE)
            device.forget()  # what a chain not yet reset may have offered
            device.frames(recording["samples"], period, limit)
            device.write(address["CONTROL"], command["FINISH"])
            device.settle(limit, SETTLE)
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
            measured.end(recording["decision_frame"].tolist(), ends)
            device.forget()
            frames += len(ends)
            last = {name: read(address[name]) for name in REGISTERS}
            words = range(-(-config.sensor.taxels // 16) if config.faults.fault_frames else 0)
            flags = sum(read(address["TAXEL_FAULTS"] + k) << 16 * k for k in words)
            scoreboard.end(last | {"TAXEL_FAULTS": flags})
        except SimulationError:
            still = "no number was taken for the watchdog's time"
            mismatch = scoreboard.mismatch("input", 0, still, 0, "a standstill")
            mismatch.frame = device.state.frame + 1
        except Mismatch as found:
            mismatch = found
        if mismatch:
            break
    state = device.state
    return {
        **measured.counts,
        "compared": dict(scoreboard.compared),
        "mismatch": vars(mismatch) | {"since_arm": mismatch.cycle - armed} if mismatch else None,
        "frames": frames,
        "cycle": state.cycle,
        "overruns": state.overruns,
        "waited": state.stalls,
        "longest": state.frame_cycles_max,
        "registers": last,
        "probe": None,
    }
