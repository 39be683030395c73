"""`eskin energy` on images: activity of the netlist, counted while it names them."""

import json

import numpy as np
import pytest

from eskin.golden.core import AcceleratorConfig
from eskin.rtl.program.image_passes import plan_of
from eskin.rtl.program.schedule import decision_cycles
from eskin.training.made_up import image_recordings, random_images
from eskin.verbs.energy_job import job
from tests.support.image_scenes import random_image_model

LAYERS = ("conv 3 9", "pool", "conv 3 5", "dense 4")


@pytest.fixture(scope="module")
def case():
    model = random_image_model(
        AcceleratorConfig.of_image(6, 7, LAYERS, ("cone", "cube", "ball", "ring")), seed=3
    )
    return model, image_recordings(model.config, random_images(model.config, 6, seed=2))


def measured(case, tmp_path, *configurations):
    return job(
        *case, configurations, count=2, out=tmp_path / "out", work=tmp_path / "work", notify=lambda *_: None
    )


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_activity_of_images_is_counted_in_the_netlist(case, tmp_path):
    """The lanes multiply in nearly every cycle of an image, and not while rows come."""
    result = measured(case, tmp_path, "icebreaker:8")
    (row,) = result["configurations"]
    config = case[0].config.with_lanes(8, "dsp")
    plan, activity = plan_of(config), row["activity"]
    assert result["passed"] and row["bit_exact"] and row["lane_type"] == "dsp" and activity["recordings"] == 2
    assert activity["step_cycles"] == decision_cycles(config)
    taps = sum(slot.taps for one in plan.passes for slot in one.slots(plan.lanes))
    assert 0.5 * plan.lanes * taps < activity["step_multiplies"] < 1.05 * plan.lanes * taps
    assert row["per_touch_j"] == pytest.approx(
        activity["step_cycles"] * 52e-12
        + activity["step_toggles"] * 0.2e-12
        + activity["step_multiplies"] * 24e-12
    )
    assert json.loads((tmp_path / "out/energy.json").read_text())["what"] == "image"
    assert np.isclose(row["touch_s"], 6e-3)
