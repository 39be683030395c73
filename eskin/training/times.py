"""Times of decisions, in seconds from the onset (from the first frame where the gate opens at once)."""

from collections.abc import Iterable

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.model import Touches, Trace
from eskin.training.record import StepAccuracies


def step_times(config: AcceleratorConfig, touches: Touches) -> np.ndarray:
    """Seconds to the end of each window: median over touches."""
    ends = np.array([last for _, last in config.window_spans])[None]
    since = touches.ends(config) - touches.onset_frame[:, None] if len(touches) else ends
    return np.median(since, axis=0) / config.sensor.scan_rate_hz


def decision_times(trace: Trace) -> np.ndarray:
    """(R) seconds to the end of the window that each recording was decided on; NaN: not decided."""
    touches, step, first = trace.touches, trace.global_step, trace.first
    ends = np.take_along_axis(touches.ends(trace.config), np.maximum(step, 0)[:, None], axis=1)[:, 0]
    since = ends - touches.onset_frame
    seconds = np.where(step >= 0, since / trace.config.sensor.scan_rate_hz, np.nan)
    return np.append(seconds, np.nan)[first]  # -1, no touch, is the last


def step_rows(steps: Iterable[tuple[float, float, float]]) -> list[StepAccuracies]:
    """``per_step`` of a result, of (time, float accuracy, integer accuracy) of each step."""
    return [
        StepAccuracies(step=k, time_s=time_s, float_accuracy=real, integer_accuracy=integer)
        for k, (time_s, real, integer) in enumerate(steps, 1)
    ]
