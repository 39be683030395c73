"""Gradient descent as every network here is trained: Adam, a one-cycle schedule or a constant rate."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import torch

Progress = Callable[[int, int], None]
"""Called with (updates done, updates in all)."""


def descend(
    parameters: Iterable[torch.Tensor],
    loss_of: Callable[[], torch.Tensor],
    rate: float,
    updates: int,
    *,
    one_cycle: bool = True,
    after: Callable[[int, torch.Tensor], None] = lambda done, loss: None,
) -> None:
    """Minimise the sum of ``loss_of()``, drawn anew for each of the ``updates``: networks that share nothing
    are each trained by their own loss.

    rate: the largest of the schedule, or constant. after: called with (updates done, the loss) after each.
    """
    optimiser = torch.optim.Adam(parameters, lr=rate, foreach=True)
    schedule = (
        torch.optim.lr_scheduler.OneCycleLR(optimiser, rate, total_steps=updates) if one_cycle else None
    )
    for done in range(1, updates + 1):
        loss = loss_of()
        optimiser.zero_grad()
        loss.sum().backward()
        optimiser.step()
        if schedule:
            schedule.step()
        after(done, loss.detach())
