"""The fit of a linear cell's weights; against scikit-learn's own in tests/rtl/program/test_linear_cell.py."""

import numpy as np
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

from eskin.golden.core import AcceleratorConfig
from eskin.training.linear_fit import QUIETEST, cut_short, discriminants, fit_least_squares, fit_linear

CONFIG = AcceleratorConfig.of(
    taxels=4,
    hop=4,
    window=8,
    steps=6,
    window_mode="free",
    pretrigger_frames=0,
    cell="linear",
    class_names=("press", "stroke"),
    decision="last",
)


def test_inputs_of_noise_alone_do_not_take_the_bits_of_the_weights():
    rng = np.random.default_rng(3)
    labels = np.arange(60) % 2
    features = rng.normal(0, 1e-3, (60, 6, 4))  # before the touch nothing but noise
    features[:, 3:] += rng.normal(0, 1, (60, 3, 4)) + 2 * labels[:, None, None]
    arrays = fit_linear(CONFIG, features, labels, 1.0)
    noise, signal = np.abs(arrays["V"][:3]).max(), np.abs(arrays["V"][3:]).max()
    assert noise < signal / QUIETEST
    logits = np.einsum("nkd,kcd->nc", features, arrays["V"]) + arrays["b_y"]
    assert (logits.argmax(axis=1) == labels).all()
    step = np.abs(arrays["V"]).max() / 127  # as weights of 8 bits
    coarse = np.einsum("nkd,kcd->nc", features, np.rint(arrays["V"] / step) * step) + arrays["b_y"]
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
        logits = np.einsum("nkd,kcd->nc", features, arrays["V"]) + arrays["b_y"]
        right = logits.argmax(axis=1) == labels
        shares.append((right[held_out & (held == 2)].mean(), right[held_out & (held == 6)].mean()))
    (before, whole_before), (after, whole_after) = shares
    assert after > before + 0.05 and whole_after > whole_before - 0.05, shares
