"""A board without a host on the part's oscillators, as it goes onto the part: its netlist between models of converter and
oscillators, each recording from power-on, at their nominal frequencies and off by their tolerance either way.

Compared is what the pins show after each frame: class, whether the decision is final, whether it is unsure, the lamp.
"""

import json
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim import runner
from eskin.cosim.flow import GOLDEN, SLOWEST_CYCLES_PER_S, converter_model
from eskin.cosim.netlist import Hardware
from eskin.cosim.results import Conversion, Cycles, Oscillator, Part, Played, Stage, joined
from eskin.cosim.scoreboard import Mismatch
from eskin.cosim.simulation import Simulation
from eskin.golden.core import AcceleratorConfig, Arrays, Progress, Record
from eskin.golden.core.converters import code_bits

BOARD, OSCILLATORS = (Path(__file__).with_name(f"{name}.sv") for name in ("standalone", "oscillators"))
STAGE = "pins"


def shown_on_pins(
    config: AcceleratorConfig, rows: np.ndarray, frames: np.ndarray, count: int
) -> tuple[list[str], list[int]]:
    """What the pins show after each of ``count`` frames: a digit for each class, the last one first, then whether the
    decision is final, whether it is unsure, and the lamp; and how many decisions have reached them by then.

    Parameters
    ----------
    rows, frames:
        Decisions of a recording and the frame (from 1) that completes each (`eskin.golden.model.completing_frames`).
        One that only the recording's end makes is never shown: without a host nobody ends it.
    """
    early, final, place = config.network.decision == "early", False, 0
    shown, pins, decided, counts = list[str](), "0" * config.classes + "00", 0, list[int]()
    for frame in range(1, count + 1):
        while place < len(rows) and 0 < frames[place] <= frame:
            is_global, step, label, _, partial, unsure = rows[place].tolist()
            place += 1
            if partial or (early and final and step and not is_global):
                continue  # behind an early final decision local ones are not shown
            final, decided = bool(is_global), decided + 1
            pins = f"{1 << label:0{config.classes}b}{is_global:d}{unsure:d}"
        shown.append(pins + "0")
        counts.append(decided)
    return shown, counts


@dataclass(frozen=True, kw_only=True)
class Board:
    """A netlist as it is placed, and its oscillators.

    clock_hz, slow_hz: nominal. tolerance: share by which both may be off. start_s: until the fast one is stable.
    turn_cycles: most fast cycles of a scan and the work behind it.
    """

    config: AcceleratorConfig
    hardware: Hardware
    clock_hz: float
    slow_hz: float
    tolerance: float
    start_s: float
    turn_cycles: int


def play(
    board: Board,
    expected: Arrays,
    how: Simulation,
    *,
    work: Path,
    progress: Progress = lambda what, done, total: None,
) -> Played:
    """Each recording from power-on: with oscillators at their nominal frequency, both faster and both slower.

    Parameters
    ----------
    expected:
        codes (frames, codes at the pins), shown and decided (frames; `shown_on_pins`), offsets and numbers of the
        recordings.

    Raises
    ------
    SimulationError
        The simulator fails or takes too long.
    """
    config, hardware = board.config, board.hardware
    models, options = converter_model(config)
    built = runner.build(
        "verilator",
        [*hardware.sources, OSCILLATORS, *models],
        {"BEATS": expected["codes"].shape[1], "CLASSES": config.classes},
        how.builds,
        options=[*hardware.options, *options, "-DSLEEPS"],
        wrapper=BOARD,
        top=BOARD.stem,
    )
    work.mkdir(parents=True, exist_ok=True)
    vectors, numbers, parts = work / "pins.npz", expected["numbers"].tolist(), []
    arrays: Any = {name: expected[name] for name in ("codes", "offsets", "shown")}
    np.savez(vectors, **arrays)
    settings = {name: getattr(board, name) for name in ("clock_hz", "slow_hz", "start_s")}
    settings |= {"vectors": str(vectors.resolve()), "rate_hz": config.sensor.scan_rate_hz}
    for position, (low, high) in enumerate(pairwise(expected["offsets"].tolist())):
        limit_s = 120 + (high - low) * board.turn_cycles / SLOWEST_CYCLES_PER_S["netlist verilator"]
        progress("recordings played from power-on", position, len(numbers))
        for off in (0.0, board.tolerance, -board.tolerance):
            (work / "bench.json").write_text(json.dumps(settings | {"position": position, "off": off}))
            wall_s = runner.run(built, work, limit_s=limit_s, bench="eskin.cosim.pins_bench")
            answer = json.loads((work / "result.json").read_text()) | {"wall_s": wall_s}
            shown, decided = (expected[name][low:high].tolist() for name in ("shown", "decided"))
            part = _part(board, how, answer, shown, [0, *decided], numbers[position], off)
            part.cocotb_recordings = int(off == 0)
            parts.append(part)
    return joined(config, parts)


def _part(
    board: Board,
    how: Simulation,
    answer: Record,
    shown: list[str],
    decided: list[int],
    number: int,
    off: float,
) -> Part:
    """What one play found."""
    config, frame, compared = board.config, answer["frames"], answer["compared"]
    pins, found, mismatch = answer["pins"], answer["found"], None
    if answer["early"]:
        found = "the fast oscillator's output is on before it is stable"
    if found or compared < len(shown):
        place = f"{found or 'class pins, final, unsure, lamp'}; oscillators off by {off:+.0%}"
        mismatch = Mismatch(number, STAGE, frame - 1, place, frame, int(shown[frame - 1], 2), int(pins, 2))
    return Part(
        frames=frame,
        steps=0,
        decisions=decided[compared],
        simulated_cycles=answer["cycles"],
        overruns=0,
        input_stalls=0,
        stages={STAGE: Stage(compared_values=compared, mismatches=int(mismatch is not None))},
        cycles=Cycles(
            step_ideal=config.step_ideal,
            frame_max=None,
            step_min=None,
            step_max=None,
            decision_latency_max=None,
        ),
        registers={},
        mismatch=mismatch,
        mismatch_list=[str(mismatch)] if mismatch else [],
        gave_up=None,
        probe=False,
        wall_s=answer["wall_s"],
        conversion=Conversion(
            converter=config.interface.converter.name,
            code_bits=code_bits(config),
            jitter_cycles=0,
            faults=0,
            violations=answer["violations"],
        ),
        oscillator=Oscillator(
            **{name: answer[name] for name in ("fast_on_s", "seconds", "scans", "starts")}, duty=0.0
        ),
        golden=GOLDEN,
        simulator="verilator",
        level="netlist",
        target=board.hardware.target,
        lanes=config.hardware.lanes,
        pace="declared",
        clock_hz=board.clock_hz,
        stalls=False,
        seed=how.seed,
        waves=None,
        cocotb_recordings=0,
        bulk_recordings=0,
    )
