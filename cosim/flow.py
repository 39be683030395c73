"""One co-simulation: a generated accelerator, a file of vectors, a simulator; the CONTRACT's result."""

import json
import operator
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim import bulk, latency, runner
from eskin.cosim.device import Design, Model
from eskin.cosim.netlist import Hardware
from eskin.cosim.scoreboard import REGISTERS, Mismatch, count_stages, loading, part_of, recordings_of
from eskin.golden.core import (
    AcceleratorConfig,
    Arrays,
    InputError,
    QFormat,
    Record,
    SimulationError,
    converters,
    images,
)

PACES = ("full", "declared")
COMPILED = "compiled"
"""The simulator of a chip's netlist, in this process."""
SLOWEST_CYCLES_PER_S = {
    ("rtl", "verilator"): 50e3,
    ("rtl", "icarus"): 500.0,
    ("netlist", "verilator"): 5e3,
    ("netlist", "icarus"): 20.0,
    ("bitstream", "verilator"): 5e3,
    ("bitstream", "icarus"): 20.0,
}
"""Cycles a second that even a busy machine reaches. They only set the wall-clock limit."""
BLOCK_BITS = 1 << 15
"""Largest number of bits that the wrapper takes at a time; at most one hop of frames."""
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
        """Parameters and errors as for `cosim`."""
        design = Path(design)
        config = AcceleratorConfig.load(design / "config.json")
        with np.load(vectors) as archive:
            expected = dict(archive)
        clock_hz = float(clock_hz or config.hardware.clock_hz)
        check(config, expected, vectors, pace, clock_hz)
        converting = config.interface.converter.name != "none"
        if hardware is None and converting:
            hardware = converter_hardware(design, config)
        hardware = hardware or Hardware((design / "accelerator.sv",))
        frames, bits = ("codes", 32) if converting else ("samples", 16)
        hop = 32 if config.is_image else config.windows.hop
        settings = {
            "design": str(design.resolve()),
            "frames": frames,
            "block": max(1, min(hop, BLOCK_BITS // (bits * expected[frames].shape[1]))),
            "bits": bits,
            "period": clock_hz / config.sensor.scan_rate_hz if pace == "declared" else 0.0,
            "patience": latency.standstill_cycles(config),
            "probes": hardware.probes,
            "stalls": None,
            "fault": None,
        }
        return cls(config, expected, hardware, simulator, Path(builds), clock_hz, settings)

    def of_recordings(self, positions: Sequence[int]) -> "Run":
        """The same of these recordings only."""
        return replace(self, expected=part_of(self.expected, positions))

    def in_process(self) -> Callable[[int], Model] | None:
        """The model behind a device in this process, by the seed of its states; None if there is none."""
        if self.simulator == COMPILED:
            return self.hardware.compiled
        if self.simulator != "verilator" or self.hardware.level != "rtl" or self.settings["bits"] == 32:
            return None
        (verilog,) = self.hardware.sources
        return lambda seed: Design(verilog.read_text(), self.builds, "co-simulation")

    def play(
        self,
        work: Path,
        settings: Mapping[str, Any],
        *,
        bench: str = "eskin.cosim.bench",
        waves: bool = False,
    ) -> tuple[Record, float]:
        """Answers of the cocotb tests of module ``bench`` with these settings beside the run's own, and
        the wall time in seconds."""
        config, hardware, settings = self.config, self.hardware, {**self.settings, **settings}
        parameters = {"FRAMES": settings["block"], "PATIENCE": settings["patience"], "BITS": settings["bits"]}
        parameters |= {"BEATS": self.expected[settings["frames"]].shape[1]}
        parameters |= {"SAMPLE_BITS": config.sensor.sample_bits}
        built = runner.build(
            self.simulator, hardware.sources, parameters, self.builds, options=hardware.options, waves=waves
        )
        work.mkdir(parents=True, exist_ok=True)
        (work / "bench.json").write_text(json.dumps(settings))
        np.savez(work / "vectors.npz", allow_pickle=False, **self.expected)
        frames, steps = len(self.expected["samples"]), len(self.expected["decision"])
        cycles = frames * (
            config.sensor.taxels * (1 if settings["stalls"] is None else 6) + settings["period"]
        )
        cycles += steps * 3 * (config.step_ideal + 500) + 20000
        limit_s = 120 + cycles / SLOWEST_CYCLES_PER_S[hardware.level, self.simulator]
        wall_s = runner.run(built, work, limit_s=limit_s, bench=bench)
        return json.loads((work / "result.json").read_text()), wall_s


def cosim(
    design: Path,
    vectors: Path,
    *,
    simulator: str = "verilator",
    pace: str = "full",
    clock_hz: float | None = None,
    stalls: bool = False,
    seed: int = 1,
    probe: bool = False,
    hardware: Hardware | None = None,
    waves: bool = True,
    cocotb: Sequence[int] | None = None,
    threads: int | None = None,
    work: Path,
    builds: Path,
) -> Record:
    """Play ``vectors`` into ``design`` and compare every stage, up to the first value that differs.

    Parameters
    ----------
    design:
        Folder written by eskin.rtl.fpga.generate.
    vectors:
        File written by eskin.golden.model.vectors.write_vectors.
    simulator:
        ``verilator``, ``icarus`` or, of hardware that has it, ``compiled``.
    pace:
        ``full``: a beat whenever ready. ``declared``: frames at the sensor's rate, at ``clock_hz``.
    clock_hz:
        Default: the configuration's.
    stalls:
        Random gaps on both sides; ``seed`` makes them.
    probe:
        Try a weight write during a touch; it must be refused and flagged, and the streams must not change.
    hardware:
        A netlist of the same design; default: the design's own Verilog.
    waves:
        On a mismatch, play its recording once more and keep waves.
    cocotb:
        Positions of the recordings that are played under cocotb; the others are played in bulk in this process
        (`eskin.cosim.bulk`). Default: all, but with ``compiled``. What the process cannot play goes under cocotb, too:
        Icarus, a board's netlist, a converter, stalls, ``probe``.
    threads:
        Threads that play in bulk; default: one per core.
    work:
        Folder for settings, log, answer and waves; made when absent.
    builds:
        Folder that keeps simulators.

    Returns
    -------
    dict
        recordings, cocotb_recordings, bulk_recordings, frames, steps, decisions, compared_values, mismatches (at most 1),
        bit_exact, golden (what computed the expectation), verdict (`verdict_of`), gave_up ({recording, frame} at
        which nothing moved any more, or None), simulator, level, lanes, clock_hz, cycles, budgets (rows of
        ``eskin.cosim.latency``), simulated_cycles, wall_s, target (None at level rtl), stages (stage ->
        compared_values, mismatches), pace, stalls, seed, cycles_per_s, overruns, input_stalls, registers
        (read at the end), probe, mismatch_list (sentences), waves (path or None), passed
        (bit-exact, no budget missed, probe refused).

    Raises
    ------
    InputError
        Bad options, a design and vectors that do not fit, a clock that cannot carry the frames.
    SimulationError
        The simulator fails or takes too long.
    """
    run = Run.of(
        design, vectors, simulator=simulator, pace=pace, clock_hz=clock_hz, hardware=hardware, builds=builds
    )
    config, hardware = run.config, run.hardware
    settings: Record = {"stalls": seed & 0x7FFFFFFF if stalls else None}
    if probe and config.hardware.loadable:
        settings["write_at"] = _open_touch(config, run.expected)
    played: Record = {
        "simulator": simulator,
        "level": hardware.level,
        "target": hardware.target,
        "pace": pace,
    }
    played |= {"stalls": stalls, "seed": seed}
    everything = range(len(run.expected["numbers"]))
    here = None if stalls or probe else run.in_process()
    if simulator == COMPILED:
        if here is None:
            reason = "takes no stalls" if stalls else "is for chips"
            raise InputError(f"--simulator {COMPILED}: {reason}; take verilator")
        cocotb = ()
    shown = [*everything] if here is None or cocotb is None else sorted({*cocotb} & {*everything})
    others = sorted({*everything} - {*shown})
    results = []
    for positions, model in ((shown, None), (others, here)):
        if positions:
            part = run.of_recordings(positions)
            results.append(_played(part, model, settings, played, Path(work), waves=waves, threads=threads))
    return joined(config, results)


def _played(
    run: Run,
    here: Callable[[int], Model] | None,
    settings: Record,
    played: Record,
    work: Path,
    *,
    waves: bool,
    threads: int | None,
) -> Record:
    """The result of recordings played under cocotb, or in bulk with the model ``here``; played: as of `result_of`."""
    begun = time.monotonic()
    if here is None:
        said, wall_s = run.play(work, settings)
    else:
        registers, boot = loading(Path(run.settings["design"]))
        said = bulk.play(
            run.config,
            here,
            recordings_of(run.expected),
            registers,
            boot,
            probes=run.hardware.probes,
            period=run.settings["period"],
            seed=played["seed"],
            threads=1 if run.simulator == COMPILED else threads or os.cpu_count() or 1,
        )
        wall_s = time.monotonic() - begun
    result = result_of(run, said, played, wall_s=wall_s, in_bulk=here is not None)
    if said["mismatch"] and waves and run.simulator in runner.SIMULATORS:
        result["waves"] = str(_keep_waves(run, said["mismatch"], settings, work))
    return result


def result_of(
    run: Run, said: Mapping[str, Any], played: Mapping[str, Any], *, wall_s: float, in_bulk: bool
) -> Record:
    """The result as `cosim` describes it.

    Parameters
    ----------
    said:
        What the bench says (`eskin.cosim.bench.Bench`).
    played:
        simulator, level, target, pace, stalls, seed: into the result as they are.
    """
    config, recordings, told = run.config, len(run.expected["numbers"]), dict(said["mismatch"] or {})
    told.pop("since_arm", None)
    mismatch = Mismatch(**told) if told else None
    result: Record = {
        "recordings": recordings,
        "cocotb_recordings": 0 if in_bulk else recordings,
        "bulk_recordings": recordings if in_bulk else 0,
        **{name: said[name] for name in ("frames", "steps", "decisions")},
        "compared_values": sum(said["compared"].values()),
        "mismatches": int(mismatch is not None),
        "stages": count_stages(said["compared"], mismatch),
        "golden": "torch",
        "gave_up": {"recording": mismatch.recording, "frame": mismatch.frame}
        if mismatch and mismatch.stage == "input"
        else None,
        **played,
        "lanes": config.hardware.lanes,
        "clock_hz": run.clock_hz,
        "cycles": {
            "frame_max": said["longest"],
            **{name: said[name] for name in ("step_min", "step_max")},
            "step_ideal": config.step_ideal,
            "decision_latency_max": said["latency_max"],
        },
        "simulated_cycles": said["cycle"],
        "wall_s": wall_s,
        "overruns": said["overruns"] if played["pace"] == "declared" else 0,
        "input_stalls": said["waited"],
        "registers": said.get("registers") or dict.fromkeys(REGISTERS),
        "probe": said["probe"],
        "mismatch_list": [str(mismatch)] if mismatch else [],
        "waves": None,
    }
    if "-DCLOCKED" in run.hardware.options and not in_bulk:
        result["clocked_share"] = said["clocked_cycles"] / max(1, said["measured_cycles"])
    if "conversion" in said:
        result["overruns"] = said["conversion"]["faults"] >> 2 & 1
        result["conversion"] = said["conversion"] | {
            "converter": config.interface.converter.name,
            "code_bits": converters.code_bits(config),
            "violations": said["violations"],
        }
    return result


def verdict_of(result: Mapping[str, Any]) -> str:
    """The result in words: ``gave up`` (the hardware stood still, so later values were not compared),
    ``differs``, ``no decision`` (no touch with a whole window, so the network was not compared) or
    ``bit-exact``."""
    if result["gave_up"]:
        return "gave up"
    if not result["bit_exact"]:
        return "differs"
    return "bit-exact" if result["decisions"] else "no decision"


def converter_hardware(design: Path, config: AcceleratorConfig) -> Hardware:
    """The generated accelerator behind the model of its converter."""
    sources, options = converter_model(config)
    return Hardware((design / "sensing.sv", *sources), ("-DCONVERTER", *options))


def converter_model(config: AcceleratorConfig) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Files and compiler options of the converter's model and of its wiring. `spi.sv` stands for every SPI
    chip that has no model of its own."""
    folder, name = Path(__file__).with_name("converters"), config.interface.converter.name
    models = (folder / f"{model}.sv" for model in (name, "spi"))
    values = converters.converter_plan(config).parameters(config)
    values |= {"CYCLE_PS": round(1e12 / config.hardware.clock_hz)}
    given = ",".join(f".{field}({value})" for field, value in values.items())
    wired = [f"-D{field}={values.get(field, 1)}" for field in ("LINES", "SELECTS")]
    options = (f"-DCONVERTER_{name}", f"-DMODEL_PARAMETERS={given}", *wired)
    return (folder / "pins.svh", next(filter(Path.is_file, models))), options


JOINED: dict[str, Callable[[list[Any]], Any]] = {
    **dict.fromkeys(
        "recordings cocotb_recordings bulk_recordings frames steps decisions compared_values mismatches simulated_cycles overruns input_stalls "
        "wall_s violations mismatch_list".split(),
        lambda values: sum(values[1:], values[0]),
    ),
    **dict.fromkeys("frame_max step_max decision_latency_max LONGEST scan_cycles jitter_cycles".split(), max),
    **dict.fromkeys(("FAULTS", "faults"), lambda values: reduce(operator.or_, values)),
    **dict.fromkeys(("STATUS", "TOUCHES"), lambda values: values[-1]),
    "step_min": min,
    "bit_exact": all,
    "feature_cycles": lambda pairs: [f(chain(*pairs)) for f in (min, max)],
}
"""Functions that join the parts' values, by their name in a result; of others the first part's is taken."""


def _joined(name: str, values: list[Any]) -> Any:
    values = [value for value in values if value is not None]
    if values and isinstance(values[0], dict):
        return {
            key: _joined(key, [value.get(key) for value in values]) for key in dict.fromkeys(chain(*values))
        }
    return JOINED.get(name, operator.itemgetter(0))(values) if values else None


def joined(config: AcceleratorConfig, results: Sequence[Mapping[str, Any]]) -> Record:
    """One result from those of parts of the recordings, in their order and played alike: counts and seconds
    are sums, cycles the extremes, budgets those of these cycles; the registers are the last part's, with the
    faults of all and the longest step.
    """
    result: Record = _joined("", [dict(part) for part in results])
    result["budgets"] = latency.budgets(
        config,
        result["cycles"],
        result["clock_hz"],
        declared=result["pace"] == "declared",
        overruns=result["overruns"],
    )
    wall_s, refused = result["wall_s"], result.get("probe")
    result["wall_s"], result["cycles_per_s"] = round(wall_s, 3), round(result["simulated_cycles"] / wall_s)
    result["bit_exact"] = result["mismatches"] == 0 and result["compared_values"] > 0
    result["verdict"] = verdict_of(result)
    result["passed"] = (
        result["bit_exact"]
        and all(row["met"] or row["reference"] for row in result["budgets"])
        and not any(result.get("conversion", {}).get(name) for name in ("faults", "violations"))
        and result.get("without_probes", {}).get("bit_exact", True)
        and (refused is None or (refused["after"] & 1 == 1 and refused["cleared"] & 1 == 0))
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
) -> tuple[float, Record]:
    """The lowest clock, Hz, that meets every budget, and the declared-pace run at it that shows so;
    ``options`` as for ``cosim``.

    ``cycles``, the counts of a declared-pace run (default: made here, at twice the clock that the multiplies
    alone need), ask for a clock; it is tried, raised until a run meets every budget, and lowered as long as
    the run's own counts ask for less (at a clock that is too slow, steps wait for one another and their
    latencies count more). It is a multiple of 1 kHz. A run that differs or gives up ends the search and is
    what comes back: no clock mends that.

    Raises
    ------
    NoClock
        When ``rounds`` runs did not find one.
    """
    config = AcceleratorConfig.load(Path(design) / "config.json")
    if cycles is None:
        guess = 2 * latency.needed_clock(config, dict.fromkeys(latency.COUNT_OF.values(), config.step_ideal))
        result = cosim(
            design, vectors, pace="declared", clock_hz=guess, work=Path(work) / "declared", **options
        )
        if not result["bit_exact"]:
            return guess, result
        cycles = result["cycles"]
    clock = latency.needed_clock(config, cycles)
    lowest: tuple[float, Record] | None = None
    for attempt in range(rounds):
        result = cosim(
            design, vectors, pace="declared", clock_hz=clock, work=Path(work) / f"clock{attempt}", **options
        )
        needed = latency.needed_clock(config, result["cycles"])
        if result["passed"]:
            lowest = clock, result
            if needed >= clock:
                break
            clock = needed
        elif not result["bit_exact"]:
            return clock, result
        elif lowest:
            break
        else:
            clock = max(needed, clock + 1e3 * round(clock / 5e4 + 1))
    if lowest:
        return lowest
    raise NoClock(
        f"no clock that meets every budget was found in {rounds} runs; the last one tried was {clock:.0f} Hz"
    )


def check(config: AcceleratorConfig, expected: Arrays, vectors: Path, pace: str, clock_hz: float) -> None:
    """Refuse a pace, an array or a clock that do not fit.

    Raises
    ------
    InputError
    """
    if pace not in PACES:
        raise InputError(f"--pace {pace}: is unknown; use {' or '.join(PACES)}")
    if expected["samples"].shape[1] != config.sensor.taxels:
        taxels = expected["samples"].shape[1]
        raise InputError(
            f"{vectors}: has {taxels} taxels and the accelerator has {config.sensor.taxels}; use one array "
            "for both"
        )
    least = config.sensor.taxels * config.sensor.scan_rate_hz
    if pace == "declared" and clock_hz < least:
        raise InputError(
            f"--clock {clock_hz:.0f}: is too slow for {config.sensor.taxels} taxels at "
            f"{config.sensor.scan_rate_hz:g} Hz, one a cycle; "
            f"give at least {least:.0f} Hz"
        )


def _open_touch(config: AcceleratorConfig, expected: Arrays) -> tuple[int, int]:
    """(recording, frame) after a touch's first step of several, or within an image: there the touch is
    open."""
    if config.is_image:
        return int(expected["numbers"][0]), config.image.height // 2
    for recording in recordings_of(expected):
        rows, frames = recording["decision"], recording["decision_frame"]
        for row, frame, following in zip(rows[:-1], frames[:-1], frames[1:], strict=True):
            if row[0] == 0 and row[1] == 0 and following > frame:
                return recording.number, int(frame)
    raise InputError(
        "the weight write during a touch needs a recording with two completed steps; take other recordings"
    )


def stage_formats(config: AcceleratorConfig) -> dict[str, QFormat]:
    """The number format of each flat stage, as on the probes."""
    if config.is_image:
        return {"map": images.PIXEL_FORMAT, "logit": config.formats.logit_format}
    return {
        "sum": QFormat(config.sum_bits, 0),
        "fault": QFormat(2, 0),
        "feature": config.formats.feature_format,
        "state": config.formats.state_format,
        "logit": config.formats.logit_format,
    }


def _keep_waves(run: Run, mismatch: Record, settings: Record, work: Path) -> Path:
    """Play the recording of the mismatch alone, with waves around it; beside them the meaning of the signals.
    The folder."""
    numbers = run.expected["numbers"].tolist()
    position = numbers.index(mismatch["recording"]) if mismatch["recording"] in numbers else 0
    folder = work / f"waves_recording{numbers[position]}"
    since = mismatch["since_arm"] if mismatch["cycle"] >= 0 else 0
    settings = settings | {"waves_from": max(0, since - WAVES_BEFORE)}
    said, _ = run.of_recordings([position]).play(folder, settings, waves=True)
    formats = stage_formats(run.config)
    signals = {f"wrapper.probe__{stage}__value": str(fmt) for stage, fmt in formats.items()}
    described = {"mismatch": said["mismatch"], "formats": signals}
    (folder / "signals.json").write_text(json.dumps(described, indent=2) + "\n")
    return folder
