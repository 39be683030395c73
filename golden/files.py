"""Files written whole or not at all."""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from golden.errors import InputError


def check_target(path: str | Path | None) -> None:
    """Refuse a file name that could not be written in the end, before the work; None is fine.

    Raises
    ------
    InputError
        ``path`` is a folder or a device, or its folder is a file.
    """
    if path is None:
        return
    path = Path(path)
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is no regular file; name a file to write")
    above = next(folder for folder in path.absolute().parents if folder.exists())
    if not above.is_dir():
        raise InputError(f"{path}: cannot be written, because {above} is a file; name a file in a folder")


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A temporary file name in ``path``'s folder (made if missing) that takes the name ``path`` when the block ends without an error.

    Raises
    ------
    InputError
        As ``check_target``: a rename must not replace a folder or a device.
    OSError
        The folder cannot be written; ``path`` is as it was.
    """
    path = Path(path)
    check_target(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    os.close(handle)
    try:
        yield Path(name)
        os.chmod(name, 0o644)  # mkstemp's 0600 is for secrets
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def write_json(path: str | Path, value: Any) -> None:
    """``value`` as indented JSON; NaN and infinities are errors, because JSON has none."""
    text = json.dumps(value, indent=2, allow_nan=False)
    with replacing(path) as temporary:
        temporary.write_text(text + "\n")
