"""Gradients through roundings and tables, for training in integers."""

import torch
from torch import Tensor


class _Through(torch.autograd.Function):
    """Forward: ``exact``, bit for bit. Backward: the gradient of ``smooth`` (straight through the
    rounding)."""

    @staticmethod
    def forward(ctx, exact: Tensor, smooth: Tensor) -> Tensor:
        return exact.view_as(exact)

    @staticmethod
    def backward(ctx, gradient: Tensor):
        return None, gradient


def straight_through(exact: Tensor, smooth: Tensor) -> Tensor:
    """``exact`` with the gradient of ``smooth``."""
    return _Through.apply(exact, smooth)
