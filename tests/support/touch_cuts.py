"""Recordings cut to the part around their touch: a whole one takes minutes at a converter's pace."""

import dataclasses

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.training.derive import find_onsets


def beginnings(
    recordings: Recordings,
    config: AcceleratorConfig,
    count: int = 5,
    steps: int = 3,
    before: int | None = None,
    rest: int = 0,
) -> Recordings:
    """Of ``count`` recordings, spread over the classes, the part from ``before`` frames ahead of the onset
    (default: what the ring keeps and 400) to the end of the touch's first ``steps`` windows, then ``rest``
    times their first frame."""
    few = recordings.subset(recordings.evenly(count))
    windows = config.windows
    before = windows.pretrigger_frames + 400 if before is None else before
    after = windows.hop * (steps - 1) + windows.window + 20
    parts = []
    for low, onset in zip(few.offsets, find_onsets(config, few), strict=False):
        cut = few.samples[low + max(int(onset) - before, 0) : low + int(onset) + after]
        parts.append(np.concatenate([cut, np.repeat(cut[:1], rest, axis=0)]))
    offsets = np.concatenate([[0], np.cumsum([len(part) for part in parts])])
    return dataclasses.replace(few, samples=np.concatenate(parts), offsets=offsets)
