"""Losses of networks, their descent, and their curves while they are trained."""

import dataclasses
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import torch

from eskin.golden.core import AcceleratorConfig
from eskin.training.batches import Batches, TouchPool
from eskin.training.datasets import Dataset
from eskin.training.network import RecurrentClassifier
from eskin.training.recipe import AS_RECORDED, Recipe

CURVE_POINTS = 20
"""Points of a training curve at most."""

CURVE_TOUCHES = 64
"""Touches on which a point's loss of unseen recordings is taken: drawn once, so that points differ by the
network alone."""

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
    """(models) loss of logits (models, batch, steps, C), over the steps that count: cross-entropy, or, of least
    squares, the distance from the classes' indicators."""
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


class Told:
    """Tells ``callback`` the mean ``loss`` since the epoch before, CURVE_POINTS times in a training; in place
    of `LossCurves` where one network is trained."""

    def __init__(self, callback: Callback) -> None:
        self._callback, self._trained = callback, list[float]()
        self.epoch = 0

    def begin(self, share: slice) -> None:
        """As of `LossCurves`."""

    def note(self, done: int, total: int, loss: torch.Tensor, *_: Any) -> None:
        """After each update: its ``loss`` (networks)."""
        self._trained.append(float(loss.mean()))
        if done * CURVE_POINTS // total != (done - 1) * CURVE_POINTS // total:
            self.tell(loss=sum(self._trained) / len(self._trained))
            self._trained = []

    def tell(self, **figures: float) -> None:
        """The next epoch, with ``figures``."""
        self.epoch += 1
        self._callback(self.epoch, figures)


class LossCurves:
    """Losses of networks while they are trained, at ``CURVE_POINTS`` points.

    updates: the gradient steps done at each point. losses: (points, networks, 2); first on what was trained
    on, augmented, mean since the point before; then on touches that the network has not seen, as they were
    recorded (nan where its part of the test has none).

    Parameters
    ----------
    tests:
        Rows of the touches that each network has not seen.
    """

    def __init__(
        self, data: Dataset, config: AcceleratorConfig, recipe: Recipe, tests: list[np.ndarray]
    ) -> None:
        self._data, self._config, self._recipe = data, config, recipe
        # a generator of its own, so that training draws the same with and without a curve
        generator = torch.Generator().manual_seed(0)
        self._unseen = torch.tensor([bool(len(rows)) for rows in tests])
        draws = [
            torch.randint(max(len(rows), 1), (CURVE_TOUCHES,), generator=generator).numpy() for rows in tests
        ]
        self._rows = [rows[drawn] if len(rows) else drawn for rows, drawn in zip(tests, draws, strict=True)]
        self._share, self._shares = slice(None), list[list[np.ndarray]]()
        self._touches: tuple[torch.Tensor, torch.Tensor, torch.Tensor] | None = None
        self._trained: list[torch.Tensor] = []
        self.updates: list[int] = []

    def begin(self, share: slice) -> None:
        """From now on ``note`` gets the losses of these networks alone."""
        self._share, self._touches, self._trained, self.updates = share, None, [], []
        self._shares.append([])

    @property
    def losses(self) -> np.ndarray:
        """(points, networks, 2), as the class says."""
        if not self.updates:
            return np.zeros((0, len(self._rows), 2))
        return np.concatenate([np.array(points) for points in self._shares], axis=1)

    def note(
        self,
        done: int,
        total: int,
        loss: torch.Tensor,
        network: RecurrentClassifier,
        scales: list[tuple[float, float]],
    ) -> None:
        """After each update: its ``loss`` (networks); at a point also that on unseen touches, scaled as the
        training part is."""
        self._trained.append(loss)
        if done * CURVE_POINTS // total == (done - 1) * CURVE_POINTS // total:
            return
        if self._touches is None:
            plain = dataclasses.replace(self._recipe, **AS_RECORDED)
            generator, rows = torch.Generator(), self._rows[self._share]
            pool = TouchPool(rows, generator)
            self._touches = Batches(
                self._data, self._config, plain, rows, generator, scales=scales, pool=pool
            ).recorded()
        features, labels, counts = self._touches
        with torch.no_grad():
            unseen = class_loss(self._recipe, network(features), labels, counts)
            unseen = unseen.where(self._unseen[self._share], torch.nan)
        point = torch.stack([torch.stack(self._trained).mean(0), unseen], dim=-1).double().numpy()
        self.updates.append(done)
        self._shares[-1].append(point)
        self._trained = []
