"""The main job, `eskin run`: recordings -> trained network -> integers -> Verilog -> co-simulation -> report,
in one folder.

Each stage works in a folder of its own beside OUT. OUT itself appears, or is replaced, in one rename when everything
is there.
"""

from __future__ import annotations

import dataclasses
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from eskin.choose import choice, doubts, yardsticks
from eskin.choose.choice import Plan, configure
from eskin.choose.cost import CostModel
from eskin.choose.networks import check_units
from eskin.cosim import flow, latency
from eskin.data import load_recordings
from eskin.data.fit import for_model
from eskin.golden.core import (
    AcceleratorConfig,
    InputError,
    Progress,
    Record,
    check_folder,
    content_key,
    replacing_folder,
    write_json,
)
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, find_touches, load_config, load_training, pipeline, write_vectors
from eskin.memo import Memo
from eskin.pages import report
from eskin.pages.views import compared, hertz, percent, verdict
from eskin.requests import RunRequest
from eskin.rtl.fpga.generate import generate
from eskin.rtl.program.image_passes import plan_of
from eskin.rtl.program.schedule import frame_cycles
from eskin.study.leak import known_from_first_frames, known_without_touch
from eskin.study.stability.panel import Panel, panel_of
from eskin.training import evaluate, integers
from eskin.training.image_models import KEPT, chosen_config
from eskin.training.splits import check_split
from eskin.verbs.cosim_job import one_of_each
from eskin.verbs.cost import cost_model
from eskin.verbs.flow import expected_of
from eskin.verbs.generate_job import generate_design
from eskin.verbs.milestones import shown

BUILDS = Path("build/simulators")
SMALL_CYCLES = 60e6
"""By default all recordings are co-simulated at full pace if they take at most about this many cycles,
otherwise PER_CLASS of each class."""
PER_CLASS = 8
IMAGES = 44
"""Images that are co-simulated by default."""
DECLARED_CYCLES = 15e6
"""A run at the sensor's pace takes as many recordings as fit into about this many cycles: at least
one, at most PER_CLASS of each class."""
FEWEST_WINDOWS = 3
"""Fewest windows of such a run: steps one after the other, with hops between them."""
RESULT_MARK = "run.json"


def run(request: RunRequest, console: Console | None = None) -> Record:
    """Do the main job and put everything into ``request.out``, at the very end. ``console``: where progress is shown;
    None: standard error.

    The folder
    ----------
    run.json (also returned; ``passed``: every check held; ``warnings``: why the accuracy may not be what it
    seems), evaluate.json, cosim.json, cosim_declared.json, cosim_lowest.json (unless no clock was found),
    model/, rtl/, report.html; waves_*/ after a mismatch. Of images no cosim_declared.json and
    cosim_lowest.json; run.json has ``images`` and layer_cycles (number of a layer -> cycles,
    with those of the pool behind).

    Raises
    ------
    InputError
        Bad input, or an ``out`` that holds something else; before any long work.
    SimulationError
        The simulator fails.
    """
    out = Path(os.path.abspath(request.out))
    check_folder(out, RESULT_MARK)
    user_config = AcceleratorConfig.load(request.config) if request.config else None
    begin = time.perf_counter()
    console = console or Console(stderr=True)

    def say(line: str) -> None:
        console.print(line, highlight=False, markup=False, soft_wrap=True)

    stages = partial(_stage, console)
    with stages("recordings"):  # before the work folder is made: bad input leaves nothing behind
        loaded = load_recordings(request.data, config=user_config)
        check_units(request.cell, request.hidden)
        prices, panel = cost_model(request.prefer, request.fits), panel_of(loaded, request.stress)
    with stages("configuration") as notify:  # what does not work is refused here
        held = load_recordings(request.test, config=user_config) if request.test else None
        if held is not None:
            check_alike(held, loaded)
            held = held.with_classes(loaded.class_names, f"--data {loaded.source}")
        if request.groups:
            check_split(loaded, request.groups, 5)
        if loaded.image_shape:
            chosen_config(loaded, user_config, request.cell)
        plan = (
            None
            if loaded.image_shape
            else configure(loaded, user_config, prices, groups=request.groups, progress=notify)
        )
        network: Record = {"group": request.groups, "cell": request.cell, "hidden": request.hidden}
        network["seeds"] = request.seeds or (1 if loaded.image_shape else 3)
        planned = plan.config if plan else user_config
        if held is not None and planned is not None:
            held = for_model(held, planned, say)
    with replacing_folder(out) as folder:
        steps = _Steps(request, loaded, held, user_config, prices, plan, panel, network, folder, stages)
        record = steps.all(begin)
        with stages("report"):
            report.write_report(folder)
    return record


def _stress(training: Record) -> Record:
    """``stress``, ``stress_held`` and ``stress_modes`` of the network taken; none without a panel."""
    taken = next((row for row in training.get("candidates") or () if row["chosen"]), None)
    if not taken or not taken["stress"]:
        return {}
    held = sum(row["held"] for row in taken["stress"])
    return {"stress": taken["stress"], "stress_held": held, "stress_modes": len(taken["stress"])}


def default_count(recordings: Recordings, config: AcceleratorConfig) -> int:
    """Recordings, or images, that are co-simulated without a wish."""
    if config.is_image:
        return IMAGES
    small = recordings.frames * frame_cycles(config, ends_window=False) <= SMALL_CYCLES
    return len(recordings) if small else min(len(recordings), PER_CLASS * len(recordings.class_names))


def recording_hashes(recordings: Recordings) -> list[str]:
    """Hashes of the samples of each recording."""
    return [content_key(recordings.recording(n).astype(np.int64)) for n in range(len(recordings))]


def check_alike(held: Recordings, recordings: Recordings) -> None:
    """Refuse recordings held back that are of another array or task than those to learn from.

    Raises
    ------
    InputError
        Naming what differs.
    """
    for name in ("taxels", "image_shape", "sample_rate_hz"):
        test, data = getattr(held, name), getattr(recordings, name)
        if test != data:
            raise InputError(
                f"--test {held.source}, field {name}: is {test}, and {data} in --data; give recordings of "
                "the same sensor and task"
            )


# ---------------------------------------------------------------------- the stages
@dataclasses.dataclass
class _Steps:
    """The stages in order, each a call into golden, rtl or cosim."""

    request: RunRequest
    recordings: Recordings
    held: Recordings | None
    user_config: AcceleratorConfig | None
    prices: CostModel
    plan: Plan | None
    panel: Panel | None
    network: Record
    folder: Path
    stages: Callable[[str], Any]
    timings: list[Record] = dataclasses.field(default_factory=list)

    def stage(self, name: str, make: Callable[..., Any], *given: Any) -> Any:
        """Result of ``make(notify, *given)``; the time that it takes is kept."""
        begin = time.perf_counter()
        with self.stages(name) as notify:
            made = make(notify, *given)
        self.timings.append({"stage": name, "wall_s": time.perf_counter() - begin})
        return made

    @property
    def model_dir(self) -> Path:
        """The model's folder."""
        return self.folder / "model"

    def all(self, begin: float) -> Record:
        """Run every stage and fill the folder with all but the page. The record, as in run.json."""
        self.stage("training", self._train)
        self.stage("quantisation", self._quantise)
        model, training = IntegerModel.load(self.model_dir, images=True), load_training(self.model_dir)
        config = self.config = model.config
        numbers = self.recordings.evenly(self.request.count or default_count(self.recordings, config))
        judged = self.stage("evaluation", lambda _: evaluate.evaluate(self.model_dir, self.recordings))
        write_json(self.folder / "evaluate.json", judged)
        baselines: list[Record] = []
        if not config.is_image:
            first = training["cross_validation"][0]["groups"]
            classify = lambda notify: yardsticks.yardsticks(self.recordings, config, first, 5, notify)
            baselines = training.get("baselines", []) + self.stage("other classifiers", classify)
        tested = self._test()
        self.stage("Verilog", self._generate, model)
        full = self._simulated(
            "cosim", "co-simulation", model, numbers, self.recordings.subset(numbers), flow.cosim
        )
        outcomes = {"cosim": full}
        if not config.is_image:
            outcomes |= self._at_the_pace_of_the_sensor(model, numbers, full)
        checks = _checks(judged, outcomes)
        found = self._doubts(training, baselines, tested, judged, model)
        record = {
            "name": self.request.name,
            "data": self._data(),
            "configuration": {"name": config.name, "reasons": training.get("reasons", [])},
            "baselines": baselines,
            "doubts": found,
            "warnings": doubts.sentences(found),
            "test": tested,
            "cosimulated": [int(number) for number in numbers],
            "checks": checks,
            "passed": all(check["held"] for check in checks),
            "timings": self.timings,
            "wall_s": round(time.perf_counter() - begin, 3),
        }
        if config.is_image:
            cycles = {str(part.number): part.cycles(config.hardware.lanes) for part in plan_of(config).passes}
            record |= {"images": True, "candidates": training.get("candidates"), "layer_cycles": cycles}
        else:
            lowest = outcomes["cosim_lowest"]
            clock_hz = lowest["clock_hz"] if lowest and lowest["passed"] else None
            record |= {
                "front_end": training.get("front_end"),
                "candidates": training.get("candidates"),
                "lowest_clock_hz": clock_hz,
                **_stress(training),
            }
        write_json(self.folder / RESULT_MARK, record)
        return record

    def _at_the_pace_of_the_sensor(
        self, model: IntegerModel, numbers: np.ndarray, full: Record
    ) -> dict[str, Record | None]:
        """The runs at the configured clock and, where hardware and model agree so far, at the lowest that meets every
        budget."""
        few = self._few(numbers, self.config.hardware.clock_hz)
        job: Any = partial(flow.cosim, pace="declared")
        declared = self._simulated("cosim_declared", "pace of the sensor", model, *few, job)
        lowest = None
        if full["bit_exact"] and declared["bit_exact"]:
            cycles = declared["cycles"]
            few = self._few(numbers, latency.needed_clock(self.config, cycles))
            job = partial(_lowest_clock, cycles=cycles)
            lowest = self._simulated("cosim_lowest", "lowest clock", model, *few, job)
        return {"cosim_declared": declared, "cosim_lowest": lowest}

    def _train(self, notify: Progress) -> None:
        options = {"of_images": {"keep": Memo(KEPT)}, "plan": self.plan, "stress": self.panel, **self.network}
        choice.train_chosen(
            self.recordings, self.user_config, self.prices, out=self.model_dir, progress=notify, **options
        )

    def _quantise(self, notify: Progress) -> None:
        prototypes = load_config(self.model_dir).has_prototypes  # which are made of recordings
        integers.quantise(self.model_dir, self.recordings if prototypes else None)

    def _test(self) -> Record | None:
        """The network on the recordings held back, once."""
        if self.held is None:
            return None
        with self.stages("recordings held back"):
            trained_on = recording_hashes(self.recordings)
            repeated = sum(recording in trained_on for recording in recording_hashes(self.held))
            judged = evaluate.evaluate(self.model_dir, self.held)
            return {"source": self.held.source, "seen_in_training": repeated} | judged

    def _doubts(
        self,
        training: Record,
        baselines: list[Record],
        tested: Record | None,
        evaluated: Record,
        model: IntegerModel,
    ) -> list[Record]:
        """The doubts from the training, from the baselines, and from the recordings held back."""
        found, things = list(training.get("doubts", [])), "recordings"
        if self.config.is_image:
            things = "images"
        else:
            first = training["cross_validation"][0]
            behind = doubts.below_baselines(first, baselines, training.get("candidates"))
            # the best of all baselines speaks for the split, and the training knew fewer of them
            replaced = {(one["code"], *one["groups"]) for one in behind}
            found = behind + [one for one in found if (one["code"], *one.get("groups", [])) not in replaced]
        if tested and tested["seen_in_training"]:
            text = (
                f"{tested['seen_in_training']} of the {tested['recordings']} {things} held back are also in the "
                f"training data, so their accuracy proves little: give --test {things} that are not in --data"
            )
            found.append(doubts.doubt("seen_in_training", text))
        if not self.config.is_image:
            known = known_from_first_frames if self.config.opens_at_once else known_without_touch
            leak = known(model, self.recordings)
            if leak and not (leak.frames and any(one["code"] == "level_tells" for one in found)):
                found += doubts.leaks(**vars(leak))
        return found + doubts.lost_in_integers(training["cross_validation"], evaluated)

    def _generate(self, notify: Progress, model: IntegerModel) -> None:
        """Verilog with a bench that plays one recording with a touch, or the first image."""
        design = self.folder / "rtl"
        if model.config.is_image:
            generate_design(model, design, recordings=self.recordings)
            return
        number, recording, trace = self._played(model)
        with tempfile.TemporaryDirectory() as work:
            vectors = write_vectors(Path(work) / "vectors.npz", trace, recording, [number])
            generate(model.config, model.arrays, design, vectors=vectors)

    def _played(self, model: IntegerModel) -> tuple[int, Recordings, pipeline.Trace]:
        """The first recording, taken evenly over the classes, with a whole touch, else the first with a
        completed step."""
        ends_early = None
        for number in dict.fromkeys(
            [*self.recordings.evenly(len(self.recordings.class_names)), *range(len(self.recordings))]
        ):
            recording = self.recordings.subset([number]).scanned(self.config.sensor.scan_every)
            trace = pipeline.run(model, recording)
            touch = int(trace.first[0])
            if touch >= 0 and trace.touches.completed[touch]:
                drawn = int(number), recording, trace
                if not trace.partial[touch]:
                    return drawn
                ends_early = ends_early or drawn
        if ends_early is None:
            raise InputError(
                f"recordings '{self.recordings.source}': none has a completed step; check them with 'eskin inspect'"
            )
        return ends_early

    def _few(self, numbers: np.ndarray, clock_hz: float) -> tuple[np.ndarray, Recordings]:
        """The recordings of a run at the sensor's pace, about DECLARED_CYCLES worth of ``numbers``: numbers,
        recordings.

        They end a hop after their first touch, because such a run spends its time waiting for frames. Those
        that end soonest are taken. If even the first is too long, it is cut, but not before FEWEST_WINDOWS
        windows.
        """
        candidates = numbers[
            self.recordings.subset(numbers).evenly(PER_CLASS * len(self.recordings.class_names))
        ]
        whole = self.recordings.subset(candidates).scanned(self.config.sensor.scan_every)
        touches = find_touches(self.config, whole)
        affordable = int(DECLARED_CYCLES * self.config.sensor.scan_rate_hz / clock_hz)
        ends, few_windows = whole.lengths.copy(), whole.lengths.copy()
        first = touches.first_touch()
        for index, touch in enumerate(first):
            if touch >= 0:
                before = touches.start_frame[touch] - 1
                ends[index] = min(ends[index], before + self.config.last_frame + self.config.windows.hop)
                few_windows[index] = min(
                    ends[index],
                    before + self.config.window_spans[:FEWEST_WINDOWS][-1][1] + self.config.windows.hop,
                )
        # recordings with a touch first (without one there is no step to time), of these the shortest
        order = np.lexsort((ends, first < 0))
        chosen = np.sort(order[: max(1, int((np.cumsum(ends[order]) <= affordable).sum()))])
        if len(chosen) == 1:
            ends = np.minimum(ends, np.maximum(affordable, few_windows))
        return candidates[chosen], whole.subset(chosen).until(ends[chosen])

    def _simulated(
        self, name: str, title: str, model: IntegerModel, numbers: np.ndarray, played: Recordings, job: Any
    ) -> Any:
        """The result of a co-simulation, as written to ``name``.json; the waves of a mismatch beside it."""

        def simulate(notify: Progress, work: Path) -> Record | None:
            notify("golden model", 0, len(played))
            vectors = expected_of(model, played, work / "vectors.npz", numbers)
            notify("golden model done; compiling the simulator and playing", 0, len(played))
            options = {
                "cocotb": one_of_each(played.labels),
                "work": work / "work",
                "builds": BUILDS.resolve(),
            }
            return job(self.folder / "rtl", vectors, **options)

        with tempfile.TemporaryDirectory() as work:
            outcome = self.stage(title, simulate, Path(work))
            if outcome is not None:
                if outcome["waves"]:
                    shutil.move(outcome["waves"], self.folder / f"waves_{name}")
                    outcome["waves"] = f"waves_{name}"
                write_json(self.folder / f"{name}.json", outcome)
        return outcome

    def _data(self) -> Record:
        recordings, lengths = self.recordings, self.recordings.lengths
        return {
            "source": recordings.source,
            "recordings": len(recordings),
            "frames": recordings.frames,
            "taxels": recordings.taxels,
            "unit": recordings.unit or ("" if recordings.volt_per_code else "V"),
            "sample_rate_hz": recordings.sample_rate_hz,
            "sha256": recordings.content,
            "classes": {
                name: int(n) for name, n in zip(recordings.class_names, recordings.class_counts, strict=True)
            },
            "groups": {name: len(np.unique(values)) for name, values in recordings.groups.items()},
            "lengths": {
                "min": int(lengths.min()),
                "median": float(np.median(lengths)),
                "max": int(lengths.max()),
            },
        }


def _lowest_clock(*where: Path, **options: Any) -> Record | None:
    """The result of `flow.lowest_clock`. None when there is no such clock: the check fails then, and the job
    goes on."""
    try:
        return flow.lowest_clock(*where, **options)
    except flow.NoClock:
        return None


def _checks(evaluated: Record, outcomes: dict[str, Record | None]) -> list[Record]:
    """Checks behind exit status 0: {name, held, detail} each."""
    integer, real = (percent(evaluated[f"{kind}_accuracy"]) for kind in ("integer", "float"))
    loss = f"integer {integer}, float {real} on the training data"
    agreement = (
        f"agreement {percent(evaluated['agreement'], 2)}, at least {percent(evaluate.MIN_AGREEMENT, 0)}"
    )
    detail = f"{loss}; at most {100 * evaluate.MAX_LOSS:g} point less is allowed; {agreement}"
    error = evaluated["logit_error"]
    if error["max"] is not None:
        figures = f"{error['mean']:.3f} on average, {error['max']:.2f} at most"
        detail += f"; logit error {figures}, most from {error['stage']}"
    checks: list[Record] = []

    def check(name: str, held: bool, detail: str) -> None:
        checks.append({"name": name, "held": held, "detail": detail})

    check("integer and float network agree", evaluate.passes(evaluated), detail)
    for name, title in (("cosim", "full pace"), ("cosim_declared", "the sensor's pace")):
        if name not in outcomes:
            continue
        outcome = outcomes[name]
        assert outcome is not None  # the lowest clock alone may be missing
        exact = outcome["bit_exact"] and outcome["decisions"] > 0
        sentence = f"{verdict(outcome)}: {compared(outcome)}"
        check(f"hardware equals model at {title}", exact, sentence)
        rows = [row for row in outcome["budgets"] if not row["reference"]]
        missed = ", ".join(row["name"] for row in rows if not row["met"])
        detail = f"{', '.join(row['name'] for row in rows) or 'no step'}; missed: {missed or 'none'}"
        name = f"latency budgets at {title}, {hertz(outcome['clock_hz'])}"
        check(name, bool(rows) and not missed, detail)
    if "cosim_lowest" in outcomes:
        lowest = outcomes["cosim_lowest"]
        held = lowest is not None and lowest["passed"]
        detail = "none was found"
        if not all(outcomes[name]["bit_exact"] for name in ("cosim", "cosim_declared")):  # type: ignore[index]
            detail = "skipped, because hardware and model differ"
        elif lowest is not None:
            detail = f"{hertz(lowest['clock_hz'])}, {'bit-exact' if held else verdict(lowest)}"
        check("a lowest clock that meets every budget", held, detail)
    return checks


@contextmanager
def _stage(console: Console, name: str) -> Iterator[Progress]:
    """Progress of a stage, and a line when it ends."""
    begin = time.perf_counter()
    with shown(console, name) as notify:
        yield notify
    line = f"{name}: done in {time.perf_counter() - begin:.1f} s"
    console.print(line, highlight=False, markup=False, soft_wrap=True)
