"""The fit of a linear cell's weights; against scikit-learn's own in tests/rtl/program/test_linear_cell.py."""

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.training.linear_fit import QUIETEST, fit_least_squares, fit_linear

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
    assert not arrays["V"].any() and np.allclose(arrays["b_y"], 0.5)
