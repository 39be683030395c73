"""Recordings put together anew."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from eskin.golden.data import Recordings


def of_parts(recordings: Recordings, parts: Sequence[np.ndarray], **changes: Any) -> Recordings:
    """``recordings`` with other samples, a part a recording."""
    offsets = np.cumsum([0, *map(len, parts)])
    return replace(recordings, samples=np.concatenate(parts), offsets=offsets, **changes)
