"""The sweep over networks for images: its points, its folds, what it names, what it refuses. No network is
trained but in one test."""

import numpy as np
import pytest

from eskin.jobs import Jobs
from eskin.memo import Memo
from eskin.pages.sweep_charts import accuracy_chart
from eskin.rtl.program.image_passes import plan_of
from eskin.study import image_sweep
from eskin.study.image_sweep import DEFAULT_GRID, make_image_points, map_values
from eskin.study.sweep import flat_rows, sweep
from tests.support.image_scenes import shapes

SMALL = [
    {"layers": ["conv 3 4", "pool"], "weight_bits": [8, 4]},
    {"layers": [["conv 3 2", "pool"], ["conv 1 2"]]},
]
COST = {"cycles_step": 100, "cycles_decision": 102, "energy_j": 1e-6, "compute_j": 1e-6}


def judged(shared, piece):
    """Float knows all; 8 bits know the first two classes; 4 bits the first one."""
    _, labels = shared
    truth = labels[np.array(piece.left_out)]
    found = {"float": truth, "w8": np.minimum(truth, 1)}
    found |= {"tuned": 0 * truth} if piece.tuned_bits else {}
    return {name: values.tolist() for name, values in found.items()} | {"wall_s": 0.0}


def swept(scene, tmp_path, monkeypatch, judging=judged, seeds=(0,)):
    monkeypatch.setattr(image_sweep, "judge", judging)
    points, jobs, keep = make_image_points(scene, SMALL), Jobs(workers=1), Memo(tmp_path / "kept")
    options = {"seeds": list(seeds), "folds": 3, "jobs": jobs, "keep": keep}
    outcomes, own = image_sweep.judge_image_points(scene, points, [], **options)
    return sweep(points, outcomes, lambda _: COST, {}, image_sweep.COSTS) | own


def test_memories_of_maps_are_those_of_the_hardware():
    scene = shapes(3, 0, (28, 50))
    for point in make_image_points(scene, DEFAULT_GRID):
        ours, plan = map_values(point.config), plan_of(point.config)
        assert ours == plan.map_values
        weights = plan.conv_words * plan.lanes + plan.dense_words * 32 // plan.weight_bits
        # the hardware fills up groups of lanes
        assert point.cost()["weight_memory_bits"] <= weights * plan.weight_bits


def test_points_share_one_training_and_each_is_judged_by_its_bits(tmp_path, monkeypatch):
    scene, asked = shapes(6, 0, (8, 10)), []

    def counted(shared, piece):
        image = piece.config.image
        asked.append((image.layers, image.width, piece.tuned_bits, piece.seed, piece.left_out))
        return judged(shared, piece)

    result = swept(scene, tmp_path, monkeypatch, counted, seeds=(0, 1))
    # three networks, three folds, two seeds; not four points
    assert len(asked) == len(set(asked)) == 3 * 3 * 2
    # a fold of every network before the next fold
    assert len({entry[:2] for entry in asked[:3]}) > 1
    eight, four, *others = result["points"]
    accuracies = [point["accuracy"] for point in (eight, four)]
    assert accuracies == pytest.approx([2 / 3, 1 / 3]) and eight["float_accuracy"] == 1
    assert len(others) == 2 and result["judged_images"] == 18
    assert result["recommended"] == 3 and result["recommendation"]["met"]
    again = swept(scene, tmp_path, monkeypatch, None, seeds=(0, 1))  # all is kept: nothing is judged again
    assert again == result
    assert [row["recommended"] for row in flat_rows(result)] == [False, False, False, True]
    figure = accuracy_chart(result | {"data": "shapes"})
    assert len(figure.axes) == 3 and all(axes.get_xlabel() and axes.get_ylabel() for axes in figure.axes)
