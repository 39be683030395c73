"""eskin/verbs/cosim.py: parts of the recordings give what one run gives, wherever they are played."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from eskin.cosim.results import Cycles, GaveUp, Placed, Stage, joined
from eskin.data.archive import save_archive
from eskin.golden.core import content_key
from eskin.golden.model import IntegerModel
from eskin.jobs import Jobs
from eskin.verbs import cosim
from scripts import ROOT
from tests.support.random_models import random_integer_model
from tests.support.result_case import cosimulation
from tests.support.touch_scenes import SMALL, scene

TIMES = ("wall_s", "cycles_per_s")
LOADING = ("simulated_cycles", "input_stalls")
"""What a run counts for the loading of a design too, so that parts have more of it than a whole."""


def without(result, *names):
    return result.model_dump(exclude={*names})


@pytest.fixture(scope="module")
def model() -> IntegerModel:
    return random_integer_model(SMALL, 5)


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """A working folder that shares the checkout's simulators."""
    (tmp_path / "build").mkdir()
    (ROOT / "build" / "simulators").mkdir(parents=True, exist_ok=True)
    (tmp_path / "build" / "simulators").symlink_to(ROOT / "build" / "simulators")
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_parts_give_what_a_whole_gives(model, here, monkeypatch):
    monkeypatch.setitem(cosim.PART, "verilator", 4)
    recordings, numbers = scene(10), list(range(30, 40))
    how = cosim.Simulation(pace="declared", clock_hz=1e5, stalls=True)
    whole = cosim.cosimulate(model, recordings, how, numbers=numbers, work=here / "whole")
    moves = []
    jobs = Jobs(workers=1, progress=lambda *move: moves.append(move))
    parts = cosim.cosimulate_parts(model, recordings, numbers, how, jobs=jobs, work=here / "work")
    assert moves[-1] == ("parts of up to 4 compiled and played", 3, 3)
    gaps = ("cycles", "budgets", "overruns")  # random stalls begin anew in each part
    assert without(parts, *TIMES, *LOADING, *gaps) == without(whole, *TIMES, *LOADING, *gaps)
    how, jobs = cosim.Simulation(), Jobs(workers=2)
    plain = cosim.cosimulate_parts(model, recordings, numbers, how, jobs=jobs, work=here / "work")
    again = cosim.cosimulate(model, recordings, how, numbers=numbers, work=here / "whole")
    ways = ("cocotb_recordings", "bulk_recordings")  # one of each class under cocotb, and all
    assert without(plain, *TIMES, *LOADING, *ways) == without(again, *TIMES, *LOADING, *ways)
    assert [getattr(plain, way) for way in ways] == [3, 7] and [getattr(again, way) for way in ways] == [
        10,
        0,
    ]
    assert plain.bit_exact and plain.recordings == 10 and plain.compared_values > 1000
    assert not list((here / cosim.CACHE).glob("*.json")), "kept only until all are done"


def test_another_liberty_file_makes_other_parts(tmp_path):
    path, keys = tmp_path / "cells.lib", []
    for text in "aab":
        path.write_text(text)
        keys.append(content_key(cosim.contents(cosim.Simulation(pdk="sky130hd", liberty=[path]))))
    assert keys[0] == keys[1] != keys[2] != content_key(cosim.contents(cosim.Simulation()))


@pytest.mark.slow
def test_a_mismatch_in_a_part_is_told_by_its_number_and_has_waves(model, here, monkeypatch):
    monkeypatch.setitem(cosim.PART, "icarus", 2)
    real = cosim.run

    def other(model, recordings):
        trace = real(model, recordings)
        trace.streams["logit"] = (trace.streams["logit"][0] + 1, trace.streams["logit"][1])
        return trace

    monkeypatch.setattr(cosim, "run", other)
    where = {"jobs": Jobs(workers=1), "work": here / "work"}
    how = cosim.Simulation(simulator="icarus")
    result = cosim.cosimulate_parts(model, scene(6), [20, 21, 22, 23, 24, 25], how, **where)
    assert not result.bit_exact and not result.passed
    assert result.mismatches == result.stages.logit.mismatches == len(result.mismatch_list) > 0
    assert result.mismatch_list[0].startswith("recording 21,") and Path(result.waves).is_dir()


@pytest.mark.slow
def test_a_fault_of_the_torch_model_alone_ends_the_verb_with_1(model, here, monkeypatch):
    from eskin.cli.main import app
    from eskin.golden.model.torch_model import Int64

    model.save(here / "model")
    save_archive(scene(2), here / "scene.npz")
    words = "cosim model --data scene.npz --simulator icarus --json cosim.json".split()
    logit = Int64.logit
    for error in (0, 1):
        monkeypatch.setattr(Int64, "logit", lambda self, acc, error=error: logit(self, acc) + error)
        assert CliRunner().invoke(app, words).exit_code == error
        said = json.loads((here / "cosim.json").read_text())
        assert (
            said["golden"].startswith("torch: states, maps, logits; numpy:") and said["mismatches"] == error
        )
    assert "stage logit, index 0" in said["mismatch_list"][0]


def test_joined_counts_and_extremes():
    cycles = Cycles(frame_max=9, step_min=30, step_max=40, step_ideal=20, decision_latency_max=50)
    registers, stages = (
        dict(STATUS=1, FAULTS=8, TOUCHES=2, LONGEST=40),
        {"sum": Stage(compared_values=5, mismatches=0)},
    )
    own = {"cycles": cycles, "registers": registers, "stages": stages, "wall_s": 2.0}
    first = cosimulation(6, pace="declared", clock_hz=1e6).model_copy(update=own)
    counts = dict(frame_max=12, step_min=28, step_max=None, decision_latency_max=None)
    second = first.model_copy(
        update={
            "overruns": 1,
            "registers": dict(STATUS=3, FAULTS=16, TOUCHES=0, LONGEST=7),
            "cycles": cycles.model_copy(update=counts),
        }
    )
    both = joined(SMALL, [first, second])
    assert both.cycles == cycles.model_copy(update={"frame_max": 12, "step_min": 28})
    assert both.registers == dict(STATUS=3, FAULTS=24, TOUCHES=0, LONGEST=40)
    assert (both.recordings, both.wall_s, both.compared_values) == (12, 4.0, 10)
    assert both.bit_exact and not both.passed, "an overrun misses the frame's budget"
    assert joined(SMALL, [first, first]).passed
    placed = dict(compared_values=1, mismatches=0, mismatch_list=[], cells={})
    placed = [
        first.model_copy(update={"without_probes": Placed(**placed, bit_exact=exact)})
        for exact in (True, False)
    ]
    assert not joined(SMALL, placed).passed, "the placed netlist of a later part differs"
    stages = {"sum": Stage(compared_values=5, mismatches=1)}
    wrong = first.model_copy(update={"stages": stages, "mismatch_list": ["x"]})
    differs = joined(SMALL, [first, wrong])
    assert (differs.mismatch_list, differs.bit_exact, differs.verdict) == (["x"], False, "differs")
    stuck = wrong.model_copy(update={"gave_up": GaveUp(recording=4, frame=2)})
    assert joined(SMALL, [first, wrong, stuck]).verdict == "gave up"
