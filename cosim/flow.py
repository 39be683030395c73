"""One co-simulation: a generated accelerator, a file of vectors, a simulator, and what came of it."""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim import bulk, latency, runner
from eskin.cosim.netlist import Hardware
from eskin.cosim.results import Answer, Cycles, Part, Played, joined
from eskin.cosim.scoreboard import Mismatch
from eskin.cosim.simulation import Simulation
from eskin.golden.core import AcceleratorConfig, Arrays, InputError, Progress, Record, SimulationError
from eskin.golden.core.converters import converter_plan

GOLDEN = "torch: states, maps, logits; numpy: sums, features, distances, decisions"
"""What computed the values of `eskin.verbs.cosim.expected_of`."""
SLOWEST_CYCLES_PER_S = {
    "rtl verilator": 50e3,
    "rtl icarus": 500,
    "netlist verilator": 5e3,
    "netlist icarus": 20,
}
"""Cycles a second that even a busy machine reaches. They only set the wall-clock limit."""
BLOCK_BITS = 1 << 15
"""Largest number of bits that the wrapper takes at a time; at most one hop of frames."""
LEAST_BEATS = 8
"""Of a block: cycles that the bench has until it must give the next one."""
WAVES_BEFORE = 2000
"""Cycles kept before a mismatch."""


class NoClock(SimulationError):
    """No clock was found that meets every budget."""


@dataclass(frozen=True)
class Run:
    """A design, its vectors and a simulator: what a cocotb test needs. settings: of `eskin.cosim.bench.Bench`."""

    config: AcceleratorConfig
    expected: Arrays
    hardware: Hardware
    how: Simulation
    clock_hz: float
    settings: Record

    @classmethod
    def of(cls, design: Path, vectors: Path, how: Simulation) -> "Run":
        """A run of all recordings.

        Parameters
        ----------
        design:
            Folder written by eskin.rtl.fpga.generate.
        vectors:
            File written by eskin.golden.model.vectors.write_vectors. If it has a converter's codes, the run begins at
            its pins.

        Raises
        ------
        InputError
            Bad options, a design and vectors that do not fit, a clock that cannot carry the frames.
        """
        design = Path(design).resolve()
        config = AcceleratorConfig.load(design / "config.json")
        with np.load(vectors) as archive:
            expected = dict(archive)
        clock_hz, pace = float(how.clock_hz or config.hardware.clock_hz), how.pace
        taxels, rate, given = config.sensor.taxels, config.sensor.scan_rate_hz, expected["samples"].shape[1]
        if given != taxels:
            raise InputError(
                f"{vectors}: has {given} taxels and the accelerator has {taxels}; use one array for both"
            )
        if pace not in ("full", "declared"):
            raise InputError(f"`pace` {pace}: is unknown; use full or declared")
        if pace == "declared" and clock_hz < taxels * rate:
            raise InputError(
                f"`clock_hz` {clock_hz:.0f}: is too slow for {taxels} taxels at {rate:g} Hz, one a cycle; "
                f"give at least {taxels * rate:.0f} Hz"
            )
        converting = "codes" in expected
        top, frames, bits = ("sensing.sv", "codes", 32) if converting else ("accelerator.sv", "samples", 16)
        models, options = converter_model(config) if converting else ((), ())
        hop = 32 if config.is_image else config.windows.hop
        beats = expected[frames].shape[1]
        hardware = how.hardware or Hardware((design / top, *models), options)
        settings = {
            "design": str(design),
            "vectors": str(Path(vectors).resolve()),
            "frames": frames,
            "beats": beats,
            "block": max(-(-LEAST_BEATS // beats), min(hop, BLOCK_BITS // (bits * beats))),
            "bits": bits,
            "pace": pace,
            "period": clock_hz / rate if pace == "declared" else 0.0,
            "patience": latency.standstill_cycles(config),
            "probes": hardware.probes,
            "stalls": None,
            "probe": False,
            "positions": [*range(len(expected["numbers"]))],
        }
        return cls(config, expected, hardware, how, clock_hz, settings)

    def play(
        self,
        work: Path,
        settings: Mapping[str, Any],
        *,
        bench: str = "eskin.cosim.bench",
        waves: bool = False,
    ) -> Record:
        """Answers of the cocotb tests of module ``bench`` with these settings beside the run's own."""
        config, hardware, how, settings = self.config, self.hardware, self.how, {**self.settings, **settings}
        parameters = {"SAMPLE_BITS": config.sensor.sample_bits, "FRAMES": settings["block"]}
        parameters |= {name.upper(): settings[name] for name in ("beats", "bits", "patience")}
        built = runner.build(
            how.simulator, hardware.sources, parameters, how.builds, options=hardware.options, waves=waves
        )
        work.mkdir(parents=True, exist_ok=True)
        (work / "bench.json").write_text(json.dumps(settings))
        cycles = len(self.expected["samples"]) * (6 * config.sensor.taxels + settings["period"])
        cycles += len(self.expected["decision"]) * 3 * (config.step_ideal + 500) + 20000
        slowest = SLOWEST_CYCLES_PER_S[f"{hardware.level} {how.simulator}"]
        limit_s, seed = 120 + cycles / slowest, how.seed & 0x7FFFFFFF
        wall_s = runner.run(built, work, limit_s=limit_s, bench=bench, seed=seed)
        return json.loads((work / "result.json").read_text()) | {"wall_s": wall_s}


def cosim(
    design: Path,
    vectors: Path,
    how: Simulation,
    *,
    work: Path,
    progress: Progress = lambda what, done, total: None,
) -> Played:
    """Play ``vectors`` into ``design`` and compare every stage, up to the first value that differs.

    Parameters
    ----------
    design, vectors:
        As for `Run.of`.
    work:
        Folder for settings, log, answer and waves; made when absent.

    Raises
    ------
    InputError
        As of `Run.of`; no touch for the probe.
    SimulationError
        The simulator fails or takes too long.
    """
    run = Run.of(design, vectors, how)
    probe, seed = how.probe and run.config.hardware.loadable, how.seed
    settings: Record = {"stalls": seed & 0x7FFFFFFF if how.stalls else None, "probe": probe}
    everything = {*run.settings["positions"]}
    here = how.cocotb is not None and how.simulator == "verilator" and run.hardware.target in (None, "asic")
    here = here and not (how.stalls or probe or "codes" in run.settings["frames"])
    shown = everything & {*(how.cocotb or ())} if here else everything
    parts = []
    for way, positions in (("cocotb", sorted(shown)), ("bulk", sorted(everything - shown))):
        if not positions:
            continue
        settings["positions"] = positions
        if way == "bulk":
            answer = bulk.play(
                run, positions, progress, seed=seed, threads=how.threads or os.cpu_count() or 1
            )
        else:
            progress(f"compiling the simulator and playing {len(positions)} under cocotb", 0, 0)
            answer = Answer.model_validate(run.play(work, settings))
        if probe and not (answer.probe or answer.mismatch):
            raise InputError(
                "the weight write during a touch needs one that stays open; take other recordings"
            )
        waves = None
        if how.waves and answer.mismatch:
            progress("playing what differs once more, with waves", 0, 0)
            waves = _keep_waves(run, answer.mismatch, settings, work)
            if not waves:
                what = "by itself this recording agrees, so there are no waves: recordings before it matter"
                answer.mismatch_list.append(what)
        parts.append(
            Part(
                **answer.plain(),
                golden=GOLDEN,
                simulator=how.simulator,
                level=run.hardware.level,
                target=run.hardware.target,
                lanes=run.config.hardware.lanes,
                pace=how.pace,
                clock_hz=run.clock_hz,
                stalls=how.stalls,
                seed=seed,
                waves=waves,
                cocotb_recordings=len(positions) * (way == "cocotb"),
                bulk_recordings=len(positions) * (way == "bulk"),
            )
        )
        if answer.mismatch:
            break
    return joined(run.config, parts)


def converter_model(config: AcceleratorConfig) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Files and compiler options of the converter's model and of its wiring. `spi.sv` stands for every SPI
    chip without a model for it alone."""
    folder, name = Path(__file__).with_name("converters"), config.interface.converter.name
    models = (folder / f"{model}.sv" for model in (name, "spi"))
    values = converter_plan(config).parameters(config)
    values |= {"CYCLE_PS": round(1e12 / config.hardware.clock_hz)}
    given = ",".join(f".{field}({value})" for field, value in values.items())
    wired = [f"-D{field}={values.get(field, 1)}" for field in ("LINES", "SELECTS")]
    options = ("-DCONVERTER", f"-DCONVERTER_{name}", f"-DMODEL_PARAMETERS={given}", *wired)
    return (folder / "pins.svh", next(filter(Path.is_file, models))), options


def lowest_clock(
    design: Path,
    vectors: Path,
    how: Simulation,
    *,
    work: Path,
    cycles: Cycles | None = None,
    rounds: int = 8,
    progress: Progress = lambda what, done, total: None,
) -> Played:
    """The declared-pace run at the lowest clock that meets every budget; the rest as for ``cosim``.

    The search begins at the clock that ``cycles``, the counts of a declared-pace run, ask for (default: at twice the clock
    that the multiplies alone need). The clock is raised until a run meets every budget, and then lowered as long as the run's own
    counts ask for less and that clock meets them (at one that is too slow, steps wait for one another and their latencies
    count more). It is a multiple of 1 kHz. A run that differs, gives up or has no decision ends the search and is returned: no clock mends that.

    Raises
    ------
    NoClock
        When ``rounds`` runs did not find one.
    """
    config = AcceleratorConfig.load(Path(design) / "config.json")
    ideal = config.step_ideal
    guess = Cycles(
        step_ideal=ideal, frame_max=ideal, step_min=ideal, step_max=ideal, decision_latency_max=ideal
    )
    clock = latency.needed_clock(config, cycles or guess) * (1 if cycles else 2)
    lowest, slow = None, 0.0  # the result at the lowest that will do, the highest that is too slow
    for attempt in range(rounds):
        folder = Path(work) / f"clock{attempt}"
        at = replace(how, pace="declared", clock_hz=clock)
        result = cosim(design, vectors, at, work=folder, progress=progress)
        needed = latency.needed_clock(config, result.cycles)
        if result.verdict != "bit-exact":
            return result
        if result.passed:
            lowest = result
        else:
            slow, needed = clock, max(needed, clock + 1e3 * round(clock / 5e4 + 1))
        if lowest and not slow < needed < lowest.clock_hz:
            return lowest
        clock = needed
    if lowest:
        return lowest
    raise NoClock(
        f"no clock that meets every budget was found in {rounds} runs; the last one tried was {clock:.0f} Hz"
    )


def _keep_waves(run: Run, mismatch: Mismatch, settings: Record, work: Path) -> str | None:
    """Play the recording of the mismatch alone, with waves around it; returns the folder. None: it agrees then."""
    position = run.expected["numbers"].tolist().index(mismatch.recording)
    folder = work / f"waves_recording{mismatch.recording}"
    since = mismatch.since_arm if mismatch.cycle >= 0 else 0
    settings = settings | {"positions": [position], "waves_from": max(0, since - WAVES_BEFORE)}
    again = run.play(folder, settings, waves=True)
    return str(folder) if again["mismatch"] else None
