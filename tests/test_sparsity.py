"""golden/sparsity.py: delta updates against plain Python that really adds differences, masks, and the count of multiplies."""

import dataclasses

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from touch_scenes import SMALL, scene

from golden import train as training
from golden.activation import sigmoid_table, tanh_table
from golden.errors import InputError
from golden.model import FloatModel, RecurrentClassifier, random_integer_model, with_network
from golden.sparsity import compare_skipping, magnitude_masks, run_skipping
from golden.train import RECIPES
from tests.test_cells import CELLS


def narrow(value: int, shift: int, fmt) -> int:
    value = (value + (1 << shift >> 1)) >> shift
    return min(max(value, fmt.min_code), fmt.max_code)


class Rows:
    """Accumulators of one vector operand: each keeps its sum, and a change of an operand adds weight x change."""

    def __init__(self, weights, threshold: int) -> None:
        self.weights = [[int(w) for w in row] for row in weights]
        self.threshold = threshold
        self.sums, self.last = [0] * len(self.weights), [0] * len(self.weights[0])
        self.made = 0

    def add(self, vector) -> list[int]:
        for j, value in enumerate(vector):
            if abs(value - self.last[j]) < self.threshold:
                continue
            for i, row in enumerate(self.weights):
                if row[j]:
                    self.sums[i] += row[j] * (value - self.last[j])
                    self.made += 1
            self.last[j] = value
        return list(self.sums)


def plain(model, features, feature_threshold: int, state_threshold: int):
    """One touch (K, D) in plain integers: (hidden, logits, multiplies made a step), by SPECIFICATION.md, sections 4 and 5."""
    c, arrays = model.config, {name: np.asarray(array).tolist() for name, array in model.arrays.items()}
    sigmoid, tanh = sigmoid_table(c).tolist(), tanh_table(c).tolist()
    half, one, state_format = c.table_entries // 2, c.gate_one, c.state_format
    after, lstm = c.cell == "gru" and c.reset == "after", c.cell == "lstm"
    last_gate = c.gates[-1]
    x_rows = {g: Rows(arrays[f"W_{g}"], feature_threshold << c.feature_align) for g in c.gates}
    u_rows = {g: Rows(arrays[f"U_{g}"], state_threshold) for g in c.gates}
    dense = Rows(arrays["V"], state_threshold)

    def gate(table, acc, shift):
        return table[narrow(acc, shift, c.index_format) + half]

    h, cell, out = [0] * c.hidden, [0] * c.hidden, []
    for codes in features.tolist():
        before = sum(rows.made for rows in (*x_rows.values(), *u_rows.values(), dense))
        x = {g: rows.add([code << c.feature_align for code in codes]) for g, rows in x_rows.items()}
        b = {g: [value << c.bias_shift for value in arrays[f"b_{g}"]] for g in c.gates}
        if lstm:
            u = {g: u_rows[g].add(h) for g in c.gates}
            acc = {g: [x[g][i] + u[g][i] + b[g][i] for i in range(c.hidden)] for g in c.gates}
            s = {g: [gate(sigmoid, a, c.sigmoid_shift) for a in acc[g]] for g in "ifo"}
            n = [gate(tanh, a, c.tanh_shift) for a in acc["g"]]
            cell = [narrow(s["f"][i] * cell[i] + s["i"][i] * n[i], c.gate_frac, state_format) for i in range(c.hidden)]
            h = [
                narrow(s["o"][i] * gate(tanh, cell[i], c.state_index_shift), c.gate_frac, state_format) for i in range(c.hidden)
            ]
        else:
            u = {g: u_rows[g].add(h) for g in "zr"}
            z, r = ([gate(sigmoid, x[g][i] + u[g][i] + b[g][i], c.sigmoid_shift) for i in range(c.hidden)] for g in "zr")
            if after:
                un = u_rows["n"].add(h)
                hn = [narrow(un[i] + (arrays["bh_n"][i] << c.bias_shift), c.value_shift, state_format) for i in range(c.hidden)]
                wx = [narrow(x["n"][i] + b["n"][i], c.value_shift, state_format) for i in range(c.hidden)]
                p = [narrow(r[i] * hn[i] + one * wx[i], c.gate_frac, state_format) for i in range(c.hidden)]
                n = [gate(tanh, value, c.state_index_shift) for value in p]
            else:
                rh = [narrow(r[i] * h[i], c.gate_frac, state_format) for i in range(c.hidden)]
                un = u_rows[last_gate].add(rh)
                n = [gate(tanh, x["n"][i] + un[i] + b["n"][i], c.tanh_shift) for i in range(c.hidden)]
            h = [narrow(z[i] * h[i] + (one - z[i]) * n[i], c.gate_frac, state_format) for i in range(c.hidden)]
        y = dense.add(h)
        logits = [narrow(y[i] + (arrays["b_y"][i] << c.dense_bias_shift), c.logit_shift, c.logit_format) for i in range(c.classes)]
        made = sum(rows.made for rows in (*x_rows.values(), *u_rows.values(), dense)) - before
        out.append((list(h), logits, made + (3 if lstm else 2) * c.hidden))
    return [np.array(column) for column in zip(*out, strict=True)]


def moving_features(config, touches: int, seed: int) -> np.ndarray:
    """Feature codes that sometimes stay and sometimes move a little or far."""
    rng = np.random.default_rng(seed)
    steps = rng.choice([0, 1, -3, 20, -200, 300], (touches, config.steps, config.taxels))
    return np.clip(np.cumsum(steps, axis=1), config.feature_format.min_code, config.feature_format.max_code)


@pytest.mark.parametrize(("cell", "reset"), CELLS)
def test_threshold_0_is_the_dense_integer_model(cell, reset):
    config = with_network(SMALL, cell=cell, reset=reset)
    for seed in range(3):
        model = random_integer_model(config, seed)
        features = moving_features(config, 5, seed)
        hidden, logits = model.forward(features)
        for thresholds in ((0, 0), (1, 1)):
            run = run_skipping(model, features, *thresholds)
            np.testing.assert_array_equal(run.hidden, hidden)
            np.testing.assert_array_equal(run.logits, logits)
        zeros = sum((model.arrays[name] == 0).sum() for name in model.arrays if name[:2] in ("W_", "U_", "V"))
        assert (run_skipping(model, features).done == config.multiplies - zeros).all()


@pytest.mark.parametrize(("cell", "reset"), CELLS)
@given(seed=st.integers(0, 10**6), feature=st.sampled_from([0, 1, 2, 25, 400]), state=st.sampled_from([0, 1, 60, 900, 5000]))
@settings(deadline=None, derandomize=True, max_examples=8)
def test_delta_updates_are_those_of_accumulated_differences(cell, reset, seed, feature, state):
    config = with_network(SMALL, cell=cell, reset=reset)
    model = random_integer_model(config, seed)
    features = moving_features(config, 2, seed)
    run = run_skipping(model, features, feature, state)
    for touch in range(2):
        hidden, logits, made = plain(model, features[touch], feature, state)
        np.testing.assert_array_equal(run.hidden[touch], hidden)
        np.testing.assert_array_equal(run.logits[touch], logits)
        np.testing.assert_array_equal(run.done[touch], made)


def test_skipping_grows_with_the_thresholds_and_is_counted_on_completed_steps():
    model = random_integer_model(SMALL, 3)
    features, completed = moving_features(SMALL, 6, 1), np.array([6, 6, 3, 1, 0, 6])
    shares = [run_skipping(model, features, t, 10 * t).share_skipped(completed) for t in (0, 1, 30, 10**6)]
    assert shares == sorted(shares) and shares[0] < shares[1] < shares[2] < shares[3]
    # nothing ever moves: only the element-wise multiplies are made
    assert shares[3] == pytest.approx(1 - 2 * SMALL.hidden / SMALL.multiplies)
    run = run_skipping(model, features, 30, 300)
    counts = np.arange(SMALL.steps) < completed[:, None]
    assert run.share_skipped(completed) == pytest.approx(1 - run.done[counts].mean() / SMALL.multiplies)
    assert run.decisions(SMALL, completed)[4] == -1


def test_thresholds_and_shares_that_mean_nothing_are_refused():
    model = random_integer_model(SMALL, 3)
    for thresholds in ((-1, 0), (0, 0.5)):
        with pytest.raises(InputError, match="whole number"):
            run_skipping(model, moving_features(SMALL, 1, 1), *thresholds)
    with pytest.raises(InputError, match="share"):
        magnitude_masks(None, 1.0)


def float_model(seed=0):
    network = RecurrentClassifier(SMALL, generator=torch.Generator().manual_seed(seed))
    return FloatModel(SMALL, network.arrays() | {"mu": np.array(5.0), "sigma": np.array(40.0)})


@pytest.mark.parametrize("share", [0.0, 0.3, 0.75])
def test_masks_keep_the_largest_weights(share):
    model = float_model()
    masks = magnitude_masks(model, share)
    assert set(masks) == {f"{kind}_{gate}" for kind in "WU" for gate in "zrn"}
    for kind in "WU":
        kept = np.concatenate([masks[f"{kind}_{gate}"].ravel() for gate in "zrn"]).astype(bool)
        size = np.concatenate([np.abs(model.arrays[f"{kind}_{gate}"]).ravel() for gate in "zrn"])
        assert np.count_nonzero(~kept) == round(share * len(kept))
        assert share == 0 or size[~kept].max() < size[kept].min()


def test_masks_hold_through_quantisation_aware_training(monkeypatch):
    monkeypatch.setattr(training, "FINE_TUNING_UPDATES", 10)
    recipe = dataclasses.replace(RECIPES["onset"], updates=10)
    work = training.Folds(scene(30, seed=4), SMALL, recipe, [[]], (0,), 2)
    models = work.fit(None)
    masks = [magnitude_masks(model, 0.6) for model in models]
    dense, pruned = work.fine_tune(models, {}, None), work.fine_tune(models, {}, None, masks)
    for mask, whole, integer in zip(masks, dense, pruned, strict=True):
        for name, kept in mask.items():
            assert (integer.arrays[name][kept == 0] == 0).all() and (whole.arrays[name][kept == 0] != 0).any()
            assert np.count_nonzero(integer.arrays[name][kept == 1]) > 0.8 * kept.sum()


def test_the_comparison_judges_what_it_skips(monkeypatch):
    monkeypatch.setattr(training, "FINE_TUNING_UPDATES", 25)
    recipe = dataclasses.replace(RECIPES["onset"], updates=80, batch=32)
    recordings = scene(45, seed=1)
    rows = compare_skipping(
        recordings, SMALL, [["person"], []], (0,), pruned=(0.0, 0.5), thresholds=((0.0, 0.0), (50.0, 4.0)), folds=2, recipe=recipe
    )
    assert len(rows) == 2 * 2 * 2
    found = {(len(row["groups"]), row["pruned"], row["feature_threshold"]): row for row in rows}
    assert found[1, 0.0, 0.0]["skipped"] < 0.1 < 0.3 < found[1, 0.5, 0.0]["skipped"] < 0.6
    assert found[1, 0.0, 50.0]["skipped"] == pytest.approx(1 - 2 * SMALL.hidden / SMALL.multiplies)
    assert found[1, 0.0, 0.0]["accuracy"] > 0.75 > found[1, 0.0, 50.0]["accuracy"]
    direct = training.cross_validate(recordings, SMALL, [["person"], []], (0,), folds=2, recipe=recipe, quantisation_aware=True)
    for record, groups in zip(direct, (1, 0), strict=True):
        assert found[groups, 0.0, 0.0]["accuracy"] == record["integer_accuracy"]
