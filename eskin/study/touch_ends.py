"""The first touch of each recording, and where what can change its decision ends."""

from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, Touches, preprocess
from eskin.training.record import OTHER_SIGNALS


def touches_and_ends(
    config: AcceleratorConfig, recordings: Recordings, **options: Any
) -> tuple[Touches, np.ndarray]:
    """(the first touch of each recording that has one, for each recording the frame a hop after its first touch:
    what follows cannot change the decision; its last frame, where that comes first or there is no touch).
    ``options``: of `preprocess.find_touches`."""
    touches = preprocess.find_touches(config, recordings, **options)
    first = touches.first_touch()
    touches = touches.take(first[first >= 0])
    ends = recordings.lengths.copy()
    after = touches.ends(config)[:, -1] + config.windows.hop
    ends[touches.recording] = np.minimum(ends[touches.recording], after)
    return touches, ends


def with_touches(model: IntegerModel, recordings: Recordings, count: int) -> tuple[np.ndarray, Recordings]:
    """``count`` recordings with a whole touch, spread over the classes: their numbers, and they themselves, cut
    a hop after it; where none goes on so long, each to its end.

    Raises
    ------
    InputError
        None has a whole touch.
    """
    config = model.config
    recordings = recordings.scanned(config.sensor.scan_every)
    touches, ends = touches_and_ends(config, recordings)
    touches = touches.take(touches.completed == config.windows.steps)
    if not len(having := touches.recording):
        raise InputError(
            f"recordings '{recordings.source}': none has a whole touch; energy needs one: {OTHER_SIGNALS}"
        )
    after = touches.ends(config)[:, -1] + config.windows.hop
    longer = having[after <= recordings.lengths[having]]
    having = longer if len(longer) else having
    numbers = having[recordings.subset(having).evenly(min(count, len(having)))]
    return numbers, recordings.subset(numbers).until(ends[numbers])
