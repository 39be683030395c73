"""golden/model/cells.py: the float cells against torch and numpy, the fixed cells against integers written
from docs/specification.md."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.golden.core import PRESETS, AcceleratorConfig, sigmoid_table, tanh_table
from eskin.golden.model import (
    Fixed,
    Float,
    network_formats,
    network_shapes,
    random_integer_model,
    run_cell,
    with_network,
)
from eskin.training.network import RecurrentClassifier
from tests.support.strategies import configurations
from tests.support.table import each_row

CELLS = [("gru", "before"), ("gru", "after"), ("lstm", "before")]


# ---------------------------------------------------------------------- an independent expression in plain integers
class Plain:
    """docs/specification.md sections 1 and 4 to 7 for one touch, one value at a time, in Python integers and
    floats from math only."""

    def __init__(self, config: AcceleratorConfig, arrays) -> None:
        self.network, self.f = config.network, config.formats
        self.w = {name: np.asarray(array).tolist() for name, array in arrays.items()}
        self.frac = self.f.recurrent_format.frac_bits + self.f.state_format.frac_bits
        self.align = self.frac - self.f.weight_format.frac_bits - self.f.feature_format.frac_bits
        self.log_t = int(math.log2(self.f.table_entries))

    @staticmethod
    def narrow(value, shift, bits):
        rounded = value if shift == 0 else (value + 2 ** (shift - 1)) // 2**shift
        return max(-(2 ** (bits - 1)), min(2 ** (bits - 1) - 1, rounded))

    def state(self, value, shift=None):
        return self.narrow(value, self.f.gate_frac if shift is None else shift, self.f.state_format.width)

    def sigmoid(self, acc):
        index = self.narrow(acc, self.frac - self.log_t + 4, self.log_t)
        x = abs(index) * 16 / self.f.table_entries
        hard = self.network.gate_activation == "hard_sigmoid"
        real = min(1.0, 0.2 * x + 0.5) if hard else 1 / (1 + math.exp(-x))
        upper = round(real * 2**self.f.gate_frac)  # Python rounds half to even
        return upper if index >= 0 else 2**self.f.gate_frac - upper

    def tanh(self, value, frac):
        index, state = self.narrow(value, frac - self.log_t + 3, self.log_t), self.f.state_format
        code = round(math.tanh(abs(index) * 8 / self.f.table_entries) * 2**state.frac_bits)
        return min(code, 2 ** (state.width - 1) - 1) * (1 if index >= 0 else -1)

    def row(self, name, unit, x, h):
        acc = self.w[f"b_{name}"][unit] * 2 ** (self.frac - self.f.bias_format.frac_bits)
        acc += sum(
            w * feature * 2**self.align for w, feature in zip(self.w[f"W_{name}"][unit], x, strict=True)
        )
        return acc + sum(u * value for u, value in zip(self.w[f"U_{name}"][unit], h, strict=False))

    def step(self, x, h, c):
        one, s = 2**self.f.gate_frac, self.f.state_format.frac_bits
        units = range(self.network.hidden)
        if self.network.cell == "lstm":
            i, f, o = ([self.sigmoid(self.row(name, u, x, h)) for u in units] for name in "ifo")
            cand = [self.tanh(self.row("g", u, x, h), self.frac) for u in units]
            c = [self.state(f[u] * c[u] + i[u] * cand[u]) for u in units]
            return [self.state(o[u] * self.tanh(c[u], s)) for u in units], c
        z, r = ([self.sigmoid(self.row(name, u, x, h)) for u in units] for name in "zr")
        if self.network.reset == "before":
            rh = [self.state(r[u] * h[u]) for u in units]
            n = [self.tanh(self.row("n", u, x, rh), self.frac) for u in units]
        else:
            n = []
            for u in units:
                hn = self.w["bh_n"][u] * 2 ** (self.frac - self.f.bias_format.frac_bits)
                hn += sum(self.w["U_n"][u][v] * h[v] for v in units)
                wx = self.state(self.row("n", u, x, []), self.frac - s)
                n.append(self.tanh(self.state(r[u] * self.state(hn, self.frac - s) + one * wx), s))
        return [self.state(z[u] * h[u] + (one - z[u]) * n[u]) for u in units], c

    def touch(self, features):
        h = c = [0] * self.network.hidden
        states, logits, logit = [], [], self.f.logit_format
        frac = self.f.dense_format.frac_bits + self.f.state_format.frac_bits
        for x in features.tolist():
            h, c = self.step(x, h, c)
            states.append(h)
            sums = [
                bias * 2 ** (frac - self.f.dense_bias_format.frac_bits)
                + sum(v * value for v, value in zip(row, h, strict=True))
                for row, bias in zip(self.w["V"], self.w["b_y"], strict=True)
            ]
            logits.append([self.narrow(value, frac - logit.frac_bits, logit.width) for value in sums])
        return states, logits


@given(configurations().filter(lambda config: config.recurrent), st.integers(0, 2**31))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_fixed_cells_equal_plain_integers(config, seed):
    rng, feature, arrays = np.random.default_rng(seed), config.formats.feature_format, {}
    for name, shape in network_shapes(config, real=False).items():
        fmt = network_formats(config)[name]
        full = rng.integers(fmt.min_code, fmt.max_code, shape, endpoint=True)
        arrays[name] = full if rng.random() < 0.5 else full // 4 + 1
    features = rng.integers(feature.min_code, feature.max_code, (2, 5, config.inputs), endpoint=True)
    features //= rng.choice([1, 4])
    tensors = {name: torch.tensor(array, dtype=torch.float64) for name, array in arrays.items()}
    hidden, logits = run_cell(Fixed(config), config, tensors, torch.tensor(features, dtype=torch.float64))
    for touch in range(2):
        expected = Plain(config, arrays).touch(features[touch])
        assert (hidden[touch].tolist(), logits[touch].tolist()) == expected


# ---------------------------------------------------------------------- float cells
def random_network(config, seed, **kwargs):
    """A float network whose biases are not 0."""
    network = RecurrentClassifier(config, generator=torch.Generator().manual_seed(seed), **kwargs).double()
    assert all(bool((weight != 0).all()) for weight in network.weights.values())
    return network


@each_row(
    "network, cell, order",
    [(torch.nn.GRU, dict(reset="after"), "rzn"), (torch.nn.LSTM, dict(cell="lstm"), "ifgo")],
)
def test_float_cells_equal_torch(network, cell, order):
    config = with_network(PRESETS["thesis"], **cell)
    p = {name: weight.detach() for name, weight in random_network(config, 3).weights.items()}
    theirs = network(config.inputs, config.network.hidden, batch_first=True).double()
    rows = {"weight_ih": "W", "weight_hh": "U", "bias_ih": "b", "bias_hh": "bh"}
    for name, row in rows.items():
        zero = torch.zeros(config.network.hidden)  # an LSTM's second bias
        parts = [p.get(f"{row}_{gate}", zero) for gate in order]
        getattr(theirs, f"{name}_l0").data = torch.cat(parts).double()
    x = torch.tensor(np.random.default_rng(4).normal(0, 1, (5, 20, config.inputs)))
    hidden, logits = run_cell(Float(config), config, p, x)
    torch.testing.assert_close(hidden, theirs(x)[0], rtol=0, atol=1e-12)
    torch.testing.assert_close(logits, hidden @ p["V"].T + p["b_y"], rtol=0, atol=1e-12)


def test_a_hard_sigmoid_is_clipped_in_float_too():
    gates = Float(PRESETS["thesis"].replace(gate_activation="hard_sigmoid"))
    assert gates.sigmoid(np.array([-3.0, -1.0, 0.0, 2.0, 9.0])) == pytest.approx([0, 0.3, 0.5, 0.9, 1])


@each_row(("cell", "reset"), CELLS)
def test_leading_dimensions_are_independent_networks(cell, reset):
    config = with_network(PRESETS["pvdf"], cell=cell, reset=reset)
    many = random_network(config, 9, batch=(2, 3))
    x = torch.randn(
        2, 1, 4, 6, config.sensor.taxels, dtype=torch.float64, generator=torch.Generator().manual_seed(1)
    )
    together = many(x)
    assert together.shape == (2, 3, 4, 6, config.classes)
    for fold in range(2):
        for seed in range(3):
            single = {name: weight[fold, seed] for name, weight in many.weights.items()}
            _, alone = run_cell(Float(config), config, single, x[fold, 0])
            torch.testing.assert_close(together[fold, seed], alone, rtol=0, atol=1e-12)


@each_row(("cell", "reset"), CELLS)
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
