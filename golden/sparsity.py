"""Skipped work in exact fixed point: weights pruned by magnitude, and delta updates; what they cost in decisions and save in multiplies.

Delta updates: an operand (a feature, a hidden state, a reset state) that lies less than a threshold from the value it was last multiplied
with is not multiplied again; its product stays in the accumulator. A product is exact, so an accumulator that adds ``w * (v - held)``
always holds ``w * held``: the same as a dense row over held operands, without drift. Held values are 0 at the start of a touch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from golden import train
from golden.cells import Fixed
from golden.config import AcceleratorConfig
from golden.errors import InputError
from golden.model import FloatModel, IntegerModel
from golden.pipeline import decide

if TYPE_CHECKING:
    from golden.recordings import Recordings

PRUNED = ("W_", "U_")
"""Arrays that are pruned, by the beginning of their names: those of the gate rows."""

SHARES = (0.0, 0.5, 0.75)
"""Shares of the gate weights that are pruned to see what it costs."""

THRESHOLDS = ((0.0, 0.0), (1 / 32, 1 / 64), (1 / 8, 1 / 16), (1 / 4, 1 / 8), (1 / 2, 1 / 4))
"""Thresholds of delta updates to try: of a feature (1 = its standard deviation) and of a hidden state."""


# ---------------------------------------------------------------------- pruning
def magnitude_masks(model: FloatModel, share: float) -> dict[str, np.ndarray]:
    """Array name -> 0/1 for every array of W and U: the ``share`` (0 to below 1) of the gate weights smallest in magnitude are 0.

    W and U are ranked apart, all gates together, so that neither loses all its weights to the other's scale.

    Raises
    ------
    InputError
        When share lies outside 0..1.
    """
    if not 0 <= share < 1:
        raise InputError(f"pruning, field share: is {share}; give a number from 0 to below 1")
    masks = {}
    for start in PRUNED:
        arrays = {name: np.abs(array) for name, array in model.arrays.items() if name.startswith(start)}
        everything = np.sort(np.concatenate([array.ravel() for array in arrays.values()]))
        count = round(share * len(everything))
        limit = everything[count] if count < len(everything) else np.inf
        masks |= {name: (array >= limit).astype(np.int64) for name, array in arrays.items()}
    return masks


# ---------------------------------------------------------------------- delta updates
def held_values(values: Tensor, held: Tensor, threshold: int) -> tuple[Tensor, Tensor]:
    """(what is multiplied with from now on, which operands moved): an operand moves where ``|value - held| >= threshold``, in codes."""
    moved = (values - held).abs() >= threshold
    return torch.where(moved, values, held), moved


class Delta(Fixed):
    """The integer arithmetic with delta updates; for one run over whole touches.

    Parameters
    ----------
    config:
        With every format.
    feature_threshold, state_threshold:
        Codes of feature_format and of state_format. 0: every operand is multiplied every step (the dense model); 1: only unchanged
        operands are skipped, which loses nothing.

    moved (name -> bool (touches, steps, width), for x, h, rh, dense): operands that were multiplied.
    """

    def __init__(self, config: AcceleratorConfig, feature_threshold: int, state_threshold: int) -> None:
        super().__init__(config)
        for field, value in (("feature", feature_threshold), ("state", state_threshold)):
            if not isinstance(value, (int, np.integer)) or value < 0:
                raise InputError(f"delta updates, {field} threshold: is {value}; give a whole number of codes, 0 or more")
        self._thresholds = {"x": feature_threshold, "h": state_threshold, "rh": state_threshold, "dense": state_threshold}
        self._held: dict[str, Tensor] = {}
        self._moved: dict[str, list[Tensor]] = {}

    @property
    def moved(self) -> dict[str, np.ndarray]:
        """Which operands were multiplied at each step."""
        return {name: torch.stack(steps, dim=-2).numpy() for name, steps in self._moved.items()}

    def recurrent(self, name: str, vector: Tensor) -> Tensor:
        """The held values of ``vector`` after this step."""
        held = self._held.get(name, torch.zeros_like(vector))
        self._held[name], moved = held_values(vector, held, self._thresholds[name])
        self._moved.setdefault(name, []).append(moved)
        return self._held[name]

    def operand(self, feature: Tensor) -> Tensor:
        """Held features, aligned."""
        return super().operand(self._over_steps("x", feature))

    def hidden(self, states: Tensor) -> Tensor:
        """Held states: the same values that U multiplies a step later."""
        return self._over_steps("dense", states)

    def _over_steps(self, name: str, values: Tensor) -> Tensor:
        return torch.stack([self.recurrent(name, value) for value in values.unbind(dim=-2)], dim=-2)


@dataclass(frozen=True)
class Skipped:
    """What a run with skipped work gave.

    hidden, logits: codes (n, K, H) and (n, K, C). done (n, K): multiplies made at each step, of ``multiplies`` in the dense model.
    """

    hidden: np.ndarray
    logits: np.ndarray
    done: np.ndarray
    multiplies: int

    def share_skipped(self, completed: np.ndarray) -> float:
        """Share of the multiplies of the ``completed`` (n) steps that were not made; 0 without such a step."""
        counts = np.arange(self.done.shape[1]) < np.asarray(completed)[:, None]
        dense = self.multiplies * int(counts.sum())
        return 1.0 - float(self.done[counts].sum()) / dense if dense else 0.0  # without a completed step there is nothing to skip

    def decisions(self, config: AcceleratorConfig, completed: np.ndarray) -> np.ndarray:
        """(n) global decisions by the configuration's rule, -1 none."""
        return decide(config, self.logits, completed)[2]


def run_skipping(model: IntegerModel, features: np.ndarray, feature_threshold: int = 0, state_threshold: int = 0) -> Skipped:
    """Run an integer model over feature codes (n, K, D) with delta updates; weights that are 0 are not multiplied either.

    Multiplies are counted as ``config.multiplies`` counts them; the element-wise ones are always made.
    """
    config = model.config
    arithmetic = Delta(config, feature_threshold, state_threshold)
    hidden, logits = model.run(arithmetic, features)

    def columns(*names: str) -> np.ndarray:
        """Weights other than 0 that each operand meets."""
        return sum((model.arrays[name] != 0).sum(axis=0) for name in names)

    rows_of_h = config.gates if "rh" not in arithmetic.moved else config.gates[:-1]
    costs = {
        "x": columns(*(f"W_{gate}" for gate in config.gates)),
        "h": columns(*(f"U_{gate}" for gate in rows_of_h)),
        "rh": columns(f"U_{config.gates[-1]}"),
        "dense": columns("V"),
    }
    matrix = sum(array.size for name, array in model.arrays.items() if name.startswith((*PRUNED, "V")))
    done = sum(moved @ costs[name] for name, moved in arithmetic.moved.items()) + config.multiplies - matrix
    return Skipped(hidden, logits, np.asarray(done, dtype=np.int64), config.multiplies)


# ---------------------------------------------------------------------- the comparison
def compare_skipping(
    recordings: Recordings,
    config: AcceleratorConfig,
    splits: Sequence[Sequence[str]],
    seeds: Sequence[int],
    *,
    pruned: Sequence[float] = SHARES,
    thresholds: Sequence[tuple[float, float]] = THRESHOLDS,
    folds: int = 5,
    recipe: train.Recipe | None = None,
    widths: dict[str, Any] | None = None,
    progress: train.Progress | None = None,
) -> list[dict[str, Any]]:
    """Multiplies skipped against accuracy, from the same float networks: every pruned share with every pair of thresholds.

    Parameters
    ----------
    pruned:
        Shares of the gate weights; every network is trained on in integer arithmetic with its masks kept (0: quantisation-aware, dense).
    thresholds:
        (feature, state) in real units, rounded to codes of each network's formats.
    splits, seeds, folds, recipe, widths, progress:
        As for ``golden.train.cross_validate``.

    Returns
    -------
    A row for each split, share and pair: groups, pruned, feature_threshold, state_threshold (real), accuracy, spread (standard deviation
    over folds x seeds), by_seed (accuracy over all folds), agreement (with the float network), skipped (share of the multiplies of the
    recordings judged), seeds.
    """
    work = train.Folds(recordings, config, recipe or train.choose_recipe(config), splits, seeds, folds)
    models = work.fit(progress)
    rows = []
    for share in pruned:
        masks = [magnitude_masks(model, share) for model in models]
        integers = work.fine_tune(models, widths or {}, progress, masks)
        for feature, state in thresholds:
            runs: list[tuple[float, float]] = []  # multiplies made and multiplies of the dense model, network by network

            def forward(integer: IntegerModel, codes: np.ndarray, completed: np.ndarray, feature=feature, state=state, runs=runs):
                formats = integer.config
                lsb = (2.0**-formats.feature_format.frac_bits, 2.0**-formats.state_format.frac_bits)
                run = run_skipping(integer, codes, round(feature / lsb[0]), round(state / lsb[1]))
                dense = formats.multiplies * int(completed.sum())
                runs.append(((1.0 - run.share_skipped(completed)) * dense, dense))
                return run.logits

            for number, record in enumerate(work.records(models, integers, forward)):
                made, dense = np.sum([run for run, split in zip(runs, work.split_numbers, strict=True) if split == number], axis=0)
                rows.append(
                    {
                        "groups": record["groups"],
                        "pruned": share,
                        "feature_threshold": feature,
                        "state_threshold": state,
                        "accuracy": record["integer_accuracy"],
                        "spread": record["integer_spread"],
                        "by_seed": record["integer_by_seed"],
                        "agreement": record["agreement"],
                        "skipped": 1.0 - made / dense if dense else 0.0,
                        "seeds": record["seeds"],
                    }
                )
    return rows
