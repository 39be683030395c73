"""eskin/study/sweep.py and eskin/verbs/sweep_job.py: points, costs, the front, the choice, the memory of
finished trainings, the files."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.golden.core import PRESETS
from eskin.jobs import Jobs
from eskin.memo import Memo
from eskin.rtl.program.schedule import decision_cycles, schedule, step_cycles
from eskin.study import sweep as sweeping
from eskin.training import recipe as recipes
from eskin.verbs import sweep_job
from eskin.verbs.cost import cost_of
from tests.support.table import each_row
from tests.support.touch_scenes import SMALL, scene

GRID = [{"hidden": [4, 6], "weight_bits": [6, 8], "lanes": [1, 2]}]


class Stub:
    """Stands in for training: better with more units and bits, better with the seed; what was asked is in
    ``jobs``."""

    def __init__(self) -> None:
        self.jobs: list[dict] = []

    def __call__(self, recordings, job):
        self.jobs.append(job)
        accuracy = 0.7 + 0.02 * job["config"].network.hidden + 0.005 * job["widths"].get("weight_bits", 8)
        splits = [self.split(groups, accuracy - 0.1 * n, job) for n, groups in enumerate(job["splits"])]
        return {"splits": splits}

    @staticmethod
    def split(groups, accuracy, job):
        by_seed = [accuracy + 0.001 * (seed - np.mean(job["seeds"])) for seed in job["seeds"]]
        times = [0.01 * (k + 1) for k in range(job["config"].windows.steps)]
        shares = {"accuracy": accuracy, "float_accuracy": accuracy, "float_by_seed": by_seed}
        return {
            "groups": list(groups),
            **shares,
            **sweeping.seed_spread(by_seed, 60),
            "agreement": 0.99,
            "decision_time_s": times[-1],
            "per_step": [{"step": k, "time_s": t, "accuracy": accuracy / 2} for k, t in enumerate(times, 1)],
            "per_fold": [
                {"accuracy": accuracy, "by_seed": by_seed, "held_out": f"person {n}"} for n in range(3)
            ],
        }


def cost_by_size(config):
    cycles = {"cycles_step": step_cycles(config), "cycles_decision": decision_cycles(config)}
    return cycles | {"energy_j": 1e-6 * (100 + config.multiplies), "compute_j": 1e-9 * config.multiplies}


def do_sweep(tmp_path, stub, grids=GRID, progress=None, **options):
    options = {"splits": [["person"], []], "seeds": (0, 1, 2), "folds": 5, "version": "1", **options}
    options |= {"jobs": Jobs(workers=1, progress=progress), "keep": Memo(tmp_path / "cache")}
    points = sweeping.make_points(SMALL, grids)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sweeping, "judge", stub)
        outcomes = sweeping.judge_points(scene(20), points, **options)
    return sweeping.sweep(points, outcomes, cost_by_size, {})


# ---------------------------------------------------------------------- points
def test_a_grid_is_every_combination_once():
    points = sweeping.make_points(
        PRESETS["pvdf"], [*GRID, {"hidden": 4, "weight_bits": 8, "lanes": 1}, {"cell": "lstm", "hop": 48}]
    )
    assert len(points) == 9 and len({point.name for point in points}) == 9
    shown = [points[0].to_dict()[key] for key in ("hidden", "weight_bits", "lanes")]
    last = points[-1].config
    assert shown == [4, 6, 1] and (last.network.cell, last.formats.state_format.int_bits) == ("lstm", 4)
    assert (last.windows.hop, last.windows.window) == (48, 96)
    (odd,) = sweeping.make_points(PRESETS["thesis"], [{"hop": 200}])
    assert (odd.config.windows.hop, odd.config.windows.window) == (200, 401)
    (early,) = sweeping.make_points(
        PRESETS["pvdf"], [{"decision": "early", "early_margin": [100], "early_steps": 3}]
    )
    assert early.name == "GRU 12 early 100 x 3, 8 bit, 4 lanes"
    assert len(sweeping.make_points(SMALL, [{"cell": "lstm", "reset": ["before", "after"]}])) == 1


@each_row("cell", [{"cell": "gru", "reset": "before"}, {"cell": "gru", "reset": "after"}, {"cell": "lstm"}])
@each_row(("lanes", "lane_type"), [(1, "plain"), (3, "plain"), (1, "dsp")])
def test_costs_are_those_of_the_hardware(cell, lanes, lane_type):
    """Multiplies and weight bits against what the program itself holds; cycles are the program's."""
    grid = {**cell, "hidden": 7, "weight_bits": 6, "lanes": lanes, "lane_type": lane_type}
    (point,) = sweeping.make_points(SMALL, [grid])
    own, config = point.cost(), point.config
    plan = schedule(config)
    assert config.weight_bits == 6 and own["weight_memory_bits"] == 6 * config.sets * plan.weights
    assert own["multiplies_step"] == config.multiplies == own["multiplies_decision"] / 6
    assert (step_cycles(config), decision_cycles(config)) == (plan.step_cycles, plan.decision_cycles)


# ---------------------------------------------------------------------- the memory
def test_points_that_differ_in_lanes_share_a_training_and_a_repeat_trains_nothing(tmp_path):
    stub, moves = Stub(), []
    first = do_sweep(tmp_path, stub, progress=lambda *move: moves.append(move[1:]))
    assert len(first["points"]) == 8 and len(stub.jobs) == 4 and moves == [(k, 4) for k in range(5)]
    assert do_sweep(tmp_path, stub) == first and len(stub.jobs) == 4
    one, two = first["points"][:2]
    assert one["accuracy"] == two["accuracy"] and one["cycles_step"] > two["cycles_step"]


@each_row(
    "change",
    [
        {"version": "2"},
        {"seeds": (0, 1, 3)},
        {"splits": [["person"]]},
        {"folds": 4},
        {"grids": [{**GRID[0], "hop": 8}]},
    ],
)
def test_what_was_trained_on_other_terms_is_trained_again(tmp_path, change):
    stub = Stub()
    do_sweep(tmp_path, stub)
    do_sweep(tmp_path, stub, **change)
    assert len(stub.jobs) == 8


def test_real_training_of_a_tiny_grid(tmp_path, monkeypatch):
    quick = dataclasses.replace(recipes.RECIPES["onset"], updates=10, epochs=0)
    monkeypatch.setattr(recipes, "RECIPES", dict.fromkeys(recipes.RECIPES, quick))
    grid = [{"hidden": 4, "weight_bits": [6, 8]}]
    points = do_sweep(tmp_path, sweeping.judge, grid, splits=[["person"]], seeds=(0, 1))["points"]
    for point in points:
        (split,) = point["splits"]
        assert split["accuracy"] == pytest.approx(np.mean(split["by_seed"])) and len(split["by_seed"]) == 2
        assert split["spread"] == pytest.approx(np.std(split["by_seed"], ddof=1))
        assert (len(split["per_step"]), len(split["per_fold"])) == (SMALL.windows.steps, 5)
    assert points[0]["float_accuracy"] == points[1]["float_accuracy"]  # it does not know of its bits


# ---------------------------------------------------------------------- front and choice
def made(accuracy, latency, multiplies, bits=100, lanes=1, error=0.0):
    return dict(
        name=f"{accuracy}/{latency}/{multiplies}",
        accuracy=accuracy,
        latency_s=latency,
        multiplies_decision=multiplies,
        weight_memory_bits=bits,
        standard_error=error,
        config={"lanes": lanes},
        energy_j=1.0,
    )


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
    assert set(sweeping.pareto(records, "latency_s")) == expected


bound = st.none() | st.integers(1, 10)


@settings(deadline=None, derandomize=True)
@given(figures, st.integers(1, 10), bound)
def test_the_recommended_meets_the_bounds_and_nothing_smaller_does(records, floor, latency):
    bounds = {"accuracy floor": floor / 10} | ({"latency budget": latency} if latency else {})

    def misses(record, names):
        over = {"accuracy floor": floor / 10 - record["accuracy"]}
        over |= {"latency budget": record["latency_s"] - (latency or 99)}
        return {name: over[name] for name in names if over[name] > 0}

    choice, names = sweeping.recommend(records, bounds), bounds
    chosen = records[choice["point"]]
    meeting = [record for record in records if not misses(record, names)]
    assert choice["met"] == bool(meeting)
    if not meeting:
        assert choice["misses"] == misses(chosen, names) != {}
        return
    assert sweeping.size(chosen) == min(map(sweeping.size, meeting))


def test_energy_of_a_point_is_that_of_a_touch_and_of_waiting_for_it():
    """151 uW at rest, on the lanes that suit the board; the sums are held by tests/scripts/test_cost_model.py."""
    found, seconds = sweep_job.cost_of(suited := SMALL.with_lanes(4, "dsp")), 0.07
    touch = cost_of(suited).energy_touch_j
    assert found["energy_j"] == pytest.approx(151e-6 * seconds + touch) and found["compute_j"] < touch
