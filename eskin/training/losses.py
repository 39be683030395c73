"""Losses of networks, and gradient descent on them."""

from collections.abc import Callable, Iterable

import torch

from eskin.training.recipe import Recipe

EPOCHS = 20
"""Number of calls of a callback during a training."""


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
    """Minimise the sum of ``loss_of()``, which is drawn again for each of the ``updates``. Networks share no
    parameters, so each is trained by a separate loss.

    rate: the largest of the schedule, or constant. after: called with (updates done, the loss) after each.
    """
    optimiser = torch.optim.Adam(parameters, lr=rate, foreach=True)
    schedule = (
        torch.optim.lr_scheduler.OneCycleLR(optimiser, rate, total_steps=updates) if one_cycle else None
    )
    for update in range(1, updates + 1):
        loss = loss_of()
        optimiser.zero_grad()
        loss.sum().backward()  # a sum, not a mean: no network's gradient depends on how many are trained
        optimiser.step()
        if schedule:
            schedule.step()
        after(update, loss.detach())


def class_loss(
    recipe: Recipe, logits: torch.Tensor, labels: torch.Tensor, counts: torch.Tensor
) -> torch.Tensor:
    """(models) loss of logits (models, batch, steps, C), over the steps that count: cross-entropy, or with
    least squares the distance from the classes' indicators."""
    wanted = labels[..., None].expand(counts.shape)
    if recipe.squares:
        losses = ((logits - torch.nn.functional.one_hot(wanted, logits.shape[-1])) ** 2).sum(-1)
    else:
        losses = torch.nn.functional.cross_entropy(logits.movedim(-1, 1), wanted, reduction="none")
    if recipe.loss == "last":
        last = counts.sum(-1, keepdim=True) - 1  # the steps that count come first
        return losses.gather(-1, last).mean(dim=(1, 2))
    return (losses * counts).sum(dim=(1, 2)) / counts.sum(dim=(1, 2))


def teacher_loss(logits: torch.Tensor, teacher: torch.Tensor, counts: torch.Tensor) -> torch.Tensor:
    """(models) cross-entropy of the teacher's class probabilities, over the steps that count."""
    losses = -(teacher.double().softmax(-1) * logits.log_softmax(-1)).sum(-1)
    return (losses * counts).sum(dim=(1, 2)) / counts.sum(dim=(1, 2))


Callback = Callable[[int, dict[str, float]], None]
"""Called with (epoch, figures) while a network is trained."""


class EpochReporter:
    """Calls ``callback`` with the mean ``loss`` since the epoch before, EPOCHS times in a training."""

    def __init__(self, callback: Callback) -> None:
        self._callback, self._trained = callback, list[float]()
        self.epoch = 0

    def note(self, done: int, total: int, loss: torch.Tensor) -> None:
        """After each update: its ``loss`` (networks)."""
        self._trained.append(float(loss.mean()))
        if done * EPOCHS // total != (done - 1) * EPOCHS // total:
            self.tell(loss=sum(self._trained) / len(self._trained))
            self._trained = []

    def tell(self, **figures: float) -> None:
        """Report the next epoch, with ``figures``."""
        self.epoch += 1
        self._callback(self.epoch, figures)
