"""Recordings from an npz archive, checked array by array before any work starts."""

from __future__ import annotations

from pathlib import Path

from eskin.golden.core.errors import InputError
from eskin.golden.core.files import ArchiveError, read_arrays
from eskin.golden.data.recordings import Recordings, recordings_of


def load_archive(path: Path) -> Recordings:
    try:
        arrays = read_arrays(path)
    except ArchiveError as error:
        where = f", array {error.member}" if error.member else ""
        raise InputError(
            f"recordings '{path}'{where}: {error}; write the archive again, of numbers and text, with numpy.savez_compressed"
        ) from None

    return recordings_of(arrays, str(path))
