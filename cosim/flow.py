"""One co-simulation: a generated accelerator, a file of vectors, a simulator, and what came of it."""

import json
import operator
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim import bulk, latency, runner
from eskin.cosim.netlist import Hardware
from eskin.cosim.scoreboard import KEPT
from eskin.golden.core import AcceleratorConfig, Arrays, InputError, Progress, Record, SimulationError
from eskin.golden.core.converters import converter_plan

GOLDEN = "torch: states, maps, logits; numpy: sums, features, distances, decisions"
"""What computed the values of `eskin.verbs.flow.expected_of`."""
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
    simulator: str
    builds: Path
    clock_hz: float
    settings: Record

    @classmethod
    def of(
        cls,
        design: Path,
        vectors: Path,
        *,
        simulator: str = "verilator",
        pace: str = "full",
        clock_hz: float | None = None,
        hardware: Hardware | None = None,
        builds: Path,
    ) -> "Run":
        """A run of all recordings.

        Parameters
        ----------
        design:
            Folder written by eskin.rtl.fpga.generate.
        vectors:
            File written by eskin.golden.model.vectors.write_vectors. If it has a converter's codes, the run begins at
            its pins.
        simulator:
            ``verilator`` or ``icarus``.
        pace:
            ``full``: a beat whenever ready. ``declared``: frames at the sensor's rate, at ``clock_hz``.
        clock_hz:
            Default: the configuration's.
        hardware:
            A netlist of the same design; default: the design's own Verilog.
        builds:
            Folder that keeps simulators.

        Raises
        ------
        InputError
            Bad options, a design and vectors that do not fit, a clock that cannot carry the frames.
        """
        design = Path(design).resolve()
        config = AcceleratorConfig.load(design / "config.json")
        with np.load(vectors) as archive:
            expected = dict(archive)
        clock_hz = float(clock_hz or config.hardware.clock_hz)
        taxels, rate, given = config.sensor.taxels, config.sensor.scan_rate_hz, expected["samples"].shape[1]
        if given != taxels:
            raise InputError(
                f"{vectors}: has {given} taxels and the accelerator has {taxels}; use one array for both"
            )
        if pace not in ("full", "declared"):
            raise InputError(f"--pace {pace}: is unknown; use full or declared")
        if pace == "declared" and clock_hz < taxels * rate:
            raise InputError(
                f"--clock {clock_hz:.0f}: is too slow for {taxels} taxels at {rate:g} Hz, one a cycle; "
                f"give at least {taxels * rate:.0f} Hz"
            )
        converting = "codes" in expected
        top, frames, bits = ("sensing.sv", "codes", 32) if converting else ("accelerator.sv", "samples", 16)
        models, options = converter_model(config) if converting else ((), ())
        hop = 32 if config.is_image else config.windows.hop
        beats = expected[frames].shape[1]
        hardware = hardware or Hardware((design / top, *models), options)
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
        return cls(config, expected, hardware, simulator, Path(builds), clock_hz, settings)

    def play(
        self,
        work: Path,
        settings: Mapping[str, Any],
        *,
        bench: str = "eskin.cosim.bench",
        waves: bool = False,
    ) -> Record:
        """Answers of the cocotb tests of module ``bench`` with these settings beside the run's own."""
        config, hardware, settings = self.config, self.hardware, {**self.settings, **settings}
        parameters = {"SAMPLE_BITS": config.sensor.sample_bits, "FRAMES": settings["block"]}
        parameters |= {name.upper(): settings[name] for name in ("beats", "bits", "patience")}
        built = runner.build(
            self.simulator, hardware.sources, parameters, self.builds, options=hardware.options, waves=waves
        )
        work.mkdir(parents=True, exist_ok=True)
        (work / "bench.json").write_text(json.dumps(settings))
        cycles = len(self.expected["samples"]) * (6 * config.sensor.taxels + settings["period"])
        cycles += len(self.expected["decision"]) * 3 * (config.step_ideal + 500) + 20000
        slowest = SLOWEST_CYCLES_PER_S[f"{hardware.level} {self.simulator}"]
        wall_s = runner.run(built, work, limit_s=120 + cycles / slowest, bench=bench)
        return json.loads((work / "result.json").read_text()) | {"wall_s": wall_s}


def cosim(
    design: Path,
    vectors: Path,
    *,
    stalls: bool = False,
    seed: int = 1,
    probe: bool = False,
    waves: bool = True,
    cocotb: Sequence[int] | None = None,
    threads: int | None = None,
    progress: Progress = lambda what, done, total: None,
    work: Path,
    **options: Any,
) -> Record:
    """Play ``vectors`` into ``design`` and compare every stage, up to the first value that differs.

    Parameters
    ----------
    stalls:
        Random gaps on both sides; ``seed`` makes them.
    probe:
        Write weights during a touch; that must be refused and flagged, and the streams must not change.
    waves:
        On a mismatch, play its recording once more and keep waves.
    cocotb:
        Positions of the recordings that are played under cocotb; the others are played in bulk in this process
        (`eskin.cosim.bulk`). Default: all. What this process cannot play goes under cocotb, too:
        Icarus, a board's netlist, a converter, stalls, ``probe``.
    threads:
        Threads that play in bulk; default: one per core.
    work:
        Folder for settings, log, answer and waves; made when absent.
    options:
        As for `Run.of`: simulator, pace, clock_hz, hardware, builds.

    Returns
    -------
    dict
        recordings, cocotb_recordings, bulk_recordings, frames, steps, decisions, compared_values, mismatches (at most 1),
        bit_exact, golden (what computed the expectation), verdict (``gave up``: the hardware stood still; ``differs``;
        ``no decision``: no touch with a whole window; ``bit-exact``), gave_up ({recording, frame} at which nothing moved
        any more, or None), simulator, level, lanes, clock_hz, cycles, budgets (rows of ``eskin.cosim.latency``),
        simulated_cycles, wall_s, target (None at level rtl), stages (stage -> compared_values, mismatches), pace,
        stalls, seed, cycles_per_s, overruns, input_stalls, conversion (behind a converter: its name, code_bits,
        jitter_cycles, faults, the bits of ConverterFault, violations of its data sheet), registers
        (read at the end), probe (weights were written), mismatch_list (sentences), waves (path or None), passed
        (bit-exact, no budget missed, a decision compared).

    Raises
    ------
    InputError
        As of `Run.of`; no touch for the probe.
    SimulationError
        The simulator fails or takes too long.
    """
    run, work = Run.of(design, vectors, **options), Path(work)
    probe = probe and run.config.hardware.loadable
    settings: Record = {"stalls": seed & 0x7FFFFFFF if stalls else None, "probe": probe}
    everything = {*run.settings["positions"]}
    here = cocotb is not None and run.simulator == "verilator" and run.hardware.target in (None, "asic")
    here = here and not (stalls or probe or "codes" in run.settings["frames"])
    shown = everything & {*(cocotb or ())} if here else everything
    given: Record = {"golden": GOLDEN, "simulator": run.simulator, "level": run.hardware.level}
    given |= {"target": run.hardware.target, "pace": run.settings["pace"], "clock_hz": run.clock_hz}
    given |= {"lanes": run.config.hardware.lanes, "stalls": stalls, "seed": seed, "waves": None}
    given |= {"cocotb_recordings": 0, "bulk_recordings": 0}
    results = []
    for way, positions in (("cocotb", sorted(shown)), ("bulk", sorted(everything - shown))):
        if not positions:
            continue
        settings["positions"] = positions
        if way == "bulk":
            figures = bulk.play(run, positions, progress, seed=seed, threads=threads or os.cpu_count() or 1)
        else:
            progress(f"compiling the simulator and playing {len(positions)} under cocotb", 0, 0)
            figures = run.play(work, settings)
        if probe and not (figures["probe"] or figures["mismatch"]):
            raise InputError(
                "the weight write during a touch needs one that stays open; take other recordings"
            )
        if waves and figures["mismatch"]:
            progress("playing what differs once more, with waves", 0, 0)
            figures["waves"] = _keep_waves(run, figures["mismatch"], settings, work)
        results.append({**given, **figures, f"{way}_recordings": len(positions)})
    return joined(run.config, results)


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


JOINED: dict[str, Callable[[Any, Any], Any]] = dict.fromkeys(
    "cocotb_recordings bulk_recordings frames steps decisions compared_values mismatches simulated_cycles "
    "overruns input_stalls wall_s violations mismatch_list".split(),
    operator.add,
)
JOINED |= dict.fromkeys("frame_max step_max decision_latency_max jitter_cycles".split(), max)
JOINED |= KEPT | {"faults": operator.or_, "step_min": min, "bit_exact": operator.and_}
"""Functions that join two parts' values, by their name in a result; of others the first part's is taken."""


def _joined(first: Any, second: Any, name: str = "") -> Any:
    if first is None or second is None:
        return second if first is None else first
    if isinstance(first, dict):
        return {key: _joined(first.get(key), second.get(key), key) for key in {**first, **second}}
    return JOINED.get(name, lambda value, _: value)(first, second)


def joined(config: AcceleratorConfig, results: Sequence[Mapping[str, Any]]) -> Record:
    """One result from the results of parts of the recordings, in their order and played alike: counts and seconds
    are sums, cycles the extremes, budgets follow from these cycles; the registers are the last part's, with the
    faults of all and the longest step.
    """
    result: Record = reduce(_joined, map(dict, results))
    result["recordings"] = result["cocotb_recordings"] + result["bulk_recordings"]
    for name in ("compared_values", "mismatches"):
        result[name] = sum(stage[name] for stage in result["stages"].values())
    result["budgets"] = latency.budgets(config, result)
    wall_s = result["wall_s"]
    result["wall_s"], result["cycles_per_s"] = round(wall_s, 3), round(result["simulated_cycles"] / wall_s)
    result["bit_exact"] = result["mismatches"] == 0 and result["compared_values"] > 0
    # an expectation without a touch of a whole window never compared the network
    words = ["gave up"] * bool(result["gave_up"]) + ["differs"] * (not result["bit_exact"])
    result["verdict"] = [*words, "bit-exact" if result["decisions"] else "no decision"][0]
    result["passed"] = (
        result["bit_exact"]
        and result["decisions"] > 0
        and all(row["met"] or row["reference"] for row in result["budgets"])
        and not any(result.get("conversion", {}).get(name) for name in ("faults", "violations"))
        and result.get("without_probes", {}).get("bit_exact", True)
    )
    return result


def lowest_clock(
    design: Path,
    vectors: Path,
    *,
    work: Path,
    cycles: Mapping[str, int | None] | None = None,
    rounds: int = 8,
    **options: Any,
) -> Record:
    """The declared-pace run at the lowest clock that meets every budget; ``options`` as for ``cosim``.

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
    guess = dict.fromkeys(latency.COUNT_OF.values(), config.step_ideal)
    clock = latency.needed_clock(config, cycles or guess) * (1 if cycles else 2)
    lowest, slow = None, 0.0  # the result at the lowest that will do, the highest that is too slow
    for attempt in range(rounds):
        folder = Path(work) / f"clock{attempt}"
        result = cosim(design, vectors, pace="declared", clock_hz=clock, work=folder, **options)
        needed = latency.needed_clock(config, result["cycles"])
        if result["verdict"] != "bit-exact":
            return result
        if result["passed"]:
            lowest = result
        else:
            slow, needed = clock, max(needed, clock + 1e3 * round(clock / 5e4 + 1))
        if lowest and not slow < needed < lowest["clock_hz"]:
            return lowest
        clock = needed
    if lowest:
        return lowest
    raise NoClock(
        f"no clock that meets every budget was found in {rounds} runs; the last one tried was {clock:.0f} Hz"
    )


def _keep_waves(run: Run, mismatch: Record, settings: Record, work: Path) -> str:
    """Play the recording of the mismatch alone, with waves around it; returns the folder."""
    position = run.expected["numbers"].tolist().index(mismatch["recording"])
    folder = work / f"waves_recording{mismatch['recording']}"
    since = mismatch["since_arm"] if mismatch["cycle"] >= 0 else 0
    settings = settings | {"positions": [position], "waves_from": max(0, since - WAVES_BEFORE)}
    run.play(folder, settings, waves=True)
    return str(folder)
