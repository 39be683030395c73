"""What a baseline is: a way to fit a classifier to some touches of a scene, and what the fitted one is and
costs."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from eskin.study.baselines.scene import Scene

FLOAT_BYTES = 4
"""Bytes of a parameter of what computes in float."""


@dataclass(frozen=True)
class Fitted:
    """A classifier and its cost.

    decide: rows of the scene -> their classes, (rows). parameters: numbers that it keeps. multiplies: of one
    decision, from windows, frames or tensor of the touch on; normalisation, exponentials, square roots and
    comparisons are not counted. comparisons: of one decision, where trees decide. alone: decides one row with
    all that a decision takes, where ``decide`` knows parts of it already.
    """

    decide: Callable[[np.ndarray], np.ndarray]
    parameters: int
    multiplies: int
    comparisons: int = 0
    alone: Callable[[int], Any] | None = None


@dataclass(frozen=True)
class Method:
    """A baseline in float: ``fit(scene, rows, seed)`` sees windows, frames and labels of these rows alone.

    one_seed: further seeds would change nothing, or cost too much: it is judged with the first one.
    """

    name: str
    label: str
    family: str
    fit: Callable[[Scene, np.ndarray, int], Fitted]
    one_seed: bool = False
