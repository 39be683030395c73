"""First touches of a set of recordings, ready to train on, and the scale of their features."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.data import Recordings
from eskin.golden.model import Touches, find_touches, real_features
from eskin.training.recipe import Recipe


@dataclass(frozen=True)
class Dataset:
    """First touches of a set of recordings, ready to train on.

    touches: first touch of each touched recording. index (R): row in touches of each recording, -1 none.
    means (n, L, D): features before mu and sigma (`real_features`), also of windows beyond the last step if
    warp needs them. faults (n, L, D), bool: masked by the fault detector; None without one. ends (n): windows
    that the recording holds, up to L.
    """

    touches: Touches
    index: np.ndarray
    labels: np.ndarray
    means: np.ndarray
    faults: np.ndarray | None
    ends: np.ndarray


def find_dataset(recordings: Recordings, config: AcceleratorConfig, recipe: Recipe) -> Dataset:
    further = max(config.windows.steps, int(np.ceil((config.windows.steps - 1) * recipe.warp)) + 1)
    long = find_touches(config, recordings, steps=further)
    first = long.first_touch()
    index = np.where(first >= 0, np.cumsum(first >= 0) - 1, -1)
    long = long.take(first[first >= 0])
    touches = long.take(np.arange(len(long)), config.windows.steps)
    return Dataset(
        touches,
        index,
        recordings.labels,
        real_features(config, long.sums, long.lengths),
        long.faults,
        long.completed,
    )


def front_end_key(config: AcceleratorConfig) -> str:
    """Key of a configuration without its network."""
    return json.dumps({name: value for name, value in config.to_dict().items() if name != "network"})


class Datasets:
    """First touches of one set of recordings under the requested front ends. Each is computed once for all
    networks."""

    def __init__(self, recordings: Recordings) -> None:
        self._recordings = recordings
        self._known: dict[str, Dataset] = {}

    def of(self, config: AcceleratorConfig, recipe: Recipe) -> Dataset:
        """Training data for recipes with this time warp under the configuration's front end."""
        key = f"{front_end_key(config)} {recipe.warp}"
        if key not in self._known:
            self._known[key] = find_dataset(self._recordings, config, recipe)
        return self._known[key]


def touch_rows(data: Dataset, recordings: np.ndarray) -> np.ndarray:
    """Rows of the touches of ``recordings`` that have a completed step."""
    rows = data.index[recordings]
    rows = rows[rows >= 0]
    return rows[data.touches.completed[rows] > 0]


QUIETEST = 1 / 16
"""With one scale per taxel: smallest sigma of a taxel, as a share of the largest of its kind. Smaller
movements are noise, and 16-bit scales hold this range (`eskin.training.formats.normaliser_constants`)."""


def scaling(
    config: AcceleratorConfig, means: np.ndarray, completed: np.ndarray, faults: np.ndarray | None = None
) -> tuple[Any, Any]:
    """(mu, sigma) of real features (touches, steps, inputs): live taxels, the first ``completed`` (touches)
    steps only, without what the fault detector masks (``faults``, of the shape of ``means``). Numbers, or
    arrays (constants) with several kinds of feature or a scale a taxel; a taxel without any value left has mu
    0 and the largest sigma of its kind.

    Raises
    ------
    InputError
        When the fault detector masks every value.
    """
    complete = np.arange(config.windows.steps) < completed[:, None]
    live = ~np.array(config.input_mask)
    values, sound = means[complete][:, live], None if faults is None else ~faults[complete][:, live]
    if sound is not None and not sound.any():
        raise InputError(
            f"configuration '{config.name}', field fault_activity: is {config.faults.fault_activity}, with "
            "which the fault detector masks "
            "every taxel of every touch; use a smaller one"
        )
    if config.constants == 1:
        values = values if sound is None else values[sound]
        return float(values.mean()), max(float(values.std()), 1e-6)
    constant_of = np.array(config.input_constants)[live]
    mu, sigma = np.zeros(config.constants), np.zeros(config.constants)
    for constant in range(config.constants):
        of_it = values[:, constant_of == constant]
        of_it = of_it if sound is None else of_it[sound[:, constant_of == constant]]
        if of_it.size:
            mu[constant], sigma[constant] = of_it.mean(), max(of_it.std(), 1e-6)
    for kind in range(config.kinds):
        of_kind = slice(kind, None, config.kinds)
        largest = max(sigma[of_kind].max(), 1e-6)
        least = QUIETEST * largest if config.features.feature_scale == "taxel" else 0.0
        sigma[of_kind] = np.where(sigma[of_kind] > 0, np.maximum(sigma[of_kind], least), largest)
    return mu, sigma
