"""Recordings from an npz archive, checked array by array before any work starts."""

from pathlib import Path

import numpy as np

from eskin.golden.core import ArchiveError, InputError, read_arrays, replacing
from eskin.golden.data.codes import Worth
from eskin.golden.data.recordings import UNITS, Recordings, recordings_of


def load_archive(path: Path, scale: Worth | None = None, *, requested: bool = False) -> Recordings:
    """The recordings of an npz archive. ``scale``: value of one code if samples are real and the archive does
    not have it. ``requested``: as `eskin.golden.data.codes.to_codes`.

    Raises
    ------
    InputError
        It is damaged, or breaks a rule of archives.
    """
    try:
        arrays = read_arrays(path)
    except ArchiveError as error:
        where = f", array {error.member}" if error.member else ""
        raise InputError(
            f"recordings '{path}'{where}: {error}; write the archive again, of numbers and text, with "
            "numpy.savez_compressed"
        ) from None

    return recordings_of(arrays, str(path), scale=scale, requested=requested)


def save_archive(recordings: Recordings, path: str | Path) -> None:
    """Write an npz archive, whole or not at all: codes in the type of their format, groups, and the value of
    a code."""
    classes = {"labels": recordings.labels, "class_names": np.array(recordings.class_names, dtype=np.str_)}
    if recordings.image_shape is not None:
        arrays = {
            "images": recordings.samples.reshape(-1, *recordings.image_shape).astype(np.uint8),
            **classes,
        }
    else:
        signed, volt = "i" if recordings.sample_signed else "u", recordings.volt_per_code
        units = recordings.unit.split(UNITS)
        unit = units if len(units) == recordings.taxels > 1 else recordings.unit  # of each taxel, or of all
        arrays = {
            "samples": recordings.samples.astype(f"{signed}{1 if recordings.sample_bits <= 8 else 2}"),
            "offsets": recordings.offsets,
            **classes,
            "sample_rate_hz": np.array(recordings.sample_rate_hz),
            **({"lsb_volt": np.array(volt)} if volt else {}),
            **({"channel_names": np.array(recordings.channel_names)} if recordings.channel_names else {}),
            **({"grid_shape": np.array(recordings.grid)} if recordings.grid else {}),
            # volt is what a reader takes for granted beside lsb_volt
            **({"unit": np.array(unit)} if unit != ("V" if volt else "") else {}),
        }
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays, **recordings.groups)
