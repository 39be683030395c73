"""One co-simulation: a generated accelerator, a file of vectors, a simulator; the CONTRACT's result."""

import copy
import csv
import json
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim import latency, runner
from eskin.cosim.netlist import Hardware
from eskin.cosim.scoreboard import (
    DECISION_FIELDS,
    KEPT_MISMATCHES,
    Capture,
    Mismatch,
    Recording,
    Verdict,
    compare,
    flat_stages,
    read_capture,
    recordings_of,
)
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
MEASURES = ("frame", "step", "windows")
SLOWEST_CYCLES_PER_S = {
    ("rtl", "verilator"): 50e3,
    ("rtl", "icarus"): 500.0,
    ("netlist", "verilator"): 5e3,
    ("netlist", "icarus"): 20.0,
    ("bitstream", "verilator"): 5e3,
    ("bitstream", "icarus"): 20.0,
}
"""Cycles a second that even a busy machine reaches. They only set the wall-clock limit."""
WAVES_BEFORE, WAVES_AFTER = 2000, 500
"""Cycles kept around a mismatch."""

Progress = Callable[[int, int], None]
"""Called with (frames taken, frames in all)."""


class NoClock(SimulationError):
    """No clock was found that meets every budget."""


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
    measure: str = "step",
    waves: bool = True,
    fault: tuple[int, int, int] | None = None,
    work: Path,
    builds: Path,
    progress: Progress | None = None,
) -> Record:
    """Play ``vectors`` into ``design`` and compare every stage.

    Parameters
    ----------
    design:
        Folder written by eskin.rtl.fpga.generate.
    vectors:
        File written by eskin.golden.model.vectors.write_vectors.
    simulator:
        ``verilator`` or ``icarus``.
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
    measure:
        What the design's own counter measures, ``frame``, ``step`` or ``windows`` (register MEASURE); read as
        ``registers`` LONGEST.
    waves:
        On a mismatch, play its recording once more and keep waves.
    fault:
        With a converter: (first frame, frames, kind) in which its model misbehaves, in every recording; kinds
        as in its file.
    work:
        Folder for stimulus, captures, log and waves; made when absent.
    builds:
        Folder that keeps simulators.

    Returns
    -------
    dict
        recordings, frames, steps, decisions, compared_values, mismatches, bit_exact, verdict (`verdict_of`),
        gave_up (`standstill`), simulator, level, lanes, clock_hz, cycles, budgets (rows of
        ``eskin.cosim.latency``), simulated_cycles, wall_s, target (None at level rtl), stages (stage ->
        compared_values, mismatches), pace, stalls, seed, cycles_per_s, overruns, input_stalls, registers
        (read at the end), probe, mismatch_list (sentences, the first ones), waves (path or None), passed
        (bit-exact, no budget missed, probe refused).

    Raises
    ------
    InputError
        Bad options, a design and vectors that do not fit, a clock that cannot carry the frames.
    SimulationError
        The simulator fails or takes too long.
    """
    design, vectors = Path(design), Path(vectors)
    config = AcceleratorConfig.load(design / "config.json")
    with np.load(vectors) as archive:
        expected = dict(archive)
    clock_hz = float(clock_hz or config.hardware.clock_hz)
    check(config, expected, vectors, pace, clock_hz)
    if measure not in MEASURES:
        raise InputError(f"measure {measure}: is unknown; use {', '.join(MEASURES[:-1])} or {MEASURES[-1]}")
    settings = {
        "declared": int(pace == "declared"),
        # in thousandths: plusargs are integers, and rates such as 35.6 Hz are not
        "rate": round(config.sensor.sample_rate_hz * 1000),
        "clock": round(clock_hz * 1000),
        "stalls": int(stalls),
        "gap_seed": seed & 0x7FFFFFFF,
        "watchdog": latency.standstill_cycles(config),
    }
    held = _probe_frame(config, expected) if probe and config.hardware.loadable else None
    if held:
        settings |= {"hold_recording": held[0], "hold_frame": held[1]}
    if config.interface.converter.name != "none":
        settings |= _misbehaviour(fault)
        hardware = hardware or converter_hardware(design, config)
    hardware = hardware or Hardware((design / "accelerator.sv",))
    run = _Run(design, config, hardware, simulator, Path(work), Path(builds), settings, measure)
    wall_s = run.play(expected, probing=held is not None, progress=progress)
    capture = read_capture(run.work, flat_stages(config))
    verdict = compare(config, expected, capture, probes=hardware.probes)
    answers = json.loads((run.work / "result.json").read_text())
    refused = answers.get("probe")
    result = result_of(
        config,
        expected,
        capture,
        verdict,
        {
            "simulator": simulator,
            "level": hardware.level,
            "target": hardware.target,
            "pace": pace,
            "stalls": stalls,
            "seed": seed,
        },
        probes=hardware.probes,
        clock_hz=clock_hz,
        wall_s=wall_s,
        registers=answers["registers"],
    )
    result["probe"] = refused
    if "played_cycles" in capture.summary:
        result["clocked_share"] = capture.summary["clocked_cycles"] / capture.summary["played_cycles"]
    if config.interface.converter.name != "none":
        result["conversion"] = conversion(config, expected, capture, run.work, clock_hz)
    result["passed"] = (
        result["passed"]
        and not (capture.summary.get("violations") or capture.summary.get("conversion_faults"))
        and (refused is None or (refused["after"] & 1 == 1 and refused["cleared"] & 1 == 0))
    )
    if verdict.first and waves:
        result["waves"] = str(_keep_waves(run, expected, capture, verdict))
    return result


def result_of(
    config: AcceleratorConfig,
    expected: Arrays,
    capture: Capture,
    verdict: Verdict,
    played: Mapping[str, Any],
    *,
    probes: bool,
    clock_hz: float,
    wall_s: float,
    registers: Mapping[str, int],
) -> Record:
    """The result of a run as `cosim` describes it. ``passed`` leaves out what only a bench in a simulator
    tries.

    Parameters
    ----------
    played:
        simulator, level, target, pace, stalls, seed: into the result as they are.
    """
    cycles = latency.cycle_table(config, expected, capture)
    summary, declared = capture.summary, played["pace"] == "declared"
    overruns = summary["overruns"] if declared else 0
    rows = latency.budgets(config, cycles, clock_hz, declared=declared, overruns=overruns)
    result = {
        "recordings": len(expected["numbers"]),
        "frames": summary["frames"],
        "steps": _steps(capture, probes),
        "decisions": sum(len(s.words) for s in capture.stages["decision"].values()),
        "compared_values": verdict.compared_values,
        "mismatches": verdict.mismatches,
        "stages": verdict.stages,
        "bit_exact": verdict.bit_exact,
        "gave_up": standstill(summary),
        **played,
        "lanes": config.hardware.lanes,
        "clock_hz": clock_hz,
        "cycles": cycles,
        "budgets": rows,
        "simulated_cycles": summary["cycles"],
        "wall_s": round(wall_s, 3),
        "cycles_per_s": round(summary["cycles"] / wall_s),
        "overruns": overruns,
        "input_stalls": summary["input_stalls"],
        "registers": dict(registers),
        "probe": None,
        "mismatch_list": [str(mismatch) for mismatch in verdict.first],
        "waves": None,
        "passed": verdict.bit_exact and all(row["met"] or row["reference"] for row in rows),
    }
    return result | {"verdict": verdict_of(result)}


def standstill(summary: Mapping[str, int]) -> dict[str, int] | None:
    """{recording, frame} at which nothing moved any more and the bench gave up; None where it did not."""
    if not summary["stuck"]:
        return None
    return {"recording": summary["stuck_recording"], "frame": summary["stuck_frame"]}


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
    return (folder / "pins.svh", next(filter(Path.is_file, models))), (f"-DCONVERTER_{name}",)


def _misbehaviour(fault: tuple[int, int, int] | None) -> dict[str, int]:
    return dict(zip(("fault_frame", "fault_frames", "fault_kind"), fault, strict=True)) if fault else {}


def conversion(
    config: AcceleratorConfig, expected: Arrays, capture: Capture, work: Path, clock_hz: float
) -> Record:
    """What the frames' way from the pins took, in cycles.

    converter, code_bits, scan_cycles (from a scan's begin to its last channel, at most), jitter_cycles
    (largest distance of a scan's begin from the declared rate), feature_cycles (from a frame's last channel
    to the first feature of the window that it ends, at least and at most; None where no window was complete),
    faults, violations (limits of the converter's data sheet that its model saw broken).
    """
    scans = np.fromfile(work / "scans.bin", dtype="<u4").reshape(-1, 2).astype(np.int64)
    period = clock_hz / config.sensor.sample_rate_hz
    jitter, waits = 0.0, []
    half = latency.STAMP_RANGE / 2
    for recording in recordings_of(expected):
        begins, ends = scans[recording.span("samples")].T
        if len(begins):
            # stamps have 32 bits and wrap: differences are taken modulo their range, around 0
            late = begins - begins[0] - np.arange(len(begins)) * period
            jitter = max(jitter, float(np.abs((late + half) % latency.STAMP_RANGE - half).max()))
        cycles = capture.stream("feature", recording.number).cycles[:: config.inputs]
        frames = recording["decision_frame"][recording["decision"][:, 0] == 0]
        for step, (frame, cycle) in enumerate(zip(frames, cycles, strict=False)):
            # of two windows that end with one frame the second waits for the first, not for the converter
            if step == 0 or frame != frames[step - 1]:
                waits.append((cycle - ends[frame - 1]) % latency.STAMP_RANGE)
    return {
        "converter": config.interface.converter.name,
        "code_bits": converters.code_bits(config),
        "scan_cycles": int(((scans[:, 1] - scans[:, 0]) % latency.STAMP_RANGE).max(initial=0)),
        "jitter_cycles": round(jitter, 3),
        "feature_cycles": [int(min(waits)), int(max(waits))] if waits else None,
        "faults": int(capture.summary["conversion_faults"]),
        "violations": int(capture.summary["violations"]),
    }


JOINED: dict[str, Callable[[list[Any]], Any]] = {
    **dict.fromkeys(
        "recordings frames steps decisions compared_values mismatches simulated_cycles overruns input_stalls "
        "wall_s conversion.violations".split(),
        sum,
    ),
    **dict.fromkeys(
        "cycles.frame_max cycles.step_max cycles.decision_latency_max registers.LONGEST "
        "conversion.scan_cycles conversion.jitter_cycles".split(),
        lambda values: max(values, default=None),
    ),
    "cycles.step_min": lambda values: min(values, default=None),
    **dict.fromkeys(("registers.FAULTS", "conversion.faults"), lambda values: reduce(operator.or_, values)),
    **dict.fromkeys(("registers.STATUS", "registers.TOUCHES"), lambda values: values[-1]),
    "conversion.feature_cycles": lambda pairs: [f(chain(*pairs)) for f in (min, max)] if pairs else None,
    "mismatch_list": lambda values: [*chain.from_iterable(values)][:KEPT_MISMATCHES],
    "gave_up": lambda values: next(iter(values), None),
}
"""What becomes of the parts' values by their place in a result, None left out."""
JOINED |= {
    f"without_probes.{name}": JOINED[name] for name in ("compared_values", "mismatches", "mismatch_list")
}
JOINED["without_probes.bit_exact"] = all


def joined(config: AcceleratorConfig, results: Sequence[Mapping[str, Any]]) -> Record:
    """One result from those of parts of the recordings, in their order and played alike: counts and seconds
    are sums, cycles the extremes, budgets those of these cycles; the registers are the last part's, with the
    faults of all and the longest of what LONGEST measures.
    """
    result: Record = copy.deepcopy(dict(results[0]))
    for place, join in JOINED.items():
        *way, name = place.split(".")
        whole: Any
        whole, *parts = (reduce(lambda at, key: at.get(key, {}), way, part) for part in (result, *results))
        if name in whole:
            whole[name] = join([part[name] for part in parts if part[name] is not None])
    for name in dict.fromkeys(name for part in results for name in part["stages"]):
        counts = [part["stages"].get(name, {}) for part in results]
        result["stages"][name] = {
            key: sum(count.get(key, 0) for count in counts) for key in ("compared_values", "mismatches")
        }
    result["bit_exact"] = result["mismatches"] == 0 and result["compared_values"] > 0
    result["verdict"] = verdict_of(result)
    declared, wall_s = result["pace"] == "declared", result["wall_s"]
    result["budgets"] = latency.budgets(
        config, result["cycles"], result["clock_hz"], declared=declared, overruns=result["overruns"]
    )
    result["wall_s"], result["cycles_per_s"] = round(wall_s, 3), round(result["simulated_cycles"] / wall_s)
    result["passed"] = (
        result["bit_exact"]
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
    least = config.sensor.taxels * config.sensor.sample_rate_hz
    if pace == "declared" and clock_hz < least:
        raise InputError(
            f"--clock {clock_hz:.0f}: is too slow for {config.sensor.taxels} taxels at "
            f"{config.sensor.sample_rate_hz:g} Hz, one a cycle; "
            f"give at least {least:.0f} Hz"
        )


def _probe_frame(config: AcceleratorConfig, expected: Arrays) -> tuple[int, int]:
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


@dataclass(frozen=True)
class _Run:
    """One design with one simulator and one work folder."""

    design: Path
    config: AcceleratorConfig
    hardware: Hardware
    simulator: str
    work: Path
    builds: Path
    settings: Mapping[str, int]
    measure: str

    def play(
        self,
        expected: Arrays,
        *,
        probing: bool = False,
        progress: Progress | None = None,
        waves: bool = False,
    ) -> float:
        """Build, write the stimulus of ``expected``, run; wall seconds of the run alone."""
        described = json.loads((self.design / "registers.json").read_text())
        boot = [int(line, 16) for line in (self.design / "load.hex").read_text().split()]
        registers, bits = described["registers"], described["bits"]
        parameters = {"TAXELS": self.config.sensor.taxels, "SAMPLE_BITS": self.config.sensor.sample_bits}
        parameters |= {name: registers[name] for name in ("CONTROL", "STATUS", "FAULTS", "TOUCHES")}
        parameters |= {name: bits["CONTROL"][name] for name in ("ARM", "FINISH")}
        if self.config.interface.converter.name != "none":
            parameters |= converter_parameters(self.config)
        if self.config.faults.fault_frames:
            parameters |= {
                "TAXEL_FAULTS": registers["TAXEL_FAULTS"],
                "FLAG_WORDS": -(-self.config.sensor.taxels // 16),
            }
        options = [*self.hardware.options, *(() if self.hardware.probes else ("-DNO_PROBES",))]
        options += ["-DIMAGES"] * self.config.is_image
        simulator = runner.build(
            self.simulator, self.hardware.sources, parameters, self.builds, options=options, waves=waves
        )
        self.work.mkdir(parents=True, exist_ok=True)
        lengths = np.diff(expected["offsets"])
        stimulus = (
            expected["codes"].astype(">u4") if "codes" in expected else expected["samples"].astype(">u2")
        )
        stimulus.tofile(self.work / "samples.bin")
        np.stack([expected["numbers"], lengths], axis=1).astype(">u4").tofile(self.work / "recordings.bin")
        np.array(boot).astype(">u4").tofile(self.work / "boot.bin")
        bench = {
            "registers": registers,
            "id": described["id"],
            "probe": probing,
            "bits": bits["STATUS"] | bits["CONTROL"],
        }
        bench["measure"] = described["measures"][self.measure.upper()]
        (self.work / "bench.json").write_text(json.dumps(bench))
        frames, stamps = int(lengths.sum()), self.work / "frames.bin"
        stamps.unlink(missing_ok=True)

        def poll() -> None:
            if progress and stamps.exists():
                progress(min(stamps.stat().st_size // 4, frames), frames)

        per_frame: float = self.config.sensor.taxels * (6 if self.settings["stalls"] else 1)
        if self.settings["declared"]:
            per_frame += self.settings["clock"] / self.settings["rate"]
        steps = len(expected["decision"])
        cycles = frames * per_frame + steps * 3 * (self.config.step_ideal + 500) + len(boot)
        limit_s = 120 + cycles / SLOWEST_CYCLES_PER_S[self.hardware.level, self.simulator]
        plus_args = {**self.settings, "recordings": len(lengths), "boot": len(boot)}
        wall_s = runner.run(simulator, self.work, plus_args, limit_s=limit_s, poll=poll)
        if progress:
            progress(frames, frames)
        return wall_s


def converter_parameters(config: AcceleratorConfig) -> dict[str, int]:
    """Parameters of the converter's model, by the fields of the configuration and the data sheet."""
    plan = converters.converter_plan(config)
    values = {"CYCLE_PS": round(1e12 / config.hardware.clock_hz), "PIN_CODES": plan.pin_codes(config)}
    return values | plan.parameters(config)


def _steps(capture: Capture, probes: bool) -> int:
    """Steps that were done: as the probe counts them, without probes the local decisions."""
    if probes:
        return sum(len(stream.words) for stream in capture.steps.values())
    low = DECISION_FIELDS["is_global"][0]
    streams = capture.stages["decision"].values()
    return sum(int((stream.definite & (stream.codes >> low & 1 == 0)).sum()) for stream in streams)


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


def _keep_waves(run: _Run, expected: Arrays, capture: Capture, verdict: Verdict) -> Path:
    """Play the recording of the first mismatch alone, with waves around it; beside them the meaning of the
    signals. The folder."""
    first = _earliest(run.config, verdict, capture)
    played = recordings_of(expected)
    recording = next((part for part in played if part.number == first.recording), played[0])
    number, centre = recording.number, _cycles_since_arm(first, recording, capture)
    settings = {k: v for k, v in run.settings.items() if not k.startswith("hold_")}
    settings |= {"waves_from": max(0, centre - WAVES_BEFORE), "waves_to": centre + WAVES_AFTER}
    folder = run.work / f"waves_recording{number}"
    again = replace(run, work=folder, settings=settings)
    alone = {name: recording[name] for name in ("samples", "codes") if name in expected}
    alone |= {"offsets": np.array([0, len(alone["samples"])]), "numbers": np.array([number])}
    alone["decision"] = expected["decision"]
    again.play(alone, waves=True)
    formats = stage_formats(run.config)
    signals = {f"harness.{'state' if stage == 'map' else stage}": str(fmt) for stage, fmt in formats.items()}
    signals["harness.i_sample"] = str(run.config.sample_format)
    (folder / "signals.json").write_text(
        json.dumps({"mismatch": str(first), "formats": signals}, indent=2) + "\n"
    )
    (folder / "waves.gtkw").write_text(_gtkwave(list(signals)))
    replayed = read_capture(folder, flat_stages(run.config))
    with (folder / "decoded.csv").open("w", newline="") as handle:
        table = csv.writer(handle)
        table.writerow(
            ["stage", "index", "cycle_since_arm", "code", "value", "expected_code", "expected_value"]
        )
        armed = replayed.summary["armed_at"]
        for stage, fmt in formats.items():
            want, stream = recording[stage], replayed.stream(stage, number)
            for index, (word, cycle) in enumerate(zip(stream.words, stream.cycles, strict=True)):
                code = int(stream.codes[index].astype(np.int32)) if stream.definite[index] else word
                aim = int(want[index]) if index < len(want) else ""
                value, aimed = (
                    float(fmt.to_real(part)) if part != "" and part != word else "" for part in (code, aim)
                )
                table.writerow([stage, index, cycle - armed, code, value, aim, aimed])
    return folder


def _earliest(config: AcceleratorConfig, verdict: Verdict, capture: Capture) -> Mismatch:
    """The mismatch nearest to the cause: lowest recording as played, then frame, then place in the chain."""
    chain = [*flat_stages(config), "decision"]
    within = [m for m in verdict.first if m.recording == verdict.first[0].recording]
    return min(
        within,
        key=lambda m: (m.frame or 1 << 62, chain.index(m.stage) if m.stage in chain else len(chain), m.index),
    )


def _cycles_since_arm(mismatch: Mismatch, recording: Recording, capture: Capture) -> int:
    """Where to look, in cycles since the recording's arm command: at the value, else at the frame that should
    have brought it."""
    if recording.number not in capture.status:
        return WAVES_BEFORE
    armed = capture.status[recording.number][3]
    if mismatch.cycle >= 0:
        return mismatch.cycle - armed
    span = recording.span("samples")
    frame = span.start + (mismatch.frame or span.stop - span.start)
    stamp = int(capture.frame_cycles[min(frame, len(capture.frame_cycles)) - 1])
    return (stamp - armed) % latency.STAMP_RANGE


def _gtkwave(signals: list[str]) -> str:
    """A GTKWave state file that lists the stage signals, signed decimal."""
    control = [
        f"harness.{name}"
        for name in (
            "clk",
            "i_valid",
            "i_ready",
            "i_first",
            "i_last",
            "o_valid",
            "o_ready",
            "o_payload[30:0]",
        )
    ]
    valid = [f"{signal}_valid" for signal in signals if not signal.endswith("i_sample")]
    wide = [f"{signal}[31:0]" if not signal.endswith("i_sample") else signal for signal in signals]
    return "\n".join(['[dumpfile] "waves.vcd"', "@28", *control, *valid, "@420", *wide, ""])
