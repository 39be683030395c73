"""Files that are written whole or not at all, and archives of arrays, read without trusting them."""

import contextlib
import fcntl
import functools
import json
import os
import re
import secrets
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import BaseModel, ValidationError

from eskin.golden.core.errors import InputError

MOST_UNPACKED_BYTES = 4 << 30
"""Largest unpacked size of an archive: a few kB can unpack to more than any memory."""


Check = Callable[[], None]
"""Callback that raises an error if a folder may not be replaced."""


def check_target(path: str | Path | None) -> None:
    """Refuse, before the work begins, a file name that cannot be written; None is allowed.

    Raises
    ------
    InputError
        ``path`` is a folder or a device, or its folder is a file.
    """
    if path is None:
        return
    path = Path(path)
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is not a regular file; name a file to write")
    above = next(folder for folder in path.absolute().parents if folder.exists())
    if not above.is_dir():
        raise InputError(f"{path}: cannot be written, because {above} is a file; name a file in a folder")


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A temporary file in ``path``'s folder (made if missing) that takes the name ``path`` when the block
    ends without an error. It has the permissions of any new file of the process (its umask).

    Raises
    ------
    InputError
        As ``check_target``: a rename must not replace a folder or a device.
    OSError
        The folder cannot be written; ``path`` is as it was.
    """
    check_target(path)
    path = Path(os.path.realpath(path))  # of a link, what it leads to
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    with _parents(path):
        try:
            # not by tempfile: its mode 0600 would stay when the file takes its final name
            os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
            yield temporary
            os.replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


@contextlib.contextmanager
def _parents(path: Path) -> Iterator[None]:
    """Create missing folders above ``path`` for the block; after an error they are removed again."""
    missing = [folder for folder in path.absolute().parents if not folder.exists()]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        with contextlib.suppress(OSError):  # others may have put something there
            for folder in missing:
                folder.rmdir()
        raise


@contextlib.contextmanager
def replacing_folder(folder: str | Path, check: Check = lambda: None) -> Iterator[Path]:
    """A new folder beside ``folder`` (its parent made if missing) that takes its name when the block ends
    without an error. It has the permissions of any new folder of the process (its umask).

    The caller decides whether ``folder`` may be replaced. ``check`` is called immediately before that, while
    no other process replaces a folder beside it; if it raises, ``folder`` stays as it is.

    Raises
    ------
    OSError
        It cannot be written; ``folder`` is as it was.
    """
    folder = Path(os.path.realpath(folder))  # of a link, what it leads to
    with _parents(folder):
        work = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
        draft, old = work / "new", work / "old"
        try:
            draft.mkdir()
            yield draft
            exchange(draft, folder, old, check)
        finally:
            shutil.rmtree(work, ignore_errors=True)


def exchange(draft: Path, folder: Path, old: Path, check: Check = lambda: None) -> None:
    """Rename ``draft`` to ``folder``; the earlier ``folder`` becomes ``old``. All three are on one file
    system.

    Raises
    ------
    OSError
        It cannot; ``folder`` is as it was.
    """
    # No rename replaces a folder that has content. The old one steps aside for the moment between two
    # renames; the lock on the parent keeps other processes out of that moment.
    parent = os.open(folder.absolute().parent, os.O_RDONLY)
    try:
        fcntl.flock(parent, fcntl.LOCK_EX)
        check()
        if folder.exists():
            os.replace(folder, old)
        try:
            os.replace(draft, folder)
        except BaseException:
            if old.exists():
                os.replace(old, folder)
            raise
    finally:
        os.close(parent)


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold an exclusive lock on ``path`` for the block, against other processes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w") as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield


class Result(BaseModel):
    """A result, or a part of one: fields of JSON, by their names there. A field that was not set is not written."""

    def plain(self) -> dict[str, Any]:
        """Its fields as JSON holds them."""
        return self.model_dump(mode="json", exclude_unset=True)

    @classmethod
    def read(cls, path: Path, fix: str) -> Self:
        """The result that a JSON file holds.

        Raises
        ------
        InputError
            The file cannot be read, or a field is missing or has another type; the sentence ends with ``fix``.
        """
        try:
            if path.exists() and not path.is_file():
                raise OSError(0, "is not a regular file")  # a pipe without a writer would wait for ever
            return cls.model_validate(json.loads(path.read_text()))
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            why = f", field {'.'.join(map(str, first['loc']))}: {first['msg'][0].lower()}{first['msg'][1:]}"
        except (OSError, ValueError, RecursionError) as error:
            why = f": cannot be read ({error.strerror if isinstance(error, OSError) else error})"
        raise InputError(f"{path}{why}; {fix}")


def write_json(path: str | Path, value: Any) -> None:
    """``value`` as indented JSON. NaN and infinities are errors, because JSON has no such numbers."""
    text = json.dumps(value, indent=2, allow_nan=False, default=Result.plain)
    with replacing(path) as temporary:
        temporary.write_text(text + "\n")


class ArchiveError(ValueError):
    """An ``.npz`` that cannot be read. member: the array at fault; empty: the archive itself. The message
    gives the reason."""

    def __init__(self, why: str, member: str = "") -> None:
        super().__init__(why)
        self.member = member


def check_unpacked(archive: zipfile.ZipFile) -> None:
    """Refuse an archive that unpacks to more than MOST_UNPACKED_BYTES, before anything in it is read.

    Raises
    ------
    ArchiveError
        The archive unpacks to more.
    """
    unpacked = sum(entry.file_size for entry in archive.infolist())
    if unpacked > MOST_UNPACKED_BYTES:
        raise ArchiveError(
            f"unpacks to {unpacked / 1e9:.3g} GB, more than the {MOST_UNPACKED_BYTES / 1e9:.3g} GB that are "
            "read"
        )


def read_arrays(path: str | Path) -> dict[str, np.ndarray]:
    """Every array of an ``.npz`` archive by name; members that are no arrays are left out. No pickle is ever
    read.

    Raises
    ------
    ArchiveError
        It is not a regular file or not an archive, is damaged, unpacks to more than MOST_UNPACKED_BYTES, or holds
        Python objects.
    OSError
        It is not there or may not be read.
    """
    path, member = Path(path), ""
    if path.exists() and not path.is_file():
        raise ArchiveError("is not a regular file")  # opening a pipe without a writer would wait for ever
    arrays: dict[str, np.ndarray] = {}
    with path.open("rb") as file:
        try:
            archive = np.load(file, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise ArchiveError("is a single array, not an .npz archive")
            assert archive.zip is not None  # it is closed at the end alone
            check_unpacked(archive.zip)
            for member in archive.files:
                value = archive[member]
                if isinstance(value, np.ndarray):
                    if value.dtype.hasobject:
                        raise ArchiveError("holds Python objects, which need a pickle", member)
                    arrays[member] = value
        except ArchiveError:
            raise
        except (
            Exception
        ) as error:  # a damaged file can fail anywhere inside numpy's, zipfile's and zlib's readers
            if "Object arrays" in str(error):
                raise ArchiveError("holds Python objects, which need a pickle", member) from None
            if not member and "pickle" in str(error):
                raise ArchiveError("is no .npz archive") from None
            raise ArchiveError("is damaged or incomplete", member) from None
    return arrays


def check_folder(out: Path, mark: str) -> None:
    """Refuse a folder that must not be replaced: one that holds something and no file ``mark``.

    Raises
    ------
    InputError
    """
    if not out.name:
        raise InputError(f"`out` {out}: cannot be replaced; name a new folder")
    if out.exists() and not out.is_dir():
        raise InputError(f"`out` {out}: is a file; name a new folder")
    if out.is_dir() and any(out.iterdir()) and not (out / mark).exists():
        raise InputError(
            f"`out` {out}: holds other files and no {mark}, so it is not an earlier result; name a new folder"
        )


PREFIX = "eskin"
"""Default prefix of every public C name in generated files."""


def prefixed(text: str, prefix: str) -> str:
    """C text with ``prefix`` in place of `PREFIX` in every name; macros in capitals."""
    return re.sub(rf"\b{PREFIX}_", f"{prefix}_", text).replace(f"{PREFIX.upper()}_", f"{prefix.upper()}_")


def check_prefix(option: str, prefix: str) -> str:
    """``prefix`` for names in C and Verilog, checked.

    Raises
    ------
    InputError
        It is not an identifier of at most 40 characters; in capitals it is the prefix of the macros.
    """
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,39}", prefix):
        raise InputError(
            f"{option} {prefix!r:.60}: is not a prefix for names in C and Verilog; give a letter, then letters, digits or _, at most 40"
        )
    return prefix


@functools.cache
@functools.cache
def template(module: str, name: str, prefix: str = PREFIX, **filters: Any) -> Any:
    """The template ``name`` in the folder templates/ beside a module's file, for texts that are not HTML; its names
    begin with ``prefix``."""
    import jinja2

    folder = Path(module).with_name("templates")
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda name: prefixed((folder / name).read_text(), prefix)),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= filters
    return environment.get_template(f"{name}.j2")
