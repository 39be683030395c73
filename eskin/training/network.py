"""The float network as a torch module."""

from typing import Any

import numpy as np
import torch

from eskin.golden.core import AcceleratorConfig
from eskin.golden.model import Float, network_shapes, run_cell


class RecurrentClassifier(torch.nn.Module):
    """The float network as a torch module: recurrent cell and dense layer, logits after every step.

    Parameters
    ----------
    config:
        Sizes, cell, reset and gate activation.
    batch:
        Leading dimensions of every parameter, (folds, seeds) say: independent networks that train at once.
    generator:
        Source of the initial weights, uniform within +-1/sqrt(H) as in torch's own cells.
    """

    def __init__(
        self, config: AcceleratorConfig, *, batch: tuple[int, ...] = (), generator: torch.Generator
    ) -> None:
        super().__init__()
        self.config = config
        bound = config.network.hidden**-0.5
        self.weights = torch.nn.ParameterDict(
            {
                name: torch.nn.Parameter((torch.rand(*batch, *shape, generator=generator) * 2 - 1) * bound)
                for name, shape in network_shapes(config, real=True).items()
            }
        )
        # written out for the cell that most trainings use; run_cell computes the others
        cell = config.network
        plain = (cell.cell, cell.reset, cell.gate_activation) == ("gru", "before", "sigmoid")
        self._by_hand = plain and len(batch) == 1

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """Logits (..., touches, steps, C) of real features (..., touches, steps, inputs)."""
        if self._by_hand and features.ndim == 4:
            return _gru_logits(dict(self.weights), features)
        return run_cell(Float(self.config), self.config, dict(self.weights), features)[1]

    def arrays(self) -> dict[str, np.ndarray]:
        """Copies of the parameters, float64."""
        return {name: weight.detach().double().numpy().copy() for name, weight in self.weights.items()}


def _gru_logits(p: dict[str, torch.Tensor], features: torch.Tensor) -> torch.Tensor:
    """Result of `run_cell` for a GRU with reset before, for networks side by side, in a fraction of the
    time: touches are the last axis, and the gradient of the steps is written out."""
    networks, touches, steps, inputs = features.shape
    x = features.permute(0, 3, 2, 1).reshape(networks, inputs, -1)
    w, b = (torch.cat([p[f"{kind}_{gate}"] for gate in "zrn"], 1) for kind in "Wb")
    u = torch.cat([p["U_z"], p["U_r"]], 1)
    rows = torch.baddbmm(b[..., None], w, x).view(networks, -1, steps, touches)
    hidden: torch.Tensor = _Steps.apply(rows.permute(2, 0, 1, 3), u, p["U_n"])
    hidden = hidden.permute(1, 2, 0, 3).flatten(2)
    logits = torch.baddbmm(p["b_y"][..., None], p["V"], hidden)
    return logits.view(networks, -1, steps, touches).permute(0, 3, 2, 1)


class _Steps(torch.autograd.Function):
    """h' (steps, networks, H, touches) after every step of a GRU, from the input's part of its rows z, r, n
    (steps, networks, 3 H, touches) and the matrices for the state, (networks, 2 H, H) and (networks, H, H).
    The gradient is of z, r = sig(row + u h), n = tanh(row + u_n (r h)), h' = z h + (1 - z) n."""

    @staticmethod
    def forward(ctx: Any, rows: torch.Tensor, u: torch.Tensor, u_n: torch.Tensor) -> torch.Tensor:
        steps, networks, width, touches = rows.shape
        size = width // 3
        h = rows.new_zeros(steps + 1, networks, size, touches)
        gates = rows.new_empty(steps, networks, 2 * size, touches)
        n = torch.empty_like(h[1:])
        for k in range(steps):
            before, row = h[k], rows[k]
            z, r = torch.baddbmm(row[:, : 2 * size], u, before, out=gates[k]).sigmoid_().chunk(2, 1)
            torch.baddbmm(row[:, 2 * size :], u_n, r * before, out=n[k]).tanh_()
            torch.addcmul(n[k], z, before - n[k], out=h[k + 1])
        ctx.save_for_backward(h, gates, n, u, u_n)
        return h[1:]

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor, ...]:
        h, gates, n, u, u_n = ctx.saved_tensors
        before, (z, r) = h[:-1], gates.chunk(2, 2)
        # of_n, of_z, of_r: local derivatives of the rows, all steps at once; of_state, the gradient of the
        # state, comes back from the following step
        of_n, of_z, of_r = (1 - z) * (1 - n * n), (before - n) * z * (1 - z), before * r * (1 - r)
        rows = n.new_empty(*n.shape[:2], 3 * n.shape[2], n.shape[3])
        row, row_n = rows.split([u.shape[1], u_n.shape[1]], 2)
        row_z, row_r = row.chunk(2, 2)
        u, u_n = u.mT.contiguous(), u_n.mT.contiguous()
        of_state = torch.zeros_like(n[0])
        for k in reversed(range(len(n))):
            of_state += gradient[k]
            torch.mul(of_state, of_n[k], out=row_n[k])
            gated = u_n @ row_n[k]
            torch.mul(of_state, of_z[k], out=row_z[k])
            torch.mul(gated, of_r[k], out=row_r[k])
            of_state = torch.baddbmm(torch.addcmul(of_state * z[k], gated, r[k]), u, row[k])
        return rows, (row @ before.mT).sum(0), (row_n @ (r * before).mT).sum(0)
