"""Does a network know the class of a recording whose touch was taken out?

A class can leak through something other than the touch: the rest level, the time of the onset, the length of
the recording. So the frames of each recording behind its quiet lead-in are replaced by that lead-in,
repeated; the gate is forced open at the onset that was found in the recording as it was; length and onset
stay.
"""

import dataclasses

import numpy as np

from eskin.choose.doubts import LEVEL_TELLS
from eskin.golden.core import AcceleratorConfig
from eskin.golden.data import Recordings
from eskin.golden.model import IntegerModel, decide_touches, preprocess
from eskin.training.derive import find_onsets, settling_frames

MARGIN = 0.10
"""Accuracy above chance that is still no leak."""


def without_touches(
    recordings: Recordings, config: AcceleratorConfig, onsets: np.ndarray, left_in: int = 0
) -> Recordings:
    """Every recording with what follows its quiet lead-in replaced by that lead-in, repeated.

    The lead-in ends before the first frame that the onset rule used, because the touch may have begun there.

    Parameters
    ----------
    onsets:
        (R) frames, from 1; a recording without one (-1) stays.
    left_in:
        Frames from the onset on that stay, with those between lead-in and onset: more than 0 shows what a leak
        looks like.
    """
    samples = recordings.samples.copy()
    for index, onset in enumerate(onsets):
        if onset < 0:
            continue
        begin, end = recordings.offsets[index], recordings.offsets[index + 1]
        quiet = samples[begin : begin + onset - _judged_frames(config)]
        first = min(begin + onset - 1 + left_in, end) if left_in else begin + len(quiet)
        samples[first:end] = np.resize(quiet, (end - first, samples.shape[1]))
    return dataclasses.replace(recordings, samples=samples)


def _judged_frames(config: AcceleratorConfig) -> int:
    return config.onset_rule.onset_mean_frames if config.onset_rule.onset == "baseline" else 1


@dataclasses.dataclass(frozen=True)
class Leak:
    """accuracy: share of ``recordings`` decided as labelled without their touch. limit: chance (the share of
    the largest class) and MARGIN. frames: all that was left of a recording; 0: its lead-in."""

    recordings: int
    accuracy: float
    limit: float
    frames: int = 0


def known_without_touch(model: IntegerModel, recordings: Recordings, left_in: int = 0) -> Leak | None:
    """Share of recordings without their touches that the model classifies; None if no recording has a
    lead-in. ``left_in``: as of ``without_touches``."""
    config = model.config
    recordings = recordings.scanned(config.sensor.scan_every)
    onsets = np.asarray(find_onsets(config, recordings))
    # an onset was found, behind a lead-in that is longer than the settling time
    quiet = np.flatnonzero(onsets - _judged_frames(config) > config.rest_level.rest_frames)
    if config.opens_at_once or not len(quiet):
        return None
    whole, onsets = recordings.subset(quiet), onsets[quiet]
    accuracy, chance = _known(model, whole, without_touches(whole, config, onsets, left_in), onsets)
    return Leak(len(whole), accuracy, round(chance + MARGIN, 6))


def known_from_first_frames(model: IntegerModel, recordings: Recordings) -> Leak | None:
    """Accuracy of a model whose gate opens at once on recordings of which only the first frames are left,
    repeated; None if all are too short. Recordings may begin in contact, so the level may lift accuracy by
    LEVEL_TELLS of the way from chance to 1."""
    config = model.config
    recordings = recordings.scanned(config.sensor.scan_every)
    frames = max(settling_frames(recordings.sample_rate_hz), config.rest_level.rest_frames + 1)
    whole = recordings.subset(np.flatnonzero(recordings.lengths > frames))
    if not len(whole):
        return None
    onsets = np.full(len(whole), frames + _judged_frames(config))
    accuracy, chance = _known(model, whole, without_touches(whole, config, onsets))
    return Leak(len(whole), accuracy, round(chance + LEVEL_TELLS * (1 - chance), 6), frames)


def _known(
    model: IntegerModel, recordings: Recordings, cut: Recordings, onsets: np.ndarray | None = None
) -> tuple[float, float]:
    """(the share of recordings that the model classifies from the parts ``cut`` of them, at forced onsets if there are
    some; chance)."""
    touches = preprocess.find_touches(model.config, cut, onsets=onsets)
    right = np.zeros(len(recordings), dtype=bool)
    right[touches.recording] = decide_touches(model, touches).decision == recordings.labels[touches.recording]
    return float(right.mean()), float(recordings.class_counts.max() / len(recordings))
