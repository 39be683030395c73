"""A name for values by their content: the key of a kept result, of a model, of recordings."""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np


def content_key(*parts: Any) -> str:
    """A name that ``parts`` determine.

    A part is bytes, an array, a file (`Path`: its content), something with a ``content`` of its own
    (recordings, a model, a configuration), or what JSON holds.
    """
    digest = hashlib.sha256()
    for part in parts:
        part = getattr(part, "content", part)
        if isinstance(part, Path):
            part = part.read_bytes()
        elif isinstance(part, np.ndarray):
            part = f"{part.dtype.str} {part.shape} ".encode() + np.ascontiguousarray(part).tobytes()
        data = part if isinstance(part, bytes) else json.dumps(part).encode()
        # the length goes first: else ("ab", "c") and ("a", "bc") had one key
        digest.update(f"{len(data)} ".encode() + data)
    return digest.hexdigest()[:32]
