"""Plays recordings through a source at their own pace, under the control of the viewers. Only `Player`
keeps time and counts.

The player's thread goes: frames to the source, events to the hub. Neither waits for a viewer.
"""

import contextlib
import math
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eskin.golden.core import AcceleratorConfig, Record
from eskin.golden.data import Recordings
from eskin.live.feed import Begin, Decided, Differs, End, Event, Frames, Hardware, Onset, Result, Tally
from eskin.live.hub import Hub
from eskin.live.sources import NO_SINCE, Listener, ModelSource, SensorSource

TICK_S = 1 / 30
"""Seconds of frames that are taken at a time."""
FASTEST_FRAMES = 512
"""A piece as fast as possible."""
BEHIND_S = 0.25
"""A source that is later than this is not hurried afterwards: what it missed stays missed, and is shown."""
TALLY_S = 0.25
LEVEL_FRAMES = 64
"""Frames at a recording's start that the eye takes its rest level from."""
SAID_MAX = 20


class Controls:
    """Requests of viewers; methods may be called from any thread.

    speed: of the sensor's pace, infinite as fast as possible. label: only recordings of this class, -1 all.
    skip: leave this recording. name: of the class whose touches are recorded, empty: none. undo: take back the last
    touch. stopped: come to an end.
    """

    def __init__(self) -> None:
        self._condition = threading.Condition()
        self.paused, self.speed, self.label, self.name = False, 1.0, -1, ""
        self.skip = self.undo = self.stopped = False

    def change(self, **changes: Any) -> None:
        """Set some of the attributes."""
        with self._condition:
            vars(self).update(changes)
            self._condition.notify_all()

    def stop(self) -> None:
        """Come to an end."""
        self.change(stopped=True)

    def left(self, label: int) -> bool:
        """True if a recording of this class is not to be played any further."""
        return self.skip or self.stopped or self.label not in (-1, label)

    def wait(self, seconds: float) -> None:
        """Wait for a time; a change may end it earlier."""
        with self._condition:
            self._condition.wait(seconds)


@dataclass
class Player:
    """Plays recordings, or listens to a board, in the thread that calls ``run``.

    Parameters
    ----------
    recordings:
        None with a SensorSource or Listener.
    numbers:
        Indices of those to play, in this order.

    Attributes
    ----------
    decisions: recording -> the model's decision, of those played to their end. error: what ended `run`.
    """

    source: ModelSource | Listener
    recordings: Recordings | None
    numbers: Sequence[int]
    hub: Hub
    controls: Controls
    tally: Tally = field(default_factory=Tally)
    decisions: dict[int, int] = field(default_factory=dict)
    error: BaseException | None = None

    def __post_init__(self) -> None:
        self._since, self._frames_then = time.monotonic(), 0
        self._ended, self._first_s = False, NO_SINCE

    def run(self) -> None:
        """Play until somebody stops it; after the last one wait to be asked for more. An exception is stored in ``error``."""
        try:
            with contextlib.closing(self.source):
                self._state()
                if isinstance(self.source, SensorSource | Listener):
                    self._listen(self.source)
                else:
                    self._play(self.source)
        except BaseException as error:
            self.error = error
        finally:
            try:
                self._tell(now=True)
                self._ended = True
                self._state()
            finally:
                self.controls.stop()

    # ------------------------------------------------------------ recordings
    def _play(self, source: ModelSource) -> None:
        assert self.recordings is not None
        while not self.controls.stopped:
            for number in self.numbers:  # of the class that is chosen when their turn comes
                if self.controls.label in (-1, int(self.recordings.labels[number])):
                    self._one(source, self.recordings, number)
                if self.controls.stopped:
                    return
            self._ended = True
            self._tell(now=True)
            self.controls.skip, label = False, self.controls.label
            while not self.controls.skip and not self.controls.stopped and self.controls.label == label:
                self._state()
                self.controls.wait(TALLY_S)
            self.controls.skip = self._ended = False

    def _one(self, source: ModelSource, recordings: Recordings, number: int) -> None:
        samples, label = recordings.recording(number), int(recordings.labels[number])
        length, controls, tally = len(samples), self.controls, self.tally
        wrong_before, self._first_s = tally.mismatches, NO_SINCE
        head = np.asarray(samples[: max(1, min(LEVEL_FRAMES, length // 8))])
        self.hub.publish(Begin(number, label, length, np.median(head, axis=0)))
        self._events(source.arm())
        at, due = 0, 0.0  # frames played, and frames beyond them whose time has come
        then = time.monotonic()
        while at < length and not controls.left(label):
            self._state()
            now, pace = time.monotonic(), recordings.sample_rate_hz * controls.speed
            passed, then = now - then, now
            if controls.paused:
                self.hub.flush()
                self._tell()
                controls.wait(TALLY_S)
                then = time.monotonic()
                continue
            count = FASTEST_FRAMES
            if math.isfinite(pace):
                due += passed * pace
                count = max(1, round(TICK_S * pace))
                if due < count:
                    controls.wait((count - due) / pace)
                    continue
                due -= count
                tally.behind_s = due / pace
                if tally.behind_s > BEHIND_S:  # too far behind to catch up: go on from now
                    due = 0.0
            part = np.asarray(samples[at : at + count])
            events = source.take(part)
            self.hub.publish(Frames(at + 1, part))
            self._events(events)
            at += len(part)
            tally.frames += len(part)
            self._tell()
        controls.skip = False
        whole = at >= length
        self._events(source.finish())
        self.hub.publish(End(source.decision, whole))
        if whole:
            self.decisions[number] = source.decision
            tally.recordings += 1
            tally.undecided += source.decision < 0
            tally.labelled += label >= 0
            tally.correct += 0 <= label == source.decision
            wrong = tally.mismatches - wrong_before
            self.hub.publish(Result(number, label, source.decision, self._first_s, wrong))
        self._tell()

    # ------------------------------------------------------------ a board by itself
    def _listen(self, source: SensorSource | Listener) -> None:
        self.hub.publish(Begin(-1, -1, 0, np.zeros(0)))
        while not self.controls.stopped:
            if isinstance(source, SensorSource):
                undo, self.controls.undo = self.controls.undo, False
                self._events(source.change(self.controls.name, undo))
            self._events(source.listen(TALLY_S))
            self._state()
            self._tell()

    # ------------------------------------------------------------ telling
    def _events(self, events: Sequence[Event]) -> None:
        for event in events:
            match event:
                case Onset():
                    self.tally.touches += 1
                case Hardware():
                    self.tally.compared += sum(len(stage.values) for stage in event.stages.values())
                    wrong = sum(len(stage.wrong) for stage in event.stages.values())
                    self.tally.mismatches += wrong
                    if wrong:
                        names = ", ".join(name for name, stage in event.stages.items() if stage.wrong)
                        where = "global decision" if event.closing else "step"
                        sentence = (
                            f"touch {event.touch}, {where} {event.step}: {wrong} values differ ({names})"
                        )
                        if self._say(sentence):  # viewers count the values themselves
                            self.hub.publish(Differs(sentence, mismatch=False))
                case Differs():
                    self.tally.mismatches += event.mismatch
                    self._say(event.sentence)
                case Frames():
                    self.tally.frames += len(event.samples)
                case Result():
                    self.tally.recordings += 1
                case Decided() if event.touch == 0:
                    self._first_s = event.since
            self.hub.publish(event)

    def _say(self, sentence: str) -> bool:
        """Keep a sentence for the end. False if the limit is reached."""
        if room := len(self.tally.sentences) < SAID_MAX:
            self.tally.sentences.append(sentence)
        return room

    def _state(self) -> None:
        controls = self.controls
        speed = controls.speed if math.isfinite(controls.speed) else 0
        shown = {"paused": controls.paused, "speed": speed, "label": controls.label, "ended": self._ended}
        self.hub.state(**shown, record=self.source.record)

    def _tell(self, *, now: bool = False) -> None:
        """Send the tally to the viewers, every TALLY_S at most, and set how much is thinned out."""
        passed = time.monotonic() - self._since
        if not now and passed < TALLY_S:
            return
        tally = self.tally
        if passed >= TALLY_S:
            tally.frames_per_s = (tally.frames - self._frames_then) / passed
            self._since, self._frames_then = time.monotonic(), tally.frames
            if tally.frames_per_s:
                self.hub.pace(tally.frames_per_s)
        self.hub.tally(tally)


def hello(
    config: AcceleratorConfig, recordings: Recordings | None, numbers: Sequence[int], **more: Any
) -> Record:
    """First message to a viewer, for JSON."""
    network, formats, every = config.network, config.formats, config.sensor.scan_every
    labels = recordings.labels[list(numbers)] if recordings is not None else np.zeros(0, dtype=np.int64)
    return {
        "name": config.name,
        "network": f"{network.cell.upper()} {network.hidden}" if config.recurrent else network.cell,
        "taxels": config.sensor.taxels,
        "masked": list(config.sensor.masked_taxels),
        "rate": config.sensor.sample_rate_hz,
        "classes": list(network.class_names),
        "steps": config.windows.steps,
        "spans": [[every * (first - 1) + 1, every * last] for first, last in config.window_spans],
        "follows": config.follows_touch,
        "decision": network.decision,
        "unit": {
            "feature": 2**formats.feature_format.frac_bits,
            "state": 2**formats.state_format.frac_bits,
            "logit": 2**formats.logit_format.frac_bits,
        },
        "data": "" if recordings is None else recordings.source,
        "recordings": len(numbers),
        "counts": np.bincount(labels, minlength=len(network.class_names)).tolist(),
        **more,
    }
