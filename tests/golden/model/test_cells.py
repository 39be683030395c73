"""golden/model/cells.py: the gradients of the fixed cells, tables. Their integers are held by hardware and C, which were
written from docs/specification.md too; the float cells by torch's own, in tests/eskin/exchange/test_import_network.py."""

import numpy as np
import pytest
import torch

from eskin.golden.core import PRESETS, sigmoid_table, tanh_table
from eskin.golden.model import Fixed, Float, network_formats, run_cell
from eskin.training.formats import with_network
from tests.support.random_models import random_integer_model
from tests.support.small_designs import CELLS
from tests.support.table import each_row


def test_a_hard_sigmoid_is_clipped_in_float_too():
    gates = Float(PRESETS["thesis"].replace(gate_activation="hard_sigmoid"))
    assert gates.sigmoid(np.array([-3.0, -1.0, 0.0, 2.0, 9.0])) == pytest.approx([0, 0.3, 0.5, 0.9, 1])


@each_row("cell, reset", CELLS)
def test_fixed_gradients_follow_the_float_ones(cell, reset):
    """Straight through: codes at full resolution give nearly the gradient of the real network they stand
    for."""
    config = with_network(PRESETS["pvdf"], cell=cell, reset=reset).replace(table_entries=1024)
    model = random_integer_model(config, 11)
    x = np.random.default_rng(12).normal(0, 1, (16, 6, config.sensor.taxels))

    def gradient(arithmetic, arrays, features, logit_unit):
        leaves = {
            name: torch.tensor(array, dtype=torch.float64, requires_grad=True)
            for name, array in arrays.items()
        }
        _, logits = run_cell(arithmetic, config, leaves, torch.tensor(features, dtype=torch.float64))
        (logits / logit_unit).log_softmax(-1)[..., 0].sum().backward()
        return {name: leaf.grad.numpy() for name, leaf in leaves.items()}

    formats = network_formats(config)
    codes = {name: model.arrays[name] // 4 for name in formats}
    real = {name: formats[name].to_real(array) for name, array in codes.items()}
    fixed = gradient(
        Fixed(config),
        codes,
        config.formats.feature_format.quantise(x),
        2.0**config.formats.logit_format.frac_bits,
    )
    ideal = gradient(Float(config), real, x, 1.0)
    for name, fmt in formats.items():
        ours, theirs = fixed[name] * 2.0**fmt.frac_bits, ideal[name]
        assert np.linalg.norm(ours - theirs) < 0.1 * np.linalg.norm(theirs), name


# ---------------------------------------------------------------------- tables and gate codes
@each_row("activation", ["sigmoid", "hard_sigmoid"])
@each_row("entries", [64, 256, 1024])
@each_row("gate_frac", [6, 13])
def test_activation_tables(activation, entries, gate_frac):
    config = PRESETS["thesis"].replace(gate_activation=activation, table_entries=entries, gate_frac=gate_frac)
    sigmoid, tanh, half = sigmoid_table(config), tanh_table(config), entries // 2
    assert len(sigmoid) == len(tanh) == entries
    assert (np.diff(sigmoid) >= 0).all() and (np.diff(tanh) >= 0).all()
    assert (sigmoid[1:] + sigmoid[1:][::-1] == config.gate_one).all()  # s(-x) + s(x) = 1, exactly
    assert (tanh[1:] == -tanh[1:][::-1]).all()
    assert sigmoid[half] == config.gate_one // 2 and tanh[half] == 0
    x = (np.arange(entries) - half) * 16 / entries
    real = 1 / (1 + np.exp(-x)) if activation == "sigmoid" else np.clip(0.2 * x + 0.5, 0, 1)
    assert np.abs(sigmoid / config.gate_one - real).max() <= 0.5000001 / config.gate_one
    assert (
        np.abs(config.formats.state_format.to_real(tanh) - np.tanh(x / 2)).max()
        <= 0.5000001 / 2**config.formats.state_format.frac_bits
    )
    assert sigmoid.min() >= 0 and sigmoid.max() <= config.gate_one
