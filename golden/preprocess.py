"""Preprocessing in exact integers: onset, windows and normaliser (SPECIFICATION.md, sections 2 and 3), vectorised over recordings.

The golden expression of those sections. It sees whole recordings, so it adds spans of stored deviations; the hardware keeps running sums.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from golden.config import AcceleratorConfig
from golden.errors import InputError
from golden.formats import clamp, narrow
from golden.recordings import Recordings

BATCH_SAMPLES = 1 << 24
"""Samples (frames x recordings x taxels) held at once while scanning, so that memory does not grow with the data set."""

Progress = Callable[[int, int], None]
"""Called with (recordings done, recordings in all)."""


@dataclass(frozen=True)
class Touches:
    """All touches of a set of recordings, ordered by recording, then by time; n touches, K windows, D taxels.

    recordings: number of recordings scanned. recording (n): index of each touch's recording. onset_frame (n): frame f, 1-based, in which
    the rule was met; 0 where the gate opens at once. start_frame (n): first frame, 1-based, of window 1. completed (n): windows that ended
    within the recording. partial (n), bool: the recording ended before the touch did. sums (n, K, D), int64: windowed sums of the
    deviations, codes; 0 from window ``completed`` on. faults (n, K, D), bool: the fault detector had masked the taxel when window k was
    complete; None without a detector. flagged (recordings, D): frame, 1-based, that raised the taxel's fault flag, 0 = none; None without.
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

    def __len__(self) -> int:
        return len(self.recording)

    def first_touch(self) -> np.ndarray:
        """For each recording the index of its first touch, -1 where there is none."""
        first = np.full(self.recordings, -1, dtype=np.int64)
        found, index = np.unique(self.recording, return_index=True)
        first[found] = index
        return first


def window_spans(config: AcceleratorConfig, steps: int) -> tuple[tuple[int, int], ...]:
    """First and last frame, 1-based from the start of window 1, of ``steps`` windows.

    The first ``config.steps`` are those of the configuration; later ones go on at the same hop with the full window length.
    """
    further = ((config.hop * k + 1, config.hop * k + config.window) for k in range(config.steps, steps))
    return (*config.window_spans[:steps], *further)


def find_touches(
    config: AcceleratorConfig,
    recordings: Recordings,
    *,
    steps: int | None = None,
    onsets: np.ndarray | None = None,
    progress: Progress | None = None,
) -> Touches:
    """Every touch of every recording, with its exact windowed sums.

    Parameters
    ----------
    steps:
        Windows a touch, K; default ``config.steps``. More shows what follows the touch (for time warp in training). Neither the detector,
        ``partial`` nor the first ``config.steps`` windows depend on it.
    onsets:
        (R) the frame at which each recording's one touch is forced, as ``find_onsets`` gives it; -1 none. The rule is then not asked.
    progress:
        Called with (recordings done, recordings in all).

    Raises
    ------
    InputError
        When the recordings do not have the taxels of the configuration.
    """
    if recordings.taxels != config.taxels:
        raise InputError(
            f"{recordings.source}: has {recordings.taxels} taxels and configuration '{config.name}', field taxels, has {config.taxels}; "
            "use recordings and a configuration of one array"
        )
    spans = window_spans(config, config.steps if steps is None else steps)
    lengths = recordings.lengths
    rows: list[tuple[int, int, int, int, bool]] = []
    sums: list[np.ndarray] = []
    flagged = np.zeros((len(lengths), config.taxels), dtype=np.int64)
    for first, last in _batches(lengths, config.taxels):
        samples = np.zeros((int(lengths[first:last].max(initial=0)), last - first, config.taxels), dtype=np.int32)
        for index in range(first, last):
            samples[: lengths[index], index - first] = recordings.recording(index)
        forced = None if onsets is None else onsets[first:last]
        deviations, found, flagged[first:last] = _scan(config, samples, lengths[first:last], forced)
        for index, onset, start in found:
            length = int(lengths[first + index])
            window_sums, completed = _span_sums(deviations[start - 1 : length, index], spans)
            rows.append((first + index, onset, start, completed, length < start - 1 + config.last_frame))
            sums.append(window_sums)
        if progress:
            progress(last, len(lengths))
    recording, onset_frame, start_frame, completed, partial = np.array(rows, dtype=np.int64).reshape(-1, 5).T
    faults = None
    if config.fault_frames:
        ends = start_frame[:, None] - 1 + np.array([last for _, last in spans], dtype=np.int64)
        of_touch = flagged[recording][:, None]
        faults = (of_touch > 0) & (of_touch <= ends[..., None])
    return Touches(
        recordings=len(lengths),
        recording=recording,
        onset_frame=onset_frame,
        start_frame=start_frame,
        completed=completed,
        partial=partial.astype(bool),
        sums=np.array(sums, dtype=np.int64).reshape(len(rows), len(spans), config.taxels),
        faults=faults,
        flagged=flagged if config.fault_frames else None,
    )


def find_onsets(config: AcceleratorConfig, recordings: Recordings) -> np.ndarray:
    """Onset frame of the first touch of each recording (1-based; 0 where the gate opens at once), -1 where there is none."""
    touches = find_touches(config, recordings, steps=0)
    first = touches.first_touch()
    onsets = np.full(touches.recordings, -1, dtype=np.int64)
    onsets[first >= 0] = touches.onset_frame[first[first >= 0]]
    return onsets


def compand(config: AcceleratorConfig, sums: np.ndarray) -> np.ndarray:
    """Companded sums (section 3), int64, shape of ``sums``; with ``compand`` none the sums themselves.

    With ``b = |d| + 2**knee`` and ``2**e`` the largest power of two in b: ``sign(d) * ((e - knee) * 2**F + floor(2**F b / 2**e) - 2**F)``,
    which is log2(1 + |d| / 2**knee) on straight lines between powers of two. Odd and monotone.
    """
    if config.compand == "none":
        return sums
    biased = np.abs(sums.astype(np.int64)) + (1 << config.compand_knee)
    exponent = np.frexp(biased.astype(np.float64))[1].astype(np.int64) - 1  # exact: sums have far fewer than 53 bits
    whole = (exponent - config.compand_knee - 1) << config.compand_frac
    return np.sign(sums) * (whole + ((biased << config.compand_frac) >> exponent))


def real_features(config: AcceleratorConfig, sums: np.ndarray) -> np.ndarray:
    """Window means, codes: ``d / length`` (float64), shape of ``sums`` (..., K, D); companded: the companded sums as real numbers. Masked
    taxels are left in."""
    if config.compand != "none":
        return compand(config, sums) / 2.0**config.compand_frac
    lengths = np.array([last - first + 1 for first, last in window_spans(config, sums.shape[-2])], dtype=np.float64)
    return sums / lengths[:, None]


def normalise(
    config: AcceleratorConfig, sums: np.ndarray, completed: np.ndarray, mean: np.ndarray, scale: np.ndarray,
    faults: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    """Feature codes of windowed sums (section 3): ``narrow(SAT((compand(d) - mean) >> shift) * scale, gate_frac, feature_format)``.

    Parameters
    ----------
    sums:
        (n, K, D) int64 with K at most ``config.steps``.
    completed:
        (n) windows that count; codes of the others are 0.
    mean, scale:
        Integers, one per distinct window length (``config.window_lengths``).
    faults:
        (n, K, D) bool, taxels masked by the fault detector (``Touches.faults``).

    Returns
    -------
    (n, K, D) int64 codes of ``feature_format``; 0 for masked taxels.

    Raises
    ------
    InputError
        When the configuration has no feature_shift yet, or the constants do not fit the window lengths.
    """
    lengths = len(config.window_lengths)
    if len(config.feature_shift) != lengths:
        raise InputError(f"configuration '{config.name}', field feature_shift: is empty; quantise the model to set it")
    if len(mean) != lengths or len(scale) != lengths:
        raise InputError(f"configuration '{config.name}': {len(mean)} means and {len(scale)} scales for {lengths} distinct window lengths")
    steps = sums.shape[1]
    if steps > config.steps:
        raise InputError(f"configuration '{config.name}', field steps: is {config.steps}, below the {steps} windows to normalise")
    which = list(config.length_index[:steps])
    mean, scale, shift = (np.asarray(values, dtype=np.int64)[which, None] for values in (mean, scale, config.feature_shift))
    centred = clamp((compand(config, sums) - mean) >> shift, config.centred_format)
    centred[..., list(config.masked_taxels)] = 0
    if faults is not None:
        centred[faults] = 0
    features = narrow(centred * scale, config.gate_frac, config.feature_format)
    features[np.arange(steps) >= np.asarray(completed)[:, None]] = 0
    return features


def _batches(lengths: np.ndarray, taxels: int) -> list[tuple[int, int]]:
    """Ranges of consecutive recordings whose padded samples stay within BATCH_SAMPLES (one recording at least)."""
    ranges, first = [], 0
    while first < len(lengths):
        longest = np.maximum.accumulate(lengths[first:])
        fits = longest * np.arange(1, len(longest) + 1) * taxels <= BATCH_SAMPLES
        last = first + max(1, int(np.count_nonzero(fits)))
        ranges.append((first, last))
        first = last
    return ranges


def _span_sums(deviations: np.ndarray, spans) -> tuple[np.ndarray, int]:
    """Sums (K, D) of the frames in each span (1-based, inclusive), and how many leading spans the frames (T, D) complete."""
    completed = sum(last <= len(deviations) for _, last in spans)
    total = np.zeros((len(deviations) + 1, deviations.shape[1]), dtype=np.int64)
    np.cumsum(deviations, axis=0, dtype=np.int64, out=total[1:])
    sums = np.zeros((len(spans), deviations.shape[1]), dtype=np.int64)
    for k, (first, last) in enumerate(spans[:completed]):
        sums[k] = total[last] - total[first - 1]
    return sums, completed


def _start_frame(config: AcceleratorConfig, onset: int, previous_end: int) -> int:
    """First frame of window 1 of a touch whose onset is frame ``onset`` (0: the gate opens at once)."""
    if config.window_mode == "touch":
        return max(1, onset - config.pretrigger_frames, previous_end + 1)
    return (max(onset // config.hop, 1) - 1) * config.hop + 1  # gate frame g = onset + 1, window 1 begins with hop j0 - 1


def activity(config: AcceleratorConfig, block: np.ndarray) -> np.ndarray:
    """Activity A of section 10, codes, of blocks of samples (frames, ...): one number for each of the further axes."""
    span = 1 << config.fault_bits
    low = block.astype(np.int64) % span
    change = np.abs((np.diff(low, axis=0) + span // 2) % span - span // 2)
    return np.where((low[1:] == 0) | (low[1:] == span - 1), 0, change).sum(axis=0)


def _fault_flags(config: AcceleratorConfig, samples: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """(recordings, taxels): the frame, 1-based, that raises the fault flag of each taxel; 0 = none."""
    flagged = np.zeros(samples.shape[1:], dtype=np.int64)
    block = config.fault_frames
    for last in range(block, len(samples) + 1, block) if block else ():
        if last - block >= config.rest_frames:
            failed = activity(config, samples[last - block : last]) <= config.fault_activity
            flagged[failed & (flagged == 0) & (last <= lengths)[:, None]] = last
    return flagged


def _scan(
    config: AcceleratorConfig, samples: np.ndarray, lengths: np.ndarray, forced: np.ndarray | None = None
) -> tuple[np.ndarray, list[tuple[int, int, int]], np.ndarray]:
    """Deviations (frames, recordings, taxels) of a batch, its touches (recording, onset frame, start frame), in order, and the frame that
    raised the fault flag of each taxel (recordings, taxels), 0 = none.

    Recordings run side by side, frame by frame, because a tracked rest level depends on when earlier touches of its recording ended.
    """
    frames, recordings, taxels = samples.shape
    settle, limit = config.rest_frames, config.clip
    baseline = np.zeros((recordings, taxels), dtype=np.int32)
    if settle:
        total = samples[:settle].sum(axis=0, dtype=np.int64)
        baseline = ((2 * 16 * total + settle) // (2 * settle)).astype(np.int32)

    def deviation(block: np.ndarray, levels: np.ndarray) -> np.ndarray:
        e = block - ((levels + 8) >> 4)
        return np.clip(e, -limit, limit, out=e) if limit else e

    tracked = config.rest == "tracked"
    deviations = np.zeros_like(samples)
    if not tracked:
        deviations[settle:] = deviation(samples[settle:], baseline)
    flagged = _fault_flags(config, samples, lengths)
    if config.opens_at_once:
        return deviations, [(index, 0, 1) for index in range(recordings)], flagged

    live = np.array([taxel not in config.masked_taxels for taxel in range(taxels)])
    banded = config.onset == "band"
    if banded:
        outside = (samples < config.band_low) | (samples > config.band_high)
    hits = np.zeros((config.onset_span, recordings), dtype=bool)  # of the last judged frames, in a ring
    period = 1 if banded else config.onset_check_frames
    armed = np.ones(recordings, dtype=bool)
    end = np.zeros(recordings, dtype=np.int64)
    quiet = np.zeros(recordings, dtype=np.int64)
    touches: list[tuple[int, int, int]] = []
    for before in range(0, frames, period):
        judged = before + period  # frames before+1..judged; the detector's state can only change after `judged`
        if tracked:
            begin, stop = max(before, settle), min(judged, frames)
            if begin < stop:
                levels = np.empty((stop - begin, recordings, taxels), dtype=np.int32)
                for offset, frame in enumerate(samples[begin:stop]):
                    levels[offset] = baseline
                    baseline = baseline + np.sign(16 * frame - baseline) * armed[:, None]
                deviations[begin:stop] = deviation(samples[begin:stop], levels)
        if judged <= settle or judged > frames:
            continue
        if banded:
            over = outside[judged - 1]
        else:
            recent = deviations[max(0, judged - config.onset_mean_frames) : judged].sum(axis=0, dtype=np.int64)
            over = np.abs(recent) > config.onset_threshold * config.onset_mean_frames
        sound = (flagged == 0) | (flagged > judged)
        hits[judged // period % len(hits)] = (over & live & sound).any(axis=1)
        met = hits.sum(axis=0) >= config.onset_hits if forced is None else forced == judged
        rearming = ~armed & (judged > end)
        quiet = np.where(rearming & ~met, quiet + period, 0)
        for index in np.flatnonzero(armed & met & (judged <= lengths)):
            start = _start_frame(config, judged, int(end[index]))
            touches.append((int(index), judged, start))
            armed[index], end[index] = False, start - 1 + config.last_frame
        armed |= rearming & (quiet >= config.rearm_frames)
    return deviations, sorted(touches), flagged
