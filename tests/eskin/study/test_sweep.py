"""eskin/verbs/sweep_job.py: points, costs, the front, the choice, the memory of
finished trainings."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.golden.core import PRESETS
from eskin.jobs import Jobs
from eskin.memo import Memo
from eskin.pages.charts import accuracy_chart
from eskin.rtl.program.schedule import schedule
from eskin.training import image_models
from eskin.verbs import sweep_job
from eskin.verbs.cost import cost_of
from tests.support.image_scenes import shapes
from tests.support.table import refused
from tests.support.touch_scenes import SMALL, scene

CELLS = [("gru", "before", 4), ("gru", "after", 6)]
WIDTHS = ({"weight_bits": 6}, {"weight_bits": 8})


class Stub:
    """Stands in for training: better with more units and bits; what was asked is in ``jobs``."""

    def __init__(self) -> None:
        self.jobs: list[dict] = []

    def __call__(self, recordings, job):
        self.jobs.append(job)
        accuracy = 0.7 + 0.02 * job["config"].network.hidden + 0.005 * job["widths"]["weight_bits"]
        return {"splits": [self.split(groups, accuracy - 0.1 * n) for n, groups in enumerate(job["splits"])]}

    @staticmethod
    def split(groups, accuracy):
        shares = {"integer_accuracy": accuracy, "float_accuracy": accuracy, "agreement": 0.99}
        return {"groups": groups, **shares, "integer_by_seed": [accuracy - 0.01, accuracy + 0.01]}


def do_sweep(tmp_path, stub, base=SMALL, splits=(["person"], []), version="1", progress=None, **bounds):
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {
            "CELLS": CELLS,
            "WIDTHS": WIDTHS,
            "LANES": (1, 2),
            "judge_recordings": stub,
        }.items():
            patch.setattr(sweep_job, name, value)
        points = sweep_job.recording_points(base)
        jobs, keep = Jobs(workers=1, progress=progress), Memo(tmp_path / "cache")
        outcomes = sweep_job.judge_points(scene(20), points, splits, jobs, keep, version)
    return sweep_job.sweep(points, outcomes, 20, **bounds)


# ---------------------------------------------------------------------- points
def test_every_point_once_with_its_widths_and_the_costs_of_the_hardware(monkeypatch):
    points = sweep_job.recording_points(PRESETS["pvdf"])
    assert len(points) == len({point.name for point in points}) == 90
    for point in points[::7]:
        config, bits = point.config, point.widths["weight_bits"]
        plan, cost = schedule(config), sweep_job.cost_of(config)
        assert config.weight_bits == bits and (bits > 4 or config.formats.state_format.width == 12)
        assert cost["cycles_step"] == plan.step_cycles
        assert cost["latency_s"] == plan.decision_cycles / config.hardware.clock_hz
    monkeypatch.setattr(sweep_job, "CELLS", [("gru", "before", 100_000)])
    with refused("no network suits"):
        sweep_job.recording_points(SMALL)


def test_energy_of_a_point_is_that_by_which_networks_are_chosen():
    suited = SMALL.with_lanes(4, "dsp")
    assert sweep_job.cost_of(suited)["energy_j"] == pytest.approx(cost_of(suited).energy_touch_j)


# ---------------------------------------------------------------------- the memory
def test_points_that_differ_in_lanes_share_a_training_and_a_repeat_trains_nothing(tmp_path):
    stub, moves = Stub(), []
    first = do_sweep(tmp_path, stub, progress=lambda *move: moves.append(move[1:]))
    assert len(first["points"]) == 8 and len(stub.jobs) == 4 and moves == [(k, 4) for k in range(5)]
    assert do_sweep(tmp_path, stub) == first and len(stub.jobs) == 4
    one, two = first["points"][:2]
    assert one["accuracy"] == two["accuracy"] and one["cycles_step"] > two["cycles_step"]
    figure = accuracy_chart(first | {"data": "touches"})
    assert len(figure.axes) == 4 and all(axes.get_xlabel() and axes.get_ylabel() for axes in figure.axes)
    for change in ({"version": "2"}, {"splits": [["person"]]}, {"base": SMALL.replace(hop=8, window=16)}):
        before = len(stub.jobs)
        do_sweep(tmp_path, stub, **change)
        assert len(stub.jobs) == before + 4


def test_images_share_one_training_and_each_is_judged_by_its_bits(tmp_path, monkeypatch):
    scene, asked = shapes(6, 0, (8, 10)), []

    def judged(shared, piece):
        """Float knows all; 8 bits know the first two classes; 4 bits the first one."""
        asked.append((piece.config.name, piece.left_out))
        truth = shared[1][np.array(piece.left_out)]
        found = {"float": truth, "w8": np.minimum(truth, 1), "w4": 0 * truth}
        return {name: values.tolist() for name, values in found.items()}

    monkeypatch.setattr(image_models, "judge", judged)
    points = sweep_job.image_points(scene)
    jobs, keep = Jobs(workers=1), Memo(tmp_path / "kept")
    outcomes = sweep_job.judge_points(scene, points, [[]], jobs, keep, "")
    assert len(asked) == len(set(asked)) == 4 * sweep_job.FOLDS
    assert len({name for name, _ in asked[:4]}) == 4  # a fold of every network before the next fold
    result = sweep_job.sweep(points, outcomes, len(scene))
    eight, four = result["points"][:2]
    assert [eight["accuracy"], four["accuracy"]] == pytest.approx([2 / 3, 1 / 3]) and eight[
        "float_accuracy"
    ] == 1
    assert result["points"][result["recommended"]]["config"]["weight_bits"] == 8
    figure = accuracy_chart(result | {"data": "shapes"})
    assert len(figure.axes) == 2


# ---------------------------------------------------------------------- front and choice
def made(accuracy, latency, multiplies, bits=8):
    config = {"lanes": 1, "weight_bits": bits}
    figures = dict(accuracy=accuracy, latency_s=latency, multiplies_decision=multiplies, standard_error=0.1)
    return dict(name="a", config=config, energy_j=1.0, **figures)


figure = st.tuples(st.integers(0, 10), st.integers(1, 10), st.integers(1, 10)).map(
    lambda t: made(t[0] / 10, t[1], t[2])
)
figures = st.lists(figure, min_size=1, max_size=12)


@settings(deadline=None, derandomize=True)
@given(figures)
def test_the_front_is_what_nothing_beats(records):
    def beats(a, b):
        as_good = a["accuracy"] >= b["accuracy"] and a["latency_s"] <= b["latency_s"]
        return as_good and (a["accuracy"], a["latency_s"]) != (b["accuracy"], b["latency_s"])

    expected = {i for i, record in enumerate(records) if not any(beats(other, record) for other in records)}
    assert set(sweep_job.pareto(records, "latency_s")) == expected


@settings(deadline=None, derandomize=True)
@given(figures, st.none() | st.integers(1, 10), st.none() | st.integers(1, 10))
def test_the_recommended_meets_the_bounds_and_nothing_smaller_does(records, tenths, budget):
    floor = tenths and tenths / 10
    number, sentence = sweep_job.recommend(records, floor, budget)
    chosen, fast = records[number], [r for r in records if r["latency_s"] <= (budget or 99)]
    most = max(r["accuracy"] for r in fast or records)
    if not fast:
        assert chosen["latency_s"] == min(r["latency_s"] for r in records) and "latency budget" in sentence
    elif floor and floor > most:
        assert chosen in fast and chosen["accuracy"] == most and "none has the accuracy" in sentence
    else:
        meeting = [r for r in fast if r["accuracy"] >= (floor or most - 0.1)]
        assert chosen in meeting and sweep_job.size(chosen) == min(map(sweep_job.size, meeting))
