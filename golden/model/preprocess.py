"""Preprocessing in exact integers: onset, windows and normaliser (docs/specification.md, sections 2 and 3),
vectorised over recordings.

Recordings come as the source made them, or thinned to the frames that the chain takes (`Recordings.scanned`);
everything here counts the frames that it takes.

This module is the reference for those sections and for the fault detector (docs/specification_interfaces.md,
section 10). It sees whole recordings, so it adds spans of stored deviations; the hardware keeps running sums.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from eskin.golden.core import EXTREMES, AcceleratorConfig, InputError, clamp, narrow
from eskin.golden.data import Recordings

BATCH_SAMPLES = 1 << 22
"""Samples (frames x recordings x taxels) held at once while scanning, so that memory does not grow with the
data set."""

OPEN = 1 << 62
"""A frame behind every other: the end of a touch that goes on, and of a window that never is complete."""

Progress = Callable[[int, int], None]
"""Called with (recordings done, recordings in all)."""


@dataclass(frozen=True)
class Touches:
    """All touches of a set of recordings, ordered by recording, then by time; n touches, K windows, D inputs
    (taxels x kinds). Frames are those that the chain takes.

    recordings: number of recordings scanned. recording (n): index of each touch's recording. onset_frame (n):
    frame f, 1-based, in which the rule was met; 0 where the gate opens at once. start_frame (n): first frame,
    1-based, of window 1. completed (n): windows that ended within the recording. partial (n), bool: the
    recording ended before the touch did. sums (n, K, D), int64: windowed sums of the deviations, codes, and
    the other values that a window gives for a taxel (`window_values`); 0 from window ``completed`` on. faults
    (n, K, D), bool: the fault detector had masked the taxel when window k was complete; None without a
    detector. flagged (recordings, taxels): frame, 1-based, that raised the taxel's fault flag, 0 = none; None
    without. armed (recordings), bool: the detector is ARMED after the last frame; None where nobody asks.

    With ``window_mode`` whole, completed is all windows or none, and partial: the touch had ``touch_frames`` frames.
    None in the other modes, where the configuration says them: ended (n), frame, 1-based, with which the touch
    ended; cut (n), bool, the end of the recording ended it; lengths (n, K), index of each window's length in
    ``window_lengths``.
    """

    recordings: int
    recording: np.ndarray
    onset_frame: np.ndarray
    start_frame: np.ndarray
    completed: np.ndarray
    partial: np.ndarray
    sums: np.ndarray
    faults: np.ndarray | None = None
    flagged: np.ndarray | None = None
    armed: np.ndarray | None = None
    ended: np.ndarray | None = None
    cut: np.ndarray | None = None
    lengths: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.recording)

    def take(self, rows: np.ndarray, steps: int | None = None) -> Touches:
        """The touches ``rows`` (indices, or bool (n)) with everything that is known of them, and their first
        ``steps`` windows (None: all).

        ``recordings``, ``flagged`` and ``armed`` are about recordings and stay.
        """
        values = {
            name: value[rows]
            for name, value in vars(self).items()
            if value is not None and name not in "recordings flagged armed".split()
        }
        if steps is not None:
            values["completed"] = np.minimum(values["completed"], steps)
            values |= {
                name: values[name][:, :steps] for name in ("sums", "faults", "lengths") if name in values
            }
        return dataclasses.replace(self, **values)

    def complete(self, steps: int) -> np.ndarray:
        """(n, ``steps``), bool: the steps that were completed."""
        return np.arange(steps) < self.completed[:, None]

    def ends(self, config: AcceleratorConfig) -> np.ndarray:
        """(n, K) frame, 1-based, with which each window is there; beyond the recording's last where it is not."""
        spans = window_spans(config, self.sums.shape[1])
        if self.ended is not None:
            return np.repeat(self.ended[:, None], len(spans), axis=1)
        return self.start_frame[:, None] - 1 + np.array([last for _, last in spans], dtype=np.int64)

    def first_touch(self) -> np.ndarray:
        """For each recording the index of its first touch, -1 where there is none."""
        first = np.full(self.recordings, -1, dtype=np.int64)
        recordings, index = np.unique(self.recording, return_index=True)
        first[recordings] = index
        return first


def window_spans(config: AcceleratorConfig, steps: int) -> tuple[tuple[int, int], ...]:
    """First and last frame, 1-based from the start of window 1, of ``steps`` windows.

    The first ``config.windows.steps`` are the configuration's windows; later ones go on at the same hop with
    the full window length.
    """
    further = (
        (config.windows.hop * k + 1, config.windows.hop * k + config.windows.window)
        for k in range(config.windows.steps, steps)
    )
    return (*config.window_spans[:steps], *further)


@dataclass(frozen=True)
class Ended:
    """A touch of ``window_mode`` whole that has ended; frames are 1-based. start: its first; loud: its last that
    met the onset rule; end: its last; cut: because the recording did."""

    start: int
    loud: int
    end: int
    cut: bool

    def partial(self, config: AcceleratorConfig) -> bool:
        """It had as many frames as a touch may have."""
        return self.end - self.start + 1 == config.last_frame


Division = tuple[tuple[tuple[int, int], ...], np.ndarray, int]
"""Of one touch: first and last frame of each window, 1-based from the touch's first; the index of each one's length;
how often the hop has doubled."""


def divided(config: AcceleratorConfig, ended: Ended) -> Division:
    """The windows that divide a touch (section 2, ``window_mode`` whole)."""
    steps, hop, frames = config.windows.steps, config.windows.hop, ended.end - ended.start + 1
    doublings = (frames // hop // config.stored_sums).bit_length()
    hop <<= doublings
    count = min(max(-((ended.start - 1 - ended.loud) // hop), 1), frames // hop)
    if not count:
        return ((1, OPEN),) * steps, np.zeros(steps, dtype=np.int64), 0
    first, stop = (np.arange(steps) + more for more in (0, 1))
    if count < steps:  # a sum each, the last one again
        first, stop = np.minimum(first, count - 1), np.minimum(stop, count)
    else:
        first, stop = first * count // steps, stop * count // steps
    spans = zip((first * hop + 1).tolist(), (stop * hop).tolist(), strict=True)
    return tuple(spans), stop - first - 1, doublings


def find_touches(
    config: AcceleratorConfig,
    recordings: Recordings,
    *,
    steps: int | None = None,
    onsets: np.ndarray | None = None,
    progress: Progress | None = None,
    most: int | None = None,
) -> Touches:
    """Every touch of every recording, with its exact windowed sums.

    Parameters
    ----------
    steps:
        Windows a touch, K; default ``config.windows.steps``. A higher number adds windows after the touch
        (for time warp in training; with ``window_mode`` whole there are none). Neither the detector,
        ``partial`` nor the first ``config.windows.steps`` windows depend on it.
    onsets:
        (R) the frame at which each recording's one touch is forced, -1 none. The onset rule is then not used.
    progress:
        Called with (recordings done, recordings in all).
    most:
        Samples held at once; None: BATCH_SAMPLES.

    Raises
    ------
    InputError
        When the recordings do not have the taxels of the configuration.
    """
    if recordings.taxels != config.sensor.taxels:
        raise InputError(
            f"{recordings.source}: has {recordings.taxels} taxels and configuration '{config.name}', field "
            f"taxels, has {config.sensor.taxels}; use recordings and a configuration of one array"
        )
    follows, steps = config.follows_touch, config.windows.steps if steps is None else steps
    spans = window_spans(config, min(steps, config.windows.steps) if follows else steps)
    recordings = recordings.scanned(config.sensor.scan_every)
    lengths = recordings.lengths
    rows: list[tuple[int, int, int, int, bool, int, bool]] = []
    sums: list[np.ndarray] = []
    places: list[np.ndarray] = []
    flagged = np.zeros((len(lengths), config.sensor.taxels), dtype=np.int64)
    armed = np.zeros(len(lengths), dtype=bool)
    for first, last, deviations, begun, front in scans(config, recordings, onsets, most):
        flagged[first:last], armed[first:last] = front.flagged, front.armed
        for index, onset, start in begun:
            length, end, cut, doublings = int(lengths[first + index]), start - 1 + config.last_frame, False, 0
            partial = length < end
            if follows:
                ended = front.ended[index, start]
                own, place, doublings = divided(config, ended)
                spans, end, cut, partial = own[: len(spans)], ended.end, ended.cut, ended.partial(config)
                places.append(place[: len(spans)])
            of_recording = deviations[:length, index]
            window_sums, complete = window_values(config, of_recording, start, spans, doublings)
            rows.append((first + index, onset, start, complete, partial, end, cut))
            sums.append(window_sums)
        if progress:
            progress(last, len(lengths))
    table = np.array(rows, dtype=np.int64).reshape(-1, 7).T
    shape = len(rows), len(spans)
    touches = Touches(
        len(lengths),
        recording=table[0],
        onset_frame=table[1],
        start_frame=table[2],
        completed=table[3],
        partial=table[4] > 0,
        sums=np.array(sums, dtype=np.int64).reshape(*shape, config.inputs),
        armed=armed,
        ended=table[5] if follows else None,
        cut=table[6] > 0 if follows else None,
        lengths=np.array(places, dtype=np.int64).reshape(shape) if follows else None,
    )
    if not config.faults.fault_frames:
        return touches
    of_touch = np.repeat(flagged[touches.recording], config.kinds, axis=1)[:, None]
    faults = (of_touch > 0) & (of_touch <= touches.ends(config)[..., None])
    return dataclasses.replace(touches, faults=faults, flagged=flagged)


def companded(values: np.ndarray, knee: int, frac: int) -> np.ndarray:
    """Integers companded as section 2 says, int64, shape of ``values``.

    With ``b = |d| + 2**knee`` and ``2**e`` the largest power of two in b: ``sign(d) * ((e - knee) * 2**F +
    floor(2**F b / 2**e) - 2**F)``, which is log2(1 + |d| / 2**knee) on straight lines between powers of two.
    Odd and monotone.
    """
    biased = np.abs(values.astype(np.int64)) + (1 << knee)
    # frexp is exact: values have far fewer than 53 bits. Its mantissa lies in 1/2..1, hence the - 1.
    exponent = np.frexp(biased.astype(np.float64))[1].astype(np.int64) - 1
    # the floor is taken of the magnitude, and the sign put back: so the function is odd
    return np.sign(values) * (((exponent - knee - 1) << frac) + ((biased << frac) >> exponent))


def real_features(
    config: AcceleratorConfig, sums: np.ndarray, lengths: np.ndarray | None = None
) -> np.ndarray:
    """Features before mu and sigma, from which the network learns, float64, shape of ``sums`` (..., K, D):
    means, mean activities of a block and extremes in codes; integrals as logarithms. Masked taxels are
    included. lengths: `Touches.lengths`."""
    if lengths is None:  # later windows are as long as the first
        known = config.length_index
        lengths = np.array([*known, *[known[0]] * sums.shape[-2]][: sums.shape[-2]], dtype=np.int64)
    units = np.array(config.feature_units).reshape(-1, config.kinds)[lengths]
    return sums / units[..., list(config.input_kinds)]


def normalise(
    config: AcceleratorConfig,
    sums: np.ndarray,
    completed: np.ndarray,
    mean: np.ndarray,
    scale: np.ndarray,
    faults: np.ndarray | None = None,
    lengths: np.ndarray | None = None,
) -> np.ndarray:
    """Feature codes of windowed sums (section 3): ``narrow(SAT((d - mean) >> shift) * scale,
    gate_frac, feature_format)``, d with as many fraction bits as the means have.

    Parameters
    ----------
    sums:
        (n, K, D) int64 with K at most ``config.windows.steps``.
    completed:
        (n) windows that count; codes of the others are 0.
    mean, scale:
        Integers, (lengths) or (lengths, constants): for each distinct window length
        (``config.window_lengths``) one, or one a kind, or one an input (``config.constants``).
    faults:
        (n, K, D) bool, taxels masked by the fault detector (``Touches.faults``).
    lengths:
        (n, K) the index of each window's length (``Touches.lengths``); None: ``config.length_index``.

    Returns
    -------
    (n, K, D) int64 codes of ``feature_format``; 0 for masked taxels.
    """
    steps = sums.shape[1]
    lengths = np.array(config.length_index[:steps], dtype=np.int64) if lengths is None else lengths
    mean, scale = (by_input(config, values)[lengths] for values in (mean, scale))
    shift, frac = shifts_by_input(config)[lengths], config.mean_frac
    # a floor, not a rounding: the half is in the mean already (normaliser_constants)
    centred = clamp(((sums << frac) - mean) >> shift + frac, config.centred_format)
    centred[..., list(config.input_mask)] = 0
    if faults is not None:
        centred[faults] = 0
    features = narrow(centred * scale, config.formats.gate_frac, config.formats.feature_format)
    features[np.arange(steps) >= np.asarray(completed)[:, None]] = 0
    return features


def _batches(lengths: np.ndarray, taxels: int, most: int | None = None) -> list[tuple[int, int]]:
    """Ranges of consecutive recordings whose padded samples stay within ``most``, BATCH_SAMPLES (one
    recording at least)."""
    most = BATCH_SAMPLES if most is None else most
    ranges, first = [], 0
    while first < len(lengths):
        # all recordings of a batch are padded to its longest
        longest = np.maximum.accumulate(lengths[first:])
        fits = longest * np.arange(1, len(longest) + 1) * taxels <= most
        last = first + max(1, int(np.count_nonzero(fits)))
        ranges.append((first, last))
        first = last
    return ranges


def by_input(config: AcceleratorConfig, constants: np.ndarray) -> np.ndarray:
    """Normaliser constants (lengths) or (lengths, constants) as (lengths, inputs), int64."""
    table = np.asarray(constants, dtype=np.int64).reshape(len(config.window_lengths), config.constants)
    return table[:, list(config.input_constants)]


def shifts_by_input(config: AcceleratorConfig) -> np.ndarray:
    """feature_shift as (lengths, inputs), int64."""
    table = np.array(config.features.feature_shift, dtype=np.int64).reshape(-1, config.kinds)
    return table[:, list(config.input_kinds)]


def window_values(
    config: AcceleratorConfig, deviations: np.ndarray, start: int, spans, doublings: int = 0
) -> tuple[np.ndarray, int]:
    """Values of every window of a touch for every taxel (section 2), and the number of leading windows that
    the recording completes.

    Parameters
    ----------
    deviations:
        (T, taxels) of the whole recording.
    start:
        First frame, 1-based, of the touch's first window.
    spans:
        First and last frame of each window, 1-based from ``start``.
    doublings:
        Of the hop, with ``window_mode`` whole: bits that a mean or an activity loses.

    Returns
    -------
    ((K, D) int64, number of windows): inputs taxel by taxel, for each its kinds in order; 0 from the first
    window that is not complete.
    """
    touch = deviations[start - 1 :]
    completed = sum(last <= len(touch) for _, last in spans)
    ends = np.array(spans[:completed], dtype=np.int64).reshape(-1, 2)  # reshape: there may be none
    ended = ends[:, 1].max(initial=0)
    touch, deviations = touch[:ended], deviations[: start - 1 + ended]
    values = np.zeros((len(spans), deviations.shape[1], config.kinds), dtype=np.int64)
    total = _running(touch)
    for number, kind in enumerate(config.features.feature_kinds):
        if kind == "mean":
            sums = total[ends[:, 1]] - total[ends[:, 0] - 1] >> doublings
        elif kind == "integral":
            sums = companded(total[ends[:, 1]], config.features.integral_knee, config.features.integral_frac)
        elif kind in EXTREMES:
            extreme = np.maximum if kind == "highest" else np.minimum
            sums = extreme.accumulate(touch)[ends[:, 1] - 1]
        else:
            block = config.features.activity_block
            amounts = _running(_block_activity(config, deviations, start))
            sums = amounts[ends[:, 1] // block] - amounts[(ends[:, 0] - 1) // block] >> doublings
        values[:completed, :, number] = sums
    return values.reshape(len(spans), values.shape[1] * config.kinds), completed


def _running(values: np.ndarray) -> np.ndarray:
    """(n + 1, taxels): sums of the first 0..n rows."""
    total = np.zeros((len(values) + 1, values.shape[1]), dtype=np.int64)
    np.cumsum(values, axis=0, dtype=np.int64, out=total[1:])
    return total


def _block_activity(config: AcceleratorConfig, deviations: np.ndarray, start: int) -> np.ndarray:
    """(blocks, taxels) activity of the whole blocks from frame ``start`` on. With rule ``change`` the very
    first block has none: the first of the recording if hops run from its first frame, the first of the touch
    if they run from there."""
    block, lead = config.features.activity_block, start - 1

    def blocks(frames: np.ndarray) -> np.ndarray:
        whole = len(frames) // block
        return frames[: whole * block].reshape(whole, block, frames.shape[1]).sum(axis=1, dtype=np.int64)

    of_touch = blocks(deviations[lead:])
    if config.features.activity_rule == "sum" or not len(of_touch):
        return np.abs(of_touch)
    reads_back = config.windows.window_mode == "free" and lead > 0
    # without a block before, the first is compared with itself: it changes by 0
    before = blocks(deviations[lead - block : lead]) if reads_back else of_touch[:1]
    return np.abs(np.diff(np.concatenate([before, of_touch]), axis=0))


def start_frame(config: AcceleratorConfig, onset: int, previous_end: int) -> int:
    """First frame of window 1 of a touch whose onset is frame ``onset`` (0: the gate opens at once)."""
    if config.windows.window_mode == "touch":
        return max(1, onset - config.windows.pretrigger_frames, previous_end + 1)
    if config.follows_touch:
        return onset + 1
    # The gate opens with frame g = onset + 1, so hop j0 = floor((g - 1) / hop) is under way. Window 1 begins
    # with the hop before it; hop 0 has none, so j0 is at least 1.
    return (max(onset // config.windows.hop, 1) - 1) * config.windows.hop + 1


def activity(config: AcceleratorConfig, block: np.ndarray) -> np.ndarray:
    """Activity A of section 10, codes, of blocks of samples (frames, ...): one number for each of the further
    axes."""
    span = 1 << config.fault_bits
    low = block.astype(np.int64) % span
    # only the low bits are looked at, so differences wrap: the shorter way round counts
    change = np.abs((np.diff(low, axis=0) + span // 2) % span - span // 2)
    return np.where((low[1:] == 0) | (low[1:] == span - 1), 0, change).sum(axis=0)


class TouchFinder:
    """Rest level, onset detector and fault detector (docs/specification.md, section 2;
    docs/specification_interfaces.md, section 10) of recordings side by side, as they stand
    after the frames seen so far. Frames come in pieces of any length, and how they are cut changes nothing.

    Recordings run side by side, frame by frame, because a tracked rest level depends on when earlier touches
    of its recording ended.

    Parameters
    ----------
    recordings:
        Number of processes.
    """

    def __init__(self, config: AcceleratorConfig, recordings: int = 1) -> None:
        self.config = config
        shape = recordings, config.sensor.taxels
        self.frames = 0
        """Frames seen."""
        self.flagged = np.zeros(shape, dtype=np.int64)
        """(recordings, taxels): the frame, 1-based, that raised the taxel's fault flag; 0 = none."""
        self.armed = np.full(recordings, not config.opens_at_once)
        """(recordings), bool: a touch may begin."""
        self.end = np.zeros(recordings, dtype=np.int64)
        """(recordings): the last frame of the latest touch, 0 before the first."""
        self.ended: dict[tuple[int, int], Ended] = {}
        """``window_mode`` whole: touches that have ended, by recording and first frame."""
        self._start, self._loud = np.ones((2, recordings), dtype=np.int64)
        if config.opens_at_once and config.follows_touch:
            self.end[:] = self._loud[:] = OPEN
        self._quiet = np.zeros(recordings, dtype=np.int64)
        self._baseline = np.zeros(shape, dtype=np.int32)
        self._settling = np.zeros(shape, dtype=np.int64)
        # a ring: True for each of the last judged frames that fulfilled the rule
        self._hits = np.zeros((config.onset_rule.onset_span, recordings), dtype=bool)
        self._banded = config.onset_rule.onset == "band"
        self._period = 1 if self._banded else config.onset_rule.onset_check_frames
        self._live = np.isin(np.arange(config.sensor.taxels), config.sensor.live)
        self._recent = np.zeros(
            (0 if self._banded or config.opens_at_once else config.onset_rule.onset_mean_frames, *shape),
            np.int32,
        )
        self._block = np.zeros((0, *shape), dtype=np.int32)  # samples of the fault detector's block under way

    def push(
        self, samples: np.ndarray, lengths: np.ndarray | None = None, forced: np.ndarray | None = None
    ) -> tuple[np.ndarray, list[tuple[int, int, int]]]:
        """Take the next frames.

        Parameters
        ----------
        samples:
            (frames, recordings, taxels) int32.
        lengths:
            (recordings) total number of frames of each recording; later frames are not judged. None: no
            recording ends in these frames.
        forced:
            (recordings) the frame at which the rule counts as met, -1 none; None: the rule itself decides.

        Returns
        -------
        (deviations (frames, recordings, taxels) int32, touches that began: (recording, onset frame, start
        frame)):
            touches in the order of their onsets.
        """
        config, first, last = self.config, self.frames, self.frames + len(samples)
        whole = lengths is not None
        lengths = np.full(len(self.armed), last) if lengths is None else lengths
        settle, tracked = config.rest_level.rest_frames, config.rest_level.rest == "tracked"
        if first < settle:
            self._settle(samples[: settle - first], min(settle, last))
        recent = len(self._recent)
        # deviations that the onset rule still needs, then the deviations of these frames
        history = np.zeros((recent + len(samples), *samples.shape[1:]), dtype=np.int32)
        history[:recent] = self._recent
        deviations = history[recent:]  # a view: the rule reads the deviations written here
        if not tracked and last > settle:
            begin = max(settle - first, 0)
            deviations[begin:] = self._deviation(samples[begin:], self._baseline)
        self._judge_faults(samples, lengths)
        self.frames = last
        if config.opens_at_once:
            begun = first == 0 < last
            self._end_longest(last, lengths)
            return deviations, [(index, 0, 1) for index in range(len(self.armed) if begun else 0)]

        touches: list[tuple[int, int, int]] = []
        before = first
        while before < last:
            # Between two judged frames the detector keeps its state, so all of them are tracked in one go.
            judged = min((before // self._period + 1) * self._period, last)
            if tracked:
                self._track(samples, deviations, first, before, judged)
            if judged > settle and judged % self._period == 0:
                over = self._over(samples, history, judged, first)
                touches += self._judge(judged, over, lengths, None if forced is None else forced == judged)
            before = judged
            # No recording can have another touch. Deviations are still wanted to the end.
            over = (self.end >= lengths) & (self.end < OPEN)
            if whole and not self.armed.any() and over.all():
                if tracked:
                    self._track(samples, deviations, first, before, last)
                break
        self._end_longest(last, lengths)
        self._recent = history[len(history) - recent :].copy()
        return deviations, touches

    def finish(self, lengths: np.ndarray) -> None:
        """The recordings end after ``lengths`` frames, and with them their touches of ``window_mode`` whole."""
        self._end(np.array(True), lengths, cut=True)

    def _end_longest(self, last: int, lengths: np.ndarray) -> None:
        """End the touches that have had ``touch_frames`` frames by frame ``last``."""
        ends = self._start - 1 + self.config.last_frame
        self._end(ends <= np.minimum(last, lengths), ends)

    def _end(self, which: np.ndarray, ends: np.ndarray, *, cut: bool = False) -> None:
        """End the touches under way with their frames ``ends`` (recordings)."""
        for index in np.flatnonzero(which & (self.end == OPEN)).tolist():
            start, end = int(self._start[index]), int(ends[index])
            self.ended[index, start] = Ended(start, min(int(self._loud[index]), end), end, cut)
            self.end[index] = end

    def _settle(self, samples: np.ndarray, last: int) -> None:
        """The rest level of settling frames, the last of which is frame ``last``."""
        settle = self.config.rest_level.rest_frames
        self._settling += samples.sum(axis=0, dtype=np.int64)
        if last == settle:
            # the mean in sixteenths of a code, rounded half up in integers
            self._baseline = ((2 * 16 * self._settling + settle) // (2 * settle)).astype(np.int32)

    def _deviation(self, samples: np.ndarray, levels: np.ndarray) -> np.ndarray:
        limit = self.config.rest_level.clip
        e = samples - ((levels + 8) >> 4)  # levels have four fraction bits
        return np.clip(e, -limit, limit, out=e) if limit else e

    def _track(
        self, samples: np.ndarray, deviations: np.ndarray, first: int, before: int, judged: int
    ) -> None:
        """Deviations of frames before+1..judged, between which the detector does not change, and the rest
        level after them."""
        begin, stop = max(before, self.config.rest_level.rest_frames) - first, judged - first
        if begin >= stop:
            return
        levels = np.broadcast_to(self._baseline, (stop - begin, *self._baseline.shape))
        if self.armed.any():
            levels = _track(samples[begin:stop], self._baseline, self.armed)
            self._baseline = levels[-1] + np.sign(16 * samples[stop - 1] - levels[-1]) * self.armed[:, None]
        deviations[begin:stop] = self._deviation(samples[begin:stop], levels)

    def _over(self, samples: np.ndarray, history: np.ndarray, judged: int, first: int) -> np.ndarray:
        """(recordings, taxels), bool: result of the onset rule for each taxel at frame ``judged``."""
        rule = self.config.onset_rule
        if self._banded:
            frame = samples[judged - 1 - first]
            return (frame < rule.band_low) | (frame > rule.band_high)
        stop = len(self._recent) + judged - first
        recent = history[stop - rule.onset_mean_frames : stop].sum(axis=0, dtype=np.int64)
        return np.abs(recent) > rule.onset_threshold * rule.onset_mean_frames

    def _judge(
        self, judged: int, over: np.ndarray, lengths: np.ndarray, forced: np.ndarray | None
    ) -> list[tuple[int, int, int]]:
        """The detector's step at the end of frame ``judged``: (recording, onset frame, start frame) of
        touches that begin."""
        rule, follows = self.config.onset_rule, self.config.follows_touch
        counts = over & self._live
        if self.config.faults.fault_frames:
            # flags are found for all frames of a push at once: flags of later frames do not count yet
            counts &= (self.flagged == 0) | (self.flagged > judged)
        self._hits[judged // self._period % len(self._hits)] = counts.any(axis=1)
        own = self._hits.sum(axis=0) >= rule.onset_hits
        met = own if forced is None else forced
        rearming = ~self.armed & (judged <= lengths)
        if follows:
            self._end_longest(judged - 1, lengths)
            goes_on = self.end == OPEN
            self._loud = np.where(rearming & own & goes_on, judged, self._loud)
            rearming &= goes_on | (judged > self.end)
        else:
            rearming &= judged > self.end
        self._quiet = np.where(rearming & ~own, self._quiet + self._period, 0)
        touches = []
        for index in np.flatnonzero(self.armed & met & (judged <= lengths)):
            start = start_frame(self.config, judged, int(self.end[index]))
            touches.append((int(index), judged, start))
            self.armed[index], self._start[index], self._loud[index] = False, start, judged
            self.end[index] = OPEN if self.config.follows_touch else start - 1 + self.config.last_frame
        # last, because the detector is armed from the next frame on
        quiet = rearming & (self._quiet >= rule.rearm_frames)
        self.armed |= quiet
        if follows:
            self._end(quiet, np.full_like(self.end, judged))
        return touches

    def _judge_faults(self, samples: np.ndarray, lengths: np.ndarray) -> None:
        """Fault flags of the blocks that end within ``samples``."""
        block = self.config.faults.fault_frames
        if not block:
            return
        samples_so_far = np.concatenate([self._block, samples]) if len(self._block) else samples
        first = self.frames - len(self._block)
        for stop in range(block, len(samples_so_far) + 1, block):
            last = first + stop
            if last - block >= self.config.rest_level.rest_frames:
                failed = (
                    activity(self.config, samples_so_far[stop - block : stop])
                    <= self.config.faults.fault_activity
                )
                self.flagged[failed & (self.flagged == 0) & (last <= lengths)[:, None]] = last
        self._block = samples_so_far[len(samples_so_far) // block * block :].copy()


def scans(
    config: AcceleratorConfig,
    recordings: Recordings,
    forced: np.ndarray | None = None,
    most: int | None = None,
) -> Iterator[tuple[int, int, np.ndarray, list[tuple[int, int, int]], TouchFinder]]:
    """Recordings batch by batch, as many as stay within ``most`` (`_batches`): the first recording, the recording behind the
    last, their deviations (frames, recordings, taxels), their touches (recording, onset frame, start frame),
    in order, and the detectors as each recording leaves them."""
    recordings = recordings.scanned(config.sensor.scan_every)
    lengths, taxels = recordings.lengths, config.sensor.taxels
    for first, last in _batches(lengths, taxels, most):
        samples = np.zeros((int(lengths[first:last].max(initial=0)), last - first, taxels), dtype=np.int32)
        for index in range(first, last):
            samples[: lengths[index], index - first] = recordings.recording(index)
        front, onsets = TouchFinder(config, last - first), None if forced is None else forced[first:last]
        deviations, touches = front.push(samples, lengths[first:last], onsets)
        front.finish(lengths[first:last])
        yield first, last, deviations, sorted(touches), front


def _track(samples: np.ndarray, baseline: np.ndarray, armed: np.ndarray) -> np.ndarray:
    """Tracked rest levels (frames, recordings, taxels) before each frame of ``samples``, from ``baseline`` at
    the first."""
    target, moves = 16 * samples, armed.astype(np.int32)[:, None]
    levels = np.empty_like(target)
    levels[0] = baseline
    step = np.empty_like(baseline)
    for frame in range(len(samples) - 1):
        np.subtract(target[frame], levels[frame], out=step)
        np.sign(step, out=step)
        np.multiply(step, moves, out=step)
        np.add(levels[frame], step, out=levels[frame + 1])
    return levels
