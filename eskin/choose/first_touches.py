"""The first touches of recordings, found once and cut into the windows of many candidates.

The choice tries hundreds of front ends; those with the same rest level and gate share their touches.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eskin.golden.core import AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.model.preprocess import Touches, companded, scans, start_frame, window_values

GATE_BATCH = 1 << 24
"""Like BATCH_SAMPLES, for the choice of front end. It runs one gate after another over all recordings, and
larger batches take less time."""


@dataclass(frozen=True)
class FirstTouches:
    """The first touch of every recording that has one, under one rest level and gate.

    recordings: number of recordings scanned. recording (n): index of each touch's recording. onset_frame (n):
    1-based, 0 where the gate opens at once. offsets (n + 1), deviations (taxels, frames): columns
    offsets[i]..offsets[i + 1] are those of touch i, codes. They go from the first frame of its recording to
    ``reach`` frames after its onset, or to an earlier end of recording or touch.
    """

    recordings: int
    recording: np.ndarray
    onset_frame: np.ndarray
    offsets: np.ndarray
    deviations: np.ndarray
    reach: int
    _known: dict[object, np.ndarray] = dataclasses.field(default_factory=dict, compare=False, repr=False)

    def __len__(self) -> int:
        return len(self.recording)

    @property
    def lengths(self) -> np.ndarray:
        """Number of frames that are kept of each touch."""
        return np.diff(self.offsets)

    def forget(self) -> None:
        """Drop the sums; they are computed again at the next access."""
        self._known.clear()

    def deviations_of_touch(self, index: int) -> np.ndarray:
        """Deviations (frames, taxels) of one touch's recording."""
        return self.deviations[:, self.offsets[index] : self.offsets[index + 1]].T

    def within(self, reach: int) -> FirstTouches:
        """The same touches, cut to ``reach`` frames after each onset."""
        lengths = np.minimum(self.lengths, self.onset_frame + reach)
        parts = [
            self.deviations[:, begin : begin + length]
            for begin, length in zip(self.offsets[:-1], lengths, strict=True)
        ]
        flat = np.concatenate(parts, axis=1) if parts else self.deviations
        return FirstTouches(self.recordings, self.recording, self.onset_frame, _offsets(lengths), flat, reach)

    @property
    def running(self) -> np.ndarray:
        """(taxels, frames + 1): sums of all columns before; the type holds the sums of one touch, so
        differences within a touch are right even if the sums over all touches wrap."""
        if () not in self._known:
            self._known[()] = self._summed(self.deviations)
        return self._known[()]

    def blocks(self, rule: str, block: int) -> tuple[np.ndarray, np.ndarray]:
        """(offsets (n), running sums (taxels, blocks + 1)) of the activity of blocks that are counted from
        each recording's first frame: the sum before touch i's block b stands in column offsets[i] + b."""
        counts = self.lengths // block
        first = _offsets(counts)
        if (rule, block) not in self._known:
            if block == 1:
                sums = self.deviations.astype(self.running.dtype)
            else:
                of_touch = np.repeat(np.arange(len(self)), counts)
                begin = self.offsets[of_touch] + (np.arange(first[-1]) - first[of_touch]) * block
                sums = self.running[:, begin + block] - self.running[:, begin]
            if rule == "change":
                sums[:, 1:] = np.diff(sums, axis=1)
                sums[:, first[:-1][counts > 0]] = 0  # the first block of a recording has none before it
            self._known[rule, block] = self._summed(np.abs(sums, out=sums))
        return first[:-1], self._known[rule, block]

    def _summed(self, values: np.ndarray) -> np.ndarray:
        largest = max(int(self.deviations.max(initial=0)), -int(self.deviations.min(initial=0)))
        # a change is twice a deviation at most
        small = 2 * largest * int(self.lengths.max(initial=0)) < 1 << 31
        total = np.zeros((len(values), values.shape[1] + 1), dtype=np.int32 if small else np.int64)
        total[:, 1:] = values
        return np.cumsum(total, axis=1, out=total)  # in place: an additional cast takes longer


def _offsets(lengths: np.ndarray | Sequence[int]) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(lengths, dtype=np.int64)])


def first_touches(config: AcceleratorConfig, recordings: Recordings) -> FirstTouches:
    """The first touch of every recording that has one. They depend on rest level and gate alone, if the touch
    is at least as long as those that ``cut_windows`` cuts from it: a tracked rest level does not move until
    the touch ends."""
    rows: list[tuple[int, int]] = []
    parts: list[np.ndarray] = []
    recordings = recordings.scanned(config.sensor.scan_every)
    lengths = recordings.lengths
    for first, _, deviations, onsets, _ in scans(config, recordings, most=GATE_BATCH):
        touched = set()
        for index, onset, start in onsets:
            if index not in touched:
                touched.add(index)
                part = deviations[: min(int(lengths[first + index]), start - 1 + config.last_frame), index]
                small = not part.size or (part.min() >= -(1 << 15) and part.max() < 1 << 15)
                rows.append((first + index, onset))
                parts.append(part.astype(np.int16 if small else np.int32).T)
    recording, onset_frame = np.array(rows, dtype=np.int64).reshape(-1, 2).T
    flat = np.concatenate(parts, axis=1) if parts else np.zeros((config.sensor.taxels, 0), dtype=np.int16)
    return FirstTouches(
        len(lengths),
        recording,
        onset_frame,
        _offsets([part.shape[1] for part in parts]),
        flat,
        config.last_frame,
    )


def cut_windows(config: AcceleratorConfig, touches: FirstTouches) -> Touches:
    """The result of ``find_touches`` for the first touches, from ``first_touches`` of a configuration with
    the same rest level and gate whose touch is at least as long. ``partial``: the recording ends before
    the touch does."""
    lead = np.array([start_frame(config, int(onset), 0) - 1 for onset in touches.onset_frame], dtype=np.int64)
    held = np.minimum(touches.lengths - lead, config.last_frame)
    spans = np.array(config.window_spans, dtype=np.int64).reshape(-1, 2)
    complete = spans[:, 1] <= held[:, None]  # (n, K)
    values = np.zeros((len(touches), len(spans), config.sensor.taxels, config.kinds), dtype=np.int64)
    if config.windows.window_mode == "free":
        touch, window = np.nonzero(complete)
        # frames before each window and up to its end, counted from the recording's first
        before, last = (lead[touch] + spans[window, 0] - 1, lead[touch] + spans[window, 1])
        at = touches.offsets[touch]
        for number, kind in enumerate(config.features.feature_kinds):
            if kind == "mean":
                sums = touches.running[:, at + last] - touches.running[:, at + before]
            elif kind == "integral":
                total = touches.running[:, at + last] - touches.running[:, at + lead[touch]]
                sums = companded(
                    total.astype(np.int64), config.features.integral_knee, config.features.integral_frac
                )
            else:  # hops are whole blocks, so a touch's blocks are those of its recording
                first, amounts = touches.blocks(config.features.activity_rule, config.features.activity_block)
                block = config.features.activity_block
                sums = amounts[:, first[touch] + last // block] - amounts[:, first[touch] + before // block]
            values[touch, window, :, number] = sums.T
    else:
        for index in range(len(touches)):
            part = touches.deviations_of_touch(index)[: lead[index] + held[index]]
            values[index] = window_values(config, part, int(lead[index]) + 1, config.window_spans)[0].reshape(
                values[index].shape
            )
    return Touches(
        touches.recordings,
        touches.recording,
        touches.onset_frame,
        lead + 1,
        complete.sum(axis=1),
        held < config.last_frame,
        values.reshape(len(touches), len(spans), config.inputs),
    )
