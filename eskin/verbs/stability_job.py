"""The failure-mode suite, `eskin stability`: golden finds where the method fails, co-simulation confirms the
worst of it.

Every experiment's record is kept by the content of what went into it (recordings, model, code), so that an
interrupted run goes on where it stopped.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from eskin.cosim.device import FOREVER, Accelerator, Design
from eskin.cosim.results import Played
from eskin.cosim.simulation import Simulation
from eskin.golden.core import InputError, Progress, Record, check_target, content_key, write_json
from eskin.golden.data import Recordings
from eskin.golden.model import FloatModel, IntegerModel, find_touches
from eskin.golden.model import run as run_golden
from eskin.jobs import Function, Jobs
from eskin.memo import Memo, code_version
from eskin.pages.stability_page import PAGE, write_page
from eskin.rtl.fpga.export import export
from eskin.rtl.fpga.generate import boot_writes, pack_decision, register_map
from eskin.study.stability import core as stability
from eskin.study.stability.core import GROUPS, Bench, Case, Confirmed, ModeResult, NotRun, Outcome, Stability
from eskin.study.stability.table import ACCURACY, MODES
from eskin.training import LEARNING
from eskin.verbs import cosim
from eskin.verbs.stability import StabilityRequest

CACHE = Path("build/stability_records")
"""Finished experiments by content; safe to delete."""
RESULT = "stability.json"
CONFIRMED = 3
"""Golden cases of each group, the weakest modes first, that are played into the hardware."""
STREAMED = 3
"""Recordings of the modes that need the hardware."""

CODE = partial(code_version, *LEARNING, "rtl", "cosim", "verbs")
"""Code on which records depend beside their data and model."""

LEFT = 150
"""Random cycles at which a recording is left; a quarter of the bench's ``flips`` where that is less."""
AROUND = range(-9, 3)
"""Cycles around a decision's offer at which it is left, too: `arm` falls before, into and behind it."""


def run(request: StabilityRequest, recordings: Recordings, *, progress: Progress | None = None) -> Stability:
    """Run the suite and write stability.json and stability.html.

    With ``request.cosim`` the weakest golden cases are confirmed in co-simulation, and modes that need the
    hardware run.

    Raises
    ------
    InputError
        A folder that is not a quantised model, an unknown mode, recordings without a touch or on which the network is no
        better than chance: a bound that is a share of its accuracy would hold whatever happens.
    """
    out, model_dir, few = request.out, request.model, request.few
    begin = time.perf_counter()
    for name in (RESULT, PAGE):
        check_target(out / name)
    for name in request.mode or ():
        if name not in MODES:
            raise InputError(f"stability, mode '{name}': is unknown; the modes are {', '.join(MODES)}")
    wanted = [MODES[name] for name in request.mode or MODES]
    model, real = IntegerModel.load(model_dir), FloatModel.load(model_dir)
    bench = Bench(config=model.config, recordings=recordings, model=model, real=real, few=few)
    chance = recordings.class_counts.max() / len(recordings)
    relative = any(mode.unit == ACCURACY for mode in wanted)
    if len(bench.touches) and relative and bench.clean_accuracy <= chance:
        raise InputError(
            f"`data`: without a disturbance the network classifies {bench.clean_accuracy:.1%} of '{recordings.source}' "
            f"correctly, and always naming the most frequent class {chance:.1%}, so no bound of accuracy means anything; "
            "train the network again, or give other recordings"
        )
    content = content_key(bench.model, recordings, CODE(), few, bench.real)
    jobs = Jobs(dask=request.dask, progress=progress, version=CODE)

    def results(function: Function, pieces: Record, shared: Any, what: str) -> list[Any]:
        """Records of named pieces, made or found."""
        keyed = {content_key(content, name): piece for name, piece in pieces.items()}
        return list(jobs.results(function, keyed, shared, keep=Memo(CACHE), what=what).values())

    reasons = {mode: stability.why_not(mode, bench.config, request.cosim) for mode in wanted}
    ready = [mode for mode, why in reasons.items() if not why]
    hardware = Hardware(bench)
    judged = results(judge_mode, {mode.name: mode.name for mode in ready}, hardware, "modes judged")
    records = [*map(ModeResult.model_validate, judged)]
    if request.cosim:
        weakest = weakest_cases(records)
        pieces = {f"rtl {record.name}": record.name for record in weakest}
        played = results(confirm, pieces, hardware, "weakest cases co-simulated")
        for record, rtl in zip(weakest, played, strict=True):
            record.rtl = Confirmed.model_validate(rtl)
    result = Stability(
        model=str(model_dir),
        data=str(recordings.source),
        recordings=len(recordings),
        clean_accuracy=bench.clean_accuracy,
        modes=records,
        not_run=[NotRun(name=mode.name, group=mode.group, why=why) for mode, why in reasons.items() if why],
        weakest=[record.name for record in stability.weakest(records)],
        passed=all(record.passed and (not record.rtl or record.rtl.bit_exact) for record in records),
        wall_s=round(time.perf_counter() - begin, 3),
    )
    write_json(out / RESULT, result)
    write_page(out, result)
    return result


# ---------------------------------------------------------------------- what workers do
def weakest_cases(records: Sequence[ModeResult]) -> list[ModeResult]:
    """The modes whose golden cases are played into the hardware: the weakest CONFIRMED of each group."""
    ranked = [record for record in stability.weakest(records, len(records)) if record.has_case]
    return [
        record
        for group in GROUPS
        for record in [record for record in ranked if record.group == group][:CONFIRMED]
    ]


def judge_mode(hardware: Hardware, name: str) -> ModeResult:
    """The record of one mode."""
    return stability.judge(MODES[name], hardware.bench, hardware.measure)[0]


def confirm(hardware: Hardware, name: str) -> Confirmed:
    """Play a mode's golden case into the hardware; {bit_exact, recordings, compared_values, mismatches
    ...}."""
    _, case = stability.judge(MODES[name], hardware.bench)
    assert case is not None  # its record says that it has one
    return _confirmed(hardware.play_case(case, name))


HOW = Simulation(waves=False)


@dataclass(frozen=True)
class Hardware:
    """Co-simulation for the suite."""

    bench: Bench
    how: Simulation = HOW

    def play_case(self, case: Case, name: str, *, stalls: bool = False, probe: bool = False) -> Played:
        """A co-simulation for the mode ``name``, which the path in a simulator's error tells."""
        how = replace(self.how, stalls=stalls, probe=probe)
        with cosim.work_folder() as folder:
            work = folder / name.replace(" ", "-")
            return cosim.cosimulate(case.model or self.bench.model, case.recordings, how, work=work)

    def measure(self, key: str) -> Outcome:
        """The figure of a mode that only the hardware can show, by its key."""
        return self.leave() if key == "reset" else self.play(key)

    def leave(self, ways: Sequence[str] = ("reset", "arm")) -> Outcome:
        """A recording that is broken off at random cycles and around its last two decisions, in each of
        ``ways``: by a reset, by `arm` for the next recording, or by ``neither``, which must fail. Counted are
        the following recordings whose decisions the golden model does not share."""
        model, clean = self.bench.model, self.bench.clean
        touched = np.flatnonzero(find_touches(model.config, clean).first_touch() >= 0)
        pair = clean.subset(touched[np.argsort(clean.lengths[touched])[:2]])
        rows, offsets = run_golden(model, pair).streams["decision"]
        expected = [pack_decision(model.config, row) for row in rows]
        design = Design(export(model.config, model.arrays), cosim.BUILD / "simulators")
        loaded = design, model.config, register_map(model.config), boot_writes(model.config, model.arrays)

        def play(way: str, at: int = FOREVER) -> tuple[list[int], list[int], int]:
            """Decisions of the last recording played, their cycles, and the cycles of the first recording."""
            device = Accelerator(*loaded, probes=False)
            device.command("ARM")
            begun, state = device.state.cycle, device.state
            state.stop_at = min(begun + at + 1, FOREVER)
            if way == "reset":
                device.poke(begun + at, rst=1)
            device.frames(pair.recording(0))
            if state.cycle < state.stop_at:
                device.command("FINISH")
            cycles = state.cycle - begun
            if way:
                device.cycle(max(0, state.stop_at - state.cycle))
                state.stop_at = FOREVER
                if way != "neither":
                    device.command("ARM")
                    device.forget()  # what was offered up to here belongs to the first recording
                device.frames(pair.recording(1))
                device.command("FINISH")
            values, offered = device.streams()["decision"]
            return values.view(np.uint32).tolist(), (offered - begun).tolist(), cycles

        first, offered, cycles = play("")
        if first != expected[: offsets[1]]:
            raise RuntimeError("the hardware does not decide as the golden model does")
        times = np.random.default_rng(1).integers(0, cycles, min(LEFT, self.bench.flips // 4))
        at_decisions = {max(at + shift, 0) for at in offered[-2:] for shift in AROUND}
        leavings = [(ways[number % len(ways)], int(at)) for number, at in enumerate(times)]
        leavings += [(way, at) for at in sorted(at_decisions) for way in ways]
        value = sum(play(way, at)[0] != expected[offsets[1] :] for way, at in leavings)
        words = f"{len(leavings)} times in a recording, at every cycle around a decision too"
        return Outcome(value, f"a reset or a new arm {words}")

    def play(self, key: str) -> Outcome:
        """A few recordings in co-simulation, with ``stalls`` or with a ``probe`` that writes a weight during
        a touch."""
        clean = self.bench.clean
        case = Case(clean.subset(clean.evenly(STREAMED)))
        rtl = self.play_case(case, key, stalls=key == "stalls", probe=key == "probe")
        words = f"{rtl.compared_values} values of {rtl.recordings} recordings compared"
        return Outcome(rtl.mismatches, words, rtl=_confirmed(rtl))


def _confirmed(rtl: Played) -> Confirmed:
    return Confirmed.model_validate(dict(rtl))
