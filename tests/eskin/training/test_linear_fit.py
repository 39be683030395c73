"""The fit of a linear cell's weights; against scikit-learn's own in tests/rtl/program/test_linear_cell.py."""

import numpy as np
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.linear_model import Ridge

from eskin.training import linear_fit
from eskin.training.linear_fit import (
    QUIETEST,
    cut_short,
    discriminants,
    fit_average,
    fit_least_squares,
    fit_linear,
)
from tests.support.small_designs import TRACKED
from tests.support.table import each_row

CONFIG = TRACKED.replace(onset="band", hop=4, window=8, steps=6, cell="linear", decision="last")


def logits(arrays, features):
    return np.einsum("nkd,kcd->nc", features, arrays["V"]) + arrays["b_y"]


def test_inputs_of_noise_alone_do_not_take_the_bits_of_the_weights():
    rng = np.random.default_rng(3)
    labels = np.arange(60) % 2
    features = rng.normal(0, 1e-3, (60, 6, 4))  # before the touch nothing but noise
    features[:, 3:] += rng.normal(0, 1, (60, 3, 4)) + 2 * labels[:, None, None]
    arrays = fit_linear(CONFIG, features, labels, 1.0)
    noise, signal = np.abs(arrays["V"][:3]).max(), np.abs(arrays["V"][3:]).max()
    assert noise < signal / QUIETEST
    assert (logits(arrays, features).argmax(axis=1) == labels).all()
    step = np.abs(arrays["V"]).max() / 127  # as weights of 8 bits
    coarse = logits(arrays | {"V": np.rint(arrays["V"] / step) * step}, features)
    assert (coarse.argmax(axis=1) == labels).mean() > 0.95


def test_an_input_that_never_changes_is_no_trouble():
    rng = np.random.default_rng(3)
    labels = np.arange(40) % 2
    features = rng.normal(0, 1, (40, 6, 4)) + labels[:, None, None]
    features[:, 0] = 7.0
    arrays = fit_linear(CONFIG, features, labels, 1.0)
    assert not arrays["V"][0].any() and np.isfinite(arrays["b_y"]).all()
    arrays = fit_least_squares(
        CONFIG, np.full_like(features, 7.0), labels
    )  # nor are inputs that all never do
    assert not arrays["V"].any() and np.ptp(arrays["b_y"]) == 0


def test_discriminants_of_a_regression_decide_as_the_linear_discriminant_analysis():
    """The regression alone passes over the class in the middle."""
    rng = np.random.default_rng(1)
    labels = np.repeat(np.arange(4), (40, 40, 40, 20))
    x = rng.normal(0, 1, (140, 5)) + 3 * np.eye(5)[0] * labels[:, None]
    indicators = np.eye(5)[labels]  # class 4 has no touch
    wide = np.c_[x, np.ones(140)]
    fitted = wide @ np.linalg.lstsq(wide, indicators, rcond=None)[0]
    turn, bias = discriminants(fitted, indicators)
    decided = (fitted @ turn + bias).argmax(axis=1)
    assert (decided == LinearDiscriminantAnalysis().fit(x, labels).predict(x)).all()
    assert (decided == labels).mean() > 0.85 > 0.7 > (fitted.argmax(axis=1) == labels).mean()


def test_the_average_weighs_both_fits_alike():
    rng = np.random.default_rng(4)
    config = CONFIG.replace(class_names=("press", "stroke", "tap", "never"))
    labels = np.arange(90) % 3
    features = rng.normal(0, 1, (90, 6, 4)) + rng.normal(0, 1, (3, 6, 4))[labels]

    def centred(arrays):
        values = logits(arrays, features)[:, :3]
        return values - values.mean(axis=1, keepdims=True)

    odds = centred(fit_linear(config, features, labels, 1.0))
    squares = centred(fit_least_squares(config, features, labels, 0, 0.01))
    average = fit_average(config, features, labels, 0, 1.0, 0.01)
    expected = (odds + squares / squares.std() * odds.std()) / 2
    assert np.allclose(centred(average), expected, atol=1e-9)
    assert not np.allclose(expected, odds, atol=0.1)
    assert (logits(average, features).argmax(axis=1) < 3).all()  # a class without a touch loses


def test_touches_that_end_early_are_decided_on_what_they_have():
    """Taxel 0 changes by the class between windows 2 and 3, on a level that differs; taxel 1 tells it a
    little. One of four touches ends after window 2."""
    rng = np.random.default_rng(2)
    labels, held = np.arange(320) // 2 % 2, np.where(np.isin(np.arange(320) % 8, (0, 2)), 2, 6)
    side = 2.0 * labels[:, None] - 1
    features = rng.normal(0, 1, (320, 6, 4))
    features[..., 0] += rng.normal(0, 4, (320, 1)) + side * np.array([1, 1, -1, -1, -1, -1])
    features[:, :2, 1] += side
    features = features * (np.arange(6) < held[:, None])[..., None]
    held_out, known = np.arange(320) >= 160, np.arange(320) < 160
    again, ends = cut_short(held[known], 6)
    assert len(again) == 120 and set(ends) == {2} and (held[known][again] == 6).all()
    cut = features[again] * (np.arange(6) < ends[:, None])[..., None]
    shares = []
    for extra in (0, len(again)):
        learnt = np.r_[features[known], cut[:extra]], np.r_[labels[known], labels[again][:extra]]
        arrays = fit_least_squares(CONFIG, *learnt, extra)
        right = logits(arrays, features).argmax(axis=1) == labels
        shares.append((right[held_out & (held == 2)].mean(), right[held_out & (held == 6)].mean()))
    (before, whole_before), (after, whole_after) = shares
    assert after > before + 0.05 and whole_after > whole_before - 0.05, shares


@each_row(
    "rest, clip, kind, sets, mode, onset",
    [
        ("initial", 0, "mean", 6, "free", "band"),
        ("initial", 0, "mean", 1, "free", "band"),
        ("initial", 0, "mean", 6, "whole", "band"),
        ("none", 0, "mean", 6, "free", "band"),
        ("initial", 9, "mean", 6, "free", "band"),
        ("initial", 9, "mean", 1, "free", "immediate"),
        ("initial", 9, "highest", 6, "free", "band"),
    ],
)
def test_the_sturdy_fit_is_least_squares_over_every_disturbed_copy(
    monkeypatch, rest, clip, kind, sets, mode, onset
):
    """In closed form and copy by copy: touches cut short, at other rates, and with the beginning of another one over
    their end; and what a lost taxel, at rest or masked, or a spike in the level changes in the logits, as a penalty."""
    for name in ("OFFSET", "COMMON", "DRIFT"):
        monkeypatch.setattr(linear_fit, name, 0.0)
    rng = np.random.default_rng(4)
    labels = np.arange(50) % 2
    features = rng.normal(0, 1, (50, 6, 4)) + (labels[:, None, None] - 0.5) * rng.normal(1, 1, (6, 4))
    level = dict(rest=rest, rest_frames=4 * (rest == "initial"), clip=clip)
    of_window = "window" if sets > 1 else "one"
    config = CONFIG.replace(**level, feature_kinds=(kind,), weight_sets=of_window, window_mode=mode)
    config = config.replace(onset=onset)

    def inputs(values: np.ndarray) -> np.ndarray:
        return values.reshape(50, sets, -1, 4).sum(axis=2).reshape(50, -1)

    arrays = linear_fit.fit_sturdy(config, features, np.ones((50, 6)), labels, (3.0, 2.0), 1.0)
    copies = [(1.0, features)]
    rates = {factor: linear_fit.RATE for factor in linear_fit.RATES}
    if mode == "whole":  # windows that divide half or three quarters of a touch
        rates = {0.5: linear_fit.HALVED, 0.75: linear_fit.CUT}
    for last in () if mode == "whole" else (3, 4, 5):
        share = linear_fit.CUT / 3 + linear_fit.HALVED * (last == 3)
        copies.append((share, features * (np.arange(6) < last)[:, None]))
    for factor, share in rates.items():
        at = np.minimum(np.arange(6) * factor, 5)
        moved = [[np.interp(at, np.arange(6), taxel) for taxel in touch.T] for touch in features]
        copies.append((share, np.array(moved).swapaxes(1, 2)))
    late = round(linear_fit.OVERLAP_AFTER * 6)
    begun = np.zeros_like(features)
    still, at_rest = (features[:, :1], features.mean(axis=0).ravel()) if rest == "none" else (-1.5, -9 / sets)
    begun[:, late:] = (features - still)[:, : 6 - late]  # over the rest level
    copies += [(linear_fit.OVERLAP / 50, features + other) for other in begun]
    x = np.concatenate([inputs(copy) for _, copy in copies])
    weight = np.repeat([of for of, _ in copies], 50)
    weight = weight / weight.sum()
    indicators = np.tile(np.eye(2)[labels], (len(copies), 1))
    unit = inputs(features).var(axis=0).sum()
    # one frame of a window's eight; half of the spikes of a touch of 28 frames are of an extreme's sign
    hit = linear_fit.SPIKED * (1 / 8 if kind == "mean" else 28 / 2)
    penalty = linear_fit.SMOOTH * unit / 50 + hit * (clip / 2.0) ** 2
    # rows of a design whose squares are the penalty, with a target of 0: the loss of each taxel, in mean 0
    mean, root = weight @ x, np.sqrt(linear_fit.LOST / 4)
    changes = []
    for taxel in range(4):
        own = np.tile(np.arange(4) == taxel, sets)
        changes.append(np.sqrt(weight)[:, None] * (x - mean) * own)
        changes += [(np.sqrt(0.5) * (level - mean) * own)[None] for level in (at_rest, 0.0)]
    if onset == "immediate":  # each of the level's four frames moves a taxel's windows by the clip
        moved = np.sqrt(4 * linear_fit.LEVEL_SPIKED) / root * clip / 2.0 * 6 / sets
        changes += [(moved * np.tile(np.arange(4) == taxel, sets))[None] for taxel in range(4)]
    centred = np.concatenate([np.sqrt(weight)[:, None] * (x - mean), *(root * rows for rows in changes)])
    share = weight @ indicators
    targets = np.zeros((len(centred), 2))
    targets[: len(x)] = np.sqrt(weight)[:, None] * (indicators - share)
    ridge = Ridge(penalty, solver="cholesky", fit_intercept=False).fit(centred, targets)

    def fitted(rows: np.ndarray) -> np.ndarray:
        return (rows - mean) @ ridge.coef_.T + share

    turn, bias = linear_fit.discriminants_of((weight[:, None] * indicators).T @ fitted(x), np.array([25, 25]))
    due = fitted(inputs(features)) @ turn + bias
    assert np.allclose(
        inputs(features) @ arrays["V"].swapaxes(0, 1).reshape(2, -1).T + arrays["b_y"],
        due,
        rtol=1e-6,
        atol=1e-9,
    )
