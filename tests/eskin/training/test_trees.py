"""Trees: fitted by scikit-learn, rounded, trained and quantised as a model folder."""

import numpy as np
from sklearn.ensemble import RandomForestClassifier

from eskin.golden.model.forest import run_forest
from eskin.training.evaluate import evaluate
from eskin.training.integers import quantise
from eskin.training.made_up import random_recordings
from eskin.training.recipe import choose_recipe
from eskin.training.train import train
from eskin.training.trees import Trees, fit_forest, forest_arrays, forest_codes
from tests.support.small_designs import TRACKED
from tests.support.table import refused

CONFIG = TRACKED.replace(cell="trees", decision="last", trees=6, depth=5, nodes=6)


def codes(touches: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Feature codes (touches, K, D) of a few levels, and labels that depend on them."""
    rng = np.random.default_rng(seed)
    features = rng.integers(-20, 20, (touches, CONFIG.windows.steps, CONFIG.inputs))
    return features, (features[:, -1, 0] + features[:, 0, 1] > 3).astype(int)


def test_rounded_trees_walk_as_real_ones():
    """scikit-learn's thresholds lie half way between two features, here between two codes."""
    whole, labels = codes(150, 1)
    frac = CONFIG.formats.feature_format.frac_bits
    sized, arrays = fit_forest(CONFIG, whole / 2.0**frac, np.ones(whole.shape[:2]), labels, 3)
    config, integers = forest_codes(sized, arrays)
    real, rounded = (
        run_forest(config, trees, features)[1]
        for trees, features in ((arrays, whole / 2.0**frac), (integers, whole))
    )
    steps = 2.0**-config.formats.logit_format.frac_bits
    assert np.abs(real - rounded * steps).max() <= config.forest.trees * steps / 2
    assert (real[:, -1].argmax(axis=1) == labels).mean() > 0.95
    assert 64 <= integers["vote"].max() <= 127 and config.forest.depth <= 5


def test_a_short_touch_is_fitted_with_the_features_of_its_last_window():
    whole, labels = codes(80, 2)
    last = np.arange(80) % CONFIG.windows.steps
    repeated = whole[np.arange(80)[:, None], np.minimum(np.arange(CONFIG.windows.steps), last[:, None])]
    counts = np.arange(CONFIG.windows.steps) <= last[:, None]
    all_there = np.ones_like(counts)
    short, same, other = (
        fit_forest(CONFIG, features, there, labels, 4)[1]
        for features, there in ((whole, counts), (repeated, all_there), (whole, all_there))
    )
    assert all(np.array_equal(short[name], same[name]) for name in short)
    assert (
        len(other["threshold"]) != len(short["threshold"]) or (other["threshold"] != short["threshold"]).any()
    )


def test_trees_under_disturbance_lose_taxels_and_none_sticks():
    plain, robust = choose_recipe(CONFIG), choose_recipe(CONFIG, robust=True)
    linear = choose_recipe(CONFIG.replace(cell="linear"), robust=True)
    assert robust.augments and robust.updates == plain.updates and not plain.channel_dropout
    assert linear.updates == 2 * plain.updates
    assert robust.channel_dropout == linear.channel_dropout > 0 < linear.taxel_failure
    assert robust.taxel_failure == 0 < robust.offset < linear.offset


def test_an_offset_of_two_taxels_does_not_move_their_difference():
    """The class depends on the difference of two taxels, and a touch to decide is offset by more than those learned from."""
    features, rng = codes(400, 7)[0] / 256, np.random.default_rng(7)
    labels = (features[:, 1, 2] > features[:, 1, 3]).astype(int)
    there = np.ones(features.shape[:2])
    config, arrays = fit_forest(CONFIG.replace(trees=40, nodes=40), features, there, labels, 1)
    offset = rng.choice([-0.2, 0.2], (400, 1, 1))
    decided = run_forest(config, arrays, features + offset)[1][:, -1].argmax(axis=1)
    assert (decided == labels).mean() > 0.9


def test_trees_stay_within_the_highest_number_of_nodes():
    features, _ = codes(600, 6)
    inputs = (features / 256).reshape(600, -1)
    labels, deep = (
        np.random.default_rng(6).integers(0, 2, 600),
        CONFIG.replace(trees=120, depth=16, nodes=120),
    )
    sized, _ = fit_forest(deep, features / 256, np.ones(features.shape[:2]), labels, 1)
    assert 8192 - 120 <= sized.forest.nodes <= 8192  # all trees would grow further
    grown = RandomForestClassifier(120, max_depth=16, random_state=1).fit(inputs, labels)
    with refused("field nodes: is [0-9]{4,}; it must lie in 1..8192, so fit fewer trees or smaller ones"):
        forest_arrays(deep, Trees.of(grown))


def test_a_model_folder(tmp_path):
    recordings = random_recordings(CONFIG, (90,) * 24, 3)
    record = train(recordings, CONFIG, out=tmp_path / "model", seed=1)
    integer = quantise(tmp_path / "model", recordings)
    nodes = integer.config.forest.nodes
    assert record.config["forest"]["nodes"] == nodes > 6 and record.parameters == 2 * nodes + 6
    again = quantise(tmp_path / "model")  # by the noted ranges
    assert all(np.array_equal(again.arrays[name], integer.arrays[name]) for name in integer.arrays)
    found = evaluate(tmp_path / "model", recordings)
    assert [row.stage for row in found.stages] == ["features", "logits"] and found.agreement > 0.9
    with refused("field dense_format: 4 bits were requested, and trees have no weights"):
        quantise(tmp_path / "model", recordings, weight_bits=4)
