"""A touch as frames in time, and how the taxels stand: what the thesis's methods on tensors and images see."""

import math

import numpy as np
from baselines import Scene

from eskin.choose.first_touches import first_touches
from eskin.golden.core import AcceleratorConfig


def frames_of(scene: Scene, count: int) -> np.ndarray:
    """(n, count, taxels): deviations from rest between the onset and the end of the last window, codes, as
    ``count`` points in time: means of equal parts where that is fewer than there are frames, else straight
    lines between frames. A touch that the recording cuts short is 0 from there on."""
    span, touches = scene.config.last_frame, first_touches(scene.config, scene.recordings)
    courses = dict(zip(touches.recording.tolist(), touches.deviations, strict=True))
    frames = np.zeros((len(scene.labels), count, scene.config.sensor.taxels), dtype=np.float32)
    for number, (recording, start) in enumerate(
        zip(scene.touches.recording, scene.touches.start_frame, strict=True)
    ):
        touch = np.zeros((span, scene.config.sensor.taxels))
        course = courses[int(recording)][start - 1 :][:span]
        touch[: len(course)] = course
        frames[number] = in_time(touch, count)
    return frames


def in_time(touch: np.ndarray, count: int) -> np.ndarray:
    """``touch`` (frames, taxels) as ``count`` points."""
    length = len(touch)
    if count <= length:
        edges = np.linspace(0, length, count + 1).astype(int)
        return np.add.reduceat(touch, edges[:-1], axis=0) / np.diff(edges)[:, None]
    position = np.linspace(0, length - 1, count)
    return np.stack([np.interp(position, np.arange(length), course) for course in touch.T], axis=1)


def shape_of(config: AcceleratorConfig) -> tuple[int, int]:
    """Rows and columns of the configuration if they fit the taxels, otherwise the most nearly square
    ones."""
    taxels, grid = config.sensor.taxels, (config.interface.rows, config.interface.columns)
    if math.prod(grid) == taxels:
        return grid
    rows = max(number for number in range(1, math.isqrt(taxels) + 1) if taxels % number == 0)
    return rows, taxels // rows
