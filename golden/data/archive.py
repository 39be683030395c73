"""Recordings from an npz archive, checked array by array before any work starts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from eskin.golden.core.errors import InputError
from eskin.golden.core.files import ArchiveError, read_arrays
from eskin.golden.data.recordings import ARCHIVE_ARRAYS, NOT_GROUPS, Recordings


def load_archive(path: Path) -> Recordings:
    try:
        arrays = read_arrays(path)
    except ArchiveError as error:
        where = f", array {error.member}" if error.member else ""
        raise InputError(
            f"recordings '{path}'{where}: {error}; write the archive again, of numbers and text, with numpy.savez_compressed"
        ) from None

    def refuse(array: str, why: str) -> None:
        raise InputError(f"recordings '{path}', array {array}: {why}")

    if "images" in arrays and "samples" not in arrays:
        refuse("images", "is an archive of still images, which have no time course; give an archive with samples and offsets")
    for name in ARCHIVE_ARRAYS:
        if name not in arrays:
            refuse(name, f"is missing; an archive holds {', '.join(ARCHIVE_ARRAYS)}")

    samples = arrays["samples"]
    if samples.dtype.kind not in "iu":
        refuse("samples", f"holds {samples.dtype}, not integers; save the A/D codes as an integer type")
    if samples.ndim != 2 or samples.shape[1] < 1:
        refuse("samples", f"has shape {samples.shape}; it must be (frames, taxels)")
    if not len(samples):
        refuse("samples", "holds no frame; an archive needs at least one recording")
    low, high = int(samples.min()), int(samples.max())
    if low < -32768 or high > (32767 if low < 0 else 65535):
        refuse("samples", f"runs from {low} to {high}, beyond 16 bits; give -32768..32767 or 0..65535")
    narrow_type = samples.dtype.itemsize <= 2
    bits = 8 * samples.dtype.itemsize if narrow_type else 16
    signed = samples.dtype.kind == "i" if narrow_type else low < 0

    offsets = arrays["offsets"]
    if offsets.dtype.kind not in "iu" or offsets.ndim != 1:
        refuse("offsets", f"is {offsets.dtype} of shape {offsets.shape}; it must be integers of shape (recordings + 1,)")
    if len(offsets) < 2:
        refuse("offsets", f"has {len(offsets)} value(s), so no recording; it needs recordings + 1 values")
    if offsets[0] != 0:
        refuse("offsets", f"starts at {offsets[0]}; it must start at 0")
    if offsets[-1] != len(samples):
        refuse("offsets", f"ends at {offsets[-1]} but samples has {len(samples)} frames; the last value must be the number of frames")
    if (offsets[1:] < offsets[:-1]).any():
        refuse("offsets", f"falls after entry {int(np.argmax(offsets[1:] < offsets[:-1]))}; it must not decrease")
    if (offsets[1:] == offsets[:-1]).any():
        refuse("offsets", f"makes recording {int(np.argmax(offsets[1:] == offsets[:-1]))} empty (0 frames); leave that recording out")
    recordings = len(offsets) - 1

    names = arrays["class_names"]
    if names.dtype.kind not in "US" or names.ndim != 1 or not len(names):
        refuse("class_names", f"is {names.dtype} of shape {names.shape}; it must be a list of text, one name a class")
    try:
        class_names = tuple(str(name.decode() if isinstance(name, bytes) else name) for name in names)
    except UnicodeDecodeError:
        refuse("class_names", "holds bytes that are not UTF-8; save the names as text")
    for index, name in enumerate(class_names):
        if not name.strip() or not name.isprintable():
            refuse("class_names", f"has an empty or unprintable name at {index}; give every class a readable name")
        if name in class_names[:index]:
            refuse("class_names", f"has the name {name} twice; names must differ")

    labels = arrays["labels"]
    if labels.dtype.kind not in "iu" or labels.shape != (recordings,):
        refuse("labels", f"is {labels.dtype} of shape {labels.shape}; it must be integers of shape ({recordings},), one a recording")
    outside = (labels < 0) | (labels >= len(class_names))
    if outside.any():
        first = int(np.argmax(outside))
        refuse("labels", f"gives recording {first} class {labels[first]}; class_names has classes 0..{len(class_names) - 1}")

    rate = _positive_number(arrays["sample_rate_hz"])
    if rate is None:
        refuse("sample_rate_hz", f"is {_shown(arrays['sample_rate_hz'])}; give one number above 0, in hertz")
    volt = 0.0
    if "lsb_volt" in arrays:
        volt = _positive_number(arrays["lsb_volt"])
        if volt is None:
            refuse("lsb_volt", f"is {_shown(arrays['lsb_volt'])}; give the volt of one code, above 0, or leave the array out")
    groups = {
        name: values
        for name, values in arrays.items()
        if name not in NOT_GROUPS and values.shape == (recordings,) and values.dtype.kind in "iubUSf"
    }
    return Recordings(
        samples=samples.astype(np.int32),
        offsets=offsets.astype(np.int64),
        labels=labels.astype(np.int64),
        class_names=class_names,
        sample_rate_hz=rate,
        groups=groups,
        source=str(path),
        volt_per_code=volt,
        sample_bits=bits,
        sample_signed=signed,
    )


def _positive_number(value: np.ndarray) -> float | None:
    """The one finite number above 0 that ``value`` holds, or None."""
    if value.size != 1 or value.dtype.kind not in "iuf":
        return None
    number = float(value.reshape(()))
    return number if np.isfinite(number) and number > 0 else None


def _shown(value: np.ndarray) -> str:
    return str(value.reshape(())) if value.size == 1 else f"of shape {value.shape}"
