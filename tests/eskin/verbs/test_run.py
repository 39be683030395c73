"""The main job's order, its memory and its last rename; the stages are stand-ins except in the slow run of
everything."""

import fcntl
import json
import shutil
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from eskin.choose.choice import Plan
from eskin.cosim.runner import SimulationError
from eskin.golden.model import IntegerModel, find_touches
from eskin.rtl.fpga.generate import MARK
from eskin.training.record import Doubt
from eskin.verbs import run_job
from eskin.verbs.run import RunRequest
from tests.support import result_case
from tests.support.folder import contents
from tests.support.random_models import random_integer_model
from tests.support.result_case import CONFIG, but, cosimulation, evaluation, float_model, training_record
from tests.support.table import each_row, refused
from tests.test_imports import beyond

QUIET = run_job.Console(quiet=True)


class Chain:
    """Stand-ins for the stages: what was called in which order, and what they answer."""

    def __init__(self, monkeypatch) -> None:
        self.calls: list[str] = []
        self.recordings = result_case.recordings()
        self.config = CONFIG
        self.evaluation = evaluation(len(self.recordings))
        self.full: dict = {}
        self.declared: dict = {}
        self.stop_at = ""
        self.stop: type[BaseException] = KeyboardInterrupt
        self.no_clock = False
        self.doubts: list[Doubt] = []
        self.played: dict[str, tuple[list[int], int]] = {}
        stand_ins = {
            "load_recordings": lambda data, **_: self.recordings,
            "configure": lambda loaded, asked, prices, **options: Plan(
                self.config, ["made up"], ["person"], "the archive's first group", prices
            ),
            "choice.train_chosen": self.train,
            "integers.quantise": self.quantise,
            "evaluate.evaluate": self.evaluate,
            "yardsticks.yardsticks": self.yardsticks,
            "generate_design": self.generate,
            "flow.cosim": self.cosim,
            "flow.lowest_clock": self.lowest_clock,
            "report.write_report": self.write_report,
        }
        stand_ins["code_version"] = lambda *packages: "this code"
        for name, stand_in in stand_ins.items():
            monkeypatch.setattr(f"eskin.verbs.run_job.{name}", stand_in)

    def call(self, name: str) -> None:
        self.calls.append(name)
        if name == self.stop_at:
            raise self.stop(f"stopped in {name}")

    def train(self, loaded, asked, prices, request, *, progress, **network):
        self.call("train")
        progress("training", 1, 2)
        float_model().save(request.out, but(training_record(loaded), doubts=self.doubts))

    def quantise(self, folder, recordings=None):
        self.call("quantise")
        random_integer_model(CONFIG, seed=2).save(folder)

    def evaluate(self, folder, loaded):
        self.call("evaluate")
        assert IntegerModel.load(folder).config.features.feature_shift
        return self.evaluation.model_copy(update={"source": loaded.source})

    def yardsticks(self, *_):
        self.call("yardsticks")
        return []

    def generate(self, model, out, *, recordings):
        self.call("generate")
        out.mkdir()
        (out / MARK).write_text("{}")
        return out

    def write_report(self, folder):
        self.call("report")
        assert {"run.json", "model", "rtl"} <= {path.name for path in folder.iterdir()}
        (folder / "report.html").write_text("page")

    def play(self, name, design, vectors):
        self.call(name)
        assert (design / MARK).exists()
        with np.load(vectors) as archive:
            self.played[name] = archive["numbers"].tolist(), int(archive["offsets"][-1])

    def cosim(self, design, vectors, how, *, work, progress):
        name, changes = ("cosim", self.full) if how.pace == "full" else ("declared", self.declared)
        self.play(name, design, vectors)
        outcome = cosimulation(len(self.played[name][0]), pace=how.pace, **changes)
        work.mkdir(exist_ok=True, parents=True)
        if outcome.mismatches:
            outcome.waves = str(work / "waves_recording3")
            Path(outcome.waves).mkdir()
        return outcome

    def lowest_clock(self, design, vectors, how, *, work, progress, cycles):
        self.play("lowest", design, vectors)
        assert cycles.step_max == 97
        if self.no_clock:
            raise run_job.flow.NoClock("no clock")
        return cosimulation(len(self.played["lowest"][0]), pace="declared", clock_hz=711e3)


@pytest.fixture
def chain(monkeypatch):
    return Chain(monkeypatch)


def run(out: Path, **options):
    return run_job.run(RunRequest(data="made", out=out, **options), QUIET)


ORDER = ["train", "quantise", "evaluate", "yardsticks", "generate", "cosim", "declared", "lowest", "report"]


def cut_at(chain, out: Path, stage: str, stop: type[BaseException] = KeyboardInterrupt, **options) -> Path:
    """The work folder of a run that was cut in this stage and took nothing over."""
    chain.calls.clear()
    chain.stop_at, chain.stop = stage, stop
    with pytest.raises(stop):
        run(out, **options)
    assert chain.calls == ORDER[: ORDER.index(stage) + 1]
    chain.calls.clear()
    chain.stop_at = ""
    return out.with_name(f".{out.name}.work")


def test_everything_is_there_and_nothing_else(chain, tmp_path):
    out = tmp_path / "run"
    assert not all(row.met for row in cosimulation(1).budgets), "a reference row never decides"
    record = run(out)
    assert chain.calls == ORDER
    files = "run.json evaluate.json cosim.json cosim_declared.json cosim_lowest.json model rtl report.html"
    assert {path.name for path in out.iterdir()} == {*files.split()}
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    assert record.passed and record.plain() == json.loads((out / "run.json").read_text())
    assert record.cosimulated == list(range(12)) and record.lowest_clock_hz == 711e3
    assert record.average_w == record.power.average_w > record.power.waiting_w > 0
    stages = [timing.stage for timing in record.timings]
    assert stages[:4] == ["training", "quantisation", "evaluation", "other classifiers"]
    assert stages[4:] == ["Verilog", "co-simulation", "pace of the sensor", "lowest clock"]
    assert not any(timing.cached for timing in record.timings)


@pytest.mark.parametrize(
    "stage, stop",
    [(stage, (KeyboardInterrupt, SimulationError)[number % 2]) for number, stage in enumerate(ORDER[::2])],
)
def test_an_interrupted_run_leaves_the_old_result_and_goes_on_where_it_stopped(chain, tmp_path, stage, stop):
    out = tmp_path / "run"
    run(out)
    before = contents(out)
    chain.recordings = result_case.recordings(10)  # other data: nothing of the old run can be used
    cut_at(chain, out, stage, stop)
    assert contents(out) == before
    record = run(out)
    assert chain.calls == ORDER[ORDER.index(stage) :]
    assert [timing.cached for timing in record.timings] == [name not in chain.calls for name in ORDER[:-1]]
    assert record.data.recordings == 10
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def change(chain, name: str) -> None:
    arrays = chain.recordings
    match name:
        case "samples":
            arrays.samples[5, 1] += 1
        case "labels":
            arrays.labels[0] += 1
        case "groups":
            arrays.groups["person"][0] += 1
        case "source" | "unit" | "channel_names":
            chain.recordings = replace(arrays, **{name: "another"})
        case "configuration":
            chain.config = CONFIG.replace(rearm_frames=17)


OPTIONS = {"hidden": 3, "cell": "gru", "seeds": 2, "group": "person", "prefer": "cells", "fits": "ulx3s"}
OPTIONS |= {"stress": "off", "config": "pvdf"}


@each_row(
    "name", ["samples", "labels", "groups", "source", "unit", "channel_names", "configuration", *OPTIONS]
)
def test_a_run_that_is_asked_for_anything_else_takes_nothing_over(monkeypatch, tmp_path, name):
    chain = Chain(monkeypatch)
    cut_at(chain, tmp_path / "run", "cosim")
    change(chain, name)
    cut_at(chain, tmp_path / "run", "cosim", **{name: OPTIONS[name]} if name in OPTIONS else {})


READ = {"training.*/model/training.json": "quantise", "quantisation.*/model/config.json": "evaluate"}
READ |= {f"Verilog.*/rtl/{MARK}": "cosim"}
WORKERS = "choose.choice training.integers training.evaluate choose.yardsticks verbs.generate".split()
WORKERS += ["verbs.cosim"] * 3
UNUSED = "eskin.training.made_up"  # by this job, of what `generate` imports


def test_a_stage_of_other_code_or_content_is_made_anew_and_all_behind_it(chain, monkeypatch, tmp_path):
    code = Mock(return_value="this code")
    monkeypatch.setattr(run_job, "code_version", code)
    work = cut_at(chain, tmp_path / "run", "report")
    calls = code.call_args_list[: len(WORKERS)]

    def again(name: str, pattern: str = "") -> list[str]:
        out = tmp_path / name
        copy = shutil.copytree(work, out.with_name(f".{name}.work"))
        for path in copy.glob(pattern) if pattern else ():
            path.write_text(path.read_text() + " ")
        chain.calls.clear()
        run(out)
        return chain.calls

    for pattern, stage in READ.items():
        assert again(stage, pattern) == ORDER[ORDER.index(stage) :]
    for number, (worker, call) in enumerate(zip(WORKERS, calls, strict=True)):
        outside = beyond(f"eskin.{worker}", call.args)
        assert not {name for name in outside if not name.startswith(UNUSED)}
        code.side_effect = [*["this code"] * number, "other code", *["this code"] * 9]
        assert again(f"run{number}") == ORDER[number:]


def test_another_number_of_recordings_trains_no_second_time(chain, tmp_path):
    cut_at(chain, tmp_path / "run", "lowest")
    record = run(tmp_path / "run", recordings="4")
    assert "train" not in chain.calls and "cosim" in chain.calls
    assert record.cosimulated == chain.recordings.evenly(4).tolist()
    assert chain.played["cosim"][0] == record.cosimulated


def test_a_failed_check_is_a_result_that_did_not_pass(chain, tmp_path):
    cases = {
        "float network agree": {"evaluation": evaluation(12, agreement=0.979)},
        "float": {"evaluation": evaluation(12, integer=0.9)},
        "hardware equals model at full pace": {"full": {"mismatches": 3}},
        "hardware equals model at the sensor's pace": {"declared": {"mismatches": 1}},
        "latency budgets at full pace": {"full": {"missed": "step"}},
        "latency budgets at the sensor's pace": {"declared": {"missed": "frame"}},
        "lowest clock": {"no_clock": True},
    }
    usual = dict(vars(chain))
    for name, changes in cases.items():
        vars(chain).update(usual | changes)
        record = run(tmp_path / "run")
        failed = [check.name for check in record.checks if not check.held]
        differs = "equals" in name
        assert not record.passed and name in failed[0], (name, failed)
        assert len(failed) == 1 + differs, (name, failed)
        assert ("lowest" in chain.played) != differs, "no clock mends what differs"
        chain.played.clear()
    assert record.lowest_clock_hz is None and not (tmp_path / "run/cosim_lowest.json").exists()


def test_runs_at_the_pace_of_the_sensor_are_short(chain, monkeypatch, tmp_path):
    frames, loaded = CONFIG.last_frame + CONFIG.windows.hop, result_case.recordings()
    touches = find_touches(CONFIG, loaded)
    # within the touch of recording 0
    ends = int(touches.onset_frame[touches.first_touch()[0]]) + CONFIG.windows.hop
    chain.recordings = replace(
        loaded,
        samples=np.concatenate([loaded.recording(0)[:ends], loaded.samples[300:]]),
        offsets=np.concatenate([[0], ends + 300 * np.arange(12)]),
    )

    def played(cycles: float) -> tuple[list[int], int]:
        monkeypatch.setattr(run_job, "DECLARED_CYCLES", cycles)
        run(tmp_path / "run")
        return chain.played["declared"]

    numbers, length = played(1e12)
    starts = touches.start_frame[touches.first_touch()].tolist()
    whole = [min(300 if number else ends, start - 1 + frames) for number, start in enumerate(starts)]
    assert numbers == list(range(12)) and length == sum(whole)
    numbers, length = played(3.2 * 80 * CONFIG.hardware.clock_hz / CONFIG.sensor.sample_rate_hz)
    assert 0 in numbers and len(numbers) < 12 and length < 300 * len(numbers)  # 0 is the shortest
    (number,), length = played(1.0)
    third = starts[number] - 1 + CONFIG.window_spans[2][1] + CONFIG.windows.hop
    assert length == min(third, 300 if number else ends)


def test_recordings_held_back_are_judged_once_and_shown_apart(chain, monkeypatch, tmp_path):
    loaded = chain.recordings
    held = replace(loaded, samples=loaded.samples ^ 1, source="held")
    monkeypatch.setattr(run_job, "load_recordings", lambda data, **_: held if data == "held" else loaded)
    judge = Mock(wraps=chain.evaluate)
    monkeypatch.setattr(run_job.evaluate, "evaluate", judge)
    for seen in (0, 12):
        if seen:
            held = replace(loaded, source="held")
        record = run(tmp_path / f"run{seen}", test="held")
        assert record.test.source == "held" and record.test.seen_in_training == seen
        assert any("held back" in sentence for sentence in record.warnings) == bool(seen)
        assert record.passed
    # one rule as `evaluate` has it, and a figure below what was quoted
    worse = evaluation(12, agreement=0.979, integer=0.3)
    judge.side_effect = lambda folder, loaded: worse if loaded.source == "held" else chain.evaluation
    record = run(tmp_path / "worse", test="held")
    assert [check.name for check in record.checks if not check.held] == [
        "integer and float network agree, recordings held back"
    ]
    assert not record.passed and "below_range" in {one.code for one in record.doubts}
    judge.side_effect = None
    assert [call.args[1].source for call in judge.call_args_list].count("held") == 3
    held = replace(loaded, class_names=("a", "b"))
    with refused("array class_names: has recordings of .*, and --data .* knows"):
        run(tmp_path / "third", test="held")
    assert not (tmp_path / "third").exists()


def test_two_runs_at_once_are_refused(chain, tmp_path):
    work = tmp_path / ".run.work"
    work.mkdir()
    with (work / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with refused("another run"):
            run(tmp_path / "run")
    assert not chain.calls
    assert run(tmp_path / "run").passed


def test_a_run_stopped_between_the_two_renames_is_put_right(chain, tmp_path):
    out = tmp_path / "run"
    run(out)
    before = contents(out)
    (tmp_path / ".run.work").mkdir()
    shutil.move(out, tmp_path / ".run.work/old")
    cut_at(chain, out, "train", hidden=3)
    assert contents(out) == before and [path.name for path in tmp_path.iterdir()] == ["run"]
