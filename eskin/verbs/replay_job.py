"""`eskin replay`: recordings or images to a board over its serial line, its decisions against the golden
model's."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from eskin.cosim.link import BURST, Link, Transport
from eskin.cosim.scoreboard import Verdict, compare_played
from eskin.cosim.serial_port import SerialPort
from eskin.golden.core.config import AcceleratorConfig
from eskin.golden.core.jobs import Record
from eskin.golden.data.recordings import Recordings
from eskin.golden.model.image_network import images_of, run_images
from eskin.golden.model.model import IntegerModel
from eskin.golden.model.pipeline import run
from eskin.golden.model.vectors import completing_frames
from eskin.live.sources import on_port
from eskin.rtl.fpga.generate import boot_writes, register_map

ANSWER_S = 0.5
"""To wait for an answer once the line is free: far more than a serial adapter holds bytes back."""
Progress = Callable[[int, int], None]
"""Called with (frames taken, frames in all)."""


def answer_s(config: AcceleratorConfig, baud: int) -> float:
    """Seconds to wait for an answer behind a burst of frames whose every byte is escaped."""
    return ANSWER_S + 10 * BURST * 2 * (2 * config.sensor.taxels + 8) / baud


def replay(
    model: IntegerModel,
    recordings: Recordings,
    *,
    numbers: Sequence[int],
    port: str,
    baud: int,
    progress: Progress,
) -> Record:
    """Load ``model`` into the board on ``port`` and play ``recordings``.

    Parameters
    ----------
    model:
        With the lanes that the board's bitstream has.
    numbers:
        What each recording is called in messages.

    Returns
    -------
    dict
        port, baud, lanes, recordings, frames, decisions, compared_values, mismatches, bit_exact, passed,
        mismatch_list (sentences, the first ones), repeated (packets sent again), replayed (recordings played
        again), unanswered (questions asked again), damaged (packets from the board), wall_s, frames_per_s.

    Raises
    ------
    InputError
        No such port; no answer, another design than eskin's, a board that goes away.
    """
    with contextlib.closing(SerialPort(port, baud)) as transport, on_port(port):
        timeout_s = answer_s(model.config, baud)
        result = play_all(transport, model, recordings, numbers, progress, timeout_s=timeout_s)
        return {"port": port, "baud": baud} | result


def play_all(
    transport: Transport,
    model: IntegerModel,
    recordings: Recordings,
    numbers: Sequence[int],
    progress: Progress,
    **options: Any,
) -> Record:
    """The same over any transport; ``options`` as for Link."""
    config = model.config
    (rows, offsets), frames, touches = _decided(model, recordings)
    verdict, decisions = Verdict(), 0
    link = Link(transport, register_map(config), **options)
    begin = time.monotonic()
    link.connect()
    link.load(boot_writes(config, model.arrays))
    for position, number in enumerate(numbers):
        before = int(recordings.offsets[position])

        def report(taken: int, before: int = before) -> None:
            progress(before + taken, recordings.frames)

        got = link.play(recordings.recording(position), report)
        low, high = offsets[position : position + 2]
        words = (got.status, got.faults, got.touches)
        compare_played(
            verdict,
            config,
            int(number),
            rows[low:high],
            frames[low:high],
            got.decisions,
            int(touches[position]),
            words,
        )
        decisions += len(got.decisions)
    wall_s = time.monotonic() - begin
    counts = {name: getattr(link, name) for name in ("repeated", "replayed", "unanswered", "damaged")}
    compared = {name: getattr(verdict, name) for name in ("compared_values", "mismatches", "bit_exact")}
    return counts | {
        "lanes": config.hardware.lanes,
        "recordings": len(recordings),
        "frames": recordings.frames,
        "decisions": decisions,
        **compared,
        "passed": verdict.bit_exact,
        "mismatch_list": [str(mismatch) for mismatch in verdict.first],
        "wall_s": round(wall_s, 3),
        "frames_per_s": round(recordings.frames / wall_s),
    }


def _decided(
    model: IntegerModel, recordings: Recordings
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray, np.ndarray]:
    """Of the integer model: stage ``decision`` (rows, offsets), the frame that brings each row, and the
    touches of each recording; an image is one, decided with its last row."""
    if model.config.is_image:
        decided = run_images(model, images_of(recordings)).streams["decision"]
        return (
            decided,
            np.full(len(decided[0]), model.config.image.height),
            np.ones(len(recordings), dtype=np.int64),
        )
    trace = run(model, recordings)
    return (
        trace.streams["decision"],
        completing_frames(trace),
        np.bincount(trace.touches.recording, minlength=len(recordings)),
    )
