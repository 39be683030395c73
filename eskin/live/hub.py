"""From a source to any number of viewers: frames are thinned out, messages wait in bounded queues; what does
not fit is counted.

Nothing here waits for a viewer. The source's thread calls ``publish``; a viewer takes messages (JSON text)
when it can.
"""

import json
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from eskin.golden.core import Record
from eskin.live.feed import Begin, Differs, Event, Frames, Result, Tally

DISPLAY_HZ = 100.0
"""Display frames (buckets of frames) a second, at most: more than an eye sees and a screen has columns
for."""
VALUES_HZ = 3200.0
"""Taxel values a second that a viewer gets, at most: large arrays get fewer display frames."""
WAITING_FRAMES, WAITING_EVENTS = 240, 1500
"""Display frames and other messages that wait for one viewer."""
HISTORY, RESULTS = 900, 60
"""Messages of the present recording, and results of those before, that a viewer who comes later gets."""


class Thinner:
    """Frames to display frames: of each bucket of ``size`` frames its first frame, count, and per taxel
    least, greatest and last code.

    So a spike of one frame is seen however much is left out. Holds one bucket back; ``rest`` returns it.
    """

    def __init__(self, size: int) -> None:
        self.size, self._first = size, 0
        self._held = np.zeros((0, 0), dtype=np.int64)

    def add(self, first: int, samples: np.ndarray) -> list[list[Any]]:
        """The display frames that ``samples`` (n, taxels), frames ``first`` and following, complete."""
        if len(self._held):
            samples = np.concatenate([self._held, samples])
        else:
            self._first = first
        self._held = samples
        return [self._bucket(self.size) for _ in range(len(samples) // self.size)]

    def rest(self) -> list[list[Any]]:
        """The bucket that is not full yet, if there is anything in it."""
        return [self._bucket(len(self._held))] if len(self._held) else []

    def _bucket(self, count: int) -> list[Any]:
        first, part = self._first, self._held[:count]
        self._first, self._held = first + count, self._held[count:]
        return [first, count, *(values.tolist() for values in (part.min(axis=0), part.max(axis=0), part[-1]))]


class Viewer:
    """One viewer's queue. ``take`` gives what waits. dropped: display frames, lost: other messages that did
    not fit."""

    def __init__(self, wake: Callable[[], None]) -> None:
        self._waiting: deque[tuple[int, str]] = deque()
        self._frames = self._events = 0
        self._lock, self._wake = threading.Lock(), wake
        self.dropped = self.lost = 0

    def put(self, frames: int, text: str) -> None:
        """Queue a message of ``frames`` display frames (0: another message); the oldest of its kind makes
        room."""
        with self._lock:
            self._waiting.append((frames, text))
            self._frames, self._events = self._frames + frames, self._events + (not frames)
            while self._frames > WAITING_FRAMES:
                self.dropped += self._drop(True)
            while self._events > WAITING_EVENTS:
                self.lost += self._drop(False)
        self._wake()

    def _drop(self, display: bool) -> int:
        message = next(message for message in self._waiting if bool(message[0]) == display)
        self._waiting.remove(message)
        self._frames, self._events = self._frames - message[0], self._events - (not display)
        return message[0] or 1

    def take(self) -> list[str]:
        """Every message that waits, oldest first."""
        with self._lock:
            texts = [text for _, text in self._waiting]
            self._waiting.clear()
            self._frames = self._events = 0
        return texts


class Hub:
    """Thins out, keeps what a late viewer needs, and hands messages to every viewer.

    Parameters
    ----------
    hello:
        What a viewer must know first: see ``eskin.live.player.hello``.
    rate_hz:
        Frames a second of the sensor.
    taxels:
        Of a frame.
    """

    def __init__(self, hello: Record, rate_hz: float, taxels: int) -> None:
        self._hello = encoded("hello", **hello)
        self._display_hz = max(10.0, min(DISPLAY_HZ, VALUES_HZ / max(1, taxels)))
        self._thinner = Thinner(1)
        self.pace(rate_hz)
        self._viewers: list[Viewer] = []
        self._history: deque[str] = deque(maxlen=HISTORY)
        self._results: deque[str] = deque(maxlen=RESULTS)
        self._latest: dict[str, str] = {}  # state and tally, which late viewers get
        self._lock = threading.Lock()
        self._gone_dropped = 0

    def pace(self, frames_per_s: float) -> None:
        """Set the thinning for a source with this frame rate."""
        self._thinner.size = max(1, round(frames_per_s / self._display_hz))

    def attach(self, wake: Callable[[], None] = lambda: None) -> Viewer:
        """A new viewer, who has the present recording's beginning waiting; ``wake`` is called, from any
        thread, when something waits."""
        viewer = Viewer(wake)
        with self._lock:
            # the whole history, whatever the limits of a queue: they are for viewers who are too slow
            for text in (self._hello, *self._latest.values(), *self._results, *self._history):
                viewer.put(0, text)
            self._viewers.append(viewer)
        return viewer

    def detach(self, viewer: Viewer) -> None:
        """Forget a viewer; what he missed stays counted."""
        with self._lock:
            if viewer in self._viewers:
                self._viewers.remove(viewer)
                self._gone_dropped += viewer.dropped

    @property
    def viewers(self) -> int:
        """Number of viewers."""
        return len(self._viewers)

    @property
    def dropped(self) -> int:
        """Display frames that some viewer, present or gone, did not get."""
        return self._gone_dropped + sum(viewer.dropped for viewer in list(self._viewers))

    def state(self, **fields: Any) -> None:
        """Tell what the player is at; late viewers get the last of these."""
        self._tell("state", fields)

    def tally(self, tally: Tally) -> None:
        """Send the counts so far; late viewers get the last ones."""
        figures = vars(tally) | {
            "behind_s": round(tally.behind_s, 3),
            "frames_per_s": round(tally.frames_per_s),
            "dropped": self.dropped,
            "viewers": self.viewers,
        }
        del figures["said"]
        self._tell("tally", figures)

    def _tell(self, kind: str, fields: Record) -> None:
        text = encoded(kind, **fields)
        if text != self._latest.get(kind):
            self._latest[kind] = text
            self._send(0, text, keep=False)

    def publish(self, event: Event) -> None:
        """Hand on an event; frames that fill no bucket wait for the next ones, but no other event overtakes
        them."""
        if isinstance(event, Frames):
            self._frames(self._thinner.add(event.first, event.samples))
            return
        self.flush()
        kind = "said" if isinstance(event, Differs) else type(event).__name__.lower()
        text, is_result = encoded(kind, **vars(event)), isinstance(event, Result)
        with self._lock:
            if isinstance(event, Begin):
                self._history.clear()
            if is_result:
                self._results.append(text)
        self._send(0, text, keep=not is_result)

    def flush(self) -> None:
        """Hand on the frames that wait for their bucket to fill."""
        self._frames(self._thinner.rest())

    def _frames(self, buckets: list[list[Any]]) -> None:
        if buckets:
            self._send(len(buckets), encoded("frames", b=buckets))

    def _send(self, frames: int, text: str, *, keep: bool = True) -> None:
        with self._lock:
            if keep:
                self._history.append(text)
            for viewer in self._viewers:
                viewer.put(frames, text)


def encoded(kind: str, **fields: Any) -> str:
    """A message: JSON with ``k`` for its kind."""
    return json.dumps({"k": kind, **fields}, separators=(",", ":"), allow_nan=False, default=_plain)


def _plain(value: Any) -> Any:
    """Values of a numpy array or number, fields of a record."""
    return value.tolist() if hasattr(value, "tolist") else vars(value)
