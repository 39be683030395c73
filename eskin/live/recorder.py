"""Frames into an archive while they are shown: straight to the disk, before any viewer gets them.

Memory does not grow with the recording. The archive (docs/recordings.md) appears whole when the recorder is
closed; the frames are deleted only then.
"""

import json
import os
import secrets
from pathlib import Path

import numpy as np

from eskin.data.frames import SUFFIX, arrays_of, row_type
from eskin.golden.core import AcceleratorConfig, InputError, check_target, replacing


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
        self.path, self._raw = path, path.with_name(f"{path.stem}.{secrets.token_hex(4)}{SUFFIX}")
        sensor = config.sensor
        head = {
            "code": f"<{'i' if sensor.sample_signed else 'u'}{1 if sensor.sample_bits <= 8 else 2}",
            "taxels": sensor.taxels,
            "class_names": config.network.class_names,
            "sample_rate_hz": sensor.sample_rate_hz,
            "lsb_volt": sensor.volt_per_code,
        }
        self._row = row_type(head)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self._raw.open("wb")
            self._file.write(json.dumps(head).encode() + b"\n")
        except OSError as error:
            raise InputError(
                f"--record {path}: cannot be written ({error.strerror}); name a file in a folder of yours"
            ) from None
        self._decisions: dict[int, int] = {}  # of the recordings that have a frame
        self._number = self._label = -1
        self.frames_written = 0

    def begin(self, label: int) -> None:
        """The next frames are of a new recording of class ``label``."""
        self._number, self._label = self._number + 1, label

    def frames(self, samples: np.ndarray) -> None:
        """Append frames (n, taxels); they are with the operating system when this returns."""
        rows = np.empty(len(samples), self._row)
        rows["samples"], rows["recording"], rows["label"] = samples, self._number, self._label
        self._file.write(rows.tobytes())
        self._file.flush()
        self._decisions.setdefault(self._number, -1)
        self.frames_written += len(samples)

    def end(self, decision: int) -> None:
        """The recording is over, if it has begun; one without a frame is left out."""
        if self._number in self._decisions:
            self._decisions[self._number] = decision

    def close(self) -> bool:
        """Make the archive; False: nothing was recorded, and there is none.

        Arrays: those of docs/recordings.md, and ``decision`` (recordings, 1): the model's, -1 none (of this
        shape it is no group).

        Raises
        ------
        InputError
            The archive cannot be written; the frames stay, and the sentence says where and what to do with
            them.
        """
        try:
            with self._file:
                self._file.flush()
                os.fsync(self._file.fileno())
            if self.frames_written:
                decisions = np.array([*self._decisions.values()])[:, None]
                with replacing(self.path) as temporary, temporary.open("wb") as file:
                    np.savez(file, allow_pickle=False, **arrays_of(self._raw), decision=decisions)
        except OSError as error:
            reason = error.strerror or error
            raise InputError(
                f"--record {self.path}: cannot be written ({reason}), what was recorded is in {self._raw}; "
                "make room, then run: "
                f"eskin convert {self._raw} --out {self.path}"
            ) from None
        self._raw.unlink(missing_ok=True)
        return bool(self.frames_written)
