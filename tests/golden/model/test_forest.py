"""Decision trees: against scikit-learn's forests, windows that are not there, and arrays that make no forest."""

import numpy as np
from sklearn.ensemble import RandomForestClassifier

from eskin.golden.model import FloatModel, IntegerModel
from eskin.training.trees import Trees, forest_arrays
from tests.support.random_models import random_integer_model
from tests.support.small_designs import SMALL
from tests.support.table import each_row, refused

TREES = SMALL.replace(cell="trees", decision="last", steps=4, trees=5, nodes=40, depth=6)


def test_leaves_are_those_of_scikit_learn():
    """Each touch ends in each tree's leaf that `apply` names: a vote is the share of its largest class above the mean
    of the other two."""
    rng = np.random.default_rng(3)
    labels = rng.integers(0, 3, 200)
    features = rng.normal(0, 1, (200, 4, TREES.inputs)).astype(np.float32) + 0.4 * labels[:, None, None]
    flat = features.reshape(200, -1)
    fitted = RandomForestClassifier(5, max_depth=6, random_state=1).fit(flat, labels)
    config, arrays = forest_arrays(TREES, Trees.of(fitted))
    model = FloatModel(config, arrays | {"mu": np.array(0.0), "sigma": np.array(1.0)})
    expected = np.zeros((200, 3))
    for tree in fitted.estimators_:
        shares = tree.tree_.value[tree.apply(flat), 0]
        expected[np.arange(200), shares.argmax(axis=1)] += 1.5 * shares.max(axis=1) - 0.5
    assert np.allclose(model.forward(features)[1][:, -1], expected) and config.forest.depth <= 6


def test_a_window_that_is_not_there_has_the_features_of_the_last():
    model, rng = random_integer_model(TREES, 2), np.random.default_rng(2)
    features = rng.integers(-900, 900, (30, 4, TREES.inputs))
    logits = model.forward(features)[1]
    for k in range(4):
        repeated = features[:, np.minimum(np.arange(4), k)]
        assert np.array_equal(logits[:, k], model.forward(repeated)[1][:, -1])
    assert (logits[:, 0] != logits[:, -1]).any()


@each_row(
    "name, place, value, words",
    [
        ("tree_input", 3, 16, "array tree_input: names an input outside 0..15"),
        ("subtrahend", 3, 17, "array subtrahend: names no input of the window of tree_input"),
        ("child", (7, 0), 7, "array child: names neither a later node"),
        ("child", (7, 0), 0, "array child: names neither a later node"),
        ("child", (7, 1), 40, "array child: names neither a later node below 40"),
        ("child", (7, 1), -4, "nor a class, -1 to -3"),
        ("vote", (0, 0), 128, "array vote: holds .* outside -128..127"),
    ],
)
def test_what_is_no_forest_is_refused(name, place, value, words):
    model = random_integer_model(TREES, 2)
    arrays = {**model.arrays, name: model.arrays[name].copy()}
    arrays[name][place] = value
    with refused(words):
        IntegerModel(model.config, arrays)


def test_a_forest_that_is_too_deep_or_does_not_add_up_is_refused():
    model = random_integer_model(TREES, 2)
    with refused("array child: makes a tree of [3-6] comparisons, above depth 2"):
        IntegerModel(model.config.replace(depth=2), model.arrays)
    for changes, words in (
        ({"trees": 50}, "field nodes: is 40 for 50 trees"),
        ({"trees": 255, "nodes": 300, "logit_format": "SQ(5,10)"}, "field trees: is 255, whose votes"),
        ({"readout": "prototypes"}, "field readout: is 'prototypes', and trees"),
    ):
        with refused(words):
            TREES.replace(**changes)
