"""Frames as `eskin watch` records them, until it writes the archive: a file with a line of JSON, then a row a
frame."""

import json
from pathlib import Path

import numpy as np

from eskin.golden.core import InputError, Record
from eskin.golden.data.recordings import Recordings, recordings_of

SUFFIX = ".frames"


def row_type(head: Record) -> np.dtype:
    """A row: the codes of a frame, the number of its recording, and the recording's class."""
    return np.dtype([("samples", head["code"], (head["taxels"],)), ("recording", "<u4"), ("label", "<i2")])


def arrays_of(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an archive (docs/recordings.md); samples stay in the file. A frame that was not finished
    is left out.

    Raises
    ------
    InputError
        It is another file, or holds no frame.
    """
    with path.open("rb") as file:
        line = file.readline(1 << 20)
    try:
        head = json.loads(line)
        row = row_type(head)
        names = np.array(head["class_names"], dtype=np.str_)
        rate = float(head["sample_rate_hz"])
        volt = float(head["lsb_volt"])
        # // leaves out a last row that was not written whole
        rows = np.memmap(
            path, row, "r", offset=len(line), shape=(path.stat().st_size - len(line)) // row.itemsize
        )
    except (ValueError, KeyError, TypeError, RecursionError):
        raise InputError(
            f"recordings '{path}': holds no frames that eskin watch left; give another file"
        ) from None
    # ~ makes the value before the first row another one, so that the first row begins a recording too
    begins = np.flatnonzero(np.diff(rows["recording"], prepend=~rows["recording"][:1]))
    arrays = {
        "samples": rows["samples"],
        "offsets": np.append(begins, len(rows)),
        "labels": rows["label"][begins].astype(np.int64),
        "class_names": names,
        "sample_rate_hz": np.array(rate),
    }
    return arrays | ({"lsb_volt": np.array(volt)} if volt else {})


def load_frames(path: Path) -> Recordings:
    """What was recorded before the archive could not be written, or the program was killed.

    Raises
    ------
    InputError
        It is another file, or holds no frame.
    """
    return recordings_of(arrays_of(path), str(path))
