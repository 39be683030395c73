"""The linear cell: golden against a direct formula, hardware on every lane type, cycles, checksum, fit,
import, what fits a part."""

import numpy as np
import pytest

from eskin.golden.core import AcceleratorConfig
from eskin.golden.model import FloatModel
from eskin.rtl.program.memory_map import Memory, memory_images
from eskin.rtl.program.microcode import Microcode
from eskin.rtl.program.schedule import schedule
from eskin.rtl.program.signature import residue
from eskin.training.linear_fit import fit_linear
from tests.rtl.engine.test_engine import check_exact_and_cycles, small
from tests.support.random_models import random_integer_model
from tests.support.table import each_row
from tests.support.unseen import unseen


def linear(lanes: int = 1, *, classes: int = 3, **changes) -> AcceleratorConfig:
    """`small` as a linear cell."""
    names = tuple(f"class{k}" for k in range(classes))
    return small("linear", "before", lanes, **{"class_names": names, "decision": "last", **changes})


# ---------------------------------------------------------------------- hardware
def bound(config: AcceleratorConfig) -> int:
    """Cycles a step may take. On DSP lanes every dot product loads its block's accumulator in a separate
    slot: one a row, and on a lane that also normalises one a feature."""
    classes, inputs, lanes = config.classes, config.inputs, config.hardware.lanes
    lost = config.hardware.lane_type == "dsp"
    return -(-classes // lanes) * (inputs + lost) + -(-inputs // lanes) * (1 + lost * (lanes == 1)) + 16


@pytest.mark.parametrize(
    "inputs, classes, lanes, lane_type",
    [(8, 5, 1, "plain"), (8, 5, 4, "dsp"), (11, 5, 6, "plain"), (5, 3, 1, "dsp"), (9, 11, 4, "plain")],
)
def test_bit_exact_in_cycles(inputs, classes, lanes, lane_type):
    """Groups of rows that fill 4 and 6 lanes and do not, and one group alone; 33 words of weights."""
    config = linear(
        lanes,
        classes=classes,
        taxels=inputs,
        lane_type=lane_type,
        decision="vote" if lanes == 6 else "last",
        weight_sets="one" if (inputs, lanes) == (9, 4) else "window",
    )
    assert schedule(config).step_cycles <= bound(config)
    check_exact_and_cycles(config, touches=2)


@each_row("lanes, lane_type", [(4, "plain"), (1, "dsp")])
def test_more_kinds_of_feature_are_more_inputs(lanes, lane_type):
    """Two kinds, a scale for each input, and a checksum whose check words, one a window, stand behind all
    those scales."""
    kinds = {
        "feature_kinds": ("mean", "activity"),
        "feature_scale": "taxel",
        "checksum": lane_type == "plain",
    }
    config = linear(lanes, classes=5, lane_type=lane_type, **kinds)
    assert config.inputs == 10 and schedule(config).program.state_regions == ("x",)
    assert schedule(config).step_cycles <= bound(config)
    check_exact_and_cycles(config, touches=2)


# ---------------------------------------------------------------------- checksum and images
@each_row("lanes, sets", [(1, "window"), (4, "window"), (4, "one"), (6, "window")])
def test_every_constant_is_under_the_checksum(lanes, sets):
    config = linear(
        lanes,
        classes=5,
        taxels=8,
        checksum=True,
        weight_sets=sets,
        lane_type="dsp" if lanes == 6 else "plain",
    )
    model = random_integer_model(config, seed=2)
    code, images = Microcode(schedule(model.config)), memory_images(model.config, model.arrays)
    counts = {lane: code.plan.weight_depth for lane in range(lanes)} | {
        "addend": len(code.plan.bias_rows),
        "gate": len(images[65]),
    }
    assert unseen(code, counts) == []
    images |= {"addend": images[Memory.ADDENDS], "gate": images[Memory.CONSTANTS]}
    for check in range(len(code.layout.checks)):
        assert residue(code, images, check) == 0
    assert len(code.layout.checks) == (config.windows.steps if sets == "window" else 1)
    images[0][-1] ^= 1
    assert residue(code, images, len(code.layout.checks) - 1) != 0


# ---------------------------------------------------------------------- fit, quantise, train
def test_the_fit_is_logistic_regression():
    """Probabilities of scikit-learn's own pipeline, standardised inputs and all; one set: on the sum over the
    windows."""
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    rng = np.random.default_rng(4)
    config = linear(classes=4, taxels=5)
    labels = rng.integers(0, 4, 90)
    features = (
        rng.normal(0, 1, (90, config.windows.steps, 5)) * rng.uniform(0.1, 9, 5) + 0.4 * labels[:, None, None]
    )
    for sets in ("window", "one"):
        chosen = config.replace(weight_sets=sets)
        inputs = features.reshape(90, -1) if sets == "window" else features.sum(axis=1)
        reference = make_pipeline(StandardScaler(), LogisticRegression(C=0.7, max_iter=300)).fit(
            inputs, labels
        )
        model = FloatModel(
            chosen, fit_linear(chosen, features, labels, 0.7) | {"mu": np.array(0.0), "sigma": np.array(1.0)}
        )
        logits = model.forward(features)[1][:, -1]
        assert np.allclose(logits, reference.decision_function(inputs), atol=1e-3)


def test_a_fit_of_two_classes_and_of_missing_ones():
    rng = np.random.default_rng(5)
    config = linear(classes=3)
    labels = np.repeat([0, 2], 20)
    features = rng.normal(0, 0.3, (40, config.windows.steps, config.inputs)) + labels[:, None, None]
    arrays = fit_linear(config, features, labels, 1.0) | {"mu": np.array(0.0), "sigma": np.array(1.0)}
    assert (FloatModel(config, arrays).forward(features)[1][:, -1].argmax(axis=1) == labels).all()
    single = fit_linear(config, features, np.full(40, 1), 1.0)
    assert not single["V"].any() and single["b_y"].argmax() == 1
