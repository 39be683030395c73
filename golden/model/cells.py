"""The cells and the dense layer, each written once over an arithmetic object (docs/specification.md, sections
4 to 6).

``Float`` computes in real numbers and trains; ``Fixed`` computes in codes, bit-true to the specification,
with straight-through gradients. Every parameter may carry leading batch dimensions (folds x seeds, say), so
that many networks run at once.

Parameters are a mapping from the names of docs/specification.md section 8 (``W_z`` ... ``b_y``) to tensors; a
float network with reset after has a second bias row ``bh_z``, ``bh_r``, ``bh_n``, as in torch.
"""

import sys
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, QFormat, sigmoid_table, tanh_table
from eskin.golden.model.forest import run_forest

Array = Any
"""A numpy array, or a torch tensor where gradients are wanted; this module never imports torch, the caller
that has tensors does."""

Parameters = Mapping[str, Array]


def _library(array: Array) -> Any:
    """numpy or torch: both name the functions used here alike."""
    # sys.modules, not import: whoever has a tensor has imported torch, and numpy users need none
    return np if isinstance(array, np.ndarray) else sys.modules["torch"]


def _parts(array: Array, *widths: int) -> list[Array]:
    """``array`` cut along its last dimension."""
    ends = np.cumsum(widths)
    return [array[..., end - width : end] for width, end in zip(widths, ends, strict=True)]


def _in_rows(array: Array) -> Array:
    """(..., touches, steps, width) as (..., touches * steps, width)."""
    return array.reshape(*array.shape[:-3], array.shape[-3] * array.shape[-2], array.shape[-1])


def _sigmoid(acc: Array) -> Array:
    # by way of tanh, because exp(-acc) overflows
    return (
        0.5 * (1.0 + np.tanh(0.5 * acc)) if isinstance(acc, np.ndarray) else sys.modules["torch"].sigmoid(acc)
    )


class Float:
    """Real arithmetic: gates in 0..1, states and values as they are, no rounding and no saturation."""

    unit = 1.0

    def __init__(self, config: AcceleratorConfig) -> None:
        self._hard = config.network.gate_activation == "hard_sigmoid"

    def operand(self, feature: Array) -> Array:
        """A feature as the lanes' operand."""
        return feature

    def bias(self, bias: Array) -> Array:
        """A gate-row bias at the scale of the products."""
        return bias

    def dense_bias(self, bias: Array) -> Array:
        """A dense bias at the scale of the dense products."""
        return bias

    def sigmoid(self, acc: Array) -> Array:
        """Gate of a row: sigmoid, or ``clip(0.2 x + 0.5, 0, 1)``."""
        return (0.2 * acc + 0.5).clip(0.0, 1.0) if self._hard else _sigmoid(acc)

    def tanh(self, acc: Array) -> Array:
        """tanh of a row."""
        return _library(acc).tanh(acc)

    def tanh_of_state(self, value: Array) -> Array:
        """tanh of a value in the state format."""
        return _library(value).tanh(value)

    def value(self, acc: Array) -> Array:
        """A row as a value in the state format."""
        return acc

    def state(self, products: Array) -> Array:
        """A sum of gate x value products as a value in the state format."""
        return products

    def logit(self, acc: Array) -> Array:
        """A dense row as a logit."""
        return acc


class Fixed:
    """Integer arithmetic in codes, bit-true to docs/specification.md sections 4 to 6.

    Values are float64 arrays or tensors that hold integers below 2**53: products and sums are exact in any
    order, and matrix products run at the speed of floating point. Gradients pass the roundings unchanged, are
    0 where a value saturates, and use the true sigmoid and tanh at the table look-ups.
    """

    def __init__(self, config: AcceleratorConfig) -> None:
        self._config = config
        self.unit = float(config.gate_one)
        self._sigmoid = sigmoid_table(config).astype(np.float64)
        self._tanh = tanh_table(config).astype(np.float64)
        self._smooth_sigmoid = Float(config).sigmoid

    def operand(self, feature: Array) -> Array:
        """``feature << feature_align`` (exact)."""
        return feature * 2.0**self._config.feature_align

    def bias(self, bias: Array) -> Array:
        """``bias << bias_shift``; the rounding half belongs to the narrowing that follows."""
        return bias * 2.0**self._config.bias_shift

    def dense_bias(self, bias: Array) -> Array:
        """``bias << dense_bias_shift``."""
        return bias * 2.0**self._config.dense_bias_shift

    def sigmoid(self, acc: Array) -> Array:
        """``sig[narrow(acc, sigmoid_shift, index_format)]``, a gate code."""
        unit, shift = 2.0**self._config.product_frac, self._config.sigmoid_shift
        return self._look_up(self._sigmoid, acc, shift, lambda: self._smooth_sigmoid(acc / unit) * self.unit)

    def tanh(self, acc: Array) -> Array:
        """``tanh[narrow(acc, tanh_shift, index_format)]``, a state code."""
        return self._tanh_at(acc, self._config.tanh_shift, self._config.product_frac)

    def tanh_of_state(self, value: Array) -> Array:
        """``tanh[narrow(value, state_index_shift, index_format)]``, a state code."""
        return self._tanh_at(
            value, self._config.state_index_shift, self._config.formats.state_format.frac_bits
        )

    def value(self, acc: Array) -> Array:
        """``narrow(acc, value_shift, state_format)``."""
        return self._narrow(acc, self._config.value_shift, self._config.formats.state_format)

    def state(self, products: Array) -> Array:
        """``narrow(products, gate_frac, state_format)``."""
        return self._narrow(products, self._config.formats.gate_frac, self._config.formats.state_format)

    def logit(self, acc: Array) -> Array:
        """``narrow(acc, logit_shift, logit_format)``."""
        return self._narrow(acc, self._config.logit_shift, self._config.formats.logit_format)

    @staticmethod
    def _narrow(value: Array, shift: int, fmt: QFormat) -> Array:
        """SAT(floor((value + 2**(shift-1)) / 2**shift)): adding the half after the division is exact too, and
        RND_0 is the identity."""
        scaled = value * 2.0**-shift
        if shift and isinstance(value, np.ndarray):
            scaled = np.floor(scaled + 0.5)
        elif shift:
            smooth = scaled
            # floor has no gradient; the saturation below keeps a gradient, 0 outside of the format
            scaled = _with_gradient(
                _library(value).floor(smooth.detach() + 0.5), lambda: smooth, smooth.requires_grad
            )
        return scaled.clip(fmt.min_code, fmt.max_code)

    def _tanh_at(self, value: Array, shift: int, frac_bits: int) -> Array:
        unit = 2.0**self._config.formats.state_format.frac_bits
        return self._look_up(
            self._tanh, value, shift, lambda: _library(value).tanh(value / 2.0**frac_bits) * unit
        )

    def _look_up(self, table: np.ndarray, value: Array, shift: int, smooth: Callable[[], Array]) -> Array:
        if isinstance(value, np.ndarray):
            return table[
                self._narrow(value, shift, self._config.index_format).astype(np.int64) + len(table) // 2
            ]
        index = self._narrow(value.detach(), shift, self._config.index_format).long() + len(table) // 2
        return _with_gradient(sys.modules["torch"].from_numpy(table)[index], smooth, value.requires_grad)


def _with_gradient(exact: Array, smooth: Callable[[], Array], with_gradient: bool) -> Array:
    """The values of ``exact``; if a gradient is needed, with the gradient of ``smooth()``."""
    if not with_gradient:
        return exact
    from eskin.golden.model.straight_through import straight_through

    return straight_through(exact, smooth())


Arithmetic = Float | Fixed


def apply_rows(matrix: Array, vector: Array) -> Array:
    """``matrix @ vector`` for every item: matrix (..., rows, columns), vector (..., items, columns) -> (...,
    items, rows)."""
    return vector @ matrix.swapaxes(-1, -2)


def _gru(
    a: Arithmetic, pre: dict[str, Array], u: dict[str, Array], state: tuple[Array, ...]
) -> tuple[Array, ...]:
    """z, r = sig(row); n = tanh(Wn x + Un (r h) + bn), or with reset after (``bh_n``) tanh(Wn x + bn + r (Un
    h + bhn)); h' = z h + (1 - z) n."""
    (h,) = state
    z, r = _parts(a.sigmoid(pre["sigmoid"] + apply_rows(u["sigmoid"], h)), h.shape[-1], h.shape[-1])
    if "bh_n" in pre:
        hn = a.value(apply_rows(u["n"], h) + pre["bh_n"])
        wx = a.value(pre["n"])
        n = a.tanh_of_state(a.state(r * hn + a.unit * wx))
    else:
        rh = a.state(r * h)
        n = a.tanh(pre["n"] + apply_rows(u["n"], rh))
    return (a.state(z * h + (a.unit - z) * n),)


def _lstm(
    a: Arithmetic, pre: dict[str, Array], u: dict[str, Array], state: tuple[Array, ...]
) -> tuple[Array, ...]:
    """i, f, o = sig(row); g = tanh(row); c' = f c + i g; h' = o tanh(c')."""
    h, c = state
    i, f, o = _parts(a.sigmoid(pre["sigmoid"] + apply_rows(u["sigmoid"], h)), *[h.shape[-1]] * 3)
    g = a.tanh(pre["g"] + apply_rows(u["g"], h))
    c = a.state(f * c + i * g)
    return a.state(o * a.tanh_of_state(c)), c


_CELLS = {"gru": _gru, "lstm": _lstm}


def _run_linear(a: Arithmetic, parameters: Parameters, features: Array) -> tuple[Array, Array]:
    """l_k = l_(k-1) + V_k x_k from l_0 = b_y. The sum stays in the accumulator's format; each step's logit is
    narrowed from it."""
    x = a.operand(features).swapaxes(-3, -2)  # steps before touches: each step has other weights
    sums = apply_rows(parameters["V"], x).cumsum(-3) + a.dense_bias(parameters["b_y"])[..., None, None, :]
    return features[..., :0], a.logit(sums).swapaxes(-3, -2)


def run_cell(
    a: Any, config: AcceleratorConfig, parameters: Parameters, features: Array
) -> tuple[Array, Array]:
    """Run the configured cell and the dense layer over whole touches. At the start h (and c) are 0, and the
    sums of a linear cell equal the bias.

    Parameters
    ----------
    a:
        ``Float(config)``, ``Fixed(config)`` or `eskin.golden.model.torch_model.Int64`.
    parameters:
        Name -> tensor (..., rows[, columns]); codes for Fixed.
    features:
        (..., touches, steps, inputs); the leading dimensions broadcast against the parameters' leading dimensions.

    Returns
    -------
    (hidden, logits):
        h' (..., touches, steps, H) and logits (..., touches, steps, C) after every step; a linear cell has H
        = 0, and so have trees, which take numpy arrays without leading dimensions alone.
    """
    if config.is_forest:
        return run_forest(config, parameters, features)
    if not config.recurrent:
        return _run_linear(a, parameters, features)
    p, xp, network = parameters, _library(features), config.network
    through_sigmoid, through_tanh = (("i", "f", "o"), "g") if network.cell == "lstm" else (("z", "r"), "n")
    reset_after = network.cell == "gru" and network.reset == "after"

    def bias(gate: str) -> Array:
        # of the two bias rows of a float reset-after GRU only bh_n stands inside the reset product; the rows of
        # the other gates are added up
        return p[f"b_{gate}"] + p[f"bh_{gate}"] if gate != "n" and f"bh_{gate}" in p else p[f"b_{gate}"]

    w = xp.concatenate([p[f"W_{gate}"] for gate in (*through_sigmoid, through_tanh)], -2)
    b = xp.concatenate([bias(gate) for gate in (*through_sigmoid, through_tanh)], -1)
    u = {
        "sigmoid": xp.concatenate([p[f"U_{gate}"] for gate in through_sigmoid], -2),
        through_tanh: p[f"U_{through_tanh}"],
    }
    touches, steps = features.shape[-3:-1]
    # W x of all steps in one product; only U h has to wait for the step before
    rows = apply_rows(w, _in_rows(a.operand(features))) + a.bias(b)[..., None, :]
    rows = rows.reshape(*rows.shape[:-2], touches, steps, rows.shape[-1])
    widths = (len(through_sigmoid) * network.hidden, network.hidden)

    zero = xp.zeros_like(rows[..., 0, : network.hidden])
    state: tuple[Array, ...] = (zero, zero) if network.cell == "lstm" else (zero,)
    step = _CELLS[network.cell]
    hidden = []
    for k in range(steps):
        pre = dict(zip(("sigmoid", through_tanh), _parts(rows[..., k, :], *widths), strict=True))
        if reset_after:
            pre["bh_n"] = a.bias(p["bh_n"])[..., None, :]
        state = step(a, pre, u, state)
        hidden.append(state[0])
    h = xp.stack(hidden, -2)
    logits = a.logit(apply_rows(p["V"], _in_rows(h)) + a.dense_bias(p["b_y"])[..., None, :])
    return h, logits.reshape(*logits.shape[:-2], touches, steps, logits.shape[-1])
