"""From a source to any number of viewers: frames are thinned out, and the latest messages are kept for all
viewers.

Nothing here waits for a viewer. The source's thread calls ``publish``; a viewer takes messages (JSON text)
when it can. What was gone before is counted.
"""

import json
import threading
from collections import deque
from typing import Any

import numpy as np

from eskin.golden.core import Record
from eskin.live.feed import Begin, Differs, Event, Frames, Result, Tally

DISPLAY_HZ = 100.0
"""Display frames (buckets of frames) a second, at most: more than an eye sees and a screen has columns
for."""
VALUES_HZ = 3200.0
"""Taxel values a second that a viewer gets, at most: large arrays get fewer display frames."""
KEPT, RESULTS = 4000, 60
"""Messages that are kept, and results before the present recording that a later viewer gets."""


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


class Hub:
    """Thins out and keeps messages for every viewer.

    Parameters
    ----------
    hello:
        What a viewer must know first: see ``eskin.live.player.hello``.
    rate_hz:
        Frames a second of the sensor.
    taxels:
        Of a frame.

    Attributes
    ----------
    viewers: number of viewers.
    """

    def __init__(self, hello: Record, rate_hz: float, taxels: int) -> None:
        self._hello = encoded("hello", **hello)
        self._display_hz = max(10.0, min(DISPLAY_HZ, VALUES_HZ / max(1, taxels)))
        self._thinner = Thinner(1)
        self.pace(rate_hz)
        self.viewers = self._count = self._begun = 0  # messages so far, and those before this recording
        self._messages: deque[str] = deque(maxlen=KEPT)
        self._results: deque[tuple[int, str]] = deque(maxlen=RESULTS)
        self._latest: dict[str, str] = {}  # state and tally, which late viewers get
        self._lock = threading.Lock()

    def pace(self, frames_per_s: float) -> None:
        """Set the thinning for a source with this frame rate."""
        self._thinner.size = max(1, round(frames_per_s / self._display_hz))

    def since(self, number: int) -> tuple[int, list[str]]:
        """(Number of messages so far, those from ``number`` on that are kept)."""
        with self._lock:
            first = self._count - len(self._messages)
            return self._count, [*self._messages][max(0, number - first) :]

    def state(self, **fields: Any) -> None:
        """Tell what the player is at; late viewers get the last of these."""
        self._tell("state", fields)

    def tally(self, tally: Tally) -> None:
        """Send the counts so far; late viewers get the last ones."""
        figures = vars(tally) | {
            "behind_s": round(tally.behind_s, 3),
            "frames_per_s": round(tally.frames_per_s),
            "viewers": self.viewers,
        }
        del figures["sentences"]
        self._tell("tally", figures)

    def _tell(self, kind: str, fields: Record) -> None:
        text = encoded(kind, **fields)
        if text != self._latest.get(kind):
            self._latest[kind] = text
            self._send(text)

    def publish(self, event: Event) -> None:
        """Hand on an event; frames that fill no bucket wait for the next ones, but no other event overtakes
        them."""
        if isinstance(event, Frames):
            self._frames(self._thinner.add(event.first, event.samples))
            return
        self.flush()
        kind = "said" if isinstance(event, Differs) else type(event).__name__.lower()
        text = encoded(kind, **vars(event))
        if isinstance(event, Begin):
            self._begun = self._count
        elif isinstance(event, Result):
            self._results.append((self._count, text))
        self._send(text)

    def flush(self) -> None:
        """Hand on the frames that wait for their bucket to fill."""
        self._frames(self._thinner.rest())

    def _frames(self, buckets: list[list[Any]]) -> None:
        if buckets:
            self._send(encoded("frames", b=buckets))

    def _send(self, text: str) -> None:
        with self._lock:
            self._messages.append(text)
            self._count += 1

    def before(self) -> tuple[int, list[str]]:
        """For a late viewer: the number of the present recording's first message, and what comes before it."""
        with self._lock:
            results = [text for number, text in self._results if number < self._begun]
            return self._begun, [self._hello, *self._latest.values(), *results]


class Viewer:
    """One viewer's place among the messages of a hub. lost: messages that he did not get."""

    def __init__(self, hub: Hub) -> None:
        self._hub, self.lost = hub, 0
        self._next, self._first = hub.before()

    def take(self) -> list[str]:
        """Every message that waits, oldest first; at first the present recording from its beginning."""
        count, texts = self._hub.since(self._next)
        self.lost += count - self._next - len(texts)
        first, self._first, self._next = self._first, [], count
        return first + texts


def encoded(kind: str, **fields: Any) -> str:
    """A message: JSON with ``k`` for its kind."""
    return json.dumps({"k": kind, **fields}, separators=(",", ":"), allow_nan=False, default=_plain)


def _plain(value: Any) -> Any:
    """Values of a numpy array or number, fields of a record."""
    return value.tolist() if hasattr(value, "tolist") else vars(value)
