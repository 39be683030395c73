"""What a baseline sees: the first touches of a set of recordings, as window means, as frames, as a tensor.

All methods see the same touches, found by one front end: from the onset to the end of the last window, with
the resting level removed. What lies before, the length of a recording and its resting level tell the session,
not the touch.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

import numpy as np

from eskin.golden.core import AcceleratorConfig, Arrays, InputError
from eskin.golden.data import Recordings
from eskin.golden.model import Touches, find_touches, first_touches, real_by_input, real_features
from eskin.golden.model.preprocess import FirstTouches
from eskin.training.datasets import scaling


@dataclass(frozen=True, eq=False)
class Scene:
    """First touches with a completed window at least, n of them; row i of everything is one touch.

    recordings, config: where they come from. shape: rows and columns of the array. touches: their windows.
    where (recordings): row of each recording's touch, -1 none. means (n, K, D): what windows say, before mean
    and scale are removed. labels (n). weights: arrays of a pretrained network by name, where the user gave
    them.
    """

    recordings: Recordings
    config: AcceleratorConfig
    shape: tuple[int, int]
    touches: Touches
    where: np.ndarray
    means: np.ndarray
    labels: np.ndarray
    weights: Arrays | None = None
    _known: dict[object, np.ndarray] = field(default_factory=dict, repr=False)

    @classmethod
    def of(
        cls,
        recordings: Recordings,
        config: AcceleratorConfig,
        shape: tuple[int, int] | None = None,
        weights: Arrays | None = None,
    ) -> Scene:
        """The touches that ``config`` finds; shape None: ``array_shape``.

        Raises
        ------
        InputError
            No recording has a touch.
        """
        every_touch = find_touches(config, recordings)
        first = every_touch.first_touch()
        usable = np.flatnonzero((first >= 0) & (every_touch.completed[first] > 0))
        if not len(usable):
            raise InputError(
                f"{recordings.source}: no recording has a touch with a completed window; look with 'eskin "
                "inspect'"
            )
        touches = every_touch.take(first[usable])
        where = np.full(len(recordings), -1)
        where[usable] = np.arange(len(usable))
        shape = shape or array_shape(config, None)
        return cls(
            recordings,
            config,
            shape,
            touches,
            where,
            real_features(config, touches.sums),
            recordings.labels[usable],
            weights,
        )

    @property
    def classes(self) -> int:
        """Classes of the task."""
        return len(self.recordings.class_names)

    def windows(self, part: np.ndarray) -> np.ndarray:
        """(n, K, D): windows of all touches with the mean and scale of the rows ``part`` alone; 0 where there
        is no window or a fault."""
        part_touches = self.touches.take(part)
        mu, sigma = scaling(self.config, self.means[part], part_touches.completed, part_touches.faults)
        windows = (self.means - real_by_input(self.config, mu)) / real_by_input(self.config, sigma)
        if self.touches.faults is not None:
            windows[self.touches.faults] = 0.0
        windows[np.arange(self.config.windows.steps) >= self.touches.completed[:, None]] = 0.0
        return windows

    def frames(self, count: int) -> np.ndarray:
        """(n, count, taxels): deviations from rest between the onset and the end of the last window, codes,
        as ``count`` points in time: means of equal parts where that is fewer than there are frames, else
        straight lines between frames. A touch that the recording cuts short is 0 from there on."""
        if count not in self._known:
            self._known[count] = self._frames(count)
        return self._known[count]

    def _frames(self, count: int) -> np.ndarray:
        span = self.config.last_frame
        held = self._held()
        rows = {int(recording): row for row, recording in enumerate(held.recording)}
        frames = np.zeros((len(self.labels), count, self.config.sensor.taxels), dtype=np.float32)
        for number, (recording, start) in enumerate(
            zip(self.touches.recording, self.touches.start_frame, strict=True)
        ):
            touch = np.zeros((span, self.config.sensor.taxels))
            course = held.of_touch(rows[int(recording)])[start - 1 :][:span]
            touch[: len(course)] = course
            frames[number] = _in_time(touch, count)
        return frames

    def _held(self) -> FirstTouches:
        return first_touches(self.config, self.recordings)

    def tensors(self, steps: int) -> np.ndarray:
        """(n, rows, columns, steps): frames as taxel x taxel x time."""
        frames = self.frames(steps)
        return frames.reshape(len(frames), steps, *self.shape).transpose(0, 2, 3, 1)


def _in_time(touch: np.ndarray, count: int) -> np.ndarray:
    """``touch`` (frames, taxels) as ``count`` points."""
    length = len(touch)
    if count <= length:
        edges = np.linspace(0, length, count + 1).astype(int)
        return np.add.reduceat(touch, edges[:-1], axis=0) / np.diff(edges)[:, None]
    position = np.linspace(0, length - 1, count)
    lower = position.astype(int)
    upper, part = np.minimum(lower + 1, length - 1), (position - lower)[:, None]
    return touch[lower] * (1 - part) + touch[upper] * part


def array_shape(config: AcceleratorConfig, asked: str | None) -> tuple[int, int]:
    """Rows and columns: those asked for (``4x4``), those of the configuration where they fit the taxels, else
    the most square ones.

    Raises
    ------
    InputError
        What was asked for is no shape, or of another number of taxels.
    """
    taxels, grid = config.sensor.taxels, (config.interface.rows, config.interface.columns)
    if asked is not None:
        sides = re.fullmatch(r"(\d{1,4})x(\d{1,4})", asked.lower())
        if not sides or not int(sides[1]) * int(sides[2]):
            raise InputError(f"--shape {asked[:40]}: is no shape; give rows and columns, 4x4 say")
        shape = int(sides[1]), int(sides[2])
        if math.prod(shape) != taxels:
            raise InputError(
                f"--shape {asked}: is {math.prod(shape)} taxels and the recordings have {taxels}; give rows "
                "and columns of that product"
            )
        return shape
    if math.prod(grid) == taxels:
        return grid
    rows = max(number for number in range(1, math.isqrt(taxels) + 1) if taxels % number == 0)
    return rows, taxels // rows
