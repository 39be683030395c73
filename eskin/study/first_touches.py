"""The first touch of each recording, and where what can change its decision ends."""

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.model import Touches, preprocess


def first_touches(config: AcceleratorConfig, recordings: Recordings) -> tuple[Touches, np.ndarray]:
    """(the first touch of each recording that has one, for each recording the frame a hop after its first touch:
    what follows cannot change the decision; its last frame, where that comes first or there is no touch)."""
    touches = preprocess.find_touches(config, recordings)
    first = touches.first_touch()
    touches = touches.take(first[first >= 0])
    ends = recordings.lengths.copy()
    after = touches.start_frame - 1 + config.last_frame + config.windows.hop
    ends[touches.recording] = np.minimum(ends[touches.recording], after)
    return touches, ends
