"""Labelled touches out of a sensor's frames, into an archive that grows."""

import dataclasses
import math
from collections import Counter, deque
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np

from eskin.data import load_recordings
from eskin.data.archive import save_archive
from eskin.data.fit import check_fit
from eskin.golden.core import AcceleratorConfig, InputError, Record, check_target
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, Stream
from eskin.golden.model.vectors import ARMED, TOUCH
from eskin.live.feed import Event, Onset

LEAD_S = 0.5
"""Seconds of rest before an onset, at least: another front end than this model's may take them for its rest level."""
MOST_LETTERS = 60


class GrowingArchive:
    """Recordings in an archive file, which is replaced as a whole with each one that is added or taken back.

    Files are written in a thread of their own: a serial port that nobody reads for so long loses bytes.

    Parameters
    ----------
    path:
        The file; where it is there already, recordings are added to it.

    Attributes
    ----------
    added: recordings that were added since it was opened, and can be taken back.

    Raises
    ------
    InputError
        The file cannot be written, or holds recordings of another sensor or with groups.
    """

    def __init__(self, path: Path, config: AcceleratorConfig) -> None:
        self.path, self.added, sensor = path, 0, config.sensor
        self._writer, self._writing = ThreadPoolExecutor(1), Future[None]()
        self._writing.set_result(None)
        self._recordings: list[tuple[np.ndarray, str]] = []  # samples and class of each
        self._of = Recordings(
            samples=np.zeros((0, sensor.taxels), dtype=np.int32),
            offsets=np.zeros(1, dtype=np.int64),
            labels=np.zeros(0, dtype=np.int64),
            class_names=(),
            sample_rate_hz=sensor.sample_rate_hz,
            source=str(path),
            volt_per_code=sensor.volt_per_code,
            sample_bits=sensor.sample_bits,
            sample_signed=sensor.sample_signed,
        )
        if path.suffix != ".npz":
            raise InputError(f"--record {path}: is no archive; give a name that ends with .npz")
        check_target(path)
        if path.exists():
            self._of = of = load_recordings(path)
            check_fit(dataclasses.replace(of, class_names=config.network.class_names), config)
            if of.groups:
                raise InputError(
                    f"--record {path}: has groups ({', '.join(of.groups)}), which a new recording has no value of; "
                    "give another file"
                )
            names = [of.class_names[label] for label in of.labels]
            self._recordings = [(of.recording(index), name) for index, name in enumerate(names)]
        self._written = self._file()

    def _file(self) -> tuple[int, int] | None:
        """Another pair for each file that takes the name."""
        return ((state := self.path.stat()).st_ino, state.st_mtime_ns) if self.path.exists() else None

    @property
    def counts(self) -> Counter[str]:
        """Recordings of each class."""
        return Counter(name for _, name in self._recordings)

    def add(self, samples: np.ndarray, name: str) -> None:
        """Append a recording (frames, taxels) of class ``name``."""
        self._recordings.append((samples, name))
        self.added += 1
        self._write()

    def undo(self) -> None:
        """Take back the recording that was added last, if there is one."""
        if self.added:
            self._recordings.pop()
            self.added -= 1
            self._write()

    def _write(self) -> None:
        self._writing.result()
        if self._file() != self._written:
            raise InputError(
                f"--record {self.path}: another program has written it, and the last touch here is not in it; give each a "
                "file"
            )
        names = tuple(dict.fromkeys([*self._of.class_names, *self.counts]))
        if not self._recordings:
            self._writing, self._written = self._writer.submit(self.path.unlink), None
            return
        recordings = dataclasses.replace(
            self._of,
            samples=np.concatenate([samples for samples, _ in self._recordings]),
            offsets=np.cumsum([0, *(len(samples) for samples, _ in self._recordings)]),
            labels=np.array([names.index(name) for _, name in self._recordings]),
            class_names=names,
        )
        self._writing = self._writer.submit(self._save, recordings)

    def _save(self, recordings: Recordings) -> None:
        save_archive(recordings, self.path)
        self._written = self._file()

    def close(self) -> None:
        """Wait until the file is written.

        Raises
        ------
        InputError, OSError
            It could not be.
        """
        self._writer.shutdown()
        self._writing.result()


class Recorder:
    """Keeps frames while a class is recorded: each touch, from its rest to the pause behind it, is a recording.

    Parameters
    ----------
    model:
        Its front end finds touches; it takes every frame.

    Attributes
    ----------
    name: of the class that is recorded; empty: none. trouble: why the last touch was not added.

    Raises
    ------
    InputError
        The model does not find touches.
    """

    def __init__(self, archive: GrowingArchive, model: IntegerModel) -> None:
        config, rule = model.config, model.config.onset_rule
        if config.opens_at_once:
            raise InputError(
                f"configuration '{config.name}', field onset: is 'immediate', which finds no touch to record; use "
                "'band' or 'baseline'"
            )
        self.archive, self._model = archive, model
        self.name = self.trouble = ""
        judged = 2 * rule.onset_mean_frames if rule.onset == "baseline" else 0
        needed = config.rest_level.rest_frames + judged + config.windows.pretrigger_frames
        self.lead = max(needed, math.ceil(LEAD_S * config.sensor.sample_rate_hz))
        self.begin()

    def begin(self) -> None:
        """Forget all frames: the next one follows `arm`."""
        self._kept, self._onset = deque[np.ndarray](), 0

    def interrupt(self, why: str) -> None:
        """Frames are missing: a touch under way is not added."""
        self.trouble = why if self._onset else self.trouble

    def take(self, samples: np.ndarray, events: Sequence[Event], stream: Stream) -> bool:
        """The next frames, what they brought, and the stream that took them. True: a touch is over."""
        self._kept.append(samples)
        self._onset = self._onset or next((event.frame for event in events if isinstance(event, Onset)), 0)
        if not self._onset:  # the rest alone
            while sum(map(len, self._kept)) - len(self._kept[0]) >= self.lead:
                self._kept.popleft()
        if not self._onset or stream.status & (ARMED | TOUCH) != ARMED:
            return False
        samples = np.concatenate(self._kept)
        begin = self._onset - 1 - self.lead - (stream.frame - len(samples))
        self.trouble = "it came too early" if begin < 0 else self._refusal(samples[begin:])
        if not self.trouble:
            self.archive.add(samples[begin:], self.name)
        return True

    def _refusal(self, samples: np.ndarray) -> str:
        """Why the frames are not one touch when they are played; empty where they are."""
        again = Stream(self._model)
        again.push(samples)
        again.finish()
        found = again.touches == 1 and again.decision >= 0
        return (
            ""
            if found
            else f"played again it is {again.touches} touches, the first with decision {again.decision}"
        )

    def progress(self, stream: Stream) -> Record:
        """What the page shows: the class, what the recorder waits for, recordings of each class, and the file."""
        counts, touch = self.archive.counts, ""
        if self.name:
            touch = f"touch {counts[self.name] + 1} of class {self.name}"
            if self._onset:
                touch += " is under way: lift when it is over"
            else:
                ready = stream.frame >= self.lead
                touch = f"press the sensor: {touch}" if ready else f"keep off the sensor: {touch} comes next"
        trouble = f"the last touch was not added: {self.trouble}" if self.trouble else ""
        return {
            "name": self.name,
            "waits": touch,
            "trouble": trouble,
            "counts": dict(counts),
            "undo": self.archive.added,
            "file": str(self.archive.path),
        }
