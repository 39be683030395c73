"""golden/model/cells.py: the float cells against torch and numpy, the fixed cells against integers written
from docs/specification.md."""

import math

import numpy as np
import torch
from hypothesis import event, given, settings
from hypothesis import strategies as st

from eskin.golden.core.activation import sigmoid_table, tanh_table
from eskin.golden.core.config import PRESETS, AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.core.formats import QFormat
from eskin.golden.model.cells import Fixed, Float, run_cell
from eskin.golden.model.model import network_formats, network_shapes, random_integer_model, with_network
from eskin.golden.training.network import RecurrentClassifier
from tests.support.table import each_row

CELLS = [("gru", "before"), ("gru", "after"), ("lstm", "before")]


# ---------------------------------------------------------------------- an independent expression in plain integers
class Plain:
    """docs/specification.md sections 1 and 4 to 7 for one touch, one value at a time, in Python integers and
    floats from math only."""

    def __init__(self, config: AcceleratorConfig, arrays) -> None:
        self.k, self.w = config, {name: np.asarray(array).tolist() for name, array in arrays.items()}
        self.product_frac = config.formats.recurrent_format.frac_bits + config.formats.state_format.frac_bits
        self.align = (
            self.product_frac
            - config.formats.weight_format.frac_bits
            - config.formats.feature_format.frac_bits
        )
        self.log_t = int(math.log2(config.formats.table_entries))

    @staticmethod
    def fit(value, bits):
        return max(-(2 ** (bits - 1)), min(2 ** (bits - 1) - 1, value))

    def narrow(self, value, shift, fmt):
        rounded = value if shift == 0 else (value + 2 ** (shift - 1)) // 2**shift
        return self.fit(rounded, fmt.int_bits + fmt.frac_bits)

    def sigmoid(self, acc):
        t, one = self.k.formats.table_entries, 2**self.k.formats.gate_frac
        index = self.fit(
            (acc + 2 ** (self.product_frac - self.log_t + 3)) // 2 ** (self.product_frac - self.log_t + 4),
            self.log_t,
        )
        x = abs(index) * 16 / t
        real = (
            1 / (1 + math.exp(-x)) if self.k.network.gate_activation == "sigmoid" else min(1.0, 0.2 * x + 0.5)
        )
        upper = round(real * one)  # Python rounds half to even
        return upper if index >= 0 else one - upper

    def tanh(self, value, frac):
        shift = frac - self.log_t + 3
        index = self.fit((value + 2 ** (shift - 1)) // 2**shift, self.log_t)
        state = self.k.formats.state_format
        code = min(
            round(math.tanh(abs(index) * 8 / self.k.formats.table_entries) * 2**state.frac_bits),
            2 ** (state.width - 1) - 1,
        )
        return code if index >= 0 else -code

    def row(self, name, unit, x, h):
        acc = self.w[f"b_{name}"][unit] * 2 ** (self.product_frac - self.k.formats.bias_format.frac_bits)
        for taxel, feature in enumerate(x):
            acc += self.w[f"W_{name}"][unit][taxel] * feature * 2**self.align
        for other, value in enumerate(h):
            acc += self.w[f"U_{name}"][unit][other] * value
        return acc

    def step(self, x, h, c):
        k, s, g, one = (
            self.k,
            self.k.formats.state_format,
            self.k.formats.gate_frac,
            2**self.k.formats.gate_frac,
        )
        units = range(k.network.hidden)
        if k.network.cell == "lstm":
            i, f, o = ([self.sigmoid(self.row(name, u, x, h)) for u in units] for name in "ifo")
            cand = [self.tanh(self.row("g", u, x, h), self.product_frac) for u in units]
            c = [self.narrow(f[u] * c[u] + i[u] * cand[u], g, s) for u in units]
            return [self.narrow(o[u] * self.tanh(c[u], s.frac_bits), g, s) for u in units], c
        z, r = ([self.sigmoid(self.row(name, u, x, h)) for u in units] for name in "zr")
        if k.network.reset == "before":
            rh = [self.narrow(r[u] * h[u], g, s) for u in units]
            n = [self.tanh(self.row("n", u, x, rh), self.product_frac) for u in units]
        else:
            n = []
            for u in units:
                bhn = self.w["bh_n"][u] * 2 ** (self.product_frac - k.formats.bias_format.frac_bits)
                hn = bhn + sum(self.w["U_n"][u][v] * h[v] for v in units)
                hn = self.narrow(hn, self.product_frac - s.frac_bits, s)
                wx = self.narrow(self.row("n", u, x, []), self.product_frac - s.frac_bits, s)
                n.append(self.tanh(self.narrow(r[u] * hn + one * wx, g, s), s.frac_bits))
        return [self.narrow(z[u] * h[u] + (one - z[u]) * n[u], g, s) for u in units], c

    def touch(self, features):
        k = self.k
        h, c = [0] * k.network.hidden, [0] * k.network.hidden
        states, logits = [], []
        frac = k.formats.dense_format.frac_bits + k.formats.state_format.frac_bits
        for x in features.tolist():
            h, c = self.step(x, h, c)
            states.append(h)
            logits.append(
                [
                    self.narrow(
                        self.w["b_y"][y] * 2 ** (frac - k.formats.dense_bias_format.frac_bits)
                        + sum(self.w["V"][y][u] * h[u] for u in range(k.network.hidden)),
                        frac - k.formats.logit_format.frac_bits,
                        k.formats.logit_format,
                    )
                    for y in range(len(k.network.class_names))
                ]
            )
        return np.array(states), np.array(logits)


@st.composite
def configurations(draw):
    """Configurations over cells, sizes and formats that the configuration's own checks accept."""
    cell, reset = draw(st.sampled_from(CELLS))
    wide = cell == "lstm" or reset == "after"
    entries = draw(st.sampled_from([64, 128, 256, 512, 1024]))
    tanh_frac = entries.bit_length() - 4
    state = QFormat(draw(st.integers(2, 4)) if wide else 2, draw(st.integers(tanh_frac + 1, 12)))
    recurrent_frac, weight_frac = draw(st.integers(1, 7)), draw(st.integers(1, 7))
    products = recurrent_frac + state.frac_bits
    feature_int = draw(st.integers(2, 5))
    # the aligned feature fits 16 bits
    weight_frac = min(max(weight_frac, feature_int + products - 16), products - 2)
    feature_frac = draw(st.integers(2, min(9, products - weight_frac)))
    dense_frac = draw(st.integers(1, 6))
    hop = draw(st.sampled_from([7, 100]))
    try:
        return AcceleratorConfig.of(
            taxels=draw(st.integers(4, 9)),
            hidden=draw(st.integers(4, 8)),
            cell=cell,
            reset=reset,
            class_names=tuple("abcdef"[: draw(st.integers(2, 6))]),
            gate_activation=draw(st.sampled_from(["sigmoid", "hard_sigmoid"])),
            band_low=20000,
            band_high=30000,
            steps=5,
            hop=hop,
            window=2 * hop + 1,
            touch_frames=600,
            weight_format=QFormat(draw(st.integers(1, 4)), weight_frac),
            recurrent_format=QFormat(draw(st.integers(1, 4)), recurrent_frac),
            dense_format=QFormat(draw(st.integers(1, 3)), dense_frac),
            bias_format=QFormat(draw(st.integers(1, 5)), draw(st.integers(1, products))),
            dense_bias_format=QFormat(
                draw(st.integers(1, 5)), draw(st.integers(1, min(11, dense_frac + state.frac_bits)))
            ),
            feature_format=QFormat(feature_int, feature_frac),
            state_format=state,
            gate_frac=draw(st.integers(4, 14)),
            logit_format=QFormat(
                draw(st.integers(3, 7)), draw(st.integers(3, min(9, dense_frac + state.frac_bits - 1)))
            ),
            table_entries=entries,
        )
    except InputError as refusal:  # bias wider than 16 bits, accumulator above 32 bits, ...
        event(str(refusal).split("field ")[1].split(":")[0])
        return None


@given(configurations().filter(lambda config: config is not None), st.integers(0, 2**31))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_fixed_cells_equal_plain_integers(config, seed):
    check_against_plain(config, seed)


def check_against_plain(config, seed, touches=2, steps=5):
    rng = np.random.default_rng(seed)
    arrays = {}
    for name, shape in network_shapes(config, real=False).items():
        fmt = network_formats(config)[name]
        full = rng.integers(fmt.min_code, fmt.max_code, shape, endpoint=True)
        arrays[name] = full if rng.random() < 0.5 else full // 4 + 1
    features = rng.integers(
        config.formats.feature_format.min_code,
        config.formats.feature_format.max_code,
        (touches, steps, config.sensor.taxels),
        endpoint=True,
    )
    if rng.random() < 0.5:
        features //= 4
    tensors = {name: torch.tensor(array, dtype=torch.float64) for name, array in arrays.items()}
    hidden, logits = run_cell(Fixed(config), config, tensors, torch.tensor(features, dtype=torch.float64))
    for touch in range(touches):
        states, expected = Plain(config, arrays).touch(features[touch])
        np.testing.assert_array_equal(hidden[touch].numpy(), states)
        np.testing.assert_array_equal(logits[touch].numpy(), expected)


@each_row("name", ["thesis", "pvdf"])
@each_row(("cell", "reset"), CELLS)
def test_fixed_cells_equal_plain_integers_in_the_presets(name, cell, reset):
    for seed in range(3):
        check_against_plain(with_network(PRESETS[name], cell=cell, reset=reset), seed, touches=1, steps=20)


# ---------------------------------------------------------------------- float cells
def random_network(config, seed, **kwargs):
    """A float network whose biases are not 0."""
    network = RecurrentClassifier(config, generator=torch.Generator().manual_seed(seed), **kwargs).double()
    assert all(bool((weight != 0).all()) for weight in network.weights.values())
    return network


def test_float_gru_reset_after_equals_torch():
    config = with_network(PRESETS["thesis"], reset="after")
    network = random_network(config, 3)
    p = {name: weight.detach() for name, weight in network.weights.items()}
    theirs = torch.nn.GRU(config.sensor.taxels, config.network.hidden, batch_first=True).double()
    order = "rzn"  # torch's gate order
    theirs.weight_ih_l0.data = torch.cat([p[f"W_{gate}"] for gate in order])
    theirs.weight_hh_l0.data = torch.cat([p[f"U_{gate}"] for gate in order])
    theirs.bias_ih_l0.data = torch.cat([p[f"b_{gate}"] for gate in order])
    theirs.bias_hh_l0.data = torch.cat([p[f"bh_{gate}"] for gate in order])
    x = torch.randn(
        5, 20, config.sensor.taxels, dtype=torch.float64, generator=torch.Generator().manual_seed(4)
    )
    hidden, logits = run_cell(Float(config), config, p, x)
    torch.testing.assert_close(hidden, theirs(x)[0], rtol=0, atol=1e-12)
    torch.testing.assert_close(logits, hidden @ p["V"].T + p["b_y"], rtol=0, atol=1e-12)


def test_float_lstm_equals_torch():
    config = with_network(PRESETS["thesis"], cell="lstm", hidden=10)
    p = {name: weight.detach() for name, weight in random_network(config, 5).weights.items()}
    theirs = torch.nn.LSTM(config.sensor.taxels, config.network.hidden, batch_first=True).double()
    theirs.weight_ih_l0.data = torch.cat([p[f"W_{gate}"] for gate in "ifgo"])
    theirs.weight_hh_l0.data = torch.cat([p[f"U_{gate}"] for gate in "ifgo"])
    theirs.bias_ih_l0.data = torch.cat([p[f"b_{gate}"] for gate in "ifgo"])
    theirs.bias_hh_l0.data.zero_()
    x = torch.randn(
        5, 20, config.sensor.taxels, dtype=torch.float64, generator=torch.Generator().manual_seed(6)
    )
    torch.testing.assert_close(run_cell(Float(config), config, p, x)[0], theirs(x)[0], rtol=0, atol=1e-12)


@each_row("activation", ["sigmoid", "hard_sigmoid"])
def test_float_gru_reset_before_equals_numpy(activation):
    config = PRESETS["thesis"].replace(gate_activation=activation)
    p = {name: weight.detach().numpy() for name, weight in random_network(config, 7).weights.items()}
    rng = np.random.default_rng(8)
    x = rng.normal(0, 3, (20, config.sensor.taxels))  # wide enough for the hard sigmoid to clip

    def sigmoid(v):
        return (
            1 / (1 + np.exp(-v)) if activation == "sigmoid" else np.minimum(1, np.maximum(0, 0.2 * v + 0.5))
        )

    h, expected = np.zeros(config.network.hidden), []
    for row in x:
        z = sigmoid(p["W_z"] @ row + p["U_z"] @ h + p["b_z"])
        r = sigmoid(p["W_r"] @ row + p["U_r"] @ h + p["b_r"])
        n = np.tanh(p["W_n"] @ row + p["U_n"] @ (r * h) + p["b_n"])
        h = z * h + (1 - z) * n
        expected.append(h)
    tensors = {name: torch.from_numpy(array) for name, array in p.items()}
    hidden, _ = run_cell(Float(config), config, tensors, torch.from_numpy(x)[None])
    np.testing.assert_allclose(hidden[0].numpy(), expected, rtol=0, atol=1e-12)


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
            one = {name: weight[fold, seed] for name, weight in many.weights.items()}
            _, alone = run_cell(Float(config), config, one, x[fold, 0])
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


def test_hard_sigmoid_reaches_both_ends():
    config = PRESETS["thesis"].replace(gate_activation="hard_sigmoid")
    table = sigmoid_table(config)
    assert table[0] == 0 and table[-1] == config.gate_one  # clipped beyond +-2.5


@given(
    st.integers(-8192, 8191),
    st.integers(-8192, 8191),
    st.sampled_from([0, 1, 1 << 12, (1 << 13) - 1, 1 << 13]),
)
@settings(deadline=None, derandomize=True)
def test_a_blend_lies_between_its_values_and_is_exact_at_both_ends(h, n, z):
    """z + (1 - z) = 1 for every gate code: h' is h at 1 and n at 0, and h where h = n."""
    a = Fixed(PRESETS["thesis"])
    for new in (h, n):
        blend = a.state(torch.tensor([float(z * h)], dtype=torch.float64) + (a.one - z) * new).item()
        assert min(h, new) <= blend <= max(h, new) and (z not in (0, a.one) or blend == (h if z else new))
