"""The first touches of recordings, found once and cut into the windows of many candidates.

The choice tries hundreds of front ends; those with the same rest level and gate share their touches.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.model.preprocess import Ended, Touches, divided, scans, start_frame, window_values

GATE_BATCH = 1 << 24
"""Like BATCH_SAMPLES, for the choice of front end. It runs one gate after another over all recordings, and
larger batches take less time."""


@dataclass(frozen=True)
class FirstTouches:
    """The first touch of every recording that has one, under one rest level and gate.

    recordings: number of recordings scanned. recording (n): index of each touch's recording. onset_frame (n):
    1-based, 0 where the gate opens at once. deviations: of each touch (frames, taxels), codes, from the first
    frame of its recording to ``reach`` frames after its onset, or to an earlier end of recording or touch. ended:
    how each touch ended, with ``window_mode`` whole; else empty.
    """

    recordings: int
    recording: np.ndarray
    onset_frame: np.ndarray
    deviations: list[np.ndarray]
    reach: int
    ended: tuple[Ended, ...] = ()

    def __len__(self) -> int:
        return len(self.recording)

    @property
    def touched(self) -> list[np.ndarray]:
        """Deviations of each touch from its onset on."""
        pairs = zip(self.deviations, self.onset_frame.tolist(), strict=True)
        return [part[max(onset - 1, 0) :] for part, onset in pairs]

    @property
    def nbytes(self) -> int:
        """Bytes of the deviations."""
        return sum(part.nbytes for part in self.deviations)

    def within(self, reach: int) -> FirstTouches:
        """The same touches, cut to ``reach`` frames after each onset."""
        pairs = zip(self.deviations, self.onset_frame.tolist(), strict=True)
        parts = [part[: onset + reach].copy() for part, onset in pairs]
        return dataclasses.replace(self, deviations=parts, reach=reach)


def first_touches(config: AcceleratorConfig, recordings: Recordings) -> FirstTouches:
    """The first touch of every recording that has one. They depend on rest level and gate alone, if the touch
    is at least as long as those that ``cut_windows`` cuts from it: a tracked rest level does not move until
    the touch ends."""
    rows: list[tuple[int, int]] = []
    parts: list[np.ndarray] = []
    ended: list[Ended] = []
    recordings = recordings.scanned(config.sensor.scan_every)
    lengths = recordings.lengths
    for first, _, deviations, onsets, front in scans(config, recordings, most=GATE_BATCH):
        touched = set()
        for index, onset, start in onsets:
            if index not in touched:
                touched.add(index)
                part = deviations[: min(int(lengths[first + index]), start - 1 + config.last_frame), index]
                small = not part.size or (part.min() >= -(1 << 15) and part.max() < 1 << 15)
                if config.follows_touch:
                    ended.append(front.ended[index, start])
                rows.append((first + index, onset))
                parts.append(part.astype(np.int16 if small else np.int32))
    recording, onset_frame = np.array(rows, dtype=np.int64).reshape(-1, 2).T
    return FirstTouches(len(lengths), recording, onset_frame, parts, config.last_frame, tuple(ended))


def cut_windows(config: AcceleratorConfig, touches: FirstTouches) -> Touches:
    """The result of ``find_touches`` for the first touches, from ``first_touches`` of a configuration with
    the same rest level and gate whose touch is at least as long; with ``window_mode`` whole, of one with that mode,
    ``rearm_frames`` and ``touch_frames``. ``partial``: the recording ends before the touch does."""
    spans, count, follows = config.window_spans, len(touches), config.follows_touch
    doublings, lengths = 0, np.zeros((count, len(spans)), dtype=np.int64)
    start = np.array(
        [start_frame(config, onset, 0) for onset in touches.onset_frame.tolist()], dtype=np.int64
    )
    values = np.zeros((count, len(spans), config.inputs), dtype=np.int64)
    completed, partial = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=bool)
    for index, (first, part) in enumerate(zip(start.tolist(), touches.deviations, strict=True)):
        end = first - 1 + config.last_frame
        partial[index] = len(part) < end
        if follows:
            ended = touches.ended[index]
            spans, lengths[index], doublings = divided(config, ended)
            partial[index] = ended.partial(config)
        values[index], completed[index] = window_values(config, part[:end], first, spans, doublings)
    known = touches.recordings, touches.recording, touches.onset_frame, start, completed, partial, values
    if not follows:
        return Touches(*known)
    ends, cut = np.array([(ended.end, ended.cut) for ended in touches.ended], dtype=np.int64).reshape(-1, 2).T
    return Touches(*known, ended=ends, cut=cut.astype(bool), lengths=lengths)
