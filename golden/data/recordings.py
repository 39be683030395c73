"""Recordings in memory.

Every refusal is an InputError of one sentence that names the file, the array or line, and the fix. Nothing
here guesses: an archive that breaks the rules of docs/recordings.md is refused before any work starts.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from eskin.golden.core import Arrays, InputError, QFormat, array_of
from eskin.golden.core.config import IMAGE_ROWS_HZ
from eskin.golden.data.codes import Worth, place_of, to_codes

ARCHIVE_ARRAYS = ("samples", "offsets", "labels", "class_names", "sample_rate_hz")
"""The arrays every archive must hold."""

IMAGE_ARRAYS = ("images", "labels", "class_names")
"""The arrays that an archive of images must hold."""

NOT_GROUPS = (*ARCHIVE_ARRAYS, "channel_names", "grid_shape", "lsb_volt", "sample_rate_is_inferred", "images")
"""Arrays that are never a group, whatever their length."""

MOST_NAMES = 1 << 12
"""Highest number of classes that get default names; larger labels are refused because they have no name."""
GROUP_KINDS = "iubUSf"
"""Kinds of numpy types that a group may have: numbers and text."""

RESERVED = (*NOT_GROUPS, "unit", "file", "allow_pickle")
"""Names that no group may have: an archive's own arrays, and ``numpy.savez_compressed``'s
arguments."""


@dataclass(frozen=True, eq=False)
class Recordings:
    """A set of labelled recordings, concatenated along time.

    Parameters
    ----------
    samples:
        A/D codes, int32, shape (frames of all recordings, taxels).
    offsets:
        int64, shape (recordings + 1): recording i is ``samples[offsets[i]:offsets[i+1]]``.
    labels:
        int64, shape (recordings): index into class_names.
    class_names:
        One name a class.
    sample_rate_hz:
        Frames a second.
    groups:
        Groups (person, trial, ...): name -> array of length recordings.
    source:
        Source of the recordings, for messages and the report.
    volt_per_code:
        Value of one code, in volt or the unit of the real samples; 0 if unknown.
    unit:
        That unit, as the archive names it; "" where it does not.
    sample_bits, sample_signed:
        The A/D code's format.
    notes:
        Sentences about choices the loader made.
    image_shape:
        Height and width where the recordings are still images: one recording is an image then, its rows are
        the frames, from the top.
    channel_names:
        Names of the taxels in the source; may be empty.
    grid:
        Rows and columns of the taxels, taxel = row x columns + column; () where the source does not say it.
    scan_every:
        N: these frames are the first of every N of the source (`scanned`).
    """

    samples: np.ndarray
    offsets: np.ndarray
    labels: np.ndarray
    class_names: tuple[str, ...]
    sample_rate_hz: float
    groups: Arrays = field(default_factory=dict)
    source: str = "recordings"
    volt_per_code: Worth = 0.0
    unit: str = ""
    sample_bits: int = 16
    sample_signed: bool = False
    notes: tuple[str, ...] = ()
    image_shape: tuple[int, int] | None = None
    channel_names: tuple[str, ...] = ()
    scan_every: int = 1
    grid: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Rename groups that have a name of one of the archive's own arrays: a group called labels would
        replace the classes when the archive is written."""
        groups = {str(name): np.asarray(values) for name, values in self.groups.items()}
        for name in [name for name in groups if name in RESERVED]:
            array_name = f"group_{name}"
            while array_name in groups:
                array_name += "_"
            groups[array_name] = groups.pop(name)
            note = f"group {name} is called {array_name}, because {name} has another meaning in an archive"
            object.__setattr__(self, "notes", (*self.notes, note))
        object.__setattr__(self, "groups", groups)

    @property
    def content(self) -> str:
        """SHA-256 of everything that a result can depend on, which excludes the source and the notes."""
        groups = {name: [str(value) for value in values] for name, values in sorted(self.groups.items())}
        scalars = [self.class_names, self.sample_rate_hz, self.volt_per_code, str(self.sample_format), groups]
        digest = hashlib.sha256(json.dumps(scalars).encode())
        for array in (self.samples, self.offsets, self.labels):
            digest.update(np.ascontiguousarray(array).data)
        return digest.hexdigest()

    @classmethod
    def of(
        cls,
        arrays: ArrayLike | Sequence[ArrayLike],
        labels: ArrayLike | None = None,
        *,
        sample_rate_hz: float,
        class_names: Sequence[str] | None = None,
        groups: Mapping[str, Any] | None = None,
        scale: Worth | None = None,
        source: str = "recordings",
    ) -> Recordings:
        """Recordings of arrays in memory.

        Parameters
        ----------
        arrays:
            One recording (frames, taxels), or several: a list of such, or an array (recordings, frames,
            taxels). In lists, and in arrays of four dimensions, taxels may also be rows and columns. Of one taxel
            also (frames,), with as many labels as a list has arrays. Integers are A/D codes.
        labels:
            The class of each, by index or by name; None: all are 0.
        sample_rate_hz:
            Frames a second.
        class_names:
            Default: the labels' own names; for indices class0, class1 and so on.
        groups:
            Name -> one value a recording.
        scale:
            Value of one code of real samples; None: chosen.

        Raises
        ------
        InputError
            The arrays break a rule of recordings archives.
        """
        given = None if labels is None else array_of(labels, f"{source}, labels")
        parts = _parts(arrays, source, 0 if given is None else given.size)
        for number, part in enumerate(parts):
            if part.ndim not in (1, 2, 3) or part.shape[1:] != parts[0].shape[1:] or not len(part):
                shape = f"(frames, {parts[0].shape[1]})" if parts[0].ndim == 2 else "(frames, taxels)"
                raise InputError(
                    f"{source}: array {number} has shape {part.shape}; every recording is an array {shape} "
                    "with a frame at least, or all are (frames, rows, columns) of one size"
                )
            if part.dtype.kind not in "iuf":  # numpy would not join them, or make numbers of them
                raise InputError(
                    f"{source}: array {number} holds {part.dtype}, not numbers; give A/D codes as integers, "
                    "or real samples as floats"
                )
        if given is not None and all(len(part) < part[0].size for part in parts):  # a model knows its taxels
            raise InputError(
                f"{source}: array 0 has shape {parts[0].shape}, so more taxels than frames; frames come first: "
                "transpose the arrays, or save an archive where they are so short"
            )
        labels = np.zeros(len(parts), dtype=np.int64) if given is None else given
        if labels.dtype.kind == "O" and all(isinstance(label, str) for label in labels.ravel()):
            labels = labels.astype(np.str_)  # as pandas has text
        if class_names is None and labels.dtype.kind not in "US":
            most = int(labels.max(initial=0)) if labels.dtype.kind in "iu" else 0
            class_names = [f"class{index}" for index in range(min(most, MOST_NAMES) + 1)]
        named = (
            {} if class_names is None else {"class_names": array_of(class_names, f"{source}, class_names")}
        )
        for name, codes in (groups or {}).items():
            values = array_of(codes, f"{source}, group {name}")
            if values.shape != (len(parts),) or values.dtype.kind not in GROUP_KINDS:
                raise InputError(
                    f"{source}, group {name}: is {values.dtype} of shape {values.shape}; give a number or "
                    f"text for each of {len(parts)} recordings"
                )
        return recordings_of(
            {
                "samples": np.concatenate(parts),
                "offsets": np.cumsum([0, *(len(part) for part in parts)]),
                "labels": labels,
                **named,
                "sample_rate_hz": array_of(
                    sample_rate_hz, f"{source}, sample_rate_hz", "give one number, in hertz"
                ),
            },
            source,
            groups=groups or {},
            scale=scale,
        )

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def taxels(self) -> int:
        """Taxels of a frame."""
        return self.samples.shape[1]

    @property
    def frames(self) -> int:
        """Frames of all recordings together."""
        return len(self.samples)

    @property
    def sample_format(self) -> QFormat:
        """Format of one A/D code."""
        return QFormat(self.sample_bits, 0, self.sample_signed)

    @cached_property
    def lengths(self) -> np.ndarray:
        """Frames of each recording, int64, shape (recordings,)."""
        return np.diff(self.offsets)

    @cached_property
    def class_counts(self) -> np.ndarray:
        """Recordings of each class, int64, shape (classes,)."""
        return np.bincount(self.labels, minlength=len(self.class_names))

    def recording(self, index: int) -> np.ndarray:
        """Recording ``index`` (from 0) as a view, shape (frames, taxels)."""
        return self.samples[self.offsets[index] : self.offsets[index + 1]]

    def subset(self, indices: Sequence[int] | np.ndarray) -> Recordings:
        """The recordings ``indices``, in that order, as a set of their own."""
        indices = np.asarray(indices, dtype=np.int64)
        if not len(indices):
            raise InputError(f"{self.source}: the subset is empty; name at least one recording")
        return dataclasses.replace(
            self,
            samples=np.concatenate([self.recording(i) for i in indices]),
            offsets=np.cumsum([0, *self.lengths[indices]]),
            labels=self.labels[indices],
            groups={name: values[indices] for name, values in self.groups.items()},
        )

    def scanned(self, every: int) -> Recordings:
        """The recordings thinned to the first of every N frames of the source, as a chain with this
        ``scan_every`` takes them; the recordings themselves if they have this ``scan_every`` already."""
        step, rest = divmod(every, self.scan_every)
        if rest:
            raise InputError(
                f"{self.source}: are every {self.scan_every}-th frame and the model scans every {every}-th; use the "
                "recordings as they were made"
            )
        if step == 1:
            return self
        parts = [self.recording(i)[::step] for i in range(len(self))]
        return dataclasses.replace(
            self,
            samples=np.concatenate(parts),
            offsets=np.cumsum([0, *map(len, parts)]),
            sample_rate_hz=self.sample_rate_hz / step,
            scan_every=every,
        )

    def until(self, ends: Sequence[int] | np.ndarray) -> Recordings:
        """Each recording up to its entry of ``ends``, or up to the recording's end if that comes first."""
        ends = np.minimum(ends, self.lengths)
        samples = np.concatenate([self.recording(i)[:end] for i, end in enumerate(ends)])
        return dataclasses.replace(self, samples=samples, offsets=np.cumsum([0, *ends]))

    def with_classes(self, names: tuple[str, ...], whose: str) -> Recordings:
        """These recordings with ``names`` as class names: a set may lack some of them, or list them in
        another order. ``whose``: owner of the names, for messages.

        Raises
        ------
        InputError
            A recording has a class that is not among them.
        """
        place = np.array([names.index(name) if name in names else -1 for name in self.class_names])
        unknown = np.flatnonzero(place[self.labels] < 0)
        if len(unknown):
            raise InputError(
                f"recordings '{self.source}', array class_names: has recordings of "
                f"{self.class_names[self.labels[unknown[0]]]}, and {whose} knows {', '.join(names)}; leave "
                "those recordings out, or use a model of the same task"
            )
        return dataclasses.replace(self, labels=place[self.labels], class_names=names)

    def evenly(self, n: int) -> np.ndarray:
        """Indices (ascending) of ``n`` recordings: the same every time, spread over the classes and over each
        class's list.

        A class with too few gives all of its recordings and the others give more; ``n`` of all or more gives
        every index.
        """
        if n < 1:
            raise InputError(f"{n} recordings were requested; give at least 1")
        if n >= len(self):
            return np.arange(len(self))
        shares = np.zeros(len(self.class_names), dtype=np.int64)
        while shares.sum() < n:
            open_classes = np.flatnonzero(shares < self.class_counts)
            shares[open_classes[np.argmin(shares[open_classes])]] += 1
        chosen = []
        for label, share in enumerate(shares.tolist()):
            members = np.flatnonzero(self.labels == label)
            chosen.append(members[(2 * np.arange(share) + 1) * len(members) // (2 * max(share, 1))])
        return np.sort(np.concatenate(chosen))


def _parts(arrays: ArrayLike | Sequence[ArrayLike], source: str, labels: int) -> list[np.ndarray]:
    """Recordings from an argument: one recording, or several. ``labels``: how many there are."""
    sequence: Any = arrays
    if any(map(np.ma.is_masked, arrays if isinstance(arrays, list | tuple) else [arrays])):
        raise InputError(f"{source}: has masked values; fill them, or leave their recordings out")
    try:
        if not hasattr(arrays, "ndim") and not isinstance(arrays, Mapping) and len(sequence) > 0:
            vectors = all(getattr(part, "ndim", 0) == 1 for part in sequence)
            of_one = vectors and (labels == len(sequence) or len({*map(len, sequence)}) > 1)  # taxel
            if of_one or np.ndim(sequence[0]) in (2, 3):
                return [np.asarray(part) for part in sequence]
        whole = np.asarray(arrays)
    except (TypeError, ValueError, KeyError):  # no sequence, or rows of several lengths
        whole = np.zeros(1, dtype=object)
    if whole.dtype == object or not whole.ndim:
        kind = type(arrays).__name__ + " of objects" * hasattr(arrays, "ndim")
        raise InputError(
            f"{source}: {kind} is not an array of numbers; give an array (frames, taxels), or a list of such "
            "arrays"
        )
    return list(whole) if whole.ndim > 2 else [whole]


def recordings_of(
    arrays: dict[str, np.ndarray],
    source: str,
    *,
    groups: Mapping[str, Any] | None = None,
    scale: Worth | None = None,
    requested: bool = False,
    notes: Sequence[str] = (),
) -> Recordings:
    """The recordings that arrays hold, as an archive has them (docs/recordings.md).

    Parameters
    ----------
    source:
        Source of the recordings, for messages.
    groups:
        Name -> one value a recording; None: the other arrays of that length.
    scale:
        Value of one code where samples are real numbers and the arrays do not have it; None: chosen
        (``eskin.golden.data.codes``). requested: as `eskin.golden.data.codes.to_codes`.
    notes:
        Sentences about choices that were made before.

    Raises
    ------
    InputError
        The arrays break a rule of archives; the sentence names the array and the fix.
    """

    def refuse(array: str, why: str) -> NoReturn:
        raise InputError(f"recordings '{source}', array {array}: {why}")

    if "images" in arrays and "samples" not in arrays:
        return _images(arrays, source, groups, notes, refuse)
    arrays = _with_names(arrays)
    for name in ARCHIVE_ARRAYS:
        if name not in arrays:
            refuse(name, f"is missing; an archive holds {', '.join(ARCHIVE_ARRAYS)}")

    if arrays["samples"].ndim in (1, 3):
        frames, *grid = arrays["samples"].shape
        flat = arrays["samples"].reshape(frames, math.prod(grid))
        if grid and arrays.get("grid_shape", np.array(grid)).tolist() != grid:
            refuse("grid_shape", f"differs from the samples' own rows and columns, {grid}; leave it out")
        arrays = arrays | {"samples": flat, "grid_shape": np.array(grid)}
    samples, volt, scaling = _samples(arrays, source, scale, requested, refuse)
    low, high = int(samples.min()), int(samples.max())
    if low < -32768 or high > (32767 if low < 0 else 65535):
        refuse("samples", f"runs from {low} to {high}, beyond 16 bits; give -32768..32767 or 0..65535")
    # a narrow integer type is the codes' format; a wide one, which most readers give, is not
    narrow_type = samples.dtype.itemsize <= 2
    bits = 8 * samples.dtype.itemsize if narrow_type else 16
    signed = samples.dtype.kind == "i" if narrow_type else low < 0
    recordings = len(arrays["offsets"]) - 1

    class_names, labels = classes_of(arrays, recordings, refuse)
    rate = _positive_number(arrays["sample_rate_hz"])
    if rate is None:
        refuse("sample_rate_hz", f"is {_shown(arrays['sample_rate_hz'])}; give one number above 0, in hertz")
    return Recordings(
        samples=samples.astype(np.int32),
        offsets=arrays["offsets"].astype(np.int64),
        labels=labels,
        class_names=class_names,
        sample_rate_hz=rate,
        groups=_groups(arrays, recordings) if groups is None else dict(groups),
        source=source,
        volt_per_code=volt,
        unit=_unit(arrays),
        channel_names=_channel_names(arrays, samples.shape[1]),
        grid=_grid(arrays, samples.shape[1], refuse),
        sample_bits=bits,
        sample_signed=signed,
        notes=(*notes, *scaling),
    )


def _samples(
    arrays: Arrays, source: str, scale: Worth | None, requested: bool, refuse: Refuse
) -> tuple[np.ndarray, Worth, list[str]]:
    """The codes, the value of one in volt (0: unknown), and sentences about a scale that was chosen."""
    samples = arrays["samples"]
    if samples.dtype.kind not in "iuf":
        refuse(
            "samples",
            f"holds {samples.dtype}, not numbers; save A/D codes as integers, or real samples as floats",
        )
    if samples.ndim != 2 or samples.shape[1] < 1:
        refuse(
            "samples", f"has shape {samples.shape}; it must be (frames, taxels), or (frames, rows, columns)"
        )
    if not len(samples):
        refuse("samples", "holds no frame; an archive needs at least one recording")
    check_offsets(arrays["offsets"], len(samples), refuse)
    volt = _worth(arrays["lsb_volt"], samples.shape[1]) if "lsb_volt" in arrays else 0.0
    if volt is None:
        refuse(
            "lsb_volt",
            f"is {_shown(arrays['lsb_volt'])}; give the volts of one code, above 0, or one value per taxel, or "
            "leave the array out",
        )
    if samples.dtype.kind == "f":
        if not np.isfinite(samples).all():
            row, taxel = place_of(~np.isfinite(samples))
            recording = np.searchsorted(arrays["offsets"], row, "right") - 1
            refuse(
                "samples",
                f"holds {samples[row, taxel]} in recording {recording}, frame {row - arrays['offsets'][recording]}, taxel "
                f"{taxel}; every sample must be a finite number",
            )
        with np.errstate(over="ignore"):  # long doubles beyond the range of float64 are refused as infinite
            samples = samples.astype(np.float64)
        return to_codes(
            samples,
            f"recordings '{source}'",
            volt or scale,
            names=_channel_names(arrays, samples.shape[1]),
            kinds=_kinds(arrays, samples.shape[1]),
            requested=requested and not volt,
        )
    return samples, volt, []


def check_offsets(offsets: np.ndarray, frames: int, refuse: Refuse) -> None:
    """Refuse offsets that do not divide the frames into recordings."""
    if offsets.dtype.kind not in "iu" or offsets.ndim != 1 or len(offsets) < 2:
        refuse(
            "offsets",
            f"is {offsets.dtype} of shape {offsets.shape}; it must be integers of shape (recordings + 1,), of one "
            "recording at least",
        )
    if offsets[0] != 0:
        refuse("offsets", f"starts at {offsets[0]}; it must start at 0")
    if offsets[-1] != frames:
        refuse(
            "offsets",
            f"ends at {offsets[-1]} but samples has {frames} frames; the last value must be the number of "
            "frames",
        )
    still = np.flatnonzero(offsets[1:] <= offsets[:-1])
    if len(still):
        refuse("offsets", f"does not rise after entry {still[0]}; each recording needs a frame at least")


def _channel_names(arrays: Arrays, taxels: int) -> tuple[str, ...]:
    """Names of the taxels in the source; empty if it has none."""
    named = arrays.get("channel_names", np.array(()))
    return tuple(map(str, named.tolist())) if named.shape == (taxels,) and named.dtype.kind == "U" else ()


def _grid(arrays: Arrays, taxels: int, refuse: Refuse) -> tuple[int, ...]:
    """Rows and columns of the taxels; () without the array grid_shape."""
    grid = arrays.get("grid_shape", np.zeros(0, dtype=int))
    if grid.size and (
        grid.shape != (2,) or grid.dtype.kind not in "iu" or grid.min() < 1 or grid.prod() != taxels
    ):
        refuse("grid_shape", f"is {grid.tolist()}; give rows and columns of {taxels} taxels, or leave it out")
    return tuple(grid.tolist())


def _unit(arrays: Arrays) -> str:
    """The unit of the samples: the text of the array unit, or the texts of all taxels joined by UNITS if they
    differ. Without that array: volt if there is lsb_volt, otherwise ""."""
    named = arrays.get("unit")
    if named is not None and named.size and named.dtype.kind in "US":
        texts = named.reshape(-1).astype(str).tolist()
        return UNITS.join(texts if len(set(texts)) > 1 else texts[:1])
    return "V" if "lsb_volt" in arrays else ""


def _kinds(arrays: Arrays, taxels: int) -> list[str]:
    """The kind of each taxel: its unit if units differ; otherwise its name without the number or the axis at
    its end, if some taxels then share a name that says something; otherwise an empty list."""
    units = _unit(arrays).split(UNITS)
    if len(units) == taxels > 1:
        return units
    names = [re.sub(r"[\W_]*(\d+|[xyzXYZ])$", "", name) for name in _channel_names(arrays, taxels)]
    says = len(set(names)) < len(names) and not {*map(str.lower, names)} <= _NUMBERED
    return names if says else []


_NUMBERED = {
    "",
    *"a adc ai analog c ch channel col column data f field in input s sensor sig signal unnamed v value var x".split(),
}
"""Words before a number that say nothing of a column."""
UNITS = ", "
"""Separator between the units of taxels of different kinds."""


Refuse = Callable[[str, str], NoReturn]


def natural(name: str) -> list:
    """A key that sorts mat2 before mat10."""
    digits = ((part.lstrip("0"), part) for part in re.split(r"(\d+)", name) if part)
    return [(0, len(number), number) if part.isdecimal() else (1, 0, part) for number, part in digits]


def _with_names(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Without class names, the labels (text or whole numbers) are the names."""
    labels = arrays.get("labels")
    if labels is None or labels.dtype.kind not in ("US" if "class_names" in arrays else "USiu"):
        return arrays
    if labels.dtype.kind == "S":
        labels = np.char.decode(labels, "utf-8", "replace")
    labels = labels.astype(np.str_)
    names = np.array(sorted(set(labels.ravel().tolist()), key=natural), dtype=np.str_)
    return {"class_names": names} | arrays | {"labels": labels}


def classes_of(arrays: Arrays, recordings: int, refuse: Refuse) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the classes, and the class of each recording."""
    names = arrays["class_names"]
    if names.dtype.kind not in "US" or names.ndim != 1 or not len(names):
        refuse(
            "class_names",
            f"is {names.dtype} of shape {names.shape}; it must be a list of text, one name per class",
        )
    try:
        class_names = tuple(str(name.decode() if isinstance(name, bytes) else name) for name in names)
    except UnicodeDecodeError:
        refuse("class_names", "holds bytes that are not UTF-8; save the names as text")
    for index, name in enumerate(class_names):
        if not name.strip() or not name.isprintable():
            refuse(
                "class_names",
                f"has an empty or unprintable name at {index}; give every class a readable name",
            )
        if name in class_names[:index]:
            refuse("class_names", f"has the name {name} twice; names must differ")

    labels = arrays["labels"]
    if labels.dtype.kind == "U" and labels.shape == (recordings,):
        unknown = [label for label in labels.tolist() if label not in class_names]
        if unknown:
            refuse(
                "labels",
                f"holds '{unknown[0][:40]}', which is not in class_names; add it or correct the label",
            )
        labels = np.array([class_names.index(label) for label in labels.tolist()])
    if labels.dtype.kind not in "iu" or labels.shape != (recordings,):
        refuse(
            "labels",
            f"is {labels.dtype} of shape {labels.shape}; it must be integers, or names, of shape "
            f"({recordings},), one per recording",
        )
    outside = (labels < 0) | (labels >= len(class_names))
    if outside.any():
        first = int(np.argmax(outside))
        refuse(
            "labels",
            f"gives recording {first} class {labels[first]}; class_names has classes "
            f"0..{len(class_names) - 1}",
        )
    return class_names, labels.astype(np.int64)


def _groups(arrays: Arrays, recordings: int) -> dict[str, np.ndarray]:
    return {
        name: values
        for name, values in arrays.items()
        if name not in NOT_GROUPS and values.shape == (recordings,) and values.dtype.kind in GROUP_KINDS
    }


def _images(
    arrays: Arrays, source: str, groups: Mapping[str, Any] | None, notes: Sequence[str], refuse: Refuse
) -> Recordings:
    """The recordings of an archive of images: each is one image, with its rows as the frames."""
    arrays = _with_names(dict(arrays))
    for name in IMAGE_ARRAYS:
        if name not in arrays:
            refuse(name, f"is missing; an archive of images holds {', '.join(IMAGE_ARRAYS)}")
    images = arrays["images"]
    if images.ndim != 3 or not len(images):
        refuse("images", f"has shape {images.shape}; it must be (images, height, width), one image at least")
    count, height, width = images.shape
    if not (4 <= height <= 256 and 4 <= width <= 160):
        refuse("images", f"are {height} x {width} pixels; give 4 x 4 to 256 x 160 (height x width)")
    if images.dtype.kind == "f":
        wrong = ~((images >= 0) & (images <= 1))  # not a number is wrong too
        if wrong.any():
            number = int(np.argmax(wrong.any(axis=(1, 2))))
            refuse(
                "images",
                f"holds {images[number][wrong[number]][0]:g} in image {number}; real pixels lie in 0..1, "
                "codes are integers 0..255",
            )
        images, notes = np.rint(255.0 * images), (*notes, "pixels from 0 to 1 became codes from 0 to 255")
    elif images.dtype.kind not in "iu":
        refuse("images", f"holds {images.dtype}, not numbers; save pixels as uint8")
    elif images.min() < 0 or images.max() > 255:
        refuse("images", f"runs from {images.min()} to {images.max()}; a pixel has 8 bits, 0..255")
    class_names, labels = classes_of(arrays, count, refuse)
    rate = _positive_number(arrays.get("sample_rate_hz", np.array(IMAGE_ROWS_HZ)))
    if rate is None:
        refuse(
            "sample_rate_hz",
            f"is {_shown(arrays['sample_rate_hz'])}; give rows per second, above 0, or leave the array out",
        )
    recordings = image_recordings(images, labels, class_names, rate_hz=rate, source=source)
    return dataclasses.replace(
        recordings, groups=_groups(arrays, count) if groups is None else dict(groups), notes=tuple(notes)
    )


def image_recordings(
    images: np.ndarray,
    labels: np.ndarray,
    class_names: Sequence[str],
    *,
    rate_hz: float = IMAGE_ROWS_HZ,
    source: str = "images",
) -> Recordings:
    """Images (n, height, width) of codes 0..255 as recordings: each row is a frame, from the top, ``rate_hz``
    rows a second."""
    count, height, width = images.shape
    return Recordings(
        samples=images.reshape(count * height, width).astype(np.int32),
        offsets=np.arange(count + 1) * height,
        labels=np.asarray(labels),
        class_names=tuple(class_names),
        sample_rate_hz=rate_hz,
        source=source,
        sample_bits=8,
        image_shape=(height, width),
    )


def _positive_number(value: np.ndarray) -> float | None:
    """The single finite number above 0 that ``value`` holds, or None."""
    if value.size != 1 or value.dtype.kind not in "iuf":
        return None
    number = float(value.item())
    return number if 0 < number < np.inf else None


def _worth(value: np.ndarray, taxels: int) -> Worth | None:
    """The finite number above 0 in ``value``, or one per taxel if they differ; otherwise None."""
    if value.shape != (taxels,) or value.dtype.kind not in "iuf":
        return _positive_number(value)
    numbers = tuple(map(float, value))
    if not all(np.isfinite(value) & (value > 0)):
        return None
    return numbers if len(set(numbers)) > 1 else numbers[0]


def _shown(value: np.ndarray) -> str:
    return str(value.item()) if value.size == 1 else f"of shape {value.shape}"
