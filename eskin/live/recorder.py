"""Frames into an archive while they are shown: straight to the disk, before any viewer gets them.

Memory does not grow with the recording. The archive (docs/recordings.md) appears whole when the recorder is closed.
"""

from __future__ import annotations

import os
import secrets
from pathlib import Path

import numpy as np

from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.errors import InputError
from eskin.golden.core.files import check_target, replacing


class Recorder:
    """Writes what ``begin``, ``frames`` and ``end`` bring.

    Parameters
    ----------
    path:
        The archive, new or replaced.
    config:
        Of the model: taxels, classes, rate.

    Raises
    ------
    InputError
        ``path`` is no file to write, or its folder cannot be written.
    """

    def __init__(self, path: Path, config: AcceleratorConfig) -> None:
        if path.suffix != ".npz":
            raise InputError(f"--record {path}: is an archive and ends with .npz; name it so")
        check_target(path)
        self.path, self._config = path, config
        self._raw = path.with_name(f".{path.name}.{secrets.token_hex(4)}.frames")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self._raw.open("wb")
        except OSError as error:
            raise InputError(f"--record {path}: cannot be written ({error.strerror}); name a file in a folder of yours") from None
        sensor = config.sensor
        self._type = np.dtype(f"<{'i' if sensor.sample_signed else 'u'}{1 if sensor.sample_bits <= 8 else 2}")
        self._ends: list[int] = []
        self._labels: list[int] = []
        self._decisions: list[int] = []
        self._label = -1
        self._open = False
        self.frames_written = 0

    def begin(self, label: int) -> None:
        """The next frames are of a new recording of class ``label`` (-1 unknown: its decision is its label)."""
        self.end(-1)
        self._label, self._open = label, True

    def frames(self, samples: np.ndarray) -> None:
        """Append frames (n, taxels); they are with the operating system when this returns."""
        self._file.write(samples.astype(self._type).tobytes())
        self.frames_written += len(samples)

    def end(self, decision: int) -> None:
        """The recording is over; one without a frame is left out."""
        begun = self._ends[-1] if self._ends else 0
        if self._open and self.frames_written > begun:
            self._ends.append(self.frames_written)
            self._labels.append(self._label)
            self._decisions.append(decision)
        self._open = False

    def close(self) -> bool:
        """Make the archive; False: nothing was recorded, and there is none.

        Arrays: those of docs/recordings.md, and ``decision`` (recordings, 1): the model's, -1 none (of this shape it is no group). A
        recording of unknown class has its decision for a label, or class 0.
        """
        self.end(-1)
        try:
            with self._file:
                self._file.flush()
                os.fsync(self._file.fileno())
            if not self._ends:
                return False
            taxels = self._config.sensor.taxels
            samples = np.memmap(self._raw, dtype=self._type, mode="r", shape=(self._ends[-1], taxels))
            decisions = np.array(self._decisions, dtype=np.int64)
            labels = np.where(np.array(self._labels) >= 0, self._labels, np.maximum(decisions, 0))
            volt = self._config.sensor.volt_per_code
            with replacing(self.path) as temporary, temporary.open("wb") as file:
                np.savez(
                    file,
                    allow_pickle=False,
                    samples=samples,
                    offsets=np.array([0, *self._ends], dtype=np.int64),
                    labels=labels,
                    class_names=np.array(self._config.network.class_names),
                    sample_rate_hz=np.array(self._config.sensor.sample_rate_hz),
                    decision=decisions[:, None],
                    **({"lsb_volt": np.array(volt)} if volt else {}),
                )
            return True
        finally:
            self._raw.unlink(missing_ok=True)
