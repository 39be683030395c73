"""Cost of a whole design, front end included, by which front end and network are chosen.

Energy, cells and latency follow from a configuration by a formula; block memories require the elaborated
design, so they are counted only if the choice depends on them. The figures come from ``eskin.verbs.cost``
through the functions of a `CostModel`, so this module imports no hardware.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar, get_args

from eskin.golden.core import AcceleratorConfig
from eskin.training.record import CandidateCost

Prefer = Literal["energy", "cells", "latency"]
"""Cost to minimise among candidates that are tied in accuracy; energy: average power, then energy of a touch."""
PREFERENCES: tuple[Prefer, ...] = get_args(Prefer)
EQUAL = 1.01
"""Largest ratio of two average powers that count as equal."""

T = TypeVar("T")


class Cost(CandidateCost):
    """touch_s: from the onset to the last sample."""

    touch_s: float


@dataclass(frozen=True, kw_only=True)
class CostModel:
    """Costs of candidates, and the user's preference.

    cost_of, blocks_of, fits: functions of a configuration that return its `Cost`, its block memories, and
    whether it fits ``board``. prefer: the cost to minimise. named: the user named the board, so a candidate
    must fit it; otherwise the board only decides between tied candidates.
    """

    cost_of: Callable[[AcceleratorConfig], Cost]
    blocks_of: Callable[[AcceleratorConfig], int]
    fits: Callable[[AcceleratorConfig], bool]
    board: str
    prefer: Prefer = "energy"
    named: bool = False

    def first(self, cost: Cost) -> float:
        """The preferred cost."""
        return {
            "energy": cost.average_w,
            "cells": float(cost.cells),
            "latency": cost.touch_s + cost.latency_s,
        }[self.prefer]

    def price(self, config: AcceleratorConfig) -> tuple[float, ...]:
        """Sort key of designs of equal average power: the preferred cost, energy, cells, time from onset to last
        sample."""
        cost = self.cost_of(config)
        rest = cost.energy_touch_j, float(cost.cells), cost.touch_s
        return rest if self.prefer == "energy" else (self.first(cost), *rest)

    def sorted(self, designs: Sequence[T], config_of: Callable[[T], AcceleratorConfig]) -> list[T]:
        """Cheapest first. With ``prefer`` energy, average powers within EQUAL of the least count as equal."""
        power = [self.cost_of(config_of(design)).average_w for design in designs]
        least = EQUAL * min(power, default=0.0)
        dear = [self.prefer == "energy" and own > least and own for own in power]
        order = sorted(range(len(designs)), key=lambda i: (dear[i], *self.price(config_of(designs[i]))))
        return [designs[i] for i in order]

    def is_candidate(self, config: AcceleratorConfig) -> bool:
        """False if the user named a board that is too small for ``config``."""
        return not self.named or self.fits(config)


def pareto(places: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """The Pareto front of (cost, accuracy), sorted by cost."""
    front: list[tuple[float, float]] = []
    for place in sorted(places, key=lambda place: (place[0], -place[1])):
        if not front or place[1] > front[-1][1] or place == front[-1]:
            front.append(place)
    return front
