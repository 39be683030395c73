"""Recordings in memory, and whether they fit a configuration.

Every refusal is an InputError of one sentence that names the file, the array or line, and the fix. Nothing here guesses: an archive
that breaks the rules of docs/recordings.md is refused before any work starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.core.formats import QFormat

ARCHIVE_ARRAYS = ("samples", "offsets", "labels", "class_names", "sample_rate_hz")
"""The arrays every archive must hold."""

NOT_GROUPS = (*ARCHIVE_ARRAYS, "channel_names", "lsb_volt", "sample_rate_is_inferred", "images")
"""Arrays that are never a group, whatever their length."""


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
        What recordings have in common (person, trial, ...): name -> array of length recordings.
    source:
        Where they come from, for messages and the report.
    volt_per_code:
        Volt of one code; 0 when the samples are no voltage or it is not known.
    sample_bits, sample_signed:
        The A/D code's format.
    notes:
        Sentences about choices the loader made.
    """

    samples: np.ndarray
    offsets: np.ndarray
    labels: np.ndarray
    class_names: tuple[str, ...]
    sample_rate_hz: float
    groups: dict[str, np.ndarray] = field(default_factory=dict)
    source: str = "recordings"
    volt_per_code: float = 0.0
    sample_bits: int = 16
    sample_signed: bool = False
    notes: tuple[str, ...] = ()

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
            raise InputError(f"{self.source}: a subset of no recordings was asked for; ask for at least one")
        return Recordings(
            samples=np.concatenate([self.recording(i) for i in indices]),
            offsets=np.concatenate([[0], np.cumsum(self.lengths[indices])]),
            labels=self.labels[indices],
            class_names=self.class_names,
            sample_rate_hz=self.sample_rate_hz,
            groups={name: values[indices] for name, values in self.groups.items()},
            source=self.source,
            volt_per_code=self.volt_per_code,
            sample_bits=self.sample_bits,
            sample_signed=self.sample_signed,
            notes=self.notes,
        )

    def evenly(self, n: int) -> np.ndarray:
        """Indices (ascending) of ``n`` recordings: the same every time, spread over the classes and over each class's list.

        A class with too few gives all of its recordings and the others give more; ``n`` of all or more gives every index.
        """
        if n < 1:
            raise InputError(f"{n} recordings were asked for; ask for at least 1")
        if n >= len(self):
            return np.arange(len(self))
        shares = np.zeros(len(self.class_names), dtype=np.int64)
        while shares.sum() < n:
            open_classes = np.flatnonzero(shares < self.class_counts)
            shares[open_classes[np.argmin(shares[open_classes])]] += 1
        chosen = []
        for label, share in enumerate(shares):
            members = np.flatnonzero(self.labels == label)
            chosen.append(members[(2 * np.arange(share) + 1) * len(members) // (2 * max(share, 1))])
        return np.sort(np.concatenate(chosen))


def check_fit(recordings: Recordings, config: AcceleratorConfig) -> None:
    """Refuse recordings that this configuration's sensor did not give, before any long work.

    Raises
    ------
    InputError
        Other taxels, codes outside the sample format, a rate more than 2 % off, or other class names.
    """

    def refuse(what: str, why: str) -> None:
        raise InputError(f"recordings '{recordings.source}', {what}: {why}; use recordings and a model of one sensor and task")

    if recordings.taxels != config.sensor.taxels:
        refuse(
            "array samples", f"has {recordings.taxels} taxels and configuration '{config.name}', field taxels, has {config.sensor.taxels}"
        )
    low, high = int(recordings.samples.min()), int(recordings.samples.max())
    if low < config.sample_format.min_code or high > config.sample_format.max_code:
        span = f"{config.sample_format.min_code}..{config.sample_format.max_code}"
        refuse("array samples", f"runs from {low} to {high} and configuration '{config.name}', field sample_bits, takes {span}")
    if abs(recordings.sample_rate_hz / config.sensor.sample_rate_hz - 1.0) > 0.02:
        wanted = f"configuration '{config.name}', field sample_rate_hz, has {config.sensor.sample_rate_hz:g}"
        rates = f"is {recordings.sample_rate_hz:g} and {wanted}"
        refuse("array sample_rate_hz", rates)
    if recordings.class_names != config.network.class_names:
        names = f"is {', '.join(recordings.class_names)} and configuration '{config.name}' has {', '.join(config.network.class_names)}"
        refuse("array class_names", names)
