"""Keys made from content: of cached results, models and recordings."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

APART = ("hardware", "interface")
"""Groups of a configuration without influence on a decision: how the network is computed, and the chips wired to it."""


def content_key(*parts: Any) -> str:
    """Key that depends on the content of ``parts`` alone.

    A part is bytes, an array, a file or folder (`Path`: its content), an object with an attribute ``content``
    (recordings, a configuration, a model), or a value that JSON can hold.
    """
    digest = hashlib.sha256()
    for part in parts:
        part = getattr(part, "content", part)
        if isinstance(part, Path) and part.is_dir():
            files = sorted(path for path in part.rglob("*") if path.is_file())
            part = [[path.relative_to(part).as_posix(), content_key(path)] for path in files]
        elif isinstance(part, Path):
            part = part.read_bytes()
        elif isinstance(part, np.ndarray):
            part = f"{part.dtype.str} {part.shape} ".encode() + np.ascontiguousarray(part).tobytes()
        data = part if isinstance(part, bytes) else json.dumps(part).encode()
        # the length goes first; otherwise ("ab", "c") and ("a", "bc") would have the same key
        digest.update(f"{len(data)} ".encode() + data)
    return digest.hexdigest()[:32]


def model_hash(config: Any, arrays: Mapping[str, np.ndarray]) -> str:
    """Hash of a configuration, without the groups `APART`, and of the integer weights: equal for the same network on
    other lanes or behind another converter."""
    fields = {name: value for name, value in config.to_dict().items() if name not in APART}
    named = (part for name in sorted(arrays) for part in (name, np.asarray(arrays[name], dtype=np.int64)))
    return content_key(fields, *named)
