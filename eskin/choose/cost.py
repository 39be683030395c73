"""Cost of a whole design, front end included, by which front end and network are chosen.

Energy, cells and latency follow from a configuration by a formula; block memories require the elaborated
design, so they are counted only if the choice depends on them. The figures come from ``eskin.verbs.cost``
through the functions of a `CostModel`, so this module imports no hardware.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar, get_args

from eskin.golden.core import AcceleratorConfig

Prefer = Literal["energy", "cells", "latency"]
"""Cost to minimise among candidates that are tied in accuracy; energy: average power, then energy of a touch."""
PREFERENCES: tuple[Prefer, ...] = get_args(Prefer)
EQUAL = 1.01
"""Largest ratio of two average powers that count as equal."""

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Cost:
    """energy_touch_j: of a touch, from its first frame to its decision, joule. cells: logic cells, onset to
    decision. latency_s: from the last sample to the decision, at the board's clock. touch_s: from the onset
    to the last sample. average_w: average power with one touch a second, on the board's clock, which always runs.
    It includes the scans of the configuration's converter if its data sheet gives a power."""

    energy_touch_j: float
    cells: int
    latency_s: float
    touch_s: float
    average_w: float


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

    def row(self, config: AcceleratorConfig) -> dict[str, Any]:
        """The costs of a candidate as training.json has them."""
        cost = self.cost_of(config)
        return {
            "energy_touch_j": cost.energy_touch_j,
            "average_w": cost.average_w,
            "cells": cost.cells,
            "block_memories": self.blocks_of(config),
            "latency_s": cost.latency_s,
            "fits": self.board if self.fits(config) else None,
        }


def pareto(records: Sequence[Mapping[str, Any]], cost: str) -> list[int]:
    """Indices of the records on the Pareto front of ``cost`` (lower is better) and accuracy (higher is
    better), sorted by cost."""
    order = sorted(range(len(records)), key=lambda i: (records[i][cost], -records[i]["accuracy"]))
    front: list[int] = []
    for i in order:
        gain, last = records[i]["accuracy"], records[front[-1]] if front else None
        if (
            last is None
            or gain > last["accuracy"]
            or (gain, records[i][cost]) == (last["accuracy"], last[cost])
        ):
            front.append(i)
    return front
