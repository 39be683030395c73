"""The stages of `eskin run`: recordings -> trained network -> integers -> Verilog -> co-simulation -> report,
in one folder.

Each stage works in a separate folder beside OUT, named by the hash of all that went into it: what was asked for
(data, configuration, options), the stages before it, its code, and the content of what it reads. A stage that was
finished before is taken over, so an interrupted run goes on where it stopped. OUT itself appears, or is replaced, in
one rename when everything is there.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from eskin.choose import choice, doubts, yardsticks
from eskin.choose.choice import configure
from eskin.choose.networks import check_units
from eskin.cli.common import remaining, spelled
from eskin.cosim import flow, latency
from eskin.cosim.results import Cycles, Played
from eskin.cosim.simulation import Simulation
from eskin.data import load_recordings
from eskin.data.fit import for_model
from eskin.golden.core import (
    AcceleratorConfig,
    InputError,
    Progress,
    Record,
    check_folder,
    content_key,
    write_json,
)
from eskin.golden.core.files import exchange
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, load_config
from eskin.memo import Memo, code_version
from eskin.pages import report
from eskin.pages.result import Check, Configuration, Data, Lengths, Run, Timing
from eskin.pages.views import compared, hertz, percent, verdict
from eskin.rtl.program.image_passes import plan_of
from eskin.rtl.program.schedule import frame_cycles
from eskin.study.leak import known_from_first_frames, known_without_touch
from eskin.study.stability.panel import panel_of
from eskin.study.touch_ends import touches_and_ends
from eskin.training import LEARNING, evaluate, integers
from eskin.training.evaluate import Evaluation, HeldBack
from eskin.training.image_models import KEPT, chosen_config
from eskin.training.record import Baseline, Doubt, Training, training_of
from eskin.training.splits import check_split
from eskin.verbs.cosim import cosimulate, one_of_each
from eskin.verbs.cost import CODE as COST
from eskin.verbs.cost import by_lanes, cost_model, power_of
from eskin.verbs.generate import generate_design
from eskin.verbs.milestones import shown
from eskin.verbs.parts import parts_of
from eskin.verbs.run import RunRequest

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
BUILT = ("golden", "rtl", "study", "training/record.py")
CODE = partial(code_version, *LEARNING, "rtl", "cosim", "verbs")
"""What a result depends on, for scripts/tables.py."""


def run(request: RunRequest, console: Console | None = None) -> Run:
    """Do the main job and put everything into ``request.out``, at the very end. ``console``: where progress is shown;
    None: standard error.

    The folder
    ----------
    run.json (also returned), evaluate.json, cosim.json, cosim_declared.json, cosim_lowest.json (unless no clock was found),
    model/, rtl/, report.html; waves_*/ after a mismatch. Of images no cosim_declared.json and
    cosim_lowest.json.

    Raises
    ------
    InputError
        Bad input, or an ``out`` that holds something else; before any long work.
    SimulationError
        The simulator fails.
    """
    out = Path(os.path.abspath(request.out))
    check_folder(out, RESULT_MARK)
    job = _Steps(request, console or Console(stderr=True))  # bad input leaves nothing behind
    with _work_folder(out) as work:
        record = job.all(work, result := work / "result")
        with job.progress("report"):
            report.write_report(result)
        exchange(result, out, work / "old")
    return record


def default_count(recordings: Recordings, config: AcceleratorConfig) -> int:
    """Recordings, or images, that are co-simulated without a wish."""
    if config.is_image:
        return IMAGES
    small = recordings.frames * frame_cycles(config, ends_window=False) <= SMALL_CYCLES
    return len(recordings) if small else min(len(recordings), PER_CLASS * len(recordings.class_names))


def check_alike(held_back: Recordings, recordings: Recordings) -> None:
    """Refuse recordings held back that are of another array or task than those to learn from.

    Raises
    ------
    InputError
        Naming what differs.
    """
    for name in ("taxels", "image_shape", "sample_rate_hz"):
        test, data = getattr(held_back, name), getattr(recordings, name)
        if test != data:
            raise InputError(
                f"--test {held_back.source}, field {name}: is {test}, and {data} in --data; give recordings of "
                "the same sensor and task"
            )


# ---------------------------------------------------------------------- the stages
class _Steps:
    """The stages in order, each a call into golden, rtl or cosim."""

    def __init__(self, request: RunRequest, console: Console) -> None:
        """Read the recordings and find a configuration; what does not work is refused here."""
        self.request, self.console, self.begin = request, console, time.perf_counter()
        self.timings: list[Timing] = []
        config = AcceleratorConfig.load(request.config) if request.config else None
        with self.progress("recordings") as notify:
            self.recordings = loaded = load_recordings(request.data, config=config, progress=notify)
            check_units(request.cell, request.hidden)
            self.prices = cost_model(request.prefer, request.fits)
            self.panel = panel_of(loaded, request.stress)
        with self.progress("configuration") as notify:
            test = load_recordings(request.test, config=config, progress=notify) if request.test else None
            if test is not None:
                check_alike(test, loaded)
                test = test.with_classes(loaded.class_names, f"--data {loaded.source}")
            if request.groups:
                check_split(loaded, request.groups, 5)
            self.plan = None
            if loaded.image_shape:
                chosen_config(loaded, config, request.cell)
            else:
                begin = time.monotonic()
                self.plan = configure(loaded, config, self.prices, groups=request.groups, progress=notify)
                if words := remaining(time.monotonic() - begin):
                    self.say(words)
            planned = self.plan.config if self.plan else config
            self.held_back = for_model(test, planned, self.say) if test is not None and planned else test
        self.user_config = config
        seeds = request.seeds or (1 if loaded.image_shape else 3)
        network = request.groups, request.cell, request.hidden, seeds, request.prefer, request.fits
        weights = self.panel and self.panel.weights
        # records hold them, the content does not
        named = loaded.source, loaded.notes, loaded.unit, loaded.channel_names
        self.key = content_key(loaded, *named, config, planned, *network, weights)

    def say(self, line: str) -> None:
        """A line of progress that stays."""
        self.console.print(line, highlight=False, markup=False, soft_wrap=True)

    @contextmanager
    def progress(self, name: str) -> Iterator[Progress]:
        """Progress of a stage, and a line when it ends."""
        begin = time.perf_counter()
        with shown(self.console, name) as notify:
            yield notify
        self.say(f"{name}: done in {time.perf_counter() - begin:.1f} s")

    def stage(self, name: str, packages: tuple[str, ...], make: Callable[..., None], *given: Any) -> Path:
        """The folder of a stage: found finished, or made now, by ``make(folder, notify, *given)``. What it reads beside
        what was asked for is ``given``: its content is part of the key, and the key of that of the next stage."""
        begin = time.perf_counter()
        self.key = content_key(self.key, name, code_version("verbs", *packages), *given)
        folder = self.work / f"{name.replace(' ', '-')}.{self.key[:20]}"
        cached = (folder / "finished").exists()
        with self.progress(name) as notify:
            Memo(self.work).folder(folder.name, lambda new: make(new, notify, *given))
        self.timings.append(Timing(stage=name, wall_s=time.perf_counter() - begin, cached=cached))
        return folder

    def all(self, work: Path, result: Path) -> Run:
        """Run every stage in the folder ``work`` and fill ``result`` with all but the page. The record, as in
        run.json."""
        self.work = work
        trained = self.stage("training", (*LEARNING, *COST), self._train)
        quantised = self.stage("quantisation", LEARNING, self._quantise, trained / "model")
        model = IntegerModel.load(quantised / "model", images=True)
        training = training_of(quantised / "model")
        config = self.config = model.config
        numbers = self.recordings.evenly(self.request.count or default_count(self.recordings, config))

        def judge(folder: Path, _: Progress, quantised: Path) -> None:
            write_json(folder / "evaluate.json", evaluate.evaluate(quantised, self.recordings))

        evaluated = self.stage("evaluation", LEARNING, judge, quantised / "model")
        baselines = [] if config.is_image else self._baselines(training)
        tested = self._test(quantised)
        generated = self.stage("Verilog", BUILT, self._generate, model)
        folders = self._cosimulations(numbers, model, generated / "rtl")

        shutil.rmtree(result, ignore_errors=True)
        result.mkdir()
        shutil.copytree(quantised / "model", result / "model")
        shutil.copytree(generated / "rtl", result / "rtl")
        shutil.copy(evaluated / "evaluate.json", result)
        outcomes = {name: _take_over(folder, result, name) for name, folder in folders.items()}
        judged = Evaluation.read(evaluated / "evaluate.json", "run it again")
        checks = _checks(judged, tested, outcomes)
        found = self._doubts(training, baselines, tested, judged, model)
        for row in found:
            row.text = spelled(row.text)
        nested = None if config.is_image else training.cross_validation[0].nested
        record = Run(
            **nested.disturbed.plain() if nested else {},
            name=self.request.name,
            code=CODE(),
            data=self._data(),
            configuration=Configuration(name=config.name, reasons=training.reasons),
            candidates=training.candidates,
            lanes=by_lanes(config),
            parts=parts_of(model),
            baselines=baselines,
            doubts=found,
            warnings=[row.text for row in found],
            test=tested,
            cosimulated=numbers.tolist(),
            checks=checks,
            passed=all(check.held for check in checks),
            timings=self.timings,
            wall_s=round(time.perf_counter() - self.begin, 3),
        )
        if config.is_image:
            cycles = {str(part.number): part.cycles(config.hardware.lanes) for part in plan_of(config).passes}
            record.images, record.layer_cycles = True, cycles
        else:
            lowest, power = outcomes["cosim_lowest"], power_of(config)
            record.front_end, record.power, record.average_w = training.front_end, power, power.average_w
            record.lowest_clock_hz = lowest.clock_hz if lowest and lowest.passed else None
        write_json(result / RESULT_MARK, record)
        return record

    def _cosimulations(
        self, numbers: np.ndarray, model: IntegerModel, design: Path
    ) -> dict[str, Path | None]:
        """The folders of the runs: at full pace, and of recordings at the configured clock and, where hardware and
        model agree so far, at the lowest that meets every budget."""

        def simulate(name: str, numbers: np.ndarray, played: Recordings, *given: Any) -> Path:
            given = (model, design, numbers, played, *given)
            return self.stage(name, (*BUILT, "cosim"), self._simulate, *given)

        full = simulate("co-simulation", numbers, self.recordings.subset(numbers), "full")
        if self.config.is_image:
            return {"cosim": full}
        few = self._few(numbers, self.config.hardware.clock_hz)
        declared, lowest = simulate("pace of the sensor", *few, "declared"), None
        at_pace = _outcome(declared)
        if at_pace and at_pace.bit_exact and (at_full := _outcome(full)) and at_full.bit_exact:
            few = self._few(numbers, latency.needed_clock(self.config, at_pace.cycles))
            lowest = simulate("lowest clock", *few, "declared", at_pace.cycles.plain())
        return {"cosim": full, "cosim_declared": declared, "cosim_lowest": lowest}

    def _baselines(self, training: Training) -> list[Baseline]:
        """The baselines of the training, and other classifiers on the same folds."""
        groups = training.cross_validation[0].groups

        def measure(folder: Path, notify: Progress, config: AcceleratorConfig, groups: Sequence[str]) -> None:
            report = lambda _, done, total: notify(
                "judged", done, total
            )  # it names the classifier that is done
            rows = yardsticks.yardsticks(self.recordings, config, groups, 5, report)
            write_json(folder / "yardsticks.json", rows)

        measured = self.stage("other classifiers", LEARNING, measure, self.config, groups)
        rows = json.loads((measured / "yardsticks.json").read_text())
        return [*training.baselines, *map(Baseline.model_validate, rows)]

    def _train(self, folder: Path, notify: Progress) -> None:
        choice.train_chosen(
            self.recordings,
            self.user_config,
            self.prices,
            replace(self.request, out=folder / "model"),
            plan=self.plan,
            stress=self.panel,
            keep=Memo(KEPT),
            progress=notify,
        )

    def _quantise(self, folder: Path, notify: Progress, trained: Path) -> None:
        shutil.copytree(trained, folder / "model")
        prototypes = load_config(folder / "model").has_prototypes  # which are made of recordings
        integers.quantise(folder / "model", self.recordings if prototypes else None)

    def _test(self, quantised: Path) -> HeldBack | None:
        """The network on the recordings held back, once."""
        if self.held_back is None:
            return None
        with self.progress("recordings held back"):
            trained_on, in_test = (
                [content_key(data.recording(n).astype(np.int64)) for n in range(len(data))]
                for data in (self.recordings, self.held_back)
            )
            repeated = int(np.isin(in_test, trained_on).sum())
            judged = evaluate.evaluate(quantised / "model", self.held_back)
        return HeldBack(**vars(judged), seen_in_training=repeated)

    def _doubts(
        self,
        training: Training,
        baselines: Sequence[Baseline],
        tested: HeldBack | None,
        evaluated: Evaluation,
        model: IntegerModel,
    ) -> list[Doubt]:
        """The doubts from the training, from the baselines, and from the recordings held back."""
        found, images = list(training.doubts), self.config.is_image
        if not images:
            first = training.cross_validation[0]
            doubted = doubts.below_baselines(first, baselines, training.candidates)
            # the best of all baselines speaks for the split, and the training knew fewer of them
            replaced = {(doubt.code, *doubt.groups) for doubt in doubted}
            found = doubted + [doubt for doubt in found if (doubt.code, *doubt.groups) not in replaced]
        if tested:
            found += doubts.seen_in_training(tested, "images" if images else "recordings")
            found += doubts.below_range(tested, training.cross_validation[0])
        if not images:
            known = known_from_first_frames if self.config.opens_at_once else known_without_touch
            leak = known(model, self.recordings)
            if leak and not (leak.frames and any(doubt.code == "level_tells" for doubt in found)):
                found += doubts.leaks(**vars(leak))
        return found + doubts.lost_in_integers(training.cross_validation, evaluated)

    def _generate(self, folder: Path, notify: Progress, model: IntegerModel) -> None:
        generate_design(model, folder / "rtl", recordings=self.recordings)

    def _few(self, numbers: np.ndarray, clock_hz: float) -> tuple[np.ndarray, Recordings]:
        """The recordings of a run at the sensor's pace, about DECLARED_CYCLES worth of ``numbers``: numbers,
        recordings.

        They end a hop after their first touch, because such a run spends its time waiting for frames. Those
        that end soonest are taken. If even the first is too long, it is cut, but not before FEWEST_WINDOWS
        windows.
        """
        config, classes = self.config, len(self.recordings.class_names)
        numbers = numbers[self.recordings.subset(numbers).evenly(PER_CLASS * classes)]
        whole = self.recordings.subset(numbers).scanned(config.sensor.scan_every)
        touches, ends = touches_and_ends(config, whole)
        few_windows = ends.copy()
        after = touches.start_frame - 1 + config.window_spans[:FEWEST_WINDOWS][-1][1] + config.windows.hop
        few_windows[touches.recording] = np.minimum(ends[touches.recording], after)
        # recordings with a touch first (without one there is no step to time), of these the shortest
        order = np.lexsort((ends, ~np.isin(np.arange(len(ends)), touches.recording)))
        affordable = int(DECLARED_CYCLES * config.sensor.scan_rate_hz / clock_hz)
        chosen = np.sort(order[: max(1, int((np.cumsum(ends[order]) <= affordable).sum()))])
        if len(chosen) == 1:
            ends = np.minimum(ends, np.maximum(affordable, few_windows))
        return numbers[chosen], whole.subset(chosen).until(ends[chosen])

    def _simulate(
        self,
        folder: Path,
        notify: Progress,
        model: IntegerModel,
        design: Path,
        numbers: np.ndarray,
        played: Recordings,
        pace: str,
        cycles: Record | None = None,
    ) -> None:
        # frames as they were recorded, whatever converter there is
        how = Simulation(pace=pace, converter="none", cocotb=one_of_each(played.labels))
        play: Any = partial(_lowest_clock, cycles=Cycles(**cycles)) if cycles else flow.cosim
        outcome = cosimulate(
            model,
            played,
            how,
            design=design,
            work=folder / "work",
            numbers=numbers.tolist(),
            play=play,
            progress=notify,
        )
        write_json(folder / "result.json", outcome)

    def _data(self) -> Data:
        recordings, lengths = self.recordings, self.recordings.lengths
        return Data(
            source=str(recordings.source),
            recordings=len(recordings),
            frames=recordings.frames,
            taxels=recordings.taxels,
            unit=recordings.unit or ("" if recordings.volt_per_code else "V"),
            sample_rate_hz=recordings.sample_rate_hz,
            sha256=recordings.content,
            classes=dict(zip(recordings.class_names, recordings.class_counts.tolist(), strict=True)),
            groups={name: len(np.unique(values)) for name, values in recordings.groups.items()},
            lengths=Lengths(min=lengths.min(), median=np.median(lengths), max=lengths.max()),
        )


def _lowest_clock(*given: Any, **where: Any) -> Played | None:
    """The result of `flow.lowest_clock`. None when there is no such clock: the check fails then, and the job
    goes on."""
    try:
        return flow.lowest_clock(*given, **where)
    except flow.NoClock:
        return None


def _outcome(folder: Path | None) -> Played | None:
    """Result that a co-simulation's stage left in its folder; None: there is none."""
    text = folder and (folder / "result.json").read_text()
    return Played.model_validate_json(text) if text and json.loads(text) else None


def _take_over(folder: Path | None, result: Path, name: str) -> Played | None:
    """Copy a co-simulation's result and waves; the result."""
    outcome = _outcome(folder)
    if outcome:
        if outcome.waves:
            waves = f"waves_{name}"
            shutil.copytree(outcome.waves, result / waves)
            outcome.waves = waves
        write_json(result / f"{name}.json", outcome)
    return outcome


def _checks(
    evaluated: Evaluation, tested: HeldBack | None, outcomes: dict[str, Played | None]
) -> list[Check]:
    """Checks behind exit status 0."""
    checks = []
    for judged, where in ((evaluated, "the training data"), (tested, "the recordings held back")):
        if judged is None:
            continue
        integer, real = percent(judged.integer_accuracy), percent(judged.float_accuracy)
        loss = f"integer {integer}, float {real} on {where}"
        agreement = f"agreement {percent(judged.agreement, 2)}, at least {percent(evaluate.MIN_AGREEMENT, 0)}"
        detail = f"{loss}; at most {100 * evaluate.MAX_LOSS:g} point less is allowed; {agreement}"
        if judged.decision_time_s is None:
            detail = f"no recording was decided on {where}, so nothing was compared"
        error = judged.logit_error
        if error.max is not None:
            figures = f"{error.mean:.3f} on average, {error.max:.2f} at most"
            detail += f"; logit error {figures}, most from {error.stage}"
        name = "integer and float network agree" + ", recordings held back" * (judged is tested)
        checks.append((name, judged.passed, detail))
    for name, title in (("cosim", "full pace"), ("cosim_declared", "the sensor's pace")):
        if name not in outcomes:
            continue
        outcome = outcomes[name]
        assert outcome is not None  # the lowest clock alone may be missing
        exact = outcome.bit_exact and outcome.decisions > 0
        sentence = f"{verdict(outcome)}: {compared(outcome)}"
        checks.append((f"hardware equals model at {title}", exact, sentence))
        rows = [row for row in outcome.budgets if not row.reference]
        missed = ", ".join(row.name for row in rows if not row.met)
        detail = f"{', '.join(row.name for row in rows) or 'no step'}; missed: {missed or 'none'}"
        name = f"latency budgets at {title}, {hertz(outcome.clock_hz)}"
        checks.append((name, bool(rows) and not missed, detail))
    if "cosim_lowest" in outcomes:
        lowest = outcomes["cosim_lowest"]
        passes = lowest is not None and lowest.passed
        detail = "none was found"
        if not all(played and played.bit_exact for played in (outcomes["cosim"], outcomes["cosim_declared"])):
            detail = "skipped, because hardware and model differ"
        elif lowest is not None:
            detail = f"{hertz(lowest.clock_hz)}, {'bit-exact' if passes else verdict(lowest)}"
        checks.append(("a lowest clock that meets every budget", passes, detail))
    return [Check(name=name, held=holds, detail=detail) for name, holds, detail in checks]


# ---------------------------------------------------------------------- folders
@contextmanager
def _work_folder(out: Path) -> Iterator[Path]:
    """The folder beside ``out`` in which stages are made, and kept until ``out`` is there; one run at a time
    may use it."""
    folder = out.with_name(f".{out.name}.work")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / "lock").open("w")
    except OSError as error:
        raise InputError(
            f"--out {out}: cannot be written ({error.strerror}); name a folder you may write to"
        ) from None
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(
                f"--out {out}: another run is writing it; wait for that one or name another folder"
            ) from None
        old = folder / "old"
        if old.exists() and not out.exists():  # stopped between the two renames of `exchange`
            os.replace(old, out)
        shutil.rmtree(old, ignore_errors=True)
        try:
            yield folder
            for mark in folder.glob("*/finished"):
                mark.unlink()  # ``out`` is there: nothing to resume
        finally:
            shutil.rmtree(folder / "result", ignore_errors=True)
            if not any(folder.glob("*/finished")):
                shutil.rmtree(folder, ignore_errors=True)
