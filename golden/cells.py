"""The recurrent cells and the dense layer, each written once over an arithmetic object (SPECIFICATION.md, sections 4 to 6).

``Float`` computes in real numbers and trains; ``Fixed`` computes in codes, bit-true to the specification, with straight-through
gradients. Every parameter may carry leading batch dimensions (folds x seeds, say), so that many networks run at once.

Parameters are a mapping from the names of SPECIFICATION.md section 8 (``W_z`` ... ``b_y``) to tensors; a float network with reset
after has a second bias row ``bh_z``, ``bh_r``, ``bh_n``, as in torch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import torch
from torch import Tensor

from golden.activation import sigmoid_table, tanh_table
from golden.config import AcceleratorConfig
from golden.formats import QFormat

Parameters = Mapping[str, Tensor]


class Float:
    """Real arithmetic: gates in 0..1, states and values as they are, no rounding and no saturation."""

    one = 1.0

    def __init__(self, config: AcceleratorConfig) -> None:
        self._hard = config.gate_activation == "hard_sigmoid"

    def operand(self, feature: Tensor) -> Tensor:
        """A feature as the lanes' operand."""
        return feature

    def recurrent(self, name: str, vector: Tensor) -> Tensor:
        """What U multiplies at this step: the vector itself; ``name`` says which, h or rh."""
        return vector

    def hidden(self, states: Tensor) -> Tensor:
        """What the dense layer multiplies, (..., touches, steps, H): the states themselves."""
        return states

    def bias(self, bias: Tensor) -> Tensor:
        """A gate-row bias at the scale of the products."""
        return bias

    def dense_bias(self, bias: Tensor) -> Tensor:
        """A dense bias at the scale of the dense products."""
        return bias

    def sigmoid(self, acc: Tensor) -> Tensor:
        """Gate of a row: sigmoid, or ``clip(0.2 x + 0.5, 0, 1)``."""
        return (0.2 * acc + 0.5).clamp(0.0, 1.0) if self._hard else torch.sigmoid(acc)

    def tanh(self, acc: Tensor) -> Tensor:
        """tanh of a row."""
        return torch.tanh(acc)

    def tanh_of_state(self, value: Tensor) -> Tensor:
        """tanh of a value in the state format."""
        return torch.tanh(value)

    def value(self, acc: Tensor) -> Tensor:
        """A row as a value in the state format."""
        return acc

    def state(self, products: Tensor) -> Tensor:
        """A sum of gate x value products as a value in the state format."""
        return products

    def logit(self, acc: Tensor) -> Tensor:
        """A dense row as a logit."""
        return acc


class _Through(torch.autograd.Function):
    """Forward: ``exact``, bit for bit. Backward: the gradient of ``smooth`` (straight through the rounding)."""

    @staticmethod
    def forward(ctx, exact: Tensor, smooth: Tensor) -> Tensor:
        return exact.view_as(exact)

    @staticmethod
    def backward(ctx, gradient: Tensor):
        return None, gradient


def straight_through(exact: Tensor, smooth: Tensor) -> Tensor:
    """``exact`` with the gradient of ``smooth``."""
    return _Through.apply(exact, smooth)


class Fixed:
    """Integer arithmetic in codes, bit-true to SPECIFICATION.md sections 4 to 6.

    Values are float64 tensors that hold integers below 2**53: products and sums are exact in any order, and matrix products run at
    the speed of floating point. Gradients pass the roundings unchanged, are 0 where a value saturates, and use the true sigmoid and
    tanh at the table look-ups.
    """

    def __init__(self, config: AcceleratorConfig) -> None:
        self._config = config
        self.one = float(config.gate_one)
        self._sigmoid = torch.from_numpy(sigmoid_table(config)).double()
        self._tanh = torch.from_numpy(tanh_table(config)).double()
        self._smooth_sigmoid = Float(config).sigmoid

    def operand(self, feature: Tensor) -> Tensor:
        """``feature << feature_align`` (exact)."""
        return feature * 2.0**self._config.feature_align

    def recurrent(self, name: str, vector: Tensor) -> Tensor:
        """What U multiplies at this step: the vector itself; ``name`` says which, h or rh."""
        return vector

    def hidden(self, states: Tensor) -> Tensor:
        """What the dense layer multiplies, (..., touches, steps, H): the states themselves."""
        return states

    def bias(self, bias: Tensor) -> Tensor:
        """``bias << bias_shift``; the rounding half belongs to the narrowing that follows."""
        return bias * 2.0**self._config.bias_shift

    def dense_bias(self, bias: Tensor) -> Tensor:
        """``bias << dense_bias_shift``."""
        return bias * 2.0**self._config.dense_bias_shift

    def sigmoid(self, acc: Tensor) -> Tensor:
        """``sig[narrow(acc, sigmoid_shift, index_format)]``, a gate code."""
        config = self._config
        return self._look_up(
            self._sigmoid, acc, config.sigmoid_shift, lambda: self._smooth_sigmoid(acc / 2.0**config.product_frac) * self.one
        )

    def tanh(self, acc: Tensor) -> Tensor:
        """``tanh[narrow(acc, tanh_shift, index_format)]``, a state code."""
        return self._tanh_at(acc, self._config.tanh_shift, self._config.product_frac)

    def tanh_of_state(self, value: Tensor) -> Tensor:
        """``tanh[narrow(value, state_index_shift, index_format)]``, a state code."""
        return self._tanh_at(value, self._config.state_index_shift, self._config.state_format.frac_bits)

    def value(self, acc: Tensor) -> Tensor:
        """``narrow(acc, value_shift, state_format)``."""
        return self._narrow(acc, self._config.value_shift, self._config.state_format)

    def state(self, products: Tensor) -> Tensor:
        """``narrow(products, gate_frac, state_format)``."""
        return self._narrow(products, self._config.gate_frac, self._config.state_format)

    def logit(self, acc: Tensor) -> Tensor:
        """``narrow(acc, logit_shift, logit_format)``."""
        return self._narrow(acc, self._config.logit_shift, self._config.logit_format)

    @staticmethod
    def _narrow(value: Tensor, shift: int, fmt: QFormat) -> Tensor:
        """SAT(floor((value + 2**(shift-1)) / 2**shift)): adding the half after the division is exact too, and RND_0 is the identity."""
        scaled = value * 2.0**-shift
        if shift:
            rounded = torch.floor(scaled.detach() + 0.5)
            scaled = _Through.apply(rounded, scaled) if scaled.requires_grad else rounded
        return scaled.clamp(fmt.min_code, fmt.max_code)

    def _tanh_at(self, value: Tensor, shift: int, frac_bits: int) -> Tensor:
        unit = 2.0**self._config.state_format.frac_bits
        return self._look_up(self._tanh, value, shift, lambda: torch.tanh(value / 2.0**frac_bits) * unit)

    def _look_up(self, table: Tensor, value: Tensor, shift: int, smooth: Callable[[], Tensor]) -> Tensor:
        index = self._narrow(value.detach(), shift, self._config.index_format).long() + len(table) // 2
        exact = table[index]
        return _Through.apply(exact, smooth()) if value.requires_grad else exact


Arithmetic = Float | Fixed


def apply_rows(matrix: Tensor, vector: Tensor) -> Tensor:
    """``matrix @ vector`` for every item: matrix (..., rows, columns), vector (..., items, columns) -> (..., items, rows)."""
    return vector @ matrix.transpose(-1, -2)


def _gru_before(a: Arithmetic, pre: dict[str, Tensor], u: dict[str, Tensor], state: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
    """z, r = sig(row); n = tanh(Wn x + Un (r h) + bn); h' = z h + (1 - z) n."""
    (h,) = state
    z, r = a.sigmoid(pre["sigmoid"] + apply_rows(u["sigmoid"], a.recurrent("h", h))).chunk(2, dim=-1)
    rh = a.state(r * h)
    n = a.tanh(pre["n"] + apply_rows(u["n"], a.recurrent("rh", rh)))
    return (a.state(z * h + (a.one - z) * n),)


def _gru_after(a: Arithmetic, pre: dict[str, Tensor], u: dict[str, Tensor], state: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
    """z, r = sig(row); n = tanh(Wn x + bn + r (Un h + bhn)); h' = z h + (1 - z) n."""
    (h,) = state
    operand = a.recurrent("h", h)
    z, r = a.sigmoid(pre["sigmoid"] + apply_rows(u["sigmoid"], operand)).chunk(2, dim=-1)
    hn = a.value(apply_rows(u["n"], operand) + pre["bh_n"])
    wx = a.value(pre["n"])
    n = a.tanh_of_state(a.state(r * hn + a.one * wx))
    return (a.state(z * h + (a.one - z) * n),)


def _lstm(a: Arithmetic, pre: dict[str, Tensor], u: dict[str, Tensor], state: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
    """i, f, o = sig(row); g = tanh(row); c' = f c + i g; h' = o tanh(c')."""
    h, c = state
    operand = a.recurrent("h", h)
    i, f, o = a.sigmoid(pre["sigmoid"] + apply_rows(u["sigmoid"], operand)).chunk(3, dim=-1)
    g = a.tanh(pre["g"] + apply_rows(u["g"], operand))
    c = a.state(f * c + i * g)
    return a.state(o * a.tanh_of_state(c)), c


_CELLS = {("gru", "before"): _gru_before, ("gru", "after"): _gru_after, ("lstm", "before"): _lstm, ("lstm", "after"): _lstm}


def run_cell(a: Arithmetic, config: AcceleratorConfig, parameters: Parameters, features: Tensor) -> tuple[Tensor, Tensor]:
    """Run the configured cell and the dense layer over whole touches, h (and c) 0 at the start.

    Parameters
    ----------
    a:
        ``Float(config)`` or ``Fixed(config)``.
    parameters:
        Name -> tensor (..., rows[, columns]); codes for Fixed.
    features:
        (..., touches, steps, taxels); the leading dimensions broadcast against those of the parameters.

    Returns
    -------
    (hidden, logits):
        h' (..., touches, steps, H) and logits (..., touches, steps, C) after every step.
    """
    p = parameters
    through_sigmoid = ("i", "f", "o") if config.cell == "lstm" else ("z", "r")
    through_tanh = "g" if config.cell == "lstm" else "n"
    reset_after = config.cell == "gru" and config.reset == "after"

    def bias(gate: str) -> Tensor:
        # the second bias row of a float reset-after gate is one with the first; only bh_n stands inside the reset product
        return p[f"b_{gate}"] + p[f"bh_{gate}"] if gate != "n" and f"bh_{gate}" in p else p[f"b_{gate}"]

    w = torch.cat([p[f"W_{gate}"] for gate in (*through_sigmoid, through_tanh)], dim=-2)
    b = torch.cat([bias(gate) for gate in (*through_sigmoid, through_tanh)], dim=-1)
    u = {"sigmoid": torch.cat([p[f"U_{gate}"] for gate in through_sigmoid], dim=-2), through_tanh: p[f"U_{through_tanh}"]}
    touches, steps = features.shape[-3:-1]
    rows = apply_rows(w, a.operand(features).flatten(-3, -2)) + a.bias(b).unsqueeze(-2)
    rows = rows.unflatten(-2, (touches, steps))
    widths = (len(through_sigmoid) * config.hidden, config.hidden)

    zero = torch.zeros((*rows.shape[:-2], config.hidden), dtype=rows.dtype)
    state: tuple[Tensor, ...] = (zero, zero) if config.cell == "lstm" else (zero,)
    step = _CELLS[config.cell, config.reset]
    hidden = []
    for row in rows.unbind(dim=-2):
        pre = dict(zip(("sigmoid", through_tanh), row.split(widths, dim=-1), strict=True))
        if reset_after:
            pre["bh_n"] = a.bias(p["bh_n"]).unsqueeze(-2)
        state = step(a, pre, u, state)
        hidden.append(state[0])
    h = torch.stack(hidden, dim=-2)
    logits = a.logit(apply_rows(p["V"], a.hidden(h).flatten(-3, -2)) + a.dense_bias(p["b_y"]).unsqueeze(-2))
    return h, logits.unflatten(-2, (touches, steps))
