"""Test vectors: the input of the accelerator and its expected output, in one file that needs no torch to
read.

The golden model hands this file to co-simulation and to the generated bench.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from eskin.golden.core import replacing
from eskin.golden.data import Recordings
from eskin.golden.model.pipeline import Trace

ARMED, TOUCH, BUSY, NO_TOUCH = 1, 2, 4, 8
"""Bits of register STATUS (docs/system.md)."""


def write_vectors(
    path: str | Path,
    trace: Trace,
    recordings: Recordings,
    numbers: Sequence[int] | np.ndarray | None = None,
    codes: np.ndarray | None = None,
    taught: int = 0,
) -> Path:
    """Write stimulus and expectation of ``recordings`` to ``path`` (.npz), in one exchange.

    Parameters
    ----------
    trace:
        The integer run over exactly these recordings.
    numbers:
        The number by which each recording is called in messages (its index in the whole data set); default 0,
        1, ...
    codes:
        With a converter: its codes (frames, taxels), from which the recordings' samples are made.
    taught:
        Taught touches of the model in use.

    The arrays
    ----------
    samples (frames, taxels) uint16: A/D codes of the frames that the chain takes, two's complement. offsets (R + 1). numbers (R). For each flat
    stage s: ``s`` int64 and ``s_offsets`` (R + 1); ``decision`` (rows, 6) and ``decision_offsets``, columns
    as pipeline.DECISION_FIELDS. decision_frame (rows): the live frame, 1-based, that completes the decision's
    last window, 0 where the end of the recording brings the decision. touches (R): touches begun. open (R, 2): the
    first touch is open from the first of these frames on up to the other one, 0 without one. status (R): register
    STATUS when all is decided. flags (R, taxels), bool: fault flags at the recording's end. taught (R). codes (frames,
    taxels) uint32, where they were given.
    """
    recordings, touches = recordings.scanned(trace.config.sensor.scan_every), trace.touches
    number = np.bincount(touches.recording, minlength=len(recordings))
    begin, end = np.zeros((2, len(recordings)), dtype=np.int64)
    first, index = np.unique(touches.recording, return_index=True)
    # what opens at once is seen with the first frame; one that is cut short stays open to the end
    begin[first] = np.maximum(touches.onset_frame[index], 1)
    last = touches.ends(trace.config)[index, -1] + (0 if touches.cut is None else touches.cut[index])
    end[first] = np.maximum(np.minimum(last, recordings.lengths[first] + 1), begin[first])
    arrays: dict[str, np.ndarray] = {
        # the port is 16 bits wide, whatever the samples are: negative ones as two's complement
        "samples": (recordings.samples & 0xFFFF).astype(np.uint16),
        "offsets": np.asarray(recordings.offsets, dtype=np.int64),
        "decision_frame": completing_frames(trace),
        "flags": np.zeros((len(recordings), recordings.taxels), dtype=bool)
        if touches.flagged is None
        else touches.flagged > 0,
        "touches": number,
        "taught": np.full(len(recordings), taught),
        "open": np.stack([begin, end], axis=1),
        "status": ARMED * np.asarray(touches.armed) + NO_TOUCH * (number == 0),
    }
    if codes is not None:
        arrays["codes"] = codes.astype(np.uint32)
    return _write(path, arrays, trace.streams, numbers)


def write_image_vectors(
    path: str | Path,
    streams: Mapping[str, tuple[np.ndarray, np.ndarray]],
    images: np.ndarray,
    numbers: Sequence[int] | np.ndarray | None = None,
) -> Path:
    """Write the test vectors of a network for images: each image is a recording, and its rows are the frames.

    Parameters
    ----------
    streams:
        `eskin.golden.model.image_network.ImageTrace.streams` of exactly these images.
    images:
        (n, height, width), codes 0..255.
    numbers:
        As for `write_vectors`.

    The arrays
    ----------
    samples, offsets, numbers, decision, decision_offsets, decision_frame, touches, open, status: as of `write_vectors`;
    logit, logit_offsets; map, map_offsets: the values of all maps of an image, one map after the other.
    """
    count, height, width = images.shape
    maps = [streams[name] for name in streams if name.startswith("map_")]
    flat = [np.zeros((count, 0), dtype=np.int64), *(values.reshape(count, -1) for values, _ in maps)]
    together = np.concatenate(flat, axis=1)
    arrays = {
        "samples": images.reshape(count * height, width).astype(np.uint16),
        "offsets": np.arange(count + 1) * height,
        "decision_frame": np.full(len(streams["decision"][0]), height, dtype=np.int64),
        "touches": np.ones(count, dtype=np.int64),
        "open": np.tile([1, height], (count, 1)),
        "status": np.zeros(count, dtype=np.int64),
    }
    whole = {"map": (together.ravel(), np.arange(count + 1) * together.shape[1])}
    return _write(path, arrays, whole | {stage: streams[stage] for stage in ("decision", "logit")}, numbers)


def _write(
    path: str | Path,
    arrays: dict[str, np.ndarray],
    streams: Mapping[str, tuple[np.ndarray, np.ndarray]],
    numbers: Sequence[int] | np.ndarray | None,
) -> Path:
    arrays["numbers"] = (
        np.arange(len(arrays["touches"])) if numbers is None else np.asarray(numbers, np.int64)
    )
    for stage, (values, offsets) in streams.items():
        arrays |= {stage: values, f"{stage}_offsets": offsets}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)
    return Path(path)


def completing_frames(trace: Trace) -> np.ndarray:
    """For each row of stage ``decision``: the live frame (1-based in its recording) that completes the window
    decided on; 0 = the end of the recording.

    Frames replayed from the pre-trigger ring were live before the onset: a window of such frames alone is
    completed by the onset's frame.
    """
    touches = trace.touches
    frames = np.maximum(touches.ends(trace.config), touches.onset_frame[:, None])
    if touches.cut is not None:
        frames[touches.cut] = 0
    closing = np.where(
        trace.global_partial & (touches.cut is None),
        0,
        np.take_along_axis(frames, np.maximum(trace.global_step, 0)[:, None], axis=1)[:, 0],
    )
    order = trace.decision_order()
    everything = np.take_along_axis(np.concatenate([frames, closing[:, None]], axis=1), order, axis=1)
    return everything[np.take_along_axis(trace.offered(), order, axis=1)]
